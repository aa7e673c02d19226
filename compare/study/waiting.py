"""Waits for a cell that another process is computing, and reports which process that is."""

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

PAUSE = 0.2  # seconds between two checks whether another process has finished
SILENCE = 1.0  # seconds of waiting before the process is named
SAFELY = os.O_NOFOLLOW | os.O_NONBLOCK  # in a shared folder the lock file may be a link or a pipe
NOTE = re.compile(r"(\d+)\n([\w.-]+)\n", re.ASCII)  # process id and host; these characters are safe on any terminal


def sign(lock: FileLock) -> None:
    """Write process id and host into a held lock file, for processes that wait."""
    if not isinstance(lock, SoftFileLock):
        with suppress(OSError):  # not essential
            number = os.open(lock.lock_file, os.O_WRONLY | os.O_TRUNC | SAFELY)
            with os.fdopen(number, "w", encoding="ascii", errors="replace") as file:
                file.write(f"{os.getpid()}\n{platform.node()}\n")


def holder(lock: Path) -> tuple[str, str]:
    """Read which process holds a lock, and since when.

    Returns: As parts of a sentence; ``another process`` and an empty string if the file does not say.

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


def print_on_stderr(text: str) -> None:
    """Print a line on standard error."""
    print(harmless(text), file=sys.stderr, flush=True)


class Waiting:
    """Pauses while other processes compute cells; after about a second each of them is named once."""

    def __init__(self, lock: Callable[[str], Path], say: Callable[[str], object] = print_on_stderr) -> None:
        self._lock, self._say = lock, say
        self._began: dict[str, float] = {}
        self._said: set[str] = set()

    def pause(self, cells: "Iterable[Cell]") -> None:
        """Wait for 0.2 s, and name the processes that compute these cells if they have taken long."""
        for cell in cells:
            if time.monotonic() - self._began.setdefault(cell.key, time.monotonic()) < SILENCE:
                continue
            who, since = holder(self._lock(cell.key))
            if who not in self._said:
                self._said.add(who)
                self._say(f"rattle: waiting for {who}, at work on {cell.label}{since}; continues when it finishes")
        time.sleep(PAUSE)
