"""Intervals from independent paths: Student's."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

__all__ = ["CONFIDENCE", "Spread", "half_width", "spread"]

Floats = NDArray[np.float64]

CONFIDENCE = 0.95


def half_width(paths: int) -> float:
    """Half width of a 95 % interval in standard errors from a number of independent paths.

    Parameters
    ----------
    paths : int
        Number of paths.

    Returns
    -------
    float
        Student's t.
    """
    return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, paths - 1))


class Spread(NamedTuple):
    """A value with the spread of what independent paths put into it.

    Attributes
    ----------
    value, se : float
        Value and standard error.
    paths : int
        Their number.
    """

    value: float
    se: float
    paths: int

    def interval(self) -> tuple[float, float]:
        """95 % interval of the value."""
        half = half_width(self.paths) * self.se
        return self.value - half, self.value + half


def spread(parts: Floats, value: float | None = None) -> Spread:
    """The mean of what paths put into a value, with its spread.

    Parameters
    ----------
    parts : ndarray, shape (paths,)
        Of each path.
    value : float, optional
        The value, where it is not their mean.

    Returns
    -------
    Spread
    """
    value = float(parts.mean()) if value is None else value
    return Spread(value, float(parts.std(ddof=1)) / math.sqrt(len(parts)), len(parts))
