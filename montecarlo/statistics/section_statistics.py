"""Moments of sections with their standard errors, and the bias of the step in them, from central
sums."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.scene import Floats, section_names
from rattle.scene.elementary import powers

Orders = tuple[tuple[int, int], ...]

Polynomial = Sequence[Floats | float]
"""Coefficients in ascending order."""

Pairs = Sequence[tuple[int, int]]
"""Places of two variables each."""

SectionColumns = Mapping[str, NDArray[Any]]
"""The columns of a table of section moments by name; (impacts,) each."""

SINGLE: Orders = tuple((p, 0) for p in range(2, 9))
"""Orders for one variable: up to 8, for the standard error of the fourth cumulant needs the eighth
moment."""

PAIR: Orders = tuple((p, q) for p in range(5) for q in range(5) if 2 <= p + q <= 4)
"""Orders for two variables: up to 4, for the standard error of a correlation needs the fourth."""


def undefined() -> np.errstate:
    """A context without warnings where what few observations leave undefined becomes NaN."""
    return np.errstate(invalid="ignore", divide="ignore")


def ratio_or_zero(a: NDArray[Any], b: Floats) -> Floats:
    """``a / b``; 0 where b is zero."""
    ratio: Floats = np.divide(a, b, out=np.zeros_like(b), where=b != 0.0)
    return ratio


class Summed(Protocol):
    """Central sums of one variable or two, for many cells at once, whoever has summed."""

    @property
    def n(self) -> Floats:
        """Observations of each cell."""

    @property
    def mean(self) -> Floats:
        """Means of both variables; (2, ...)."""

    def moment(self, p: int, q: int) -> Floats:
        """Central moment ``E[(a - E a)^p (b - E b)^q]``, without bias correction."""


# smallest normal float; smaller ones have fewer digits
SMALLEST_NORMAL = float(np.finfo(float).tiny)

FEWEST_FOR_ERROR = {"mean": 2, "sd": 3, "cov": 3, "rho": 3, "skew": 3, "kurt": 4}
"""Least number of paths from which the standard error of a statistic can be estimated.

