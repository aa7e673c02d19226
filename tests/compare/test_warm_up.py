"""Tasks that compile: each is run by one process, and again where machine code is missing."""

import shutil
from functools import partial

import pytest
from filelock import FileLock
from needs import COMPILED
from programs import python

from rattle.compare.warm_up import DoneTasks, compile_tasks, measure_times
from rattle.scene import compile_ahead, compiled


@pytest.fixture
def kept(tmp_path):
    return DoneTasks(tmp_path, "this processor")


@pytest.fixture
def ran():
    return []


@pytest.fixture
def three(ran):
    return {name: partial(ran.append, name) for name in "abc"}


def test_tasks_are_done_once_for_each_kind_of_processor(kept, three, ran, tmp_path):
    assert list(compile_tasks(three, kept)) == ["a", "b", "c"]
    list(compile_tasks(three, kept, 1.0))
    assert ran == ["a", "b", "c"]
    list(compile_tasks(three, DoneTasks(tmp_path, "another processor")))
    assert ran == ["a", "b", "c"] * 2


def test_a_task_of_another_process_is_left_to_it_until_it_takes_too_long(kept, three, ran):
    with FileLock(kept.mark("a").with_suffix(".lock")):
        list(compile_tasks(three, kept))
        assert ran == ["b", "c"]
        list(compile_tasks(three, kept, 0.05))
    assert ran == ["b", "c", "a"]


def test_tasks_are_run_where_nothing_can_be_noted(kept, three, ran, monkeypatch):
    def refuse(*words, **settings):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(FileLock, "acquire", refuse)
    monkeypatch.setattr("pathlib.Path.touch", refuse)
    list(compile_tasks(three, kept, 1.0))
    assert ran == ["a", "b", "c"]


@COMPILED
def test_times_are_those_of_each_functions_own_work():
    @compiled.internal
    def inner(x):
        return x + 1

    @compiled.jit
    def outer(x):
        return inner(x) + inner(x + 1.0)

    table = measure_times({"": lambda: outer(1)})
    of_outer = table.loc[f"{__name__}.{outer.py_func.__qualname__}"]
    assert of_outer["signatures"] == 1
    assert table["signatures"][f"{__name__}.{inner.__qualname__}"] == 2
    assert (of_outer[["typing", "LLVM"]] > 0.0).all()


@COMPILED
def test_no_other_process_compiles_while_times_are_measured(monkeypatch):
    started = []
    monkeypatch.setattr(compile_ahead, "start", started.append)

    def add_one(x):
        return x + 1

    add_one.__module__ = "rattle.of_this_test"
    compiled_function = compiled.jit(add_one)
    measure_times({"": lambda: compiled_function(1)})
    assert not started
    compiled_function(1.0)
    assert started


SESSION = """
import sys, time
from pathlib import Path
import rattle as rt
from rattle.scene import compile_ahead
from rattle.scene.compiled import folder
from rattle.scene.progress import compiler
rt.mean_map(rt.Scene.from_gears(rt.DAT21, sigma=0.01), impacts=2, closure="saltation")
for process in compile_ahead._started:
    process.wait()
print(len(compile_ahead._started), compiler.functions, len(list(folder().rglob("*.nbc"))))
"""


@pytest.mark.slow
@COMPILED
def test_another_process_compiles_what_a_session_will_need(tmp_path):
    """The folder is that of these tests, but for two functions: what is there is not compiled
    again."""
    place = tmp_path / compiled.folder().name
    # what a session needs at once, and what it will need
    missing = shutil.ignore_patterns("orbit.fly*", "central_sums._block_sums*", "task-*")
    shutil.copytree(compiled.folder(), place, ignore=missing)
    there = len(list(place.rglob("*.nbc")))
    environment = {compile_ahead.COMPILERS: 2, "NUMBA_CACHE_DIR": tmp_path}
    done = [python("-c", SESSION, PYTEST_XDIST_WORKER=None, **environment) for _ in range(2)]
    started, own, every = map(int, done[0].stdout.split())
    assert started == 1
    assert 0 < own < every - there
    assert list(place.rglob("central_sums._block_sums*.nbc"))
    assert done[1].stdout.split() == ["0", "0", str(every)]
    assert done[0].stderr == done[1].stderr == ""
