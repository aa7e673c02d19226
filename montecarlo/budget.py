"""What an answer may cost: seconds, looked at between the blocks of paths that are followed."""

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

__all__ = ["HOUR", "Budget", "clock", "in_words"]

HOUR = 3600.0
"""Seconds that an accuracy may take where no budget is given."""


def clock() -> float:
    """Seconds that have passed since some instant."""
    return time.perf_counter()


class Budget:
    """Seconds from now on, and what is left of them.

    Parameters
    ----------
    seconds : float

    Examples
    --------
    >>> budget = Budget(60.0)
    >>> 0.0 < budget.left <= 60.0
    True
    """

    def __init__(self, seconds: float) -> None:
        self.ends = clock() + seconds

    @property
    def left(self) -> float:
        """Seconds that are left; below 0 where it is overdrawn."""
        return self.ends - clock()

    @contextmanager
    def uncounted(self) -> Iterator[None]:
        """What is done inside does not count."""
        began = clock()
        yield
        self.ends += clock() - began

    def limited(self, blocks: Blocks) -> Blocks:
        """The same blocks, but none after the budget is spent; the first comes in any case, and none is cut short."""

        def until_spent(plan: Plan, first: int) -> Iterator[tuple[BlockResult, NDArray[np.float64] | None]]:
            for result in blocks(plan, first):
                yield result
                if self.left <= 0.0:
                    return

        return until_spent


def in_words(seconds: float) -> str:
    """A duration as a person says it.

    Examples
    --------
    >>> in_words(3.0), in_words(5400.0), in_words(1e9)
    ('3 s', '1.5 h', '31.7 years')
    """
    units = {"s": 1.0, "minutes": 60.0, "h": HOUR, "days": 24.0 * HOUR, "years": 365.25 * 24.0 * HOUR}
    name = max((n for n, size in units.items() if seconds >= 1.5 * size), key=lambda n: units[n], default="s")
    return f"{seconds / units[name]:.3g} {name}"
