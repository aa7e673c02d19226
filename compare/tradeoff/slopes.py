"""Slopes of changes over the step, with jackknife intervals, and whether they have settled on an order."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
STILL = 1e-9  # change below which a quantity counts as constant


SETTLED = 0.3
"""Largest half width of the interval of the difference of two local slopes with which they can be said to agree."""
AGREE = 0.05  # difference of two local slopes that does not matter


def slope_from(bias: Floats, se: Floats, steps: Sequence[float]) -> tuple[float, float, float, float]:
    """Slope of log(change) over log(step) with its jackknife interval, and the last change.

    The change at a step is the root mean square over the rows of the replicates' mean, corrected for the variance of
    its measurement; NaN where that exceeds it.

    `bias`, `se`: Change between a step and its half in each row (moment), and its standard error. Shapes: `bias`,
    `se` (replicates, steps, rows).
    """
    n = len(bias)
    slope = _slope(bias, se, steps, np.ones(n))
    half = float(_half(np.array([_slope(bias, se, steps, 1.0 - np.eye(n)[r]) for r in range(n)])))
    return slope, slope - half, slope + half, float(_sizes(bias, se, np.ones(n))[-1])


def _slope(bias: Floats, se: Floats, steps: Sequence[float], chosen: Floats) -> float:
    x, y = np.log(np.asarray(steps)), np.log(_sizes(bias, se, chosen))
    return float(((x - x.mean()) * y).sum() / ((x - x.mean()) ** 2).sum())


def find_settled(bias: Floats, se: Floats, steps: Sequence[float]) -> tuple[float, float, float, int]:
    """The order, if the slope has settled: the local slopes of the finest three changes agree, and none turns its sign.

    Returns: Slope over the finest three steps and its 95 % interval; NaN if it has not settled, or noise hides
    it. Returns: Rows whose change turns its sign from one step to the next, over all steps, beyond three standard
    errors.
    """
    n = len(bias)
    mean, error = bias.mean(axis=0), np.sqrt((se**2).sum(axis=0)) / n
    seen = np.abs(mean) > np.maximum(3.0 * error, STILL)
    turning = (mean[1:] * mean[:-1] < 0.0) & seen[1:] & seen[:-1]
    turns = int(turning.any(axis=0).sum())

    def pair(i: int) -> slice:
        return slice(len(steps) + i, len(steps) + i + 2)

    def change(chosen: Floats) -> float:
        first, second = (_slope(bias[:, pair(i)], se[:, pair(i)], steps[pair(i)], chosen) for i in (-3, -2))
        return second - first

    half = float(_half(np.array([change(1.0 - np.eye(n)[r]) for r in range(n)])))
    if turning[-2:].any() or not (abs(change(np.ones(n))) <= max(half, AGREE) and half <= SETTLED):
        return math.nan, math.nan, math.nan, turns
    return *slope_from(bias[:, -3:], se[:, -3:], steps[-3:])[:3], turns


def changes_from(bias: Floats, se: Floats) -> tuple[Floats, Floats, Floats]:
    """Size of the change at each step with its jackknife interval, which is symmetric in the logarithm.

    Shapes: `bias`, `se` (replicates, steps, rows); result (steps,).
    """
    n = len(bias)
    change = _sizes(bias, se, np.ones(n))
    half = _half(np.log([_sizes(bias, se, 1.0 - np.eye(n)[r]) for r in range(n)]))
    return change, change * np.exp(-half), change * np.exp(half)


def _sizes(bias: Floats, se: Floats, chosen: Floats) -> Floats:
    weight = chosen / chosen.sum()
    mean = np.einsum("r,rsi->si", weight, bias)
    noise = np.einsum("r,rsi->si", weight**2, se**2)
    square = (mean**2 - noise).mean(axis=1)
    return np.sqrt(np.where(square > 0.0, square, np.nan))


def _half(without: Floats) -> Floats:
    """Half width of the jackknife interval, from the values without each replicate, shape (replicates, ...)."""
    n = len(without)
    return np.asarray(float(stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)) * np.sqrt((n - 1) * without.var(axis=0)))
