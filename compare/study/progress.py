"""Progress of a study: a line on the terminal, and a log file in its folder."""

import os
import sys
import time
from collections import Counter
from collections.abc import Collection
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self

from tqdm import tqdm

from rattle.compare.report.folder import describe_refusal
from rattle.compare.study.cells import Sampled
from rattle.compare.study.store import Cell
from rattle.montecarlo.diagnostics.accuracy import sampling_error
from rattle.scene.text import line

LOG = "study.log"


class ProgressLine:
    """Counts finished cells and estimates the remaining time from what finished cells of the same group took.

    `show`: Whether to draw the progress line if standard error is a terminal, and to print there which process is
    waited for and which cells fail.
    """

    def __init__(self, todo: Collection[Cell], stored: int, folder: Path, show: bool) -> None:
        self.worst, self.seconds, self.computed = 0.0, 0.0, 0
        self._stored, self._show = stored, show
        self._left = Counter(cell.group for cell in todo)
        self._taken: dict[str, list[float]] = {}  # seconds of the finished cells of each group
        self._started = time.perf_counter()
        try:
            number = os.open(folder / LOG, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o666)
            self._file = os.fdopen(number, "a", encoding="utf-8", buffering=1)
        except OSError as error:
            raise describe_refusal(folder / LOG, error) from None
        self._bar: tqdm[NoReturn] = tqdm(
            total=stored + len(todo),
            initial=stored,
            desc="study",
            unit="cell",
            disable=None if show else True,
            bar_format="{desc} {n}/{total} cells |{bar:20}| {elapsed}{postfix}",
        )

    def __enter__(self) -> Self:
        self.log(f"start: {self._stored} results stored, {self._left.total()} to compute")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._bar.close()
        self.log("end" if error is None else f"ended by {kind.__name__ if kind else ''}: {error}")
        with suppress(OSError):
            self._file.close()

    @property
    def seconds_left(self) -> float:
        """Expected seconds to the end; infinite before the first cell is finished."""
        if not self._taken:
            return float("inf")
        means = {group: sum(taken) / len(taken) for group, taken in self._taken.items()}
        other = sum(means.values()) / len(means)
        left = sum(count * means.get(group, other) for group, count in self._left.items())
        return (time.perf_counter() - self._started) * left / max(sum(map(sum, self._taken.values())), 1e-9)

    def log(self, text: str) -> None:
        """Write a line to the log file."""
        now = datetime.fromtimestamp(time.time()).isoformat(" ", "milliseconds")
        with suppress(OSError):  # a full disk is reported when a result cannot be stored
            self._file.write(f"{now} {os.getpid()} {line(text)}\n")

    def notify(self, text: str) -> None:
        """Log a line, and print it at once: the other cells may take hours."""
        self.log(text)
        if self._show:
            self._bar.write(f"rattle: {text}", file=sys.stderr)

    def begin(self, cell: Cell) -> None:
        """Show the cell whose computation begins."""
        self._draw(cell)

    def finish(self, cell: Cell, found: Any, here: bool) -> None:
        """Count a finished cell."""
        seconds = float(found.facts["seconds"])
        text = f"{'done' if here else 'found'} {cell.label} {cell.key}: {seconds:.2f} s"
        if isinstance(found, Sampled):
            error, where = sampling_error(found)
            self.worst = max(self.worst, error)
            text += f", largest se {error:.2g} sd ({where})"
        self.computed += here
        self.seconds += seconds * here
        self._taken.setdefault(cell.group, []).append(seconds)
        self.log(text)
        self._count(cell)

    def fail(self, cell: Cell, why: str) -> None:
        """Count and report a cell that cannot be computed."""
        self.notify(f"{cell.label} failed: {why}")
        self._count(cell)

    def _count(self, cell: Cell) -> None:
        self._left[cell.group] -= 1
        self._bar.update(1)
        self._draw(cell)

    def _draw(self, cell: Cell) -> None:
        if self._bar.disable:
            return
        rate = (self._bar.n - self._stored) / max(time.perf_counter() - self._started, 1e-9)
        left = tqdm.format_interval(self.seconds_left) if self._taken else "?"
        self._bar.set_postfix_str(f"{left} left, {rate:.2g} cells/s, {cell.label}, largest se {self.worst:.2g} sd")
