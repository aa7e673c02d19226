"""Sources that are edited while a process runs: nothing is kept of others than those that it began
with."""

import shutil

import pytest
from commands import study
from places import ROOT
from programs import install, python
from studies import Sample, Store

from rattle import Study
from rattle.compare.engine.store import numerical_version
from rattle.compare.report.provenance import provenance
from rattle.scene import OutputError, sources

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
from rattle.scene.progress import compiler
inner = Path(compiled.__file__).with_name("inner.py")
right = inner.read_text()
wrong = right.replace("2.0", "3.0")
"""
CALL = """
from rattle.scene.outer import outer
print(outer(5.0), compiler.functions)
"""
EDIT = "inner.write_text(wrong)\n"
REVERT = "inner.write_text(right)\n"
COMMENT = "inner.write_text(right + '# a comment')\n"
SAME_TIME = "times = os.stat(inner)\n{}os.utime(inner, ns=(times.st_atime_ns, times.st_mtime_ns))\n"


@pytest.fixture
def run(tmp_path):
    """A function that runs code with a small installation of its own; returns what it prints, and
    on standard error."""
    place = tmp_path / "installed" / "rattle"
    install(place)
    (place / "scene" / "inner.py").write_text(INNER)
    (place / "scene" / "outer.py").write_text(OUTER)
    environment = {"PYTHONPATH": str(place.parent), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    def run_code(code, bytecode=False):
        kept = {"PYTHONDONTWRITEBYTECODE": "" if bytecode else "1"}
        done = python("-c", BEGIN + code, cwd=tmp_path, **environment, **kept)
        return done.stdout.split(), done.stderr

    return run_code


EDITED = "scene/inner.py was edited while this process ran"


EDITS = {
    "taken back after it was compiled": EDIT + CALL + REVERT,
    "taken back before it is compiled": f"{EDIT}import rattle.scene.inner\n{REVERT}{CALL}",
    "after what was imported": f"import rattle.scene.outer\n{EDIT}{CALL}{REVERT}",
}


@pytest.mark.parametrize("name", EDITS)
def test_machine_code_of_an_edit_is_not_kept(run, name):
    printed, said = run(EDITS[name])
    assert printed == ["11.0" if name.startswith("after") else "16.0", "1"]
    assert said.count("\n") == 1
    assert EDITED in said
    assert run(CALL) == (["11.0", "1"], "")


def test_machine_code_of_bytecode_that_python_takes_for_that_of_another_source_is_not_kept(run):
    """Both sources have one size and one time, to the second."""
    run(
        SAME_TIME.format(EDIT) + "import rattle.scene.inner\n" + SAME_TIME.format(REVERT),
        bytecode=True,
    )
    printed, said = run(CALL)
    assert printed == ["16.0", "1"]
    assert "Python has bytecode of another source for scene/inner.py" in said
    run("inner.touch()\n")
    assert run(CALL) == (["11.0", "1"], "")


def test_a_process_that_has_imported_an_edit_takes_no_machine_code_of_the_source_before(run):
    assert run(CALL)[0] == ["11.0", "1"]
    assert run(EDIT + CALL + REVERT)[0] == ["16.0", "1"]
    assert run(CALL)[0] == ["11.0", "0"]


def test_a_comment_changes_nothing(run):
    assert run("import rattle.scene.outer\n" + COMMENT + CALL) == (["11.0", "1"], "")
    assert run(CALL) == (["11.0", "0"], "")


CALL_CLOSURES = """
from rattle.scene.outer import make, outer
numbers = [make(1.5)(2.0), make(2.5)(2.0), make(2.5)(2), outer(2.0)]
print(*numbers, compiler.functions)
"""


def test_closures_of_one_function_and_types_are_told_apart(run):
    right = ["3.0", "5.0", "5.0", "5.0"]
    assert run(CALL_CLOSURES) == ([*right, "4"], "")
    assert run(CALL_CLOSURES) == ([*right, "0"], "")


@pytest.fixture
def edit(tmp_path, monkeypatch):
    """A function that writes something behind a source of this process: of a copy that it takes for
    its own."""
    sources.note_imports()
    for name in sources.BEGUN:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    monkeypatch.setattr(sources, "ROOT", tmp_path)

    def append(name):
        with (tmp_path / name).open("a") as file:
            file.write("touched = 1\n")

    return append


REMEDY = (
    "montecarlo/kernel/kernel.py was edited while this process ran, so no result is stored; start"
    " it again"
)


def test_no_result_is_stored_under_the_version_of_sources_that_this_process_has_not_imported(
    edit, tmp_path
):
    (sample,) = (cell for cell in Study.from_toml(study()).cells if isinstance(cell, Sample))
    store = Store(tmp_path / "cells")
    version = numerical_version()
    edit("closure/branching/mixture.py")  # of no part in the result
    store.obtain(sample)
    store.path(sample).unlink()
    edit("montecarlo/kernel/kernel.py")
    with pytest.raises(OutputError, match=REMEDY):
        store.obtain(sample)
    with pytest.raises(OutputError, match=REMEDY):  # it was edited while the result was computed
        store.write(sample, None)
    assert not store.path(sample).exists()
    numerical_version.cache_clear()
    assert numerical_version() == version


def test_no_manifest_names_a_commit_whose_sources_this_process_has_not_imported(edit):
    assert provenance()["commit"]
    edit("compare/report/style.py")
    said = r"compare/report/style\.py was edited while this process ran"
    with pytest.raises(OutputError, match=said):
        provenance()
