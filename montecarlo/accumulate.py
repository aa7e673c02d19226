"""Mergeable central sums: moments and their standard errors from a stream of blocks, in flat memory."""

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from scene.compiled import jit

__all__ = ["COVARIANCE", "PAIR", "SINGLE", "CentralSums", "Orders", "pair_statistics", "single_statistics"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Orders = tuple[tuple[int, int], ...]

SINGLE: Orders = tuple((p, 0) for p in range(2, 9))
"""Orders for one variable: up to 8, for the standard error of the fourth cumulant needs the eighth moment."""

PAIR: Orders = tuple((p, q) for p in range(5) for q in range(5) if 2 <= p + q <= 4)
"""Orders for two variables: up to 4, for the standard error of a correlation needs the fourth."""

COVARIANCE: Orders = ((1, 1),)
"""A covariance alone."""

BINOMIAL = np.array([[comb(n, k) for k in range(9)] for n in range(9)], dtype=float)


@jit
def _means(v: Floats, seen: Bools, n: Floats) -> Floats:
    """Means of the cells over the rows that were seen, about the first of them: what does not vary comes out exact."""
    paths, cells = v.shape
    origin, total, begun = np.zeros(cells), np.zeros(cells), np.zeros(cells, np.bool_)
    for p in range(paths):
        for i in range(cells):
            if seen[p, i] and not begun[i]:
                origin[i], begun[i] = v[p, i], True
        if begun.all():
            break
    for p in range(paths):
        for i in range(cells):
            total[i] += v[p, i] - origin[i] if seen[p, i] else 0.0
    return origin + total / np.maximum(n, 1.0)


@jit
def _block_sums(a: Floats, b: Floats, exponents: Ints) -> tuple[Floats, Floats, Floats]:
    """Counts, means (2, cells) and sums of ``da^p db^q`` (orders, cells) over the rows where both are finite."""
    paths, cells = a.shape
    orders = len(exponents)
    most_a, most_b = exponents[:, 0].max(), exponents[:, 1].max()
    seen = np.isfinite(a) & np.isfinite(b)
    n = np.zeros(cells)
    for p in range(paths):
        for i in range(cells):
            n[i] += seen[p, i]
    mean, sums = np.empty((2, cells)), np.zeros((orders, cells))
    mean[0], mean[1] = _means(a, seen, n), _means(b, seen, n)
    power_a, power_b = np.ones((9, cells)), np.ones((9, cells))
    for p in range(paths):
        for i in range(cells):
            power_a[1, i] = a[p, i] - mean[0, i] if seen[p, i] else 0.0
            power_b[1, i] = b[p, i] - mean[1, i] if seen[p, i] else 0.0
        for k in range(1, most_a):
            for i in range(cells):
                power_a[k + 1, i] = power_a[k, i] * power_a[1, i]
        for k in range(1, most_b):
            for i in range(cells):
                power_b[k + 1, i] = power_b[k, i] * power_b[1, i]
        for o in range(orders):
            u, v, total = power_a[exponents[o, 0]], power_b[exponents[o, 1]], sums[o]
            for i in range(cells):
                total[i] += u[i] * v[i]
    return n, mean, sums


@jit
def _about(n: Floats, mean: Floats, sums: Floats, centre: Floats, exponents: Ints, place: Ints, out: Floats) -> None:
    """Add to `out` the sums of one part taken about another centre, by the binomial theorem."""
    for i in range(n.size):
        shift_a, shift_b = mean[0, i] - centre[0, i], mean[1, i] - centre[1, i]
        for o in range(len(exponents)):
            p, q = exponents[o]
            for j in range(p + 1):
                for k in range(q + 1):
                    if j + k == 1:
                        continue  # first powers about the own mean add up to zero
                    inner = n[i] if j + k == 0 else sums[place[j, k], i]
                    out[o, i] += BINOMIAL[p, j] * BINOMIAL[q, k] * shift_a ** (p - j) * shift_b ** (q - k) * inner


@dataclass(frozen=True)
class CentralSums:
    """Sums ``sum (a - mean_a)^p (b - mean_b)^q`` of two variables over observations, for many cells at once.

    Blocks are merged about the new mean (Pebay 2008), always in block order, so that the result does not depend on
    who computed which block.

    Attributes
    ----------
    orders : tuple of (p, q)
        Which sums are kept; with an order, all lower ones of degree 2 and more.
    n : ndarray
        Number of observations of each cell.
    mean : ndarray, shape (2, ...)
        Means of both variables.
    sums : ndarray, shape (orders, ...)
        The sums.

    Examples
    --------
    >>> x = np.arange(10.0)[:, None]
    >>> whole, parts = CentralSums.of(x, x, SINGLE), CentralSums.of(x[:4], x[:4], SINGLE)
    >>> parts = parts.merged(CentralSums.of(x[4:], x[4:], SINGLE))
    >>> bool(np.allclose(whole.sums, parts.sums))
    True
    """

    orders: Orders
    n: Floats
    mean: Floats
    sums: Floats

    @classmethod
    def of(cls, a: Floats, b: Floats, orders: Orders) -> "CentralSums":
        """Sums of one block; `a` and `b` have shape (paths, ...), and NaN marks what was never observed."""
        shape = a.shape[1:]
        flat_a, flat_b = (np.ascontiguousarray(v).reshape(len(v), -1) for v in (a, b))
        n, mean, sums = _block_sums(flat_a, flat_b, np.array(orders))
        return cls(orders, n.reshape(shape), mean.reshape(2, *shape), sums.reshape(len(orders), *shape))

    def merged(self, other: "CentralSums") -> "CentralSums":
        """The sums of both sets of observations together."""
        n = self.n + other.n
        weight = np.divide(other.n, n, out=np.zeros_like(n), where=n > 0)
        mean = self.mean + (other.mean - self.mean) * weight
        out = np.zeros((len(self.orders), n.size))
        place = np.zeros((9, 9), np.int64)
        for o, (p, q) in enumerate(self.orders):
            place[p, q] = o
        for part in (self, other):
            _about(
                part.n.ravel(), part.mean.reshape(2, -1), part.sums.reshape(len(self.orders), -1), mean.reshape(2, -1),
                np.array(self.orders), place, out,
            )  # fmt: skip
        return CentralSums(self.orders, n, mean, out.reshape(self.sums.shape))

    def moment(self, p: int, q: int) -> Floats:
        """Central moment ``E[(a - E a)^p (b - E b)^q]``; NaN where nothing was observed."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.sums[self.orders.index((p, q))] / self.n)


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
    """Mean, sd, skewness and excess kurtosis with standard errors, from sums over the orders `SINGLE`.

    Skewness and excess kurtosis are the third and fourth cumulants in units of the sd.  Standard errors are those
    of the influence functions (delta method); they hold for any distribution with eight moments.  What does not
    vary has sd 0 with error 0 and no skewness.
    """
    n = sums.n
    with np.errstate(invalid="ignore", divide="ignore"):
        m2 = sums.moment(2, 0)
        sd = np.sqrt(m2)
        z = [np.ones_like(n), np.zeros_like(n), np.ones_like(n)] + [sums.moment(p, 0) / sd**p for p in range(3, 9)]
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
    """Covariance and correlation of a pair with their standard errors, from sums over the orders `PAIR`.

    ``se_z`` is the standard error of Fisher's ``artanh rho``; it is ``1 / sqrt(n)`` for a Gaussian pair.
    """
    n = sums.n
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c = sums.moment(2, 0), sums.moment(0, 2), sums.moment(1, 1)
        rho = c / np.sqrt(a * b)
        root = np.sqrt(a * b)
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
            "se_z": se / (1.0 - rho**2),
        }
