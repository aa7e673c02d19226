"""Computes the missing cells of a study, each once, even if several processes share the work or one is interrupted."""

import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import NamedTuple

from rattle.compare.study.cells import Cell
from rattle.compare.study.design import Study
from rattle.compare.study.executors import Failed, Place, Stopped
from rattle.compare.study.obtain import attempt, read_stored
from rattle.compare.study.progress import Progress
from rattle.compare.study.store import Store, Stored
from rattle.compare.study.waiting import Waiting
from rattle.scene.errors import InputError

CHANGED = "its file has changed while it ran; finished results are kept: run the command again"
LOOK = 0.2  # seconds between two checks of the threads: the longest delay of Ctrl-C


class Work(NamedTuple):
    """What a thread returns: the result (None while another process computes it), and whether it was computed here."""

    found: Stored | None
    here: bool


class Outcome(NamedTuple):
    """Summary of a run."""

    computed: int  # cells that this run has computed; others may come from another process
    failed: dict[str, str]  # error message of each cell that could not be computed, by key
    wall_seconds: float  # wall_seconds, cell_seconds: wall time of the run, and the sum of the times of its cells
    cell_seconds: float


def missing(study: Study, store: Store) -> list[Cell]:
    """List the cells that are not in the store."""
    return [cell for cell in study.cells if not store.path(cell.key).exists()]


def run(
    study: Study, store: Store, place: Place, *, show: bool = False, unchanged: Callable[[], bool] = lambda: True
) -> Outcome:
    """Compute the cells that are missing.

    `unchanged`: Called between cells; false if the study's file has changed, which ends the run.
    """
    store.sweep()
    todo = {cell.key: cell for cell in study.cells if read_stored(store, cell) is None}
    stored = len(study.cells) - len(todo)
    started = time.perf_counter()
    failed: dict[str, str] = {}
    with place, Progress(todo, stored, store.folder.parent, show) as progress, _threads(place.threads) as pool:
        running: dict[Future[Work], Cell] = {}
        waiting, others = list(todo.values()), Waiting(store.lock, progress.waits)
        elsewhere: list[Cell] = []  # being computed by other processes; tried again when nothing else is left
        try:
            while waiting or running or elsewhere:
                while waiting and len(running) < place.threads:
                    cell = waiting.pop(0)
                    progress.begin(cell)
                    running[pool.submit(_work, store, cell, place)] = cell
                done, _ = wait(running, timeout=LOOK, return_when=FIRST_COMPLETED)
                elsewhere += _collect(done, running, progress, failed)
                if elsewhere and not waiting and not running:
                    others.pause(elsewhere)
                    waiting, elsewhere = elsewhere, []
                if done and not unchanged():
                    raise InputError("study", study.title, CHANGED)
        except KeyboardInterrupt:
            have = len(study.cells) - sum(not store.path(key).exists() for key in todo)
            text = f"interrupted; {have} of {len(study.cells)} results stored; run the same command again to continue"
            raise KeyboardInterrupt(text) from None
        finally:
            place.stop()
            pool.shutdown(wait=False, cancel_futures=True)
    return Outcome(progress.computed, failed, time.perf_counter() - started, progress.seconds)


def _work(store: Store, cell: Cell, place: Place) -> Work:
    computed = []

    def compute(cell: Cell) -> Stored:
        computed.append(cell.key)
        return place.compute(cell)

    return Work(attempt(store, cell, compute), bool(computed))


def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix="cell")


def _collect(
    done: set[Future[Work]], running: dict[Future[Work], Cell], progress: Progress, failed: dict[str, str]
) -> list[Cell]:
    """Record finished and failed cells; return those that other processes are computing."""
    elsewhere = []
    for future in done:
        cell = running.pop(future)
        try:
            found, here = future.result()
        except (InputError, Failed) as error:
            failed[cell.key] = str(error)
            progress.fail(cell, str(error))
            continue
        except Stopped:
            raise KeyboardInterrupt from None
        if found is None:
            elsewhere.append(cell)
        else:
            progress.finish(cell, found, here)
    return elsewhere
