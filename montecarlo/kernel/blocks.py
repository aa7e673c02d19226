"""Who runs the blocks of a plan: threads of this process, or workers that other runs share."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import Any

from rattle.montecarlo.branches.weighted_paths import run_mixture
from rattle.montecarlo.kernel.block import BlockResult, Plan, run
from rattle.scene.types import Floats

Blocks = Callable[[Plan, int], Iterator[tuple[BlockResult, Floats | None]]]
"""Runs the blocks of a plan from one on, and gives their results in block order; may end before the last."""


def in_threads(workers: int) -> Blocks:
    """Run blocks on threads of this process."""

    def blocks(plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        with ThreadPoolExecutor(workers) as pool:
            yield from in_tasks(pool.submit, workers)(plan, first)

    return blocks


def in_tasks(submit: Callable[..., Future[Any]], workers: int, share: int = 1) -> Blocks:
    """Run blocks in tasks of `share` blocks on workers that other runs may share; `submit` hands them a call."""

    def blocks(plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        starts = iter(range(first, plan.blocks, share))

        def start_task(start: int) -> Future[Any]:
            return submit(run_blocks, plan, start, min(start + share, plan.blocks))

        waiting = [start_task(start) for start in islice(starts, 4 * workers)]
        try:
            while waiting:
                yield from waiting.pop(0).result()
                waiting.extend(start_task(start) for start in islice(starts, 1))
        finally:
            for future in waiting:
                future.cancel()

    return blocks


def run_blocks(plan: Plan, first: int, end: int) -> list[tuple[BlockResult, Floats | None]]:
    """On a worker: the results of blocks `first` to `end`, one each, so that they can be merged in order."""
    mixture = plan.mixture
    return [run(plan, n) if mixture is None else run_mixture(plan, mixture, n) for n in range(first, end)]
