"""Ctrl-C (SIGINT) ends a command within about a second, whatever its threads or an import are doing."""

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

EXIT_INTERRUPTED = 130
NOTHING_WRITTEN = "interrupted; nothing was written"
LOST = "interrupted; unfinished work is lost, no file is half written"
GRACE = 1.2
"""Seconds from Ctrl-C to the end of the process: enough to finish running blocks of paths and to print one line."""
RETRY = 0.1  # seconds between two attempts to raise the interrupt while a module is imported; enough to print a line
LOSES_EXCEPTIONS = ("<frozen importlib._bootstrap>", "executionengine.py", "ffi.py")
"""Ends of the files of frames in which an exception goes astray: imports, the compiler's callbacks and destructors."""

said = threading.Event()
"""Set once the one line about the interrupt has been printed."""
unfinished: set[Path] = set()
"""Folders that are being written; removed if the process ends before they are complete."""


@contextmanager
def ends_at_once() -> Iterator[None]:
    """Context in which Ctrl-C ends the process immediately; for code that writes nothing, such as imports.

    A KeyboardInterrupt would not do here: an extension module that is interrupted while it is loaded raises an
    ImportError instead, and a traceback would be printed.
    """
    with _handling_interrupts(lambda number, frame: _end("interrupted")):
        yield


@contextmanager
def ends_soon() -> Iterator[None]:
    """Context in which Ctrl-C raises KeyboardInterrupt once; if it has no effect within `GRACE` seconds, exits.

    The exception is postponed until a running import, or a callback from the compiler, is complete.  Exiting is needed
    because an exception raised while a compiler or a destructor runs is swallowed there, and because a thread cannot be
    stopped from outside.  It is safe because results are written whole or not at all.
    """
    asked, raised = threading.Event(), threading.Event()

    def interrupted(number: int, frame: FrameType | None) -> None:
        if not asked.is_set():
            asked.set()
            _thread.start_new_thread(_interrupt_again, (raised,))  # a Thread takes locks that the main thread may hold
        if not raised.is_set() and not _loses_exceptions(frame):
            raised.set()
            raise KeyboardInterrupt

    said.clear()
    with _handling_interrupts(interrupted):
        yield
        if asked.is_set() and not raised.is_set():
            raised.set()
            raise KeyboardInterrupt("interrupted")


@contextmanager
def _handling_interrupts(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Context in which SIGINT calls a handler; without effect outside the main thread, which alone gets signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _loses_exceptions(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.endswith(LOSES_EXCEPTIONS):
            return True
        frame = frame.f_back
    return False


def _interrupt_again(raised: threading.Event) -> None:
    """Repeat the interrupt until it has been raised; end the process when the grace period is over."""
    end = time.monotonic() + GRACE
    while time.monotonic() < end and not raised.wait(RETRY):
        _thread.interrupt_main()
    time.sleep(max(end - time.monotonic(), 0.0))
    _end(LOST)


def _end(text: str) -> None:
    for folder in list(unfinished):
        shutil.rmtree(folder, ignore_errors=True)
    if said.is_set():
        time.sleep(RETRY)  # the main thread is printing its line
    else:
        os.write(2, f"rattle: {text}\n".encode())
    os._exit(EXIT_INTERRUPTED)
