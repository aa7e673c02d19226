"""What long work is doing, on standard error: a bar on a terminal or in a notebook, lines in a pipe
or a log.

A function that is asked for it shows a `ProgressBar`.  A command also says what it does where there
is no bar, and in a pipe how far its bars are (`speaking`).  A thread does so, since compiled code
and the compiler return only when they are done.  The same thread draws a line while numba compiles
in a Python session.
"""

import io
import logging
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from tqdm import tqdm

from rattle.scene.text import duration_text, harmless, line

QUIET = 1.5  # seconds without a word that nobody wonders about
BETWEEN = 15.0  # seconds between two lines of a log
LINE_TICK = 0.5  # seconds between two states of the line that a terminal shows
# seconds to wait for a thread that may be stuck where nobody reads what it says
THREAD_PATIENCE = 1.0
# of a terminal that does not say its size
TERMINAL_COLUMNS = 80
TERMINAL_ROWS = 24
COMPILING = "compiling for this processor, once, a minute or so in all"

ESTIMATES = logging.getLogger("rattle.estimate")
"""What work is expected to take is said here (level INFO) before it starts."""

_bars: list["ProgressBar"] = []  # those that are open, the innermost last
_status: "Bar | None" = None  # the line that a terminal shows where no bar does
_speaking = 0  # commands that say what they do
_doing = ""  # what is done where no bar says it
_began = 0.0  # when that began
_lock = threading.RLock()  # of all that is drawn


def has_terminal() -> bool:
    """Whether standard error is a terminal."""
    with suppress(AttributeError, ValueError):  # there is none, or it is closed
        return sys.stderr.isatty()
    return False


def shows_bars() -> bool:
    """Whether standard error is a terminal or the output of a notebook's cell, which show a line
    that changes."""
    notebook = sys.modules.get("ipykernel.iostream")
    return has_terminal() or (notebook is not None and isinstance(sys.stderr, notebook.OutStream))


class Bar(tqdm):  # type: ignore[type-arg]  # generic in its stubs only
    """A bar with a lock of this process alone: tqdm's own is shared with child processes, which may
    die holding it.

    It is drawn on a terminal without a size too, as in a container or under ``script``, where
    tqdm's own is invisible.
    """

    def __init__(self, *given: Any, **settings: Any) -> None:
        with suppress(OSError, ValueError, AttributeError):  # a notebook has no size
            columns, rows = os.get_terminal_size(sys.stderr.fileno())
            settings |= {"ncols": (columns or TERMINAL_COLUMNS) - 1, "nrows": rows or TERMINAL_ROWS}
        super().__init__(*given, **settings)


def _renew_lock() -> None:
    """Give bars a lock that nobody holds, as a thread of the parent may when a process is
    forked."""
    global _lock
    _lock = threading.RLock()
    Bar.set_lock(_lock)


_renew_lock()
os.register_at_fork(after_in_child=_renew_lock)


class ProgressBar(Bar):
    """A bar on a terminal or in a notebook, which elsewhere only counts: `describe` says how far it
    is.

    `label`: What is done; without one nothing is counted or shown.
    """

    def __init__(
        self, items: Iterable[Any] | None = None, label: str | None = None, **settings: Any
    ) -> None:
        self.label = line(label or "")
        self._shown = shows_bars()
        if not label:
            settings["disable"] = True
        elif not self._shown:
            settings |= {"disable": False, "file": io.StringIO()}
        with _lock:
            _hide_status()
            super().__init__(items, desc=self.label, **settings)
            if label:
                _bars.append(self)

    def display(self, *given: Any, **settings: Any) -> Any:
        """Draw the bar."""
        return self._shown and super().display(*given, **settings)

    def close(self) -> None:
        """Take the bar away, or leave it as it is at its end."""
        if self in _bars:
            _bars.remove(self)
        super().close()

    def describe(self) -> str:
        """How far it is and how long the rest may take, in words."""
        facts = self.format_dict
        done = facts["n"]
        total = facts["total"]
        elapsed = facts["elapsed"]
        unit = facts["unit"].strip()
        units = unit if unit.endswith("s") else f"{unit}s"
        text = f"{self.label}: {done:,.0f} {units}"
        if total is not None:
            text = f"{self.label}: {done:,.0f} of {total:,.0f} {units}"
        counted = done - facts["initial"]
        if total is not None and counted > 0 and done < total:
            text += f", about {duration_text(elapsed / counted * (total - done), 2)} left"
        elif elapsed >= QUIET:
            text += f", {duration_text(elapsed, 2)} so far"
        return f"{text} ({facts['postfix']})" if facts["postfix"] else text


def do(what: str) -> None:
    """State what is done from now on, for work that has no bar; a command says it if it takes
    long."""
    global _doing, _began
    _doing = what
    _began = time.monotonic()


