"""Who runs the blocks of a plan: threads of this process, or a pool that other runs share."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.block import BlockResult, Plan, run

Floats = NDArray[np.float64]
Blocks = Callable[[Plan, int], Iterator[tuple[BlockResult, Floats | None]]]
"""Runs the blocks of a plan from one on, and gives their results in block order; may end before the last."""


def in_threads(workers: int) -> Blocks:
    """Run blocks on threads of this process."""

    def blocks(plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        with ThreadPoolExecutor(workers) as pool:
            yield from in_pool(pool, workers)(plan, first)

    return blocks


def in_pool(pool: ThreadPoolExecutor, workers: int) -> Blocks:
    """Run blocks on the threads of a pool that other runs may share."""

    def blocks(plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        numbers = iter(range(first, plan.blocks))
        waiting = [pool.submit(run, plan, b) for b in islice(numbers, 4 * workers)]
        try:
            while waiting:
                yield waiting.pop(0).result()
                waiting.extend(pool.submit(run, plan, b) for b in islice(numbers, 1))
        finally:
            for future in waiting:
                future.cancel()

    return blocks
