"""Machine code that is damaged, or for which there is no room, is compiled again; numba alone would end in a trace."""

import os
import shutil
import subprocess
import sys

import pytest
from small_disks import disk

CODE = (
    "from scene.moments import gaussian_raw_moments as f;"
    "print(float(f(1.0, 0.5, 2.0, 4)[2, 2]), sum(f.stats.cache_hits.values()) if hasattr(f, 'stats') else 1)"
)
DAMAGE = {
    "truncated": lambda b: b[: len(b) // 2],
    "flipped": lambda b: b[: len(b) // 2] + bytes([b[len(b) // 2] ^ 255]) + b[len(b) // 2 + 1 :],
    "foreign": lambda b: b"not what numba wrote",
}


def computed(cache):
    """What a process prints that keeps its machine code in a folder: the number, and how much it had not to compile."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    number, hits = done.stdout.split()
    assert float(number) == 2.5
    return int(hits)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kept")
    assert computed(folder) == 0
    assert computed(folder) == 1
    return folder


@pytest.mark.parametrize(
    ("kind", "damage"), [("nbi", "truncated"), ("nbi", "foreign"), ("nbc", "flipped"), ("nbc", "truncated")]
)
def test_damaged_machine_code_is_compiled_again(kept, tmp_path, kind, damage):
    folder = shutil.copytree(kept, tmp_path / "code")
    (path,) = folder.rglob(f"*gaussian*.{kind}")
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    assert computed(folder) == 0


def test_without_room_it_is_compiled_every_time(tmp_path):
    with disk(tmp_path / "disk", "8k") as place:
        assert computed(place) == 0
        assert not list(place.rglob("*.nbc"))
