"""Machine code that is damaged or cannot be stored is compiled again, where numba alone would raise an exception."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from small_disks import disk

from rattle.scene.machine_code import PACKAGES, TAKEN, Sealed, source_digest

ROOT = Path(__file__).resolve().parents[2]
CODE = (
    "from rattle.scene.moments import gaussian_raw_moments as f;"
    "print(float(f(1.0, 0.5, 2.0, 4)[2, 2]), sum(f.stats.cache_hits.values()) if hasattr(f, 'stats') else 1)"
)
DAMAGE = {
    "truncated": lambda b: b[: len(b) // 2],
    "flipped": lambda b: b[: len(b) // 2] + bytes([b[len(b) // 2] ^ 255]) + b[len(b) // 2 + 1 :],
    "foreign": lambda b: b"not what numba wrote",
}


def run(code=CODE, cwd=None, **environment):
    """Run code in a process; returns its cache hits and standard error.  None unsets an environment variable."""
    changed = {name: str(value) for name, value in environment.items() if value is not None}
    kept = {name: value for name, value in os.environ.items() if name not in environment}
    done = subprocess.run([sys.executable, "-c", code], env=kept | changed, cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    number, hits = done.stdout.split()
    assert float(number) == 2.5
    return int(hits), done.stderr


def computed(cache):
    """Cache hits of a process that keeps its machine code in a folder and prints nothing on standard error."""
    hits, said = run(NUMBA_CACHE_DIR=cache)
    assert said == ""
    return hits


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kept")
    assert computed(folder) == 0
    assert computed(folder) == 1
    return folder


# --- damage


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_machine_code_is_compiled_again(kept, tmp_path, kind, damage):
    folder = shutil.copytree(kept, tmp_path / "code")
    (path,) = folder.rglob(f"*gaussian*.{kind}")
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    assert computed(folder) == 0


def test_no_flipped_bit_of_an_index_is_read(tmp_path):
    """Numba unpickles its index: every single bit of it counts."""
    file = Sealed(str(tmp_path), "f", b"the sources")
    file.save(("signature", ("x86_64", "some processor", "+avx2"), ("code", "closure")), {"machine": "code"})
    index = file._load_index()
    assert len(index) == 1
    path = tmp_path / "f.nbi"
    content = path.read_bytes()
    for bit in range(8 * len(content)):
        at, mask = bit // 8, 1 << bit % 8
        path.write_bytes(content[:at] + bytes([content[at] ^ mask]) + content[at + 1 :])
        assert file._load_index() == {}, bit
    path.write_bytes(content)
    assert file._load_index() == index


def test_without_room_it_is_compiled_every_time(tmp_path):
    with disk(tmp_path / "disk", "8k") as place:
        assert computed(place) == 0
        assert not list(place.rglob("*.nbc"))


def test_a_folder_that_is_swept_away_in_use_breaks_nothing(kept, tmp_path):
    """As another version of the sources removes it: functions not loaded yet are compiled, and stored if possible."""
    before = "import numba, pathlib, shutil; import rattle.scene.{}; folder = rattle.scene.machine_code.folder(); {};"
    folder = shutil.copytree(kept, tmp_path / "code")
    for module in ("compiled", "moments"):  # before numba has made a folder for the function, and after that
        assert run(before.format(module, "shutil.rmtree(folder)") + CODE, NUMBA_CACHE_DIR=folder) == (0, "")
    assert computed(folder) == 1
    in_the_way = "shutil.rmtree(folder); folder.write_text('')"
    assert run(before.format("moments", in_the_way) + CODE, NUMBA_CACHE_DIR=folder) == (0, "")


def test_a_changed_environment_does_not_end_the_cache(tmp_path):
    """Numba reads all its variables again when it compiles and one of them has changed; a user's code is the user's."""
    changed = (
        "import os, numba; import rattle.scene.moments; os.environ['NUMBA_WARNINGS'] = '0';"
        "numba.njit(lambda: 1)(); assert not numba.config.CACHE_DIR;"
    )
    root = Path(
        shutil.copytree(
            ROOT, tmp_path / "sources", ignore=shutil.ignore_patterns(".*", "__pycache__", "reports", "docs")
        )
    )
    hits = [run(changed + CODE, cwd=root, NUMBA_CACHE_DIR=None, PYTHONPATH=root)[0] for _ in range(2)]
    assert hits == [0, 1]


# --- sources


DECORATORS = {"inlined", "jit", "lean", "spliced"}


def test_the_digest_changes_with_every_source_of_compiled_code_and_with_no_other(tmp_path):
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    nested = tmp_path / "closure" / "deep" / "deeper" / "new.py"
    seen = {source_digest(tmp_path)}
    nested.parent.mkdir(parents=True)
    nested.write_text("from rattle.scene.compiled import jit\n")
    seen.add(source_digest(tmp_path))
    sources = sorted(tmp_path.rglob("*.py"))
    compiled = {path for path in sources if imports(path, "rattle.scene.compiled")}
    compiled |= {tmp_path / name for name in TAKEN}
    assert 50 < len(compiled) < len(sources) - 30
    for path in sources:
        with path.open("a") as file:
            file.write("# touched\n")
        before = len(seen)
        seen.add(source_digest(tmp_path))
        assert len(seen) == before + (path in compiled), path
    nested.rename(nested.with_name("other.py"))
    assert source_digest(tmp_path) not in seen


def imports(path, module):
    return any(
        isinstance(node, ast.ImportFrom) and node.module == module for node in ast.walk(ast.parse(path.read_text()))
    )


def test_compiled_functions_take_nothing_from_sources_outside_the_digest():
    sources = {path.relative_to(ROOT).as_posix(): path for name in PACKAGES for path in (ROOT / name).rglob("*.py")}
    inside = {name for name, path in sources.items() if imports(path, "rattle.scene.compiled")} | {*TAKEN}
    for name in inside:
        tree = ast.parse(sources[name].read_text())
        foreign = {
            alias.asname or alias.name: node.module
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rattle.")
            if node.module.removeprefix("rattle.").replace(".", "/") + ".py" not in inside
            for alias in node.names
        }
        for function in ast.walk(tree):
            if isinstance(function, ast.FunctionDef) and DECORATORS & names(*function.decorator_list):
                assert not foreign.keys() & names(*function.body), (name, function.name)


def names(*nodes):
    return {part.id for node in nodes for part in ast.walk(node) if isinstance(part, ast.Name)}


def test_only_the_folders_of_earlier_sources_are_removed(kept, tmp_path):
    folder = shutil.copytree(kept, tmp_path / "code")
    (current,) = folder.iterdir()
    _, user, installation, _ = current.name.split("-")
    earlier, others = (
        folder / f"rattle-{user}-{installation}-0123",
        [folder / "numba", folder / f"rattle-{user}-ab-0123"],
    )
    for place in (earlier, *others):
        place.mkdir()
    assert computed(folder) == 1
    assert sorted(folder.iterdir()) == sorted([current, *others])


# --- where nothing can be written: files stand where folders would be, which stops a privileged process too


@pytest.fixture
def installed(tmp_path):
    """An installation that nobody can write, and an environment without a home."""
    place = tmp_path / "installed"
    shutil.copytree(ROOT / "scene", place / "rattle" / "scene", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "rattle" / "__init__.py", place / "rattle")
    (place / "rattle" / "scene" / "__pycache__").touch()
    (tmp_path / "tmp").mkdir()
    return {
        "cwd": tmp_path, "PYTHONPATH": place, "HOME": "/dev/null", "TMPDIR": tmp_path / "tmp",
        "NUMBA_CACHE_DIR": None, "XDG_CACHE_HOME": None,
    }  # fmt: skip


def test_a_read_only_installation_without_a_home(installed, tmp_path):
    """A private temporary folder is used; the compiling process reports it, and the next one uses it again."""
    hits, said = run(**installed)
    (folder,) = (tmp_path / "tmp").iterdir()
    assert hits == 0
    assert said.count("\n") == 1
    assert said.endswith(f"cannot be written: machine code is kept in {folder}\n")
    assert folder.stat().st_mode & 0o777 == 0o700
    assert run(**installed) == (1, "")


def test_a_home_is_better(installed, tmp_path):
    hits, said = run(**installed | {"HOME": tmp_path / "home"})
    (folder,) = (tmp_path / "home" / ".cache").iterdir()
    assert hits == 0
    assert said.endswith(f"machine code is kept in {folder}\n")
    assert not list((tmp_path / "tmp").iterdir())


def test_a_place_that_is_asked_for_and_cannot_be_written(installed, tmp_path):
    (tmp_path / "file").touch()
    hits, said = run(**installed | {"NUMBA_CACHE_DIR": tmp_path / "file" / "cache"})
    assert hits == 0
    assert said.startswith(f"rattle: {tmp_path / 'file' / 'cache'} cannot be written: machine code is kept in ")
    assert said.count("\n") == 1


def link_elsewhere(folder):
    elsewhere = folder.parent.parent / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    folder.symlink_to(elsewhere)


NOT_OURS = {
    "a link": link_elsewhere,
    "a file": lambda folder: folder.touch(),
}


@pytest.mark.parametrize("kind", NOT_OURS)
def test_a_temporary_folder_that_is_not_ours_alone_is_not_used(installed, tmp_path, kind):
    """Somebody else could have made a folder of that name; then machine code is not kept."""
    run(**installed)
    (folder,) = (tmp_path / "tmp").iterdir()
    shutil.rmtree(folder)
    NOT_OURS[kind](folder)
    hits, said = run(**installed)
    assert hits == 0
    assert "machine code is kept in" in said
    assert str(folder) not in said
    assert [*(tmp_path / "tmp").iterdir()] == [folder]
    assert not [p for p in tmp_path.rglob("*.nbi") if p.is_relative_to(tmp_path / "elsewhere") or folder in p.parents]


def test_a_folder_that_was_open_to_others_is_made_anew(kept, tmp_path):
    """Others may have put files into it."""
    folder = shutil.copytree(kept, tmp_path / "code")
    (current,) = folder.iterdir()
    current.chmod(0o755)
    assert computed(folder) == 0
    assert current.stat().st_mode & 0o777 == 0o700
    assert computed(folder) == 1


def test_nowhere_at_all(installed, tmp_path):
    """Then machine code is not kept, and the command works nevertheless."""
    code = f"import tempfile; tempfile._candidate_tempdir_list = lambda: ['/dev/null'];{CODE}"
    hits, said = run(code, **installed)
    assert hits in (0, 1)
    assert said.endswith("cannot be written: machine code is not kept\n")


# --- what compiled code calls, and Python too

BOTH = (
    "import numpy as np; from rattle.scene.small_matrices import {};"
    "from rattle.scene.machine_code import count_compiled; a = np.array([[1.0, 2.0], [0.0, 1.0]]);"
    "assert {}.tolist() == [[9.0, 4.0], [2.0, 1.0]]; print(2.5, count_compiled())"
)  # fmt: skip
CALLER, CALLED = BOTH.format("congruence", "congruence(a, a)"), BOTH.format("times", "times(times(a, a), a.T)")


def test_a_function_is_called_by_kept_machine_code_and_by_python(tmp_path):
    """Its caller is kept without what Python needs to call it, in whichever order the two are compiled and read."""
    together = CALLER.split("print")[0] + CALLED
    assert run(together, NUMBA_CACHE_DIR=tmp_path)[0] > 0
    for code in (together, CALLED, CALLER, CALLED.split("print")[0] + CALLER):
        assert run(code, NUMBA_CACHE_DIR=tmp_path)[0] == 0
