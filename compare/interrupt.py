"""Ctrl-C ends a command soon, whatever its threads are doing and whatever is being imported."""

import _thread
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

__all__ = ["EXIT_INTERRUPTED", "NOTHING_WRITTEN", "ends_at_once", "ends_soon", "said", "unfinished"]

EXIT_INTERRUPTED = 130
NOTHING_WRITTEN = "interrupted; nothing was written"
LOST = "interrupted; what was in flight is lost, nothing is half written"
PATIENCE = 1.2
"""Seconds from Ctrl-C to the end: long enough for the blocks of paths in flight, and for a word of farewell."""
LOOK = 0.02  # seconds between two interrupts while something is imported
IMPORTING = "<frozen importlib._bootstrap>"  # in whose frames every import runs

said = threading.Event()
"""Whether the one line about the interrupt has been said."""
unfinished: set[Path] = set()
"""Folders that are being written; they go with a process that ends before they are whole."""


@contextmanager
def ends_at_once() -> Iterator[None]:
    """Within the block Ctrl-C ends the process: for the time in which nothing is written, and nothing catches it.

    An extension that meets a KeyboardInterrupt while it is loaded makes an ImportError of it, and so a trace.
    """
    with _heard_by(lambda number, frame: _end("interrupted")):
        yield


@contextmanager
def ends_soon() -> Iterator[None]:
    """Within the block Ctrl-C raises KeyboardInterrupt, once, and ends the process where that is not heard in time.

    It is put off until what is being imported is there.  An interrupt that arrives while a compiler or a destructor
    runs is swallowed there, and a thread cannot be told to stop.  Results are written whole or not at all, so the
    process may end at any moment.
    """
    asked, raised = threading.Event(), threading.Event()

    def interrupted(number: int, frame: FrameType | None) -> None:
        if not asked.is_set():
            asked.set()
            _thread.start_new_thread(_insist, (raised,))  # a Thread takes locks that the main thread may hold
        if not raised.is_set() and not _importing(frame):
            raised.set()
            raise KeyboardInterrupt

    said.clear()
    with _heard_by(interrupted):
        yield
        if asked.is_set() and not raised.is_set():
            raised.set()
            raise KeyboardInterrupt("interrupted")


@contextmanager
def _heard_by(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Within the block Ctrl-C calls a handler; nothing is done in a thread that never hears of it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            return True
        frame = frame.f_back
    return False


def _insist(raised: threading.Event) -> None:
    """Interrupt again until it can be raised; then, the process had its time."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and not raised.wait(LOOK):
        _thread.interrupt_main()
    time.sleep(max(end - time.monotonic(), 0.0))
    _end(LOST)


def _end(text: str) -> None:
    for folder in list(unfinished):
        shutil.rmtree(folder, ignore_errors=True)
    if not said.is_set():
        os.write(2, f"rattle: {text}\n".encode())
    os._exit(EXIT_INTERRUPTED)
