"""A row of the table of extremes: a computation, the range over which it is checked, its worst error and the bound."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

ROUNDING = 4e-15
"""A few roundings of a double: the default bound where a formula is compared with 400-digit arithmetic."""


class Extreme(NamedTuple):
    """A computation that was checked at extreme values.

    Examples
    --------
    >>> Extreme("E", "beta", "0 to 1e3", "mpmath", 2e-16, 4e-15, "its value").holds
    True
    """

    name: str  # description of the computation
    field: str  # fields of the scene that are extreme
    tried: str  # their range
    truth: str  # the reference
    worst: float  # worst error over the range, in units of `unit`
    allowed: float  # largest admissible error
    unit: str  # the size that errors are relative to, or "z" for standard errors

    @property
    def holds(self) -> bool:
        """Whether the worst error is admissible; false for NaN."""
        return self.worst <= self.allowed


def farthest(found: ArrayLike, truth: ArrayLike, unit: ArrayLike = 1.0) -> float:
    """Compute the largest absolute error in given units.

    Examples
    --------
    >>> farthest([1.0, np.nan], [1.5, np.nan], 2.0), farthest(np.nan, 1.0)
    (0.25, inf)
    """
    a, b, u = (np.asarray(v, dtype=float) for v in (found, truth, unit))
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.where(same, 0.0, np.abs(a - b) / u)
    return float(np.where(np.isnan(error), math.inf, error).max(initial=0.0))


def spread(low: float, high: float, count: int, *also: float) -> list[float]:
    """List logarithmically spaced values, preceded by others.

    Examples
    --------
    >>> spread(1e-2, 1e2, 3, 0.0)
    [0.0, 0.01, 1.0, 100.0]
    """
    return [*also, *(float(v) for v in np.geomspace(low, high, count))]


def worst_of(errors: Iterable[float]) -> float:
    """The largest error; infinite if one is NaN."""
    return max((math.inf if math.isnan(e) else e for e in errors), default=math.inf)
