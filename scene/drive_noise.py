"""The noise of a measured drive, from what the acceleration of each period is of the mean one.

That share is 1 plus the integral of the modulation with a weight; for white noise of the drive the
periods are independent and normal, with variances that `rattle.scene.period_fits.measure_gains`
knows.  So their scatter gives sigma, with an interval from the chi-square distribution.  Not noise
are periods that stand far off, a slow change, and a pattern that repeats after some periods, such
as that of a half order.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre

from rattle.scene.types import Bools, Floats

# robust standard deviations from which on a period is left out: never a normal one
FAR_PERIOD = 8.0
MOST_LEFT_OUT = 0.2  # share of the periods up to which they are left out
CYCLES = (1, 2, 3, 4, 5, 6, 8)  # periods after which a pattern may repeat
HIGHEST_DEGREE = 12  # of the polynomial of a slow change
PERIODS_PER_NUMBER = 4  # periods at least for each number of a pattern
PATTERN_PASSES = 3  # between leaving out periods and finding their pattern
# times log(periods) for each number of a model: white noise of 60 periods passes in 5 of 10,000
PENALTY = 3.0
RESOLVED = 1e-7  # scatter, relative to the mean, below which nothing is looked for
RESOLUTION = 1e-5  # of sigma / alpha: what is smaller counts as 0
SURE = 3.0  # standard errors of the noise of the measurement that an interval allows for


@dataclass(frozen=True)
class Pattern:
    """What in numbers of successive periods is no noise: a slow change, and a pattern of `cycle`
    periods."""

    slow: Legendre  # over the number of the period, from 0
    residual: Floats
    parameters: int
    cycle: int
    good: Bools


def _find_near(residual: Floats, good: Bools, least: float) -> Bools:
    """Which of the good periods are not far off, by the median of all; where many are, it is no
    exception."""
    size = np.abs(residual - np.median(residual[good]))
    sd = 1.4826 * float(np.median(size[good]))
    near = good & (size <= max(FAR_PERIOD * sd, least))
    return near if near.sum() >= (1.0 - MOST_LEFT_OUT) * good.sum() else good


def find_pattern(
    values: Floats, good: Bools, least: float, cycles: Sequence[int] = CYCLES
) -> Pattern:
    """Tell noise from periods that stand far off, a slow change and a repeating pattern.

    `least`: What does not count as far off.  `cycles`: Periods after which a pattern may repeat.
    """
    number = np.arange(float(len(values)))
    domain = (0.0, len(values) - 1.0)
    degrees = range(min(HIGHEST_DEGREE, len(values) // PERIODS_PER_NUMBER) + 1)
    powers = np.transpose([Legendre.basis(degree, domain)(number) for degree in degrees])
    rows = _find_near(values, good, least)
    for _ in range(PATTERN_PASSES):
        scores = {}
        for cycle in (c for c in cycles if c * PERIODS_PER_NUMBER <= len(values)):
            phases = _mark_phases(number, cycle)
            parts, _ = np.linalg.qr(np.hstack([phases, powers])[rows])
            rest = values[rows, None] - np.cumsum(parts * (parts.T @ values[rows]), axis=1)
            error = np.log((rest**2).mean(axis=0)[cycle - 1 :] + RESOLVED**2)
            count = np.arange(cycle, cycle + len(error))  # of the numbers of each model
            score = error + PENALTY * count * math.log(rows.sum()) / np.maximum(
                rows.sum() - count - 1, 1
            )
            degree = int(score.argmin())
            scores[float(score[degree])] = cycle, degree
        cycle, degree = scores[min(scores)]
        design = np.hstack([powers[:, : degree + 1], _mark_phases(number, cycle)])
        coefficients = np.linalg.lstsq(design[rows], values[rows], rcond=None)[0]
        slow = Legendre(coefficients[: degree + 1], domain)
        pattern = Pattern(slow, values - design @ coefficients, len(coefficients), cycle, rows)
        again = _find_near(pattern.residual, good, least)
        if np.array_equal(again, rows):
            break
        rows = again
    return pattern


def _mark_phases(number: Floats, cycle: int) -> Floats:
    """A column for each period of a cycle but one; each is 0 on the mean of a cycle."""
    return np.transpose([(number % cycle == k) - 1.0 / cycle for k in range(cycle)])[:, 1:]


def correlate_neighbours(pattern: Pattern) -> float:
    """Correlation of the residuals of successive periods."""
    rest = np.where(pattern.good, pattern.residual, 0.0)
    return float((rest[1:] * rest[:-1]).sum() / max((rest**2).sum(), 1e-300))


def estimate_noise(
    pattern: Pattern, gains: tuple[Floats, Floats], own_noise: tuple[float, float]
) -> tuple[float, float, float, float]:
    """Sigma over alpha, its 95 % interval, and the sigma that the noise of the measurement would be
    taken for.

    `own_noise`: Variance of the samples by noise of the measurement, and its standard error.
    """
    from scipy.stats import chi2

    drive, own = (gain[pattern.good] for gain in gains)
    freedom = int(pattern.good.sum()) - pattern.parameters
    scatter = float((pattern.residual[pattern.good] ** 2 / drive).sum())
    share = float((own / drive).mean())
    variance, error = own_noise
    most = max(variance + SURE * error, 0.0) * share
    least = max(variance - SURE * error, 0.0) * share
    shown = variance * share if least > 0.0 else 0.0
    sigma = math.sqrt(max(scatter / freedom - shown, 0.0))
    low = math.sqrt(max(scatter / float(chi2.ppf(0.975, freedom)) - most, 0.0))
    high = math.sqrt(max(scatter / float(chi2.ppf(0.025, freedom)) - least, 0.0))
    floor = max(math.sqrt(shown), RESOLUTION)
    if low < RESOLUTION:
        low = 0.0
    if sigma < RESOLUTION:
        sigma = 0.0
    return sigma, low, max(high, RESOLUTION), floor
