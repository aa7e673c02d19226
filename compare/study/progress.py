"""Progress of a study: a line on the terminal, and a log file in its folder."""

import logging
import os
import sys
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import NoReturn, Self

from tqdm import tqdm

from rattle.compare.report.folder import describe_refusal
from rattle.compare.study.cells import Cell, Sample
from rattle.compare.study.store import Stored
from rattle.montecarlo.accuracy import sampling_error
from rattle.scene.text import line

LOG = "study.log"


class _LogFile(logging.FileHandler):
    """A log file; if it can no longer be written, the study continues without it."""

    def __init__(self, path: Path) -> None:
        try:
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o666))  # refuses a symbolic link
            super().__init__(path, encoding="utf-8")
        except OSError as error:
            raise describe_refusal(path, error) from None

    def handleError(self, record: logging.LogRecord) -> None:
        """Ignore errors here: a full disk is reported when a result cannot be stored."""


class Progress:
    """Counts finished cells and estimates the remaining time from what finished cells of the same kind took.

    `show`: Whether to draw the progress line if standard error is a terminal, and to print there which process is
    waited for and which cells fail.
    """

    def __init__(self, todo: Mapping[str, Cell], there: int, folder: Path, show: bool) -> None:
        self.there = there
        self._left = Counter(_kind(cell) for cell in todo.values())
        self._taken: dict[str, list[float]] = {}
        self._show = show
        self.worst, self.seconds, self.computed = 0.0, 0.0, 0
        self.started = time.perf_counter()
        self._log = logging.getLogger(f"rattle.study.{folder}")
        self._log.setLevel(logging.INFO)
        self._log.propagate = False
        self._file = _LogFile(folder / LOG)
        self._file.setFormatter(logging.Formatter("%(asctime)s %(process)d %(message)s"))
        self._bar: tqdm[NoReturn] = tqdm(
            total=there + len(todo),
            initial=there,
            desc="study",
            unit="cell",
            disable=None if show else True,
            bar_format="{desc} {n}/{total} cells |{bar:20}| {elapsed}{postfix}",
        )

    def __enter__(self) -> Self:
        self._log.addHandler(self._file)
        self.say(f"start: {self.there} results stored, {self._left.total()} to compute")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._bar.close()
        self.say("end" if error is None else f"ended by {kind.__name__ if kind else ''}: {error}")
        self._log.removeHandler(self._file)
        self._file.close()

    @property
    def seconds_left(self) -> float:
        """Expected seconds to the end; infinite before the first cell is finished."""
        if not self._taken:
            return float("inf")
        means = {kind: sum(taken) / len(taken) for kind, taken in self._taken.items()}
        other = sum(means.values()) / len(means)
        left = sum(count * means.get(kind, other) for kind, count in self._left.items())
        passed = time.perf_counter() - self.started
        return passed * left / max(sum(map(sum, self._taken.values())), 1e-9)

    def say(self, text: str) -> None:
        """Write a line to the log."""
        self._log.info(line(text))

    def waits(self, text: str) -> None:
        """Report that another process is waited for."""
        self.say(text)
        if self._show:
            self._bar.write(text, file=sys.stderr)

    def begin(self, cell: Cell) -> None:
        """Show the cell whose computation begins."""
        self._draw(cell.label)

    def finish(self, cell: Cell, found: Stored, here: bool) -> None:
        """Count a finished cell."""
        text = f"{'done' if here else 'found'} {cell.label} {cell.key}: {found.facts['seconds']:.2f} s"
        if isinstance(cell, Sample):
            error, where = sampling_error(cell.restore(found))
            self.worst = max(self.worst, error)
            text += f", largest se {error:.2g} sd ({where})"
        self.computed += here
        self._taken.setdefault(_kind(cell), []).append(found.facts["seconds"])
        self.seconds += found.facts["seconds"] if here else 0.0
        self._count(cell, text)

    def fail(self, cell: Cell, why: str) -> None:
        """Count and report a cell that cannot be computed."""
        if self._show:
            self._bar.write(f"rattle: {why}", file=sys.stderr)  # at once: the other cells may take hours
        self._count(cell, f"failed {cell.label} {cell.key}: {why}")

    def _count(self, cell: Cell, text: str) -> None:
        self.say(text)
        self._left[_kind(cell)] -= 1
        self._bar.update(1)
        self._draw(cell.label)

    def _draw(self, label: str) -> None:
        if self._bar.disable:
            return
        done = self._bar.n - self.there
        rate = done / max(time.perf_counter() - self.started, 1e-9)
        left = tqdm.format_interval(self.seconds_left) if self._taken else "?"
        self._bar.set_postfix_str(f"{left} left, {rate:.2g} cells/s, {label}, largest se {self.worst:.2g} sd")


def _kind(cell: Cell) -> str:
    """Cells of one closure, or simulations."""
    return str(getattr(cell, "closure", type(cell).__name__))
