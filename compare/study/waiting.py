"""Waiting for what another process is at work on, and saying for whom."""

import os
import platform
import re
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock, SoftFileLock

from rattle.scene.text import harmless

if TYPE_CHECKING:  # cells know the store, and the store signs its locks
    from rattle.compare.study.cells import Cell

__all__ = ["Waiting", "aloud", "holder", "sign"]

PAUSE = 0.2  # seconds between two looks at what another process is working on
SILENCE = 1.0  # seconds of waiting before it is said for whom
SAFELY = os.O_NOFOLLOW | os.O_NONBLOCK  # whatever lies there in a folder that is shared
NOTE = re.compile(r"(\d+)\n([\w.-]+)\n", re.ASCII)  # what is shown of it is harmless on any terminal


def sign(lock: FileLock) -> None:
    """Leave process and host in a lock that is held, for those who wait; where locks are files they say so already."""
    if not isinstance(lock, SoftFileLock):
        with suppress(OSError):  # a courtesy
            number = os.open(lock.lock_file, os.O_WRONLY | os.O_TRUNC | SAFELY)
            with os.fdopen(number, "w", encoding="ascii", errors="replace") as file:
                file.write(f"{os.getpid()}\n{platform.node()}\n")


def holder(lock: Path) -> tuple[str, str]:
    """Who holds a lock, as far as it says, and since when.

    Examples
    --------
    >>> holder(Path("nowhere"))
    ('another process', '')
    """
    try:
        number = os.open(lock, os.O_RDONLY | SAFELY)
        with os.fdopen(number, encoding="ascii", errors="replace") as file:
            found, since = NOTE.match(file.read(1000)), os.fstat(number).st_mtime
    except OSError:
        found = None
    if found is None:
        return "another process", ""
    return f"process {found[1]} on {found[2]}", f" since {time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(since))}"


def aloud(text: str) -> None:
    """A line on standard error."""
    print(harmless(text), file=sys.stderr, flush=True)


class Waiting:
    """Pauses between looks at cells that others are at work on; after about a second it is said who, of each once.

    Parameters
    ----------
    lock : callable
        The lock of a key.
    say : callable
        Says a line.
    """

    def __init__(self, lock: Callable[[str], Path], say: Callable[[str], object] = aloud) -> None:
        self._lock, self._say = lock, say
        self._began: dict[str, float] = {}
        self._said: set[str] = set()

    def pause(self, cells: "Iterable[Cell]") -> None:
        """Wait for a moment."""
        for cell in cells:
            if time.monotonic() - self._began.setdefault(cell.key, time.monotonic()) < SILENCE:
                continue
            who, since = holder(self._lock(cell.key))
            if who not in self._said:
                self._said.add(who)
                self._say(f"rattle: waiting for {who}, at work on {cell.label}{since}; when it ends, this one goes on")
        time.sleep(PAUSE)
