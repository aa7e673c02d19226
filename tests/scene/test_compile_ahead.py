"""Processes that share the compiling: each function by one of them, and none depends on another."""

import os
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from types import SimpleNamespace

import numba
import pytest
from filelock import FileLock
from programs import python

from rattle.scene import compile_ahead, compiled

COMPILED = pytest.mark.skipif(
    bool(getattr(numba.config, "DISABLE_JIT", False)), reason="the compiler is off"
)


@compiled.jit
def doubled(x):
    """A function that can be compiled for numbers alone."""
    return 2 * x


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The machine code of `doubled` in a folder of its own, and how it is asked for."""
    tmp_path.chmod(0o700)
    monkeypatch.setattr(compile_ahead, "start", lambda place: None)
    function = numba.njit(**compiled.OPTIONS)(doubled.py_func)
    function._cache = compiled.Kept(function.py_func, function.targetoptions)
    function._cache.cache_path = str(tmp_path)
    return function


@pytest.fixture
def started(monkeypatch):
    """The commands of the processes that are started, without starting any."""
    commands = []

    def note(command, **settings):
        commands.append(command)
        return SimpleNamespace(poll=lambda: 0)

    monkeypatch.setattr(subprocess, "Popen", note)
    monkeypatch.setattr(compile_ahead, "_asked", set())
    monkeypatch.setattr(compile_ahead, "_started", [])
    monkeypatch.setenv(compile_ahead.COMPILERS, "3")
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    monkeypatch.setattr("multiprocessing.parent_process", lambda: None)
    monkeypatch.setattr(threading, "current_thread", threading.main_thread)
    yield commands
    compile_ahead._started.clear()


@COMPILED
def test_who_waits_for_another_takes_what_it_has_compiled(kept, tmp_path, monkeypatch):
    """Another process holds the lock, and writes the machine code while this one waits."""
    assert kept(3) == 6
    (code,) = tmp_path.glob("*.nbc")
    made = code.read_bytes()
    code.unlink()
    lock = FileLock(code.with_suffix(".lock"))
    waits = []

    @contextmanager
    def wait():
        waits.append(code)
        code.write_bytes(made)
        lock.release()
        yield

    monkeypatch.setattr(compiled, "compiling", wait)
    again = numba.njit(**compiled.OPTIONS)(doubled.py_func)
    again._cache = kept._cache
    before = compiled.count_compiled()
    lock.acquire()
    assert again(3) == 6
    assert waits == [code]
    assert compiled.count_compiled() == before


@COMPILED
def test_locks_are_released_whether_a_function_can_be_compiled_or_not(kept, tmp_path):
    with pytest.raises(numba.TypingError):
        kept({"no": "number"})
    with pytest.raises(numba.TypingError):
        kept(None)
    assert kept(3) == 6
    assert not kept._cache._locks
    for path in tmp_path.glob("*.lock"):
        FileLock(path).acquire(timeout=0.0)


@COMPILED
@pytest.mark.parametrize(
    "fault", [PermissionError, NotImplementedError, OSError(28, "No space left on device")]
)
def test_without_locks_every_process_compiles(kept, monkeypatch, fault):
    def refuse(*words, **settings):
        raise fault

    monkeypatch.setattr(FileLock, "acquire", refuse)
    assert kept(3) == 6


def test_a_process_is_started_on_every_other_core_once_for_each_command(started, tmp_path):
    compile_ahead.expect("stationary")
    compile_ahead.start(tmp_path)
    compile_ahead.start(tmp_path)
    assert [command[3] for command in started] == ["stationary"] * 2
    compile_ahead.expect("validate", orders=3)
    compile_ahead.start(tmp_path)
    assert started[-1][3] == "validate, several orders"


@pytest.mark.parametrize(
    ("what", "value"),
    [
        ("sys.executable", ""),
        ("sys.executable", None),
        ("sys.executable", "/opt/cad/bin/viewer"),
        ("multiprocessing.parent_process", lambda: "a pool"),
        ("threading.current_thread", lambda: "a server's"),
    ],
)
def test_none_is_started_where_that_is_not_allowed_or_makes_no_sense(
    started, monkeypatch, tmp_path, what, value
):
    monkeypatch.setattr(what, value)
    compile_ahead.start(tmp_path)
    assert not started


@pytest.mark.parametrize(
    ("name", "value"), [(compile_ahead.COMPILERS, "1"), ("PYTEST_XDIST_WORKER", "gw0")]
)
def test_none_is_started_where_the_environment_says_so(started, monkeypatch, tmp_path, name, value):
    monkeypatch.setenv(name, value)
    compile_ahead.start(tmp_path)
    assert not started


@pytest.mark.parametrize(
    "fault", [OSError(11, "Resource temporarily unavailable"), RuntimeError("audit")]
)
def test_where_no_process_can_be_started_nothing_is_said(
    started, monkeypatch, tmp_path, capfd, fault
):
    def refuse(*words, **settings):
        raise fault

    monkeypatch.setattr(subprocess, "Popen", refuse)
    compile_ahead.start(tmp_path)
    assert capfd.readouterr() == ("", "")


SLEEPER = """
import sys, time
from rattle.scene import compile_ahead
compile_ahead.HELPER_CODE = "import os, time; print(os.getpid(), flush=True)" + {then!r}
compile_ahead.subprocess.DEVNULL = None
from pathlib import Path
compile_ahead.start(Path("kept"))
time.sleep({alive})
"""


def is_running(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{process}/stat") as file:
        return file.read().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(
    not os.path.exists("/proc/self/stat"), reason="processes are looked up in /proc"
)
@pytest.mark.parametrize("end", [None, signal.SIGKILL])
def test_what_was_started_ends_with_this_process(end):
    """By itself or killed."""
    then = "\nfrom rattle.compare.warm_up import _end_with_parent\n_end_with_parent()"
    code = SLEEPER.format(then=then, alive=60 if end else 0.5)
    environment = os.environ | {
        compile_ahead.COMPILERS: "2",
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    environment.pop("PYTEST_XDIST_WORKER", None)
    with subprocess.Popen(
        [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE
    ) as parent:
        child = int(parent.stdout.readline())
        if end:
            parent.send_signal(end)
        parent.wait(timeout=60)
        parent.stdout.read()  # its end: nobody else has it open
    assert not is_running(child)


KILLED = """
import os, signal
from numba.core import event
from rattle.scene.moments import gaussian_raw_moments as f
class Killer(event.Listener):
    def on_start(self, event): os.kill(os.getpid(), signal.SIGKILL)
    def on_end(self, event): pass
event.register("numba:compile", Killer())
f(1.0, 0.5, 2.0, 4)
"""
COUNTED = """
from rattle.scene.moments import gaussian_raw_moments as f
from rattle.scene.compiled import count_compiled
print(float(f(1.0, 0.5, 2.0, 4)[2, 2]), count_compiled())
"""


@pytest.mark.slow
@COMPILED
def test_a_process_that_is_killed_while_it_compiles_costs_its_part_alone(tmp_path):
    python("-c", KILLED, NUMBA_CACHE_DIR=str(tmp_path), code=-signal.SIGKILL)
    assert list(tmp_path.rglob("*.lock"))
    assert python("-c", COUNTED, NUMBA_CACHE_DIR=str(tmp_path)).stdout.split() == ["2.5", "1"]
    assert not list(tmp_path.rglob("*.lock"))
