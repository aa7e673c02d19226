"""Where the cells of a study are computed: on threads of this process here, on a cluster in
`rattle.compare.study.cluster`.
"""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol, Self

from rattle.compare.study.cells import Cell
from rattle.compare.study.store import Stored
from rattle.montecarlo.ensemble import Blocks, Floats, in_pool
from rattle.montecarlo.kernel.block import BlockResult, Plan
from rattle.scene.errors import RattleError

__all__ = ["SHARE", "Failed", "Here", "Place", "Stopped", "stoppable"]

SHARE = 64
"""Blocks of one task on a cluster: about a second of exact flights, long beside what the scheduler takes for a task."""


class Stopped(RattleError):
    """The study was interrupted; what was in flight is given up."""


class Failed(RattleError):
    """One cell cannot be computed at this place; the others go on."""


class Place(Protocol):
    """Where cells are computed."""

    threads: int

    def compute(self, cell: Cell) -> Stored:
        """The result of a cell."""
        ...

    def stop(self) -> None:
        """Give up what is in flight."""
        ...

    def __enter__(self) -> Self:
        """Get ready."""
        ...

    def __exit__(self, *what: object) -> None:
        """Let go."""
        ...


class Here:
    """Threads of this process; cells in flight share them, so that the last cell uses all."""

    def __init__(self, workers: int) -> None:
        self.threads = workers
        self._stopped = threading.Event()

    def __enter__(self) -> Self:
        self._pool = ThreadPoolExecutor(self.threads)
        return self

    def __exit__(self, *what: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def compute(self, cell: Cell) -> Stored:
        """The result of a cell."""
        return cell.compute(stoppable(in_pool(self._pool, self.threads), self._stopped))

    def stop(self) -> None:
        """Give up what is in flight, after the blocks that run."""
        self._stopped.set()


def stoppable(blocks: Blocks, stopped: threading.Event) -> Blocks:
    """The same blocks; raises Stopped between two of them once it is asked for."""

    def until_stopped(plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        for result in blocks(plan, first):
            if stopped.is_set():
                raise Stopped("interrupted")
            yield result

    return until_stopped