With fewer, the statistic or its error is a constant whatever the data: the sd of one value is 0,
two values have equal squared deviations and a correlation of +-1, and the kurtosis of three values
is 1.5.
"""


def quantities_in(columns: Mapping[str, Any]) -> tuple[str, ...]:
    """The section quantities of a table of moments."""
    wheels = sum(name[0] == "x" and name[1:].isdigit() for name in map(str, columns))
    return section_names(wheels)


def quantity_at(place: int) -> str:
    """The section quantity at a place among them, which is the same for any number of wheels."""
    return section_names(place)[place]


def stack_section(columns: SectionColumns, prefix: str = "") -> Floats:
    """The columns of all section quantities whose names have a prefix.

    Shapes: `columns` (impacts,); result (quantities, impacts).
    """
    return np.array([columns[prefix + q] for q in quantities_in(columns)], dtype=float)


def variance_of(coefficients: Polynomial, moments: Polynomial | Floats) -> Floats:
    """Variance of a polynomial in a standardised variable, coefficients in ascending order, given
    its moments."""
    square: Floats | float = 0.0
    mean: Floats | float = 0.0
    for i, a in enumerate(coefficients):
        mean = mean + a * moments[i]
        for j, b in enumerate(coefficients):
            square = square + a * b * moments[i + j]
    return np.maximum(square - np.square(mean), 0.0)


def mean_statistics(sums: Summed) -> dict[str, Floats]:
    """Mean of the first variable with its standard error."""
    with undefined():
        se = np.sqrt(sums.moment(2, 0) / sums.n)
    return {"mean": np.where(sums.n > 0, sums.mean[0], np.nan), "se_mean": se}


def single_statistics(sums: Summed) -> dict[str, Floats]:
    """Mean, sd, skewness and excess kurtosis with standard errors.

    Skewness and excess kurtosis are the third and fourth cumulants in units of the sd.  Standard
    errors come from the influence functions (delta method) and hold for any distribution with eight
    moments.  A constant has sd 0 with error 0 and no skewness.  ``se_skew`` and ``se_kurt`` are NaN
    where the sixth and the eighth power of the sd underflow: below about 1e-51 and 1e-38.
    """
    n = sums.n
    with undefined():
        m2 = sums.moment(2, 0)
        sd = np.sqrt(m2)
        unit = powers(sd, 8)
        higher = [sums.moment(p, 0) / unit[p] for p in range(3, 9)]
        z: Polynomial = [1.0, 0.0, 1.0, *higher]
        skew = higher[0]
        kurt = higher[1]
        # z^3 - 3 z - 3/2 g (z^2 - 1)
        influence_skew: Polynomial = [1.5 * skew, -3.0, -1.5 * skew, 1.0]
        # z^4 - 4 g z - 2 k (z^2 - 1)
        influence_kurt: Polynomial = [2.0 * kurt, -4.0 * skew, -2.0 * kurt, 0.0, 1.0]
        fourth = sums.moment(4, 0)
        return {
            "mean": np.where(n > 0, sums.mean[0], np.nan),
            "se_mean": sd / np.sqrt(n),
            "sd": sd,
            "se_sd": np.where(
                sd > 0.0, np.sqrt(np.maximum(fourth - m2**2, 0.0) / n) / (2.0 * sd), 0.0 * sd
            ),
            "skew": skew,
            "se_skew": np.sqrt(variance_of(influence_skew, z) / n),
            "kurt": kurt - 3.0,
            "se_kurt": np.sqrt(variance_of(influence_kurt, z) / n),
        }


def pair_statistics(sums: Summed) -> dict[str, Floats]:
    """Covariance and correlation of a pair with their standard errors.

    ``se_z`` is the standard error of Fisher's ``artanh rho``; it is ``1 / sqrt(n)`` for a Gaussian
    pair, and NaN where ``|rho| = 1``.  The correlation and its errors are NaN where the product of
    the variances underflows.
    """
    n = sums.n
    with undefined():
        a = sums.moment(2, 0)
        b = sums.moment(0, 2)
        c = sums.moment(1, 1)
        root = np.sqrt(np.where(a * b >= SMALLEST_NORMAL, a * b, np.nan))
        rho = np.clip(c / root, -1.0, 1.0)  # rounding can pass 1
        m22 = sums.moment(2, 2) / (a * b)
        m31 = sums.moment(3, 1) / (a * root)
        m13 = sums.moment(1, 3) / (b * root)
        m40 = sums.moment(4, 0) / a**2
        m04 = sums.moment(0, 4) / b**2
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


# standard errors by which changes must fall more slowly than first order, to be taken for slow
BEYOND = 3.0
SLOW_RATIO = (
    2.0**0.9
    # ratio of two changes below which they are; above it is first order with a remainder of second
    # order
)
SLOWEST_RATIO = 2.0**0.5
"""Ratio that is assumed of changes that fall more slowly still, or turn their sign.  The half order
of impacts that a discrete path misses is the slowest that is known; beside first order it leaves as
much at any ratio."""


class StepBias(NamedTuple):
    """Step bias of a moment; each entry has shape (impacts, quantities)."""

    # bias, se_bias: first-order estimate of (value at dt) - (limit dt -> 0), the change from dt to
    # 2 dt; its standard error
    bias: Floats
    se_bias: Floats
    # corrected, se_corrected: richardson extrapolation, value - bias; its standard error
    corrected: Floats
    se_corrected: Floats
    # estimate of the error left: the difference to the same extrapolation from 2 dt and 4 dt, over
    # ``2^p - 1``.  The error left is of second order (p = 2), as means settle at first order; where
    # the changes of an sd fall more slowly, beyond noise, p is the slope that they have, 1/2 at
    # least (`rattle check order`: docs/theory/schemes.md)
    rest: Floats


def extrapolate(fine: Summed, coarse: Summed) -> dict[str, StepBias]:
    """Step bias of the means and of the sds.

    `fine`, `coarse`: Joint sums of the same quantities at dt and 2 dt, and at 2 dt and 4 dt.
    """
    n = np.where(fine.n > 0, fine.n, np.nan)
    v = {(p, q): fine.moment(p, q) for p, q in ((2, 0), (1, 1), (0, 2), (4, 0), (2, 2), (0, 4))}
    sd = np.sqrt(np.stack([v[2, 0], v[0, 2], coarse.moment(0, 2)]))
    means = np.stack([fine.mean[0], fine.mean[1], coarse.mean[1]])
    # (co)variances of the influence functions at dt and 2 dt: var(dt), cov, var(2 dt), of the means
    # and of the sds
    spread = ([v[2, 0], v[1, 1], v[0, 2]], sd_influence(v, sd[0], sd[1]))
    biases = {}
    for moment, values, (ff, fc, cc) in (("mean", means, spread[0]), ("sd", sd, spread[1])):
        values = np.where(fine.n > 0, values, np.nan)
        bias = values[1] - values[0]
        se = np.sqrt(np.maximum(ff - 2.0 * fc + cc, 0.0) / n)
        before = values[2] - values[1]
        se_corrected = np.sqrt(np.maximum(4.0 * ff - 4.0 * fc + cc, 0.0) / n)
        rest = (
            estimate_remainder(bias, before, se)
            if moment == "sd"
            else np.abs(2.0 * bias - before) / 3.0
        )
        biases[moment] = StepBias(bias, se, values[0] - bias, se_corrected, rest)
    return biases


def estimate_remainder(change: Floats, before: Floats, se: Floats) -> Floats:
    """Estimate the error that first-order extrapolation leaves.

    `change`, `before`: Change of a value from dt to 2 dt, and from 2 dt to 4 dt. `se`: Standard
    error of `change`; that of ``2 change - before`` is taken to be three times as large, as the
    earlier change has about twice the error.
    """
    missing = 2.0 * change - before
    with undefined():
        ratio = before / change
        slow = (np.abs(missing) > 3.0 * BEYOND * se) & (ratio < SLOW_RATIO)
    return np.abs(missing) / (np.where(slow, np.maximum(ratio, SLOWEST_RATIO), 4.0) - 1.0)


def sd_influence(v: Mapping[tuple[int, int], Floats], a: Floats, b: Floats) -> list[Floats]:
    """Variances and covariance of the influence functions ``((u - E u)^2 - a^2) / 2a`` of two
    sds."""
    with undefined():
        parts = [
            (v[4, 0] - v[2, 0] ** 2) / (4.0 * a * a),
            (v[2, 2] - v[2, 0] * v[0, 2]) / (4.0 * a * b),
            (v[0, 4] - v[0, 2] ** 2) / (4.0 * b * b),
        ]
    return [np.where((a > 0.0) & (b > 0.0), p, 0.0) for p in parts]