def describe() -> str:
    """What is being done at the moment, and how far it is."""
    if compiler.depth:
        number = compiler.functions
        return (
            f"{COMPILING}: {number} function{'s' * (number != 1)} so far" if number else COMPILING
        )
    if _bars:
        return "; ".join(bar.describe() for bar in list(_bars))
    return f"{_doing}: {duration_text(time.monotonic() - _began, 2)} so far"


def is_drawn() -> bool:
    """Whether the last line of a terminal is a bar, or what is said in place of one."""
    return has_terminal() and (_status is not None or bool(_bars))


@contextmanager
def apart_from_bars() -> Iterator[None]:
    """Context in which something else is printed: bars are taken away before, and drawn again after
    it.

    What is said where no bar is comes back only if the work goes on: it would stand below an
    answer.  The lock is held from before it is taken away, for the thread would draw it again.
    """
    with _lock:
        _hide_status()
        with Bar.external_write_mode():
            yield


def print_on_stderr(text: str) -> None:
    """Print a line on standard error, where there is one: a daemon has none, or one that is
    closed."""
    with suppress(OSError, ValueError), apart_from_bars():
        if sys.stderr is not None:  # `print` would take standard output
            print(harmless(f"rattle: {text}"), file=sys.stderr, flush=True)


def _hide_status() -> None:
    """Take the line away that a terminal shows where no bar does."""
    global _status
    with _lock:
        if _status is not None:
            _status.close()
        _status = None


def _show_status() -> None:
    """Draw that line, or take it away where a bar says what is done; a bar shows how late it is."""
    global _status
    with _lock:
        for bar in _bars:
            bar.refresh()
        if _bars and not (compiler.depth and has_terminal()):  # a notebook has no place below a bar
            _hide_status()
            return
        text = line(describe())
        if _status is None:
            _status = Bar(desc=text, bar_format="{desc}", leave=False)
        _status.set_description_str(text)


class Speaker:
    """A thread that says what is done: where bars are shown in a line that changes, elsewhere in
    lines of a log.

    `after`: Seconds after which it begins.
    """

    def __init__(self, after: float) -> None:
        self._ended = threading.Event()
        self._thread = threading.Thread(
            target=self._speak, args=(after,), daemon=True, name="progress"
        )
        self._thread.start()

    def _speak(self, pause: float) -> None:
        while not self._ended.wait(pause):
            if shows_bars():
                pause = LINE_TICK
                _show_status()
            else:
                pause = BETWEEN
                print_on_stderr(describe())

    def stop(self) -> None:
        """Say nothing more, and leave nothing drawn."""
        self._ended.set()
        self._thread.join(THREAD_PATIENCE)
        _hide_status()


@contextmanager
def speaking(what: str) -> Iterator[None]:
    """Context of a command, which says what it is doing once it has taken `QUIET` seconds.

    `what`: What it does as a whole; `do` and bars say more.
    """
    global _speaking
    do(what)
    speaker = Speaker(QUIET)
    _speaking += 1
    try:
        yield
    finally:
        _speaking -= 1
        speaker.stop()
        for bar in reversed(_bars.copy()):  # of a loop that an error has left
            bar.close()


class Compiler:
    """The compiler at work: how many functions it has compiled in this process, and the line that
    says so.

    `depth`: Functions that are being compiled now, each for the one before. `functions`: Compiled
    so far, without those that are part of others. `processor_seconds`: Of this process, meanwhile.
    """

    def __init__(self) -> None:
        self.depth = 0
        self.functions = 0
        self._lock = threading.RLock()
        self.processor_seconds = 0.0
        self._seconds = 0.0
        self._began = 0.0
        self._began_processor = 0.0
        self._speaker: Speaker | None = None

    def begin(self) -> None:
        """A function is compiled from now on."""
        with self._lock:
            self.depth += 1
            if self.depth > 1:
                return
            self._began = time.monotonic()
            self._began_processor = time.process_time()
            alone = (
                multiprocessing.parent_process() is None and "PYTEST_CURRENT_TEST" not in os.environ
            )
            if alone and not _speaking and shows_bars():
                self._speaker = Speaker(max(QUIET - self._seconds, 0.0))

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Another process compiles a function, which this one waits for."""
        self.begin()
        try:
            yield
        finally:
            self.end(compiled=0)

    def end(self, compiled: int = 1) -> None:
        """A function is compiled, or cannot be; `compiled` is 0 where it was not this process."""
        with self._lock:
            self.depth -= 1
            if self.depth:
                return
            self.functions += compiled
            self._seconds += time.monotonic() - self._began
            self.processor_seconds += time.process_time() - self._began_processor
            speaker = self._speaker
            self._speaker = None
        if speaker is not None:
            speaker.stop()


compiler = Compiler()
"""`rattle.scene.compiled` tells it when a function is compiled."""
