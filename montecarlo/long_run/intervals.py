"""Intervals from independent paths: Student's."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

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
    return float(stdtrit(paths - 1, 0.5 + 0.5 * CONFIDENCE))


class Spread(NamedTuple):
    """A value with the spread of what independent paths put into it.

    Attributes
    ----------
    value, se : float
        Value and standard error.
    paths : int
        Their number.
    carriers : float
        How many of them carry the variance, ``(sum r^2)^2 / sum r^4`` of what they deviate by: a third of them where
        that is normal, few where rare bursts are all.
    """

    value: float
    se: float
    paths: int
    carriers: float

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
    n, rest = len(parts), parts - parts.mean()
    square, fourth = float((rest**2).sum()), float((rest**4).sum())
    value = float(parts.mean()) if value is None else value
    return Spread(value, math.sqrt(square / (n - 1) / n), n, square**2 / fourth if fourth > 0.0 else float(n))
