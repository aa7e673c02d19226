"""Machine code that is damaged or cannot be stored is compiled again, where numba alone would raise
an exception."""

import ast
import shutil

import pytest
from places import ROOT
from programs import install, python

from rattle.scene.compiled import SOURCES, TAKEN, source_digest

GAUSSIAN = (
    "from rattle.scene.moments import gaussian_raw_moments as f;print(float(f(1.0, 0.5, 2.0, 4)[2,"
    " 2]), sum(f.stats.cache_hits.values()) if hasattr(f, 'stats') else 1)"
)


def run(cwd=None, **environment):
    """Run the code in a process; returns its cache hits and standard error."""
    done = python("-c", GAUSSIAN, cwd=cwd, **environment)
    number, hits = done.stdout.split()
    assert float(number) == 2.5
    return int(hits), done.stderr


def computed(cache):
    """Cache hits of a process that keeps its machine code in a folder and prints nothing on
    standard error."""
    hits, said = run(NUMBA_CACHE_DIR=cache)
    assert said == ""
    return hits


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kept")
    assert computed(folder) == 0
    assert computed(folder) == 1
    return folder


@pytest.mark.parametrize("file", ["nbc", "nbi"])
def test_damaged_machine_code_is_compiled_again(kept, tmp_path, file):
    """Code or index; both are whole again afterwards."""
    folder = shutil.copytree(kept, tmp_path / "code")
    (path,) = folder.rglob(f"*gaussian*.{file}")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert computed(folder) == 0
    assert computed(folder) == 1


DECORATORS = {"inline", "internal", "jit", "lean", "splice"}


def test_the_digest_changes_with_every_source_of_compiled_code_and_with_no_other(tmp_path):
    plain = "closure/plain.py"
    texts = dict.fromkeys([*TAKEN, plain], "")
    texts["closure/deep/deeper/new.py"] = "from rattle.scene.compiled import jit\n"
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    seen = {source_digest(tmp_path)}
    for name, text in texts.items():
        (tmp_path / name).write_text(f"{text}# a comment\n")
        assert source_digest(tmp_path) in seen
        (tmp_path / name).write_text(f"{text}touched = 1\n")
        assert (source_digest(tmp_path) in seen) == (name == plain), name
        seen.add(source_digest(tmp_path))
    (tmp_path / name).rename(tmp_path / "closure" / "other.py")
    assert source_digest(tmp_path) not in seen


def imported(source):
    """Module, name there and name here of what a source imports from this project."""
    for node in ast.walk(source):
        if isinstance(node, ast.ImportFrom) and f"{node.module}".startswith("rattle."):
            for alias in node.names:
                yield node.module, alias.name, alias.asname or alias.name


def names(*nodes):
    return {part.id for node in nodes for part in ast.walk(node) if isinstance(part, ast.Name)}


def test_compiled_functions_take_nothing_from_sources_outside_the_digest():
    face = ast.parse((ROOT / "scene" / "__init__.py").read_text())
    home_of = {name: module for module, name, _ in imported(face)}
    for name in SOURCES:
        tree = ast.parse((ROOT / name).read_text())
        foreign = set()
        for module, taken, own in imported(tree):
            home = home_of.get(taken, module) if module == "rattle.scene" else module
            homes = {home, f"{module}.{taken}"}
            files = {of.removeprefix("rattle.").replace(".", "/") + ".py" for of in homes}
            if files.isdisjoint(SOURCES):
                foreign.add(own)
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and DECORATORS & names(*node.decorator_list):
                assert not foreign & names(*node.body), (name, node.name)


@pytest.fixture
def installed(tmp_path):
    """An installation that nobody can write, and an environment without a home."""
    place = tmp_path / "installed"
    install(place / "rattle")
    (place / "rattle" / "scene" / "__pycache__").touch()
    (tmp_path / "tmp").mkdir()
    return {
        "cwd": tmp_path,
        "PYTHONPATH": place,
        "HOME": "/dev/null",
        "TMPDIR": tmp_path / "tmp",
        "NUMBA_CACHE_DIR": None,
        "XDG_CACHE_HOME": None,
    }


def test_a_read_only_installation_without_a_home(installed, tmp_path):
    """A private temporary folder is used; the compiling process reports it, and the next one uses
    it again."""
    hits, said = run(**installed)
    (folder,) = (tmp_path / "tmp").iterdir()
    assert hits == 0
    assert said.count("\n") == 1
    assert said.endswith(f"cannot be written: machine code is kept in {folder}\n")
    assert folder.stat().st_mode & 0o777 == 0o700
    assert run(**installed) == (1, "")


def test_a_folder_that_was_open_to_others_is_made_anew(kept, tmp_path):
    """Others may have put files into it."""
    folder = shutil.copytree(kept, tmp_path / "code")
    (current,) = folder.iterdir()
    current.chmod(0o755)
    assert computed(folder) == 0
    assert current.stat().st_mode & 0o777 == 0o700
    assert computed(folder) == 1
