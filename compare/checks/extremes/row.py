"""A row of the table of extremes: what was tried, over which range, and the worst error beside what is allowed."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["ROUNDING", "Extreme", "farthest", "spread"]

ROUNDING = 4e-15
"""A few roundings of a double: allowed where a formula is held against a higher precision, unless a row says more."""


class Extreme(NamedTuple):
    """A thing that was tried at its extremes.

    Attributes
    ----------
    name : str
        What was computed.
    field : str
        Which field of the scene was extreme.
    tried : str
        The range.
    truth : str
        What it was held against.
    worst : float
        The worst error over the range.
    allowed : float
        The error up to which the row holds.
    unit : str
        What the error is relative to, or "z" for standard errors.

    Examples
    --------
    >>> Extreme("E", "beta", "0 to 1e3", "mpmath", 2e-16, 4e-15, "its value").holds
    True
    """

    name: str
    field: str
    tried: str
    truth: str
    worst: float
    allowed: float
    unit: str

    @property
    def holds(self) -> bool:
        """Whether the worst error is allowed; never if it is not a number."""
        return self.worst <= self.allowed


def farthest(found: ArrayLike, truth: ArrayLike, unit: ArrayLike = 1.0) -> float:
    """The largest error in these units; infinite where something is not a number on one side alone.

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
    """Values from `low` to `high`, equally far apart in their logarithms, and others.

    Examples
    --------
    >>> spread(1e-2, 1e2, 3, 0.0)
    [0.0, 0.01, 1.0, 100.0]
    """
    return [*also, *(float(v) for v in np.geomspace(low, high, count))]


def worst_of(errors: Iterable[float]) -> float:
    """The largest; infinite if one is not a number."""
    return max((math.inf if math.isnan(e) else e for e in errors), default=math.inf)
