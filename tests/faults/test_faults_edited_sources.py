"""Sources that are edited while a process runs: nothing is kept of others than those that it began with."""

import shutil
from pathlib import Path

import pytest
from programs import python

ROOT = Path(__file__).resolve().parents[2]
INNER = """from rattle.scene.compiled import internal


@internal
def inner(x):
    return 2.0 * x
"""
OUTER = """from rattle.scene.compiled import jit, lean
from rattle.scene.inner import inner


@jit
def outer(x):
    return inner(x) + 1.0


def make(number):
    @lean
    def scaled(x):
        return number * x

    return scaled
"""
BEGIN = """
import os
from pathlib import Path
from rattle.scene import compiled
inner = Path(compiled.__file__).with_name("inner.py")
right = inner.read_text()
wrong = right.replace("2.0", "3.0")
"""
CALL = """
from rattle.scene.outer import outer
print(outer(5.0), compiled.count_compiled())
"""
EDIT, REVERT = "inner.write_text(wrong)\n", "inner.write_text(right)\n"
COMMENT = "inner.write_text(right + '# a comment')\n"
SAME_TIME = "times = os.stat(inner)\n{}os.utime(inner, ns=(times.st_atime_ns, times.st_mtime_ns))\n"


@pytest.fixture
def run(tmp_path):
    """A function that runs code with a small installation of its own; returns what it prints, and on standard error."""
    place = tmp_path / "installed" / "rattle"
    shutil.copytree(ROOT / "scene", place / "scene", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "rattle" / "__init__.py", place)
    (place / "scene" / "inner.py").write_text(INNER)
    (place / "scene" / "outer.py").write_text(OUTER)
    environment = {"PYTHONPATH": str(place.parent), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    def run_code(code, bytecode=False):
        kept = {"PYTHONDONTWRITEBYTECODE": "" if bytecode else "1"}
        done = python("-c", BEGIN + code, cwd=tmp_path, **environment, **kept)
        return done.stdout.split(), done.stderr

    return run_code


EDITED = "scene/inner.py was edited while this process ran"


def test_machine_code_of_an_edit_is_not_kept(run):
    """Of one that is imported late, and taken back after it was compiled."""
    printed, said = run(EDIT + CALL + REVERT)
    assert printed == ["16.0", "1"]
    assert said.count("\n") == 1
    assert EDITED in said
    assert run(CALL) == (["11.0", "1"], "")


@pytest.mark.slow
def test_machine_code_of_an_edit_that_is_taken_back_before_it_is_compiled_is_not_kept(run):
    printed, said = run(EDIT + "import rattle.scene.inner\n" + REVERT + CALL)
    assert printed == ["16.0", "1"]
    assert EDITED in said
    assert run(CALL) == (["11.0", "1"], "")


@pytest.mark.slow
def test_machine_code_is_not_kept_after_an_edit_of_what_was_imported(run):
    printed, said = run("import rattle.scene.outer\n" + EDIT + CALL + REVERT)
    assert printed == ["11.0", "1"]
    assert EDITED in said
    assert run(CALL) == (["11.0", "1"], "")


@pytest.mark.slow
def test_machine_code_of_bytecode_that_python_takes_for_that_of_another_source_is_not_kept(run):
    """Both sources have one size and one time, to the second."""
    run(SAME_TIME.format(EDIT) + "import rattle.scene.inner\n" + SAME_TIME.format(REVERT), bytecode=True)
    printed, said = run(CALL)
    assert printed == ["16.0", "1"]
    assert "Python has bytecode of another source for scene/inner.py" in said
    run("inner.touch()\n")
    assert run(CALL) == (["11.0", "1"], "")


@pytest.mark.slow
def test_a_process_that_has_imported_an_edit_takes_no_machine_code_of_the_source_before(run):
    assert run(CALL)[0] == ["11.0", "1"]
    assert run(EDIT + CALL + REVERT)[0] == ["16.0", "1"]
    assert run(CALL)[0] == ["11.0", "0"]


@pytest.mark.slow
def test_a_comment_changes_nothing(run):
    assert run("import rattle.scene.outer\n" + COMMENT + CALL) == (["11.0", "1"], "")
    assert run(CALL) == (["11.0", "0"], "")


EXCHANGED = """
from rattle.scene.outer import make, outer
numbers = [make(1.5)(2.0), make(2.5)(2.0), make(2.5)(2), outer(2.0)]
print(*numbers, compiled.count_compiled())
"""


def test_machine_code_under_the_name_of_another_is_compiled_again(run, tmp_path):
    """Of another function, another closure of the same function, other types."""
    right = ["3.0", "5.0", "5.0", "5.0"]
    assert run(EXCHANGED)[0] == [*right, "4"]
    files = sorted((tmp_path / "kept").rglob("*.nbc"))
    contents = [file.read_bytes() for file in files]
    assert len(files) == 4
    for file, content in zip(files, contents[1:] + contents[:1], strict=True):
        file.write_bytes(content)
    assert run(EXCHANGED) == ([*right, "4"], "")
    assert run(EXCHANGED) == ([*right, "0"], "")
