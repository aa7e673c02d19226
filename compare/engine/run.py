"""The engine of studies: it computes the missing cells, each once, even if several processes share
the work.

The work runs on threads of this process, or on a Dask cluster (`rattle.compare.engine.cluster`).
"""

import io
import os
import time
from collections import deque
from collections.abc import Callable, Collection
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, Self, TextIO

from rattle.compare.engine.store import LOCKS, Cell, Content, Say, Store, TemporaryStore
from rattle.compare.report.folder import (
    ANY_TEXT,
    check_own,
    describe_refusal,
    refuse_foreign,
    sweep,
)
from rattle.montecarlo.kernel.blocks import Budget, in_tasks
from rattle.montecarlo.looks import begin_budget
from rattle.scene import InputError, line
from rattle.scene.progress import ProgressBar, print_on_stderr

CELLS_FOLDER = "cells"
LOG_FILE = "study.log"
LOG_LINE = rb"\A\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3} \d+ "
LOOK = 0.2  # seconds between two checks of the threads: the longest delay of Ctrl-C


class Runner:
    """An executor, used as a context manager, on whose `workers` all cells share their blocks of
    paths.

    So the last cell uses every worker.
    """

    share = 1  # blocks of a task

    def __init__(self, workers: int, budget: Budget | None = None) -> None:
        self.workers = workers
        self._budget = budget or begin_budget(None)
        self._executor: Executor

    def __enter__(self) -> Self:
        self._executor = ThreadPoolExecutor(self.workers)
        return self

    def __exit__(self, kind: type[BaseException] | None, *what: object) -> None:
        self._executor.shutdown(wait=kind is None)  # an interrupt does not wait for a long cell

    def submit(self, work: Callable[..., Any], *given: Any) -> Future[Any]:
        """Run some work on a worker."""
        return self._executor.submit(work, *given)

    def stop(self) -> None:
        """Abandon all work: what has not begun is cancelled, which raises CancelledError where it
        is waited for."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    def check(self, say: Say) -> None:
        """Raise an error if there are no workers any more, and say which do not answer; called
        every now and then."""

    def reason(self, error: BaseException) -> str:
        """Why one cell cannot be computed; raises an error that concerns all cells."""
        if isinstance(error, InputError):
            return str(error)
        raise error

    def compute(self, cell: Cell) -> Content:
        """Compute a cell; raises BudgetEnded if its blocks of paths do not fit the budget."""
        if cell.splits:
            blocks = in_tasks(self.submit, self.workers, self.share)
            return cell.compute(self._budget.limit(blocks, required=True))
        content: Content = self.submit(cell.compute).result()
        return content


def check_log(folder: Path) -> None:
    """Check that a log can be continued, if there is one."""
    check_own(folder / LOG_FILE, LOG_LINE, "a log of rattle")


def check_cells(folder: Path) -> None:
    """Check that a folder holds nothing of others under the names of cells and log."""
    check_log(folder)
    if not has_cells(folder) and (folder / CELLS_FOLDER).is_dir():
        refuse_foreign(folder / CELLS_FOLDER, os.listdir(folder / CELLS_FOLDER))


def open_cells(folder: Path | None) -> Store:
    """Open the store of the cells in a folder; without a folder, a temporary one."""
    if folder is None:
        return TemporaryStore()
    check_cells(folder)
    return Store(folder / CELLS_FOLDER)


def has_cells(folder: Path) -> bool:
    """Whether there is a store of cells in a folder."""
    return (folder / CELLS_FOLDER / LOCKS).is_dir()


class StudyProgress:
    """What a run has done so far: a line on the terminal, a log file in a folder, and the counts
    for the manifest.

    `show`: Whether to draw the line if standard error is a terminal, and to print there which
    process is waited for and which cells fail.
    """

    def __init__(
        self, todo: Collection[Cell], stored: int, folder: Path | None, show: bool
    ) -> None:
        # of this run; other cells may come from another process
        self.computed = 0
        self.cell_seconds = 0.0
        # error message of each cell that could not be computed, by key
        self.failed: dict[str, str] = {}
        self._show, self._started = show, time.perf_counter()
        self._file: TextIO = io.StringIO()
        if folder is not None:
            check_log(folder)
            try:
                self._file = open(folder / LOG_FILE, "a", encoding="utf-8", buffering=1)  # noqa: SIM115  (see __exit__)
            except OSError as error:
                raise describe_refusal(folder / LOG_FILE, error) from None
        self._bar = ProgressBar(
            total=stored + len(todo),
            initial=stored,
            label="study" if show else None,
            unit=" cells",
            bar_format="{desc} {n}/{total} cells |{bar:20}| {elapsed}, {remaining} left{postfix}",
        )
        self.log(f"start: {stored} results stored, {len(todo)} to compute")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *what: object) -> None:
        self._bar.close()
        self.log("end" if kind is None else f"ended by {kind.__name__}: {what[0]}")
        with suppress(OSError):
            self._file.close()

    @property
    def wall_seconds(self) -> float:
        """Seconds since the beginning."""
        return time.perf_counter() - self._started

    def log(self, text: str) -> None:
        """Write a line to the log file."""
        now = datetime.fromtimestamp(time.time()).isoformat(" ", "milliseconds")
        with suppress(OSError):  # a full disk is reported when a result cannot be stored
            self._file.write(f"{now} {os.getpid()} {line(text)}\n")

    def notify(self, text: str) -> None:
        """Log a line, and print it at once: the other cells may take hours."""
        self.log(text)
        if self._show:
            print_on_stderr(text)

    def finish(self, cell: Cell, result: Any, here: bool) -> None:
        """Count a finished cell, computed here or by another process."""
        seconds = float(result.facts["seconds"])
        description = cell.describe(result)
        self.computed += here
        self.cell_seconds += seconds * here
        self.log(
            f"{'done' if here else 'found'} {cell.label} {cell.key}: {seconds:.2f} s"
            + f", {description}" * bool(description)
        )
        self._count(f"{cell.label}: {description or 'done'}")

    def fail(self, cell: Cell, why: str) -> None:
        """Count and report a cell that cannot be computed."""
        self.failed[cell.key] = why
        self.notify(f"{cell.label} failed: {why}")
        self._count(f"{cell.label} failed")

    def _count(self, text: str) -> None:
        """Advance the line on the terminal by a cell."""
        self._bar.update(1)
        self._bar.set_postfix_str(text)


def run(
    cells: Collection[Cell], store: Store, runner: Runner, *, show: bool = False
) -> StudyProgress:
    """Compute the cells that are missing."""
    folder = None if isinstance(store, TemporaryStore) else store.folder
    if folder:
        sweep(folder, ANY_TEXT)
    todo = deque(cell for cell in cells if store.read(cell) is None)
    computed: set[str] = set()

    def compute(cell: Cell) -> Content:
        """Compute a cell, and note that it was computed here."""
        content = runner.compute(cell)
        computed.add(cell.key)
        return content

    with (
        runner,
        StudyProgress(todo, len(cells) - len(todo), folder and folder.parent, show) as progress,
    ):
        pool = ThreadPoolExecutor(runner.workers, thread_name_prefix="cell")
        running: dict[Future[Any], Cell] = {}
        try:
            while todo or running:
                while todo and len(running) < runner.workers:
                    cell = todo.popleft()
                    running[pool.submit(store.attempt, cell, compute, progress.notify)] = cell
                done, _ = wait(running, timeout=LOOK, return_when=FIRST_COMPLETED)
                runner.check(progress.notify)
                for future in done:
                    cell = running.pop(future)
                    if error := future.exception():
                        progress.fail(cell, runner.reason(error))
                    elif (result := future.result()) is None:  # another process computes it
                        todo.append(cell)
                    else:
                        progress.finish(cell, result, cell.key in computed)
        except KeyboardInterrupt:
            if folder is None:
                raise
            have = len(cells) - len(store.missing(cells))
            text = (
                f"interrupted; {have} of {len(cells)} results stored; run the same command again to"
                " continue"
            )
            raise KeyboardInterrupt(text) from None
        finally:
            runner.stop()
            pool.shutdown(wait=False, cancel_futures=True)
    return progress


def obtain_all(cells: Collection[Cell], folder: Path | None, workers: int) -> list[Any]:
    """Read or compute the results of some cells; without a folder none is stored."""
    store = open_cells(folder)
    run(cells, store, Runner(workers), show=True)
    return [store.obtain(cell) for cell in cells]
