"""Intervals from independent paths, skewed as the paths are.

Where few paths hold rare bursts of slow impacts, most samples lie below the truth, and those that do underrate their
error too: a symmetric interval misses the truth far more often above than below.

References
----------
Hall, "On the removal of skewness by transformation" (1992).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

__all__ = ["CONFIDENCE", "Spread", "half_width", "spread", "student_quantiles"]

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
FLAT = 1e-6  # skewness that is none


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
    skewness : float
        Of the paths' parts.
    paths : int
        Their number.
    carriers : float
        How many of them carry the variance, ``(sum r^2)^2 / sum r^4`` of what they deviate by: a third of them where
        that is normal, few where rare bursts are all.
    """

    value: float
    se: float
    skewness: float
    paths: int
    carriers: float

    def interval(self) -> tuple[float, float]:
        """95 % interval of the value, skewed as the paths are.

        The cubic transformation of Hall (1992) makes the studentised value normal to second order; its inverse at
        Student's quantiles gives the interval.
        """
        low, high = student_quantiles(self.skewness, self.paths)
        return self.value - high * self.se, self.value - low * self.se


def student_quantiles(skewness: float, paths: int) -> tuple[float, float]:
    """Studentised means that 2.5 % of the samples lie below and above.

    Parameters
    ----------
    skewness : float
        Of what is averaged.
    paths : int
        How many.

    Returns
    -------
    low, high : float

    Examples
    --------
    >>> [round(x, 2) for x in student_quantiles(0.0, 64)], [round(x, 2) for x in student_quantiles(1.5, 64)]
    ([-2.0, 2.0], [-2.36, 1.77])
    """
    t, root = half_width(paths), math.sqrt(paths)
    if abs(skewness) < FLAT:
        return -t, t
    low, high = (
        root * 3.0 / skewness * (np.cbrt(1.0 + skewness * (x / root - skewness / (6.0 * paths))) - 1.0) for x in (-t, t)
    )
    return float(low), float(high)


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
    square = float((rest**2).sum())
    skewness = float((rest**3).mean()) / (square / n) ** 1.5 if square > 0.0 else 0.0
    carriers = square**2 / fourth if (fourth := float((rest**4).sum())) > 0.0 else float(n)
    centre = float(parts.mean()) if value is None else value
    return Spread(centre, math.sqrt(square / (n - 1) / n), skewness, n, carriers)
