"""Ctrl-C ends a command soon, whatever its threads are doing."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["EXIT_INTERRUPTED", "NOTHING_WRITTEN", "ends_soon"]

EXIT_INTERRUPTED = 130
NOTHING_WRITTEN = "interrupted; nothing was written"
PATIENCE = 1.2
"""Seconds from Ctrl-C to the end: long enough for the blocks of paths in flight, and for a word of farewell."""


@contextmanager
def ends_soon() -> Iterator[None]:
    """Within the block Ctrl-C raises KeyboardInterrupt, and ends the process where that is not heard in time.

    An interrupt that arrives while a compiler or a destructor runs is swallowed there, and a thread cannot be told to
    stop.  Results are written whole or not at all, so the process may end at any moment.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupted(number: int, frame: FrameType | None) -> None:
        timer = threading.Timer(PATIENCE, _end)
        timer.daemon = True
        timer.start()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupted)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _end() -> None:
    os.write(2, b"rattle: interrupted; what was in flight is lost, nothing is half written\n")
    os._exit(EXIT_INTERRUPTED)
