"""Ctrl-C (SIGINT) ends a command within about a second, whatever its threads or an import do; so
does a budget."""

import _thread
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from traceback import walk_stack
from types import FrameType

from rattle.scene.errors import BudgetEnded
from rattle.scene.progress import is_drawn

EXIT_INTERRUPTED = 130
NOTHING_WRITTEN = "interrupted; nothing was written"
GRACE = 1.2
"""Seconds from Ctrl-C to the end of the process: enough to finish running blocks of paths and to
print one line."""
LOSES_EXCEPTIONS = ("<frozen importlib._bootstrap>", "executionengine.py", "ffi.py")
"""Ends of the files of frames in which an exception goes astray: imports, the compiler's callbacks
and destructors."""

stored: list[Callable[[], str]] = []
"""What a command says, at its end, of what it has stored when it is interrupted; empty where that
is nothing."""
said = threading.Event()
"""Set once the one line about the interrupt has been printed."""


@contextmanager
def ends_soon() -> Iterator[None]:
    """Context in which Ctrl-C raises KeyboardInterrupt, and ends the process `GRACE` seconds later
    at the latest.

    It ends at once where an exception would be lost; the threads of a simulation cannot be stopped
    otherwise.  That is safe because results are written whole or not at all.
    """
    if threading.current_thread() is not threading.main_thread():  # which alone gets signals
        yield
        return
    asked = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        if asked.is_set():  # a second Ctrl-C does not stop the cleaning up
            return
        asked.set()
        if any(part.f_code.co_filename.endswith(LOSES_EXCEPTIONS) for part, _ in walk_stack(frame)):
            _end(0.0)
        # a Thread takes locks that the main thread may hold
        _thread.start_new_thread(_end, (GRACE,))
        raise KeyboardInterrupt

    said.clear()
    stored.clear()
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def stop_after(seconds: float) -> Iterator[None]:
    """Context that raises `BudgetEnded` after so many seconds by the clock; without effect in other
    threads."""
    if seconds == math.inf or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise BudgetEnded

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, max(seconds, 1e-3))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def describe_interrupt() -> str:
    """What an interrupted command says."""
    return f"interrupted; {stored[-1]()}" if stored else NOTHING_WRITTEN


def _end(seconds: float) -> None:
    time.sleep(seconds)
    if said.is_set():
        time.sleep(0.1)  # the main thread is printing its line
    else:
        lost = "interrupted; unfinished work is lost, no file is half written"
        start = "\n" if is_drawn() else ""
        os.write(
            2,
            f"{start}rattle: {describe_interrupt() if stored else lost}\n".encode(errors="replace"),
        )
    os._exit(EXIT_INTERRUPTED)
