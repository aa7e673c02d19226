"""Processes that share the compiling, and none depends on another."""

import os
import signal
import subprocess
import threading
from types import SimpleNamespace

import pytest
from needs import COMPILED
from programs import install, python, start

from rattle.scene import compile_ahead, compiled


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A function whose machine code is kept in a folder of its own."""
    tmp_path.chmod(0o700)
    monkeypatch.setattr(compile_ahead, "start", lambda place: None)
    monkeypatch.setattr(compiled, "_folder", tmp_path)

    @compiled.jit
    def doubled(x):
        return 2 * x

    return doubled


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


WRITE_FAULTS = [PermissionError, NotImplementedError, OSError(28, "No space left on device")]


@COMPILED
@pytest.mark.parametrize(
    "place", ["filelock.FileLock.acquire", "tempfile.TemporaryFile", "os.replace"]
)
@pytest.mark.parametrize("fault", WRITE_FAULTS)
def test_where_nothing_can_be_kept_every_process_compiles(kept, monkeypatch, place, fault):
    """No lock, a read-only folder, a full disk."""

    def refuse(*words, **settings):
        raise fault

    monkeypatch.setattr(place, refuse)
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
        (compile_ahead.COMPILERS, "1"),
        ("PYTEST_XDIST_WORKER", "gw0"),
    ],
)
def test_none_is_started_where_that_is_not_allowed_or_makes_no_sense(
    started, monkeypatch, tmp_path, what, value
):
    if "." in what:
        monkeypatch.setattr(what, value)
    else:
        monkeypatch.setenv(what, value)
    compile_ahead.start(tmp_path)
    assert not started


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
    environment = {compile_ahead.COMPILERS: 2, "PYTEST_XDIST_WORKER": None}
    with start("-c", code, **environment) as parent:
        child = int(parent.stdout.readline())
        if end:
            parent.send_signal(end)
        parent.wait(timeout=60)
        parent.stdout.read()  # its end: nobody else has it open
    assert not is_running(child)


SUSPENDED_WRITING = """
import os, signal
from rattle.scene.moments import gaussian_raw_moments as f
rename = os.replace
def suspend(old, new):
    os.replace = rename
    os.kill(os.getpid(), signal.SIGSTOP)
    rename(old, new)
os.replace = suspend
f(1.0, 0.5, 2.0, 4)
"""
COUNTED = """
from rattle.scene.moments import gaussian_raw_moments as f
from rattle.scene.progress import compiler
print("asks for it", flush=True)
print(float(f(1.0, 0.5, 2.0, 4)[2, 2]), compiler.functions)
"""
WITHOUT_LOCKS = """
import filelock
def refuse(*words, **settings):
    raise NotImplementedError
filelock.FileLock.acquire = refuse
"""


@pytest.mark.slow
@COMPILED
@pytest.mark.parametrize(
    ("end", "compiled"), [(signal.SIGCONT, "0"), (signal.SIGKILL, "1"), (None, "1")]
)
def test_a_function_that_another_process_compiles_is_waited_for(tmp_path, end, compiled):
    """One that is killed costs its part alone; without locks it is compiled twice."""
    kept = {"NUMBA_CACHE_DIR": str(tmp_path)}
    with start("-c", SUSPENDED_WRITING, **kept) as other:
        stopped = os.waitid(os.P_PID, other.pid, os.WEXITED | os.WSTOPPED | os.WNOWAIT)
        assert stopped.si_code == os.CLD_STOPPED
        with start("-c", COUNTED if end else WITHOUT_LOCKS + COUNTED, **kept) as asking:
            assert asking.stdout.readline() == "asks for it\n"
            if end:
                other.send_signal(end)
            assert asking.stdout.read().split() == ["2.5", compiled]
        other.send_signal(signal.SIGCONT)
    assert python("-c", COUNTED, **kept).stdout.split()[-2:] == ["2.5", "0"]


TYPES = """
import numpy as np
from rattle.scene.compiled import jit

@jit
def sum_of(x):
    return x.sum()

def sums():
    for name in KINDS:
        assert sum_of(np.arange(3, dtype=name)) == 3
"""
BOTH = """
import sys
from rattle.scene import types_of_sums
from rattle.scene.progress import compiler
types_of_sums.KINDS = sys.argv[1:]
types_of_sums.sums()
print(compiler.functions)
"""
NUMBER_TYPES = ["int16", "int32", "int64", "float32", "float64", "complex128"]


@pytest.mark.slow
@COMPILED
def test_processes_that_compile_one_function_for_different_types_at_once_keep_all(tmp_path):
    """Numba's index has room for each, whoever writes it last."""
    place = tmp_path / "installed" / "rattle"
    install(place)
    (place / "scene" / "types_of_sums.py").write_text(TYPES)
    environment = {"NUMBA_CACHE_DIR": tmp_path / "kept", "PYTHONPATH": place.parent}
    processes = [
        start("-c", BOTH, *part, **environment) for part in (NUMBER_TYPES[:3], NUMBER_TYPES[3:])
    ]
    for process in processes:
        _, said = process.communicate()
        assert process.returncode == 0, said
    assert python("-c", BOTH, *NUMBER_TYPES, **environment).stdout == "0\n"
