"""Computes the missing cells of a study, each once, even if several processes share the work or one is interrupted."""

import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any, NamedTuple

from rattle.compare.report.folder import ANY_TEXT, sweep
from rattle.compare.study.design import Study
from rattle.compare.study.progress import ProgressLine
from rattle.compare.study.runner import Runner
from rattle.compare.study.store import Cell, Content, Store, Waits
from rattle.scene.errors import InputError

CHANGED = "its file has changed while it ran; finished results are kept: run the command again"
LOOK = 0.2  # seconds between two checks of the threads: the longest delay of Ctrl-C


class Outcome(NamedTuple):
    """Summary of a run."""

    computed: int  # cells that this run has computed; others may come from another process
    failed: dict[str, str]  # error message of each cell that could not be computed, by key
    wall_seconds: float  # wall_seconds, cell_seconds: wall time of the run, and the sum of the times of its cells
    cell_seconds: float


def missing(study: Study, store: Store) -> list[Cell]:
    """List the cells that are not in the store."""
    return [cell for cell in study.cells if not store.path(cell).exists()]


def run(
    study: Study, store: Store, runner: Runner, *, show: bool = False, unchanged: Callable[[], bool] = lambda: True
) -> Outcome:
    """Compute the cells that are missing.

    `unchanged`: Called between cells; false if the study's file has changed, which ends the run.
    """
    sweep(store.folder, ANY_TEXT)
    todo = deque(cell for cell in study.cells if store.read(cell) is None)
    stored = len(study.cells) - len(todo)
    started = time.perf_counter()
    failed: dict[str, str] = {}
    computed: set[str] = set()

    def compute(cell: Cell) -> Content:
        content = runner.compute(cell)
        computed.add(cell.key)
        return content

    with runner, ProgressLine(todo, stored, store.folder.parent, show) as progress:
        pool = ThreadPoolExecutor(runner.workers, thread_name_prefix="cell")
        running: dict[Future[Any], Cell] = {}
        waits = Waits(store, progress.notify)
        try:
            while todo or running:
                while todo and len(running) < runner.workers:
                    cell = todo.popleft()
                    progress.begin(cell)
                    running[pool.submit(store.attempt, cell, compute)] = cell
                done, _ = wait(running, timeout=LOOK, return_when=FIRST_COMPLETED)
                runner.check()
                for future in done:
                    cell = running.pop(future)
                    if error := future.exception():
                        failed[cell.key] = runner.reason(error)
                        progress.fail(cell, failed[cell.key])
                    elif (found := future.result()) is None:  # another process computes it
                        todo.append(cell)
                        waits.count(cell)
                    else:
                        progress.finish(cell, found, cell.key in computed)
                if done and not unchanged():
                    raise InputError("study", study.title, CHANGED)
        except KeyboardInterrupt:
            have = len(study.cells) - len(missing(study, store))
            text = f"interrupted; {have} of {len(study.cells)} results stored; run the same command again to continue"
            raise KeyboardInterrupt(text) from None
        finally:
            runner.stop()
            pool.shutdown(wait=False, cancel_futures=True)
    return Outcome(progress.computed, failed, time.perf_counter() - started, progress.seconds)
