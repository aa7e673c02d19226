"""Mergeable central sums: moments and their standard errors from a stream of blocks, in flat memory."""

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from scene.compiled import jit

__all__ = [
    "COVARIANCE", "PAIR", "SINGLE", "VARIANCE", "CentralSums", "Orders", "pair_statistics", "single_statistics",
]  # fmt: skip

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

VARIANCE: Orders = ((2, 0),)
"""A variance alone."""

BINOMIAL = np.array([[comb(n, k) for k in range(9)] for n in range(9)], dtype=float)


@jit
def _means(v: Floats, columns: Ints, seen: Bools, n: Floats, total: Floats, mean: Floats) -> None:
    """Means of the cells over the rows that were seen, about the first of them: what does not vary comes out exact."""
    cells = columns.size
    for i in range(cells):
        total[i], mean[i] = 0.0, 0.0
        for p in range(len(v)):
            if len(seen) == 0 or seen[p, i]:
                mean[i] = v[p, columns[i]]
                break
    for p in range(len(v)):
        if len(seen) == 0:
            for i in range(cells):
                total[i] += v[p, columns[i]] - mean[i]
        else:
            for i in range(cells):
                total[i] += v[p, columns[i]] - mean[i] if seen[p, i] else 0.0
    for i in range(cells):
        mean[i] += total[i] / max(n[i], 1.0)


@jit
def _add_powers(da: Floats, power: Floats, sums: Floats) -> None:
    """Add ``da^2, da^3, ...`` to the rows of `sums`."""
    cells = da.size
    for i in range(cells):
        power[i] = da[i]
    for o in range(len(sums)):
        total = sums[o]
        for i in range(cells):
            power[i] *= da[i]
            total[i] += power[i]


@jit
def _add_products(da: Floats, db: Floats, exponents: Ints, most: tuple[int, int], powers: Floats, sums: Floats) -> None:
    """Add ``da^p db^q`` of all exponents to the rows of `sums`; scratch `powers`, shape (2, 9, cells)."""
    cells = da.size
    for side in range(2):
        own, base = powers[side], da if side == 0 else db
        for i in range(cells):
            own[1, i] = base[i]
        for k in range(1, most[side]):
            for i in range(cells):
                own[k + 1, i] = own[k, i] * base[i]
    for o in range(len(exponents)):
        u, w, total = powers[0, exponents[o, 0]], powers[1, exponents[o, 1]], sums[o]
        for i in range(cells):
            total[i] += u[i] * w[i]


@jit
def _block_sums(
    a: Floats, b: Floats, left: Ints, right: Ints, exponents: Ints, seen: Bools, n: Floats, scratch: Floats,
    mean: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Means (2, cells) and sums of ``da^p db^q`` (orders, cells) over the rows where both are finite.

    Cell i is about the columns ``left[i]`` of `a` and ``right[i]`` of `b`, both of shape (paths, columns).
    Exponents of one variable alone are 2, 3, 4, ... in this order.  `seen` is empty where everything was seen;
    `scratch` has shape (4, 9, cells), and ones in it.
    """
    cells, most_a, most_b = left.size, 0, 0
    for o in range(len(exponents)):
        most_a, most_b = max(most_a, exponents[o, 0]), max(most_b, exponents[o, 1])
    alone = most_b == 0
    da, db, powers = scratch[2, 0], scratch[3, 0], scratch[:2]
    _means(a, left, seen, n, da, mean[0])
    _means(b, right, seen, n, da, mean[1])
    for p in range(len(a)):
        for i in range(cells):
            da[i] = a[p, left[i]] - mean[0, i]
        if not alone:
            for i in range(cells):
                db[i] = b[p, right[i]] - mean[1, i]
        if len(seen) > 0:
            for i in range(cells):
                if not seen[p, i]:
                    da[i] = db[i] = 0.0
        if alone:
            _add_powers(da, db, sums)
        else:
            _add_products(da, db, exponents, (most_a, most_b), powers, sums)


@jit
def _about(
    n: Floats, mean: Floats, sums: Floats, centre: Floats, exponents: Ints, place: Ints, powers: Floats, out: Floats
) -> None:
    """Add to `out` the sums of one part taken about another centre, by the binomial theorem (scratch `powers`)."""
    for i in range(n.size):
        for side in range(2):
            shift = mean[side, i] - centre[side, i]
            powers[side, 0] = 1.0
            for k in range(1, 9):
                powers[side, k] = powers[side, k - 1] * shift
        for o in range(len(exponents)):
            p, q = exponents[o]
            for j in range(p + 1):
                for k in range(q + 1):
                    if j + k == 1:
                        continue  # first powers about the own mean add up to zero
                    inner = n[i] if j + k == 0 else sums[place[j, k], i]
                    out[o, i] += BINOMIAL[p, j] * BINOMIAL[q, k] * powers[0, p - j] * powers[1, q - k] * inner


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
        cells = np.arange(a[0].size)
        return cls.of_columns(a.reshape(len(a), -1), b.reshape(len(b), -1), cells, cells, orders, a.shape[1:])

    @classmethod
    def of_columns(
        cls, a: Floats, b: Floats, left: Ints, right: Ints, orders: Orders, shape: tuple[int, ...]
    ) -> "CentralSums":
        """Sums of one block over cells of this shape, each about one column of `a` and one of `b`."""
        cells = left.size
        finite_a = np.isfinite(a)
        finite_b = finite_a if b is a else np.isfinite(b)
        seen, n = np.empty((0, cells), np.bool_), np.full(cells, float(len(a)))
        if not (finite_a.all() and finite_b.all()):
            seen = finite_a[:, left] & finite_b[:, right]
            n = seen.sum(axis=0, dtype=float)
        mean, sums = np.empty((2, cells)), np.zeros((len(orders), cells))
        _block_sums(a, b, left, right, np.array(orders), seen, n, np.ones((4, 9, cells)), mean, sums)
        return cls(orders, n.reshape(shape), mean.reshape(2, *shape), sums.reshape(len(orders), *shape))

    def merged(self, other: "CentralSums") -> "CentralSums":
        """The sums of both sets of observations together."""
        n = self.n + other.n
        weight = np.divide(other.n, n, out=np.zeros_like(n), where=n > 0)
        mean = self.mean + (other.mean - self.mean) * weight
        out = np.zeros((len(self.orders), n.size))
        place, powers = np.zeros((9, 9), np.int64), np.empty((2, 9))
        for o, (p, q) in enumerate(self.orders):
            place[p, q] = o
        for part in (self, other):
            _about(
                part.n.ravel(), part.mean.reshape(2, -1), part.sums.reshape(len(self.orders), -1), mean.reshape(2, -1),
                np.array(self.orders), place, powers, out,
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
