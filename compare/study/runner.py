"""Runs the work of cells on threads of this process; for a Dask cluster see `rattle.compare.study.cluster`."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from itertools import islice
from typing import Any, Self

from rattle.compare.study.store import Cell, Content
from rattle.montecarlo.kernel.block import BlockResult, Plan, run
from rattle.montecarlo.kernel.blocks import Floats
from rattle.scene.errors import InputError


class Runner:
    """An executor, used as a context manager, on whose `workers` all cells share their blocks of paths.

    So the last cell uses every worker.
    """

    share = 1  # blocks of a task

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._executor: Executor

    def __enter__(self) -> Self:
        self._executor = ThreadPoolExecutor(self.workers)
        return self

    def __exit__(self, *what: object) -> None:
        self._executor.shutdown()

    def submit(self, work: Callable[..., Any], *given: Any) -> Future[Any]:
        """Run some work on a worker."""
        return self._executor.submit(work, *given)

    def stop(self) -> None:
        """Abandon all work: what has not begun is cancelled, which raises CancelledError where it is waited for."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    def check(self) -> None:
        """Raise an error if there are no workers any more; called every now and then."""

    def reason(self, error: BaseException) -> str:
        """Why one cell cannot be computed; raises an error that concerns all cells."""
        if isinstance(error, InputError):
            return str(error)
        raise error

    def compute(self, cell: Cell) -> Content:
        """Compute a cell."""
        if cell.splits:
            return cell.compute(self._blocks)
        found: Content = self.submit(cell.compute).result()
        return found

    def _blocks(self, plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        """Run the blocks of a plan in tasks of `share` blocks, and give their results in block order."""
        starts = iter(range(first, plan.blocks, self.share))

        def submit(start: int) -> Future[list[BlockResult]]:
            return self.submit(run_blocks, plan, start, min(start + self.share, plan.blocks))

        waiting = [submit(start) for start in islice(starts, 2 * self.workers)]
        try:
            while waiting:
                yield from ((result, None) for result in waiting.pop(0).result())
                waiting.extend(submit(start) for start in islice(starts, 1))
        finally:
            for future in waiting:
                future.cancel()


def run_blocks(plan: Plan, first: int, end: int) -> list[BlockResult]:
    """On a worker: the results of blocks `first` to `end`, one each, so that they can be merged in order."""
    return [run(plan, block)[0] for block in range(first, end)]
