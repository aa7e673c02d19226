"""Means, sds, skewnesses, kurtoses, covariances and correlations with their standard errors, from central sums."""

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.statistics.central_sums import CentralSums
from rattle.scene.elementary import powers

Floats = NDArray[np.float64]

TINY = float(np.finfo(float).tiny)  # smallest normal float; smaller ones have fewer digits

FEWEST = {"mean": 2, "sd": 3, "cov": 3, "rho": 3, "skew": 3, "kurt": 4}
"""Least number of paths from which the standard error of a statistic can be estimated.

With fewer, the statistic or its error is a constant whatever the data: the sd of one value is 0, two values have equal
squared deviations and a correlation of +-1, and the kurtosis of three values is 1.5.
"""


def _variance_of(coefficients: list[Floats], moments: list[Floats]) -> Floats:
    """Variance of a polynomial in a standardised variable, coefficients in ascending order, given its moments."""
    square: Floats | float = 0.0
    mean: Floats | float = 0.0
    for i, a in enumerate(coefficients):
        mean = mean + a * moments[i]
        for j, b in enumerate(coefficients):
            square = square + a * b * moments[i + j]
    return np.maximum(square - np.square(mean), 0.0)


def single_statistics(sums: CentralSums) -> dict[str, Floats]:
    """Mean, sd, skewness and excess kurtosis with standard errors.

    Skewness and excess kurtosis are the third and fourth cumulants in units of the sd.  Standard errors come from the
    influence functions (delta method) and hold for any distribution with eight moments.  A constant has sd 0 with error
    0 and no skewness.  ``se_skew`` and ``se_kurt`` are NaN where the sixth and the eighth power of the sd underflow:
    below about 1e-51 and 1e-38.
    """
    n = sums.n
    with np.errstate(invalid="ignore", divide="ignore"):
        m2 = sums.moment(2, 0)
        sd = np.sqrt(m2)
        unit = powers(sd, 8)
        z = [np.ones_like(n), np.zeros_like(n), np.ones_like(n)] + [sums.moment(p, 0) / unit[p] for p in range(3, 9)]
        skew, kurt = z[3], z[4]
        one, nil = np.ones_like(n), np.zeros_like(n)
        influence_skew = [1.5 * skew, -3.0 * one, -1.5 * skew, one]  # z^3 - 3 z - 3/2 g (z^2 - 1)
        influence_kurt = [2.0 * kurt, -4.0 * skew, -2.0 * kurt, nil, one]  # z^4 - 4 g z - 2 k (z^2 - 1)
        fourth = sums.moment(4, 0)
        return {
            "mean": np.where(n > 0, sums.mean[0], np.nan),
            "se_mean": sd / np.sqrt(n),
            "sd": sd,
            "se_sd": np.where(sd > 0.0, np.sqrt(np.maximum(fourth - m2**2, 0.0) / n) / (2.0 * sd), 0.0 * sd),
            "skew": skew,
            "se_skew": np.sqrt(_variance_of(influence_skew, z) / n),
            "kurt": kurt - 3.0,
            "se_kurt": np.sqrt(_variance_of(influence_kurt, z) / n),
        }


def pair_statistics(sums: CentralSums) -> dict[str, Floats]:
    """Covariance and correlation of a pair with their standard errors.

    ``se_z`` is the standard error of Fisher's ``artanh rho``; it is ``1 / sqrt(n)`` for a Gaussian pair, and NaN where
    ``|rho| = 1``.  The correlation and its errors are NaN where the product of the variances underflows.
    """
    n = sums.n
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c = sums.moment(2, 0), sums.moment(0, 2), sums.moment(1, 1)
        root = np.sqrt(np.where(a * b >= TINY, a * b, np.nan))
        rho = np.clip(c / root, -1.0, 1.0)  # rounding can pass 1
        m22, m31, m13 = sums.moment(2, 2) / (a * b), sums.moment(3, 1) / (a * root), sums.moment(1, 3) / (b * root)
        m40, m04 = sums.moment(4, 0) / a**2, sums.moment(0, 4) / b**2
        # influence function u v - rho (u^2 + v^2) / 2 of a correlation, u and v standardised
        variance = m22 - rho * (m31 + m13) + rho**2 * (m40 + 2.0 * m22 + m04) / 4.0
        se = np.sqrt(np.maximum(variance, 0.0) / n)
        return {
            "cov": c,
            "se_cov": np.sqrt(np.maximum(sums.moment(2, 2) - c**2, 0.0) / n),
            "rho": rho,
            "se_rho": se,
            "se_z": np.where(np.abs(rho) < 1.0, se / (1.0 - rho**2), np.nan),
        }
