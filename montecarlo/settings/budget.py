"""Time budget of an answer in seconds of processor time, checked between blocks of paths."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rattle.montecarlo.kernel.block import BlockResult, Plan
from rattle.montecarlo.kernel.blocks import Blocks
from rattle.scene.types import Floats

HOUR = 3600.0
"""Seconds that an accuracy may take where no budget is given."""


def clock() -> float:
    """Processor time of this process so far, all threads together, in seconds: other work on the machine is none."""
    return time.process_time()


class Budget:
    """A time budget that starts now, and what is left of it.

    `seconds`: the whole budget. `ends`: `clock` at which it is spent.

    Examples
    --------
    >>> budget = Budget(60.0)
    >>> 0.0 < budget.remaining <= 60.0
    True
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

    def limit(self, blocks: Blocks) -> Blocks:
        """The same blocks, but none is started after the budget is spent.

        The first block is run in any case, and no block is interrupted.
        """

        def until_spent(plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
            for result in blocks(plan, first):
                yield result
                if self.remaining <= 0.0:
                    return

        return until_spent
