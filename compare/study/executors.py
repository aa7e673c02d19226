"""Executors of cells: threads of this process; for a Dask cluster see `rattle.compare.study.cluster`."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol, Self

from rattle.compare.study.cells import Cell
from rattle.compare.study.store import Stored
from rattle.montecarlo.blocks import Blocks, Floats, in_pool
from rattle.montecarlo.kernel.block import BlockResult, Plan
from rattle.scene.errors import RattleError

SHARE = 64
"""Blocks of one cluster task: about a second of exact flights, against 3.5 ms of scheduling."""


class Stopped(RattleError):
    """The study was interrupted; unfinished blocks are abandoned."""


class Failed(RattleError):
    """One cell cannot be computed by this executor; the others are still computed."""


class Place(Protocol):
    """An executor of cells, used as a context manager; `threads` cells are computed at a time."""

    threads: int

    def compute(self, cell: Cell) -> Stored:
        """Compute a cell."""
        ...

    def stop(self) -> None:
        """Abandon the blocks that are running."""
        ...

    def __enter__(self) -> Self:
        """Start threads or connect to the cluster."""
        ...

    def __exit__(self, *what: object) -> None:
        """End threads or close the connection."""
        ...


class Here:
    """Executes cells on threads of this process; all cells share one pool, so that the last cell uses every thread."""

    def __init__(self, workers: int) -> None:
        self.threads = workers
        self._stopped = threading.Event()

    def __enter__(self) -> Self:
        self._pool = ThreadPoolExecutor(self.threads)
        return self

    def __exit__(self, *what: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def compute(self, cell: Cell) -> Stored:
        """Compute a cell."""
        return cell.compute(stoppable(in_pool(self._pool, self.threads), self._stopped))

    def stop(self) -> None:
        """Abandon the cells that are running as soon as their current blocks have ended."""
        self._stopped.set()


def stoppable(blocks: Blocks, stopped: threading.Event) -> Blocks:
    """Wrap a runner of blocks so that it can be stopped between two blocks."""

    def until_stopped(plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        for result in blocks(plan, first):
            if stopped.is_set():
                raise Stopped("interrupted")
            yield result

    return until_stopped
