"""Intervals from independent paths: Student's, with as many degrees of freedom as paths the error
rests on, less one.

A standard error is known as well as the variance of what paths put into a value.  Where rare bursts
are nearly all of it, that variance comes from the few paths that had one, and is most often too
small when few had.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri, stdtrit

from rattle.scene import Floats

CONFIDENCE = 0.95
"""Probability of an interval, and of an accuracy that is said to be reached."""


FAMILY_ERROR = 0.05
"""Probability that anything of all that is said together is wrong, unless another one is given."""

AGAIN = 0.25
"""Share of the probability of a wrong statement that a second look may add, which decides rows that
wait for a rare branch by other paths, a part of them near it."""

TOO_FEW = "too few paths to decide"
"""Why something stays undecided that more paths would decide."""

FEWEST_FOR_SD = 32
"""Least number of paths from which an sd is judged: the fourth moment of fewer says too little
about its error."""

ABSOLUTE = 1e-6
"""Tolerance, relative to size, of a quantity that does not vary."""

ROUNDED_SD = 2.0**-40
"""Sd over size of a quantity below which the rounding of a path matters beside 5 % of the sd."""


def tail_of(checks: int, family_error: float = FAMILY_ERROR) -> float:
    """Probability on either side of each of some simultaneous intervals (Bonferroni)."""
    return 0.5 * family_error / max(checks, 1)


def widest(checks: int, family_error: float = FAMILY_ERROR) -> float:
    """Half width, in standard errors, of simultaneous two-sided normal confidence intervals
    (Bonferroni)."""
    return float(-ndtri(tail_of(checks, family_error)))


def half_width(effective_paths: ArrayLike, tail: float = 0.5 - 0.5 * CONFIDENCE) -> Any:
    """Half width of an interval in standard errors, from the number of paths that the error rests
    on.

    `tail`: Probability on each side of the interval; by default those of a 95 % interval.
    """
    return -stdtrit(np.maximum(np.asarray(effective_paths) - 1.0, 1.0), tail)


def count_effective_paths(rest: Floats) -> float:
    """How many paths an error rests on: all where what they deviate by is normal, few where rare
    bursts are all.

    Where few of many paths do, their number is about ``(sum r^2)^2 / sum r^4``, which is a third of
    all where the deviations r are normal; the inverses are shifted such that these count in full.

    Shapes: `rest` (paths,).
    """
    n = len(rest)
    largest = float(np.abs(rest).max())
    if largest == 0.0:
        return float(n)
    square = (rest / largest) ** 2  # of any magnitude: a fourth power would overflow
    few = float(square.sum()) ** 2 / float((square**2).sum())
    inverse = 1.0 / max(few - 1.0, 1e-9) - 1.0 / (n / 3.0 - 1.0) + 1.0 / (n - 1.0)
    return 1.0 + 1.0 / max(inverse, 1.0 / (n - 1.0))


class Spread(NamedTuple):
    """A value with the spread of what independent paths put into it."""

    value: float  # value, se: value and standard error
    se: float
    effective_paths: float  # how many paths the error rests on, see `count_effective_paths`

    def interval(self) -> tuple[float, float]:
        """95 % interval of the value."""
        half = float(half_width(self.effective_paths)) * self.se
        return self.value - half, self.value + half


def spread(parts: Floats, value: float | None = None) -> Spread:
    """The mean of what paths put into a value, with its spread.

    Shapes: `parts` (paths,).
    """
    n = len(parts)
    rest = parts - parts.mean()
    value = float(parts.mean()) if value is None else value
    return Spread(
        value, math.sqrt(float((rest**2).sum()) / (n - 1) / n), count_effective_paths(rest)
    )
