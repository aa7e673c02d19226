"""Files that are no text files, or too large, are refused at once by every reader of TOML and JSON."""

import os
from pathlib import Path

import pytest

from rattle.compare.report.json_text import read_page
from rattle.compare.report.manifest import read_settings
from rattle.compare.study.design import Study
from rattle.compare.thresholds.fixture import read_baseline
from rattle.scene import FileError, Scene
from rattle.scene.files import LARGEST, LARGEST_JSON

READERS = {
    "scene file": Scene.load,
    "study file": Study.load,
    "baseline": read_baseline,
    "manifest": lambda path: read_settings(Path(path)),
    "page": lambda path: read_page(Path(path)),
}


@pytest.fixture(params=READERS)
def refusal(request):
    def of(path):
        with pytest.raises(FileError) as refused:
            READERS[request.param](path)
        assert str(refused.value).startswith(f"{request.param} = {str(path)!r}: ")
        return str(refused.value)

    return of


def test_a_sparse_file_is_too_large(refusal, tmp_path):
    path = tmp_path / "sparse.toml"
    with path.open("wb") as file:
        file.truncate(10_000_000_000)
    text = refusal(path)
    most = LARGEST_JSON if text.startswith(("manifest", "page")) else LARGEST
    assert f"is too large, 10,000,000,000 bytes where {most:,} are the most" in text


def test_pipes_and_devices_are_refused_and_not_waited_for(refusal, tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for path in (tmp_path / "pipe.toml", "/dev/zero"):
        assert "is a pipe or a device; give a" in refusal(path)


def test_the_largest_file_is_read(tmp_path):
    path = tmp_path / "long.toml"
    text = Scene(alpha=1.0, epsilon=0.5, beta1=0.1, gamma1=0.1, stages=1).to_toml()
    path.write_text(text + "#" * (LARGEST - len(text.encode())))
    assert path.stat().st_size == LARGEST
    assert Scene.load(path).alpha == 1.0
    path.write_bytes(text.replace("\n", "\r\n").encode())
    assert Scene.load(path).alpha == 1.0
