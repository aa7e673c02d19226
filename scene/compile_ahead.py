"""Other processes that compile, on the other cores, what this one will soon need.

They begin when this process first has to compile something, and end with it.  A function is
compiled by one of them, and whoever else needs it waits (`rattle.scene.compiled`).  Nothing depends
on them: where none can be started, or one dies, this process compiles for itself.
"""

import atexit
import multiprocessing
import os
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

COMPILERS = "RATTLE_COMPILERS"
"""Environment variable: the number of processes that compile, this one included; otherwise the
number of cores."""
HELPER_CODE = """
import sys
sys.path[:] = sys.argv[2:]
from rattle.compare.warm_up import help_parent
help_parent(sys.argv[1])
"""

_expected = "session"  # what is compiled ahead: a name in `rattle.compare.warm_up.NEEDS`
_asked: set[str] = set()  # for what processes were started
_started: list["subprocess.Popen[bytes]"] = []


def expect(command: str, orders: int = 1) -> None:
    """Announce what this process will do, for a drive of so many orders: other processes compile it
    ahead."""
    global _expected
    _expected = command if orders == 1 else f"{command}, several orders"


def count_processes() -> int:
    """How many processes may compile at the same time."""
    with suppress(ValueError):
        return int(os.environ.get(COMPILERS, ""))
    with suppress(AttributeError):  # not every system counts the cores of a process
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def may_start() -> bool:
    """Whether this process may start others: not one of several that share the work, nor what is no
    Python itself.

    A thread that is not the main one may be that of a server or of a Dask worker.
    """
    alone = multiprocessing.parent_process() is None and "PYTEST_XDIST_WORKER" not in os.environ
    main = threading.current_thread() is threading.main_thread()
    return alone and main and Path(sys.executable or "").name.startswith("python")


def start(kept: Path) -> None:
    """Start a process on every other core that compiles what is expected; `kept` is the folder of
    machine code."""
    busy = any(process.poll() is None for process in _started)
    if busy or _expected in _asked or not may_start():
        return
    _asked.add(_expected)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(kept.parent), COMPILERS: "1"}
    with suppress(Exception):  # whatever forbids it
        for _ in range(count_processes() - 1):
            process = subprocess.Popen(
                [sys.executable, "-c", HELPER_CODE, _expected, *map(str, sys.path)],
                env=environment,
                stdin=subprocess.PIPE,  # it ends when this is closed, however this process ends
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                process_group=0,  # Ctrl-C is for this process
            )
            _started.append(process)


@atexit.register
def stop() -> None:
    """Stop the processes that compile."""
    while _started:
        with suppress(OSError):
            _started[-1].kill()
        with _started.pop():  # closes the pipe, and waits
            pass
