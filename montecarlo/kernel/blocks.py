"""Who runs the blocks of a plan, threads of this process or workers that other runs share, and for
how long.

A time budget is in seconds of processor time, and is looked at between blocks.
"""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import Any

from rattle.montecarlo.kernel.block import Plan, Reduced, run
from rattle.scene.errors import BudgetEnded
from rattle.scene.progress import compiler

HOUR = 3600.0
"""Seconds that an accuracy may take where no budget is given."""

Blocks = Callable[[Plan, int], Iterator[Reduced]]
"""Runs the blocks of a plan from one on, and gives their results in block order; may end before the
last."""


def in_threads(workers: int) -> Blocks:
    """Run blocks on threads of this process."""

    def blocks(plan: Plan, first: int) -> Iterator[Reduced]:
        with ThreadPoolExecutor(workers) as pool:
            yield from in_tasks(pool.submit, workers)(plan, first)

    return blocks


def in_tasks(submit: Callable[..., Future[Any]], workers: int, share: int = 1) -> Blocks:
    """Run blocks in tasks of `share` blocks on workers that other runs may share; `submit` hands
    them a call."""

    def blocks(plan: Plan, first: int) -> Iterator[Reduced]:
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


def run_blocks(plan: Plan, first: int, end: int) -> list[Reduced]:
    """On a worker: the results of blocks `first` to `end`, one each, so that they can be merged in
    order."""
    return [run(plan, n) for n in range(first, end)]


def clock() -> float:
    """Processor time of this process so far, all threads together, in seconds, without that of
    compiling: neither that nor other work on the machine is charged to a budget."""
    return time.process_time() - compiler.processor_seconds


class Budget:
    """A time budget that starts now, and what is left of it.

    `seconds`: the whole budget. `ends`: `clock` at which it is spent.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds, self.ends = seconds, clock() + seconds

    @property
    def remaining(self) -> float:
        """Seconds that are left; negative once overspent."""
        return self.ends - clock()

    @contextmanager
    def pause(self) -> Iterator[None]:
        """Context whose duration is not charged to the budget."""
        began = clock()
        yield
        self.ends += clock() - began

    def limit(self, blocks: Blocks, required: bool = False) -> Blocks:
        """The same blocks, but none is started after the budget is spent.

        The first block is run in any case, and no block is interrupted.  `required`: Raise
        `BudgetEnded` in place of blocks that are left out, so that nothing unfinished is taken for
        a result.
        """

        def until_spent(plan: Plan, first: int) -> Iterator[Reduced]:
            for number, result in enumerate(blocks(plan, first), start=first + 1):
                yield result
                if self.remaining > 0.0:
                    continue
                if not required:
                    return
                if number < plan.blocks:
                    raise BudgetEnded

        return until_spent
