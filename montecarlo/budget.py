"""Time budget of an answer in seconds of processor time, checked between blocks of paths."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rattle.montecarlo.ensemble import Blocks
    from rattle.montecarlo.kernel.block import BlockResult, Plan

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

        def until_spent(plan: Plan, first: int) -> Iterator[tuple[BlockResult, NDArray[np.float64] | None]]:
            for result in blocks(plan, first):
                yield result
                if self.remaining <= 0.0:
                    return

        return until_spent


def in_words(seconds: float, digits: int = 3) -> str:
    """A duration in a convenient unit, to some digits.

    >>> in_words(3.0), in_words(5400.0), in_words(1e9), in_words(0.00123, 2)
    ('3 s', '1.5 h', '31.7 years', '1.2 ms')
    """
    units = {"s": 1.0, "minutes": 60.0, "h": HOUR, "days": 24.0 * HOUR, "years": 365.25 * 24.0 * HOUR}
    name = max((n for n, size in units.items() if seconds >= 1.5 * size), key=lambda n: units[n], default="s")
    if 0.0 < seconds < 0.1:
        return f"{float(f'{1e3 * seconds:.{digits}g}'):g} ms"
    return f"{float(f'{seconds / units[name]:.{digits}g}'):g} {name}"
