"""Mergeable central sums: moments and their standard errors from a stream of blocks, in constant memory."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import lean
from rattle.scene.elementary import powers
from rattle.scene.instructions import widest_vectors

__all__ = [
    "COVARIANCE",
    "FEWEST",
    "PAIR",
    "SINGLE",
    "VARIANCE",
    "CentralSums",
    "Orders",
    "columns_of",
    "pair_statistics",
    "single_statistics",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Orders = tuple[tuple[int, int], ...]

SINGLE: Orders = tuple((p, 0) for p in range(2, 9))
"""Orders for one variable: up to 8, for the standard error of the fourth cumulant needs the eighth moment."""

PAIR: Orders = tuple((p, q) for p in range(5) for q in range(5) if 2 <= p + q <= 4)
"""Orders for two variables: up to 4, for the standard error of a correlation needs the fourth."""

COVARIANCE: Orders = ((1, 1),)
"""A covariance alone."""

VARIANCE: Orders = ((2, 0),)
"""A variance alone."""

TINY = float(np.finfo(float).tiny)  # smallest normal float; smaller ones have fewer digits
FEWEST = {"mean": 2, "sd": 3, "cov": 3, "rho": 3, "skew": 3, "kurt": 4}
"""Least number of paths from which the standard error of a statistic can be estimated.

With fewer, the statistic or its error is a constant whatever the data: the sd of one value is 0, two values have equal
squared deviations and a correlation of +-1, and the kurtosis of three values is 1.5.
"""

STRAND = 64  # numbers of paths are filled up to a multiple of it: eight strands of whole vectors

BINOMIAL = np.array([[comb(n, k) for k in range(9)] for n in range(9)], dtype=float)  # [n, k] = n over k


@lean
def _transpose(rows: Floats, columns: Floats) -> None:
    """Copy `rows`, shape (paths, variables), to `columns`, shape (variables, paths), eight paths at a time."""
    paths, variables = rows.shape
    whole = paths // 8 * 8
    for p in range(0, whole, 8):
        a, b, c, d, e, f, g, h = (
            rows[p], rows[p + 1], rows[p + 2], rows[p + 3], rows[p + 4], rows[p + 5], rows[p + 6], rows[p + 7]
        )  # fmt: skip
        for i in range(variables):
            out = columns[i][p : p + 8]
            out[0], out[1], out[2], out[3] = a[i], b[i], c[i], d[i]
            out[4], out[5], out[6], out[7] = e[i], f[i], g[i], h[i]
    for p in range(whole, paths):
        for i in range(variables):
            columns[i, p] = rows[p, i]


@lean
def _folded(x: Floats, n: int) -> float:
    """Sum of the first n numbers of an array, n a multiple of 8, which is overwritten.

    The order of summation is that of the source, whatever the width of the processor's vectors: eight strands, added in
    pairs, then one after another.
    """
    widest_vectors()
    m = n // 8
    a, b, c, d = x[:m], x[m : 2 * m], x[2 * m : 3 * m], x[3 * m : 4 * m]
    e, f, g, h = x[4 * m : 5 * m], x[5 * m : 6 * m], x[6 * m : 7 * m], x[7 * m : 8 * m]
    for i in range(m):
        a[i] = ((a[i] + b[i]) + (c[i] + d[i])) + ((e[i] + f[i]) + (g[i] + h[i]))
    total = 0.0
    for i in range(m):
        total += a[i]
    return total


@lean
def _sum(u: Floats, room: Floats) -> float:
    """Sum of numbers in a fixed order; their number is a multiple of `STRAND`, and `room` has an eighth of it."""
    widest_vectors()
    n = u.size // 8
    a, b, c, d = u[:n], u[n : 2 * n], u[2 * n : 3 * n], u[3 * n : 4 * n]
    e, f, g, h = u[4 * n : 5 * n], u[5 * n : 6 * n], u[6 * n : 7 * n], u[7 * n : 8 * n]
    for i in range(n):
        room[i] = ((a[i] + b[i]) + (c[i] + d[i])) + ((e[i] + f[i]) + (g[i] + h[i]))
    return _folded(room, n)


@lean
def _product_sum(u: Floats, v: Floats, room: Floats) -> float:
    """Sum of products in the order of `_sum`."""
    widest_vectors()
    n = u.size // 8
    a, b, c, d = u[:n], u[n : 2 * n], u[2 * n : 3 * n], u[3 * n : 4 * n]
    e, f, g, h = u[4 * n : 5 * n], u[5 * n : 6 * n], u[6 * n : 7 * n], u[7 * n : 8 * n]
    a2, b2, c2, d2 = v[:n], v[n : 2 * n], v[2 * n : 3 * n], v[3 * n : 4 * n]
    e2, f2, g2, h2 = v[4 * n : 5 * n], v[5 * n : 6 * n], v[6 * n : 7 * n], v[7 * n : 8 * n]
    for i in range(n):
        room[i] = ((a[i] * a2[i] + b[i] * b2[i]) + (c[i] * c2[i] + d[i] * d2[i])) + (
            (e[i] * e2[i] + f[i] * f2[i]) + (g[i] * g2[i] + h[i] * h2[i])
        )
    return _folded(room, n)


@lean
def _power_sums(d: Floats, room: Floats, sums: Floats) -> None:
    """Sums of ``d^2`` to ``d^8`` in a fixed order; `room` has seven rows, each an eighth as long as d."""
    widest_vectors()
    n = d.size // 8
    s2, s3, s4, s5, s6, s7, s8 = room[0], room[1], room[2], room[3], room[4], room[5], room[6]
    for i in range(n):
        s2[i], s3[i], s4[i], s5[i], s6[i], s7[i], s8[i] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(8):
        part = d[k * n : (k + 1) * n]
        for i in range(n):
            x = part[i]
            square = x * x
            cube, fourth = square * x, square * square
            s2[i] += square
            s3[i] += cube
            s4[i] += fourth
            s5[i] += fourth * x
            s6[i] += fourth * square
            s7[i] += fourth * cube
            s8[i] += fourth * fourth
    for o in range(7):
        sums[o] = _folded(room[o], n)


@lean
def _first_seen(u: Floats, v: Floats) -> int:
    """Index of the first path where both variables are finite; the last if there is none."""
    for p in range(u.size):
        if np.isfinite(u[p]) and np.isfinite(v[p]):
            return p
    return u.size - 1


@lean
def _centred(u: Floats, v: Floats, da: Floats, db: Floats, room: Floats) -> tuple[float, float, float]:
    """Deviations of both variables from their means, 0 where either is not finite; the count and the means.

    Means are taken about the first value, so that a constant comes out exact.
    """
    widest_vectors()
    origin = _first_seen(u, v)
    first_u, first_v, count = u[origin], v[origin], 0
    for p in range(u.size):
        seen = np.isfinite(u[p]) & np.isfinite(v[p])
        da[p], db[p] = u[p] - first_u if seen else 0.0, v[p] - first_v if seen else 0.0
        count += seen
    if count == 0:
        return 0.0, 0.0, 0.0
    shift_u, shift_v = _sum(da, room) / count, _sum(db, room) / count
    for p in range(u.size):
        seen = np.isfinite(u[p]) & np.isfinite(v[p])
        da[p] -= shift_u if seen else 0.0
        db[p] -= shift_v if seen else 0.0
    return float(count), first_u + shift_u, first_v + shift_v


@lean
def _block_sums(
    a: Floats, b: Floats, left: Ints, right: Ints, exponents: Ints, most: Ints, powers: Floats, room: Floats, n: Floats,
    mean: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Counts (cells), means (2, cells) and sums of ``da^p db^q`` (orders, cells) over the paths where both are finite.

    Cell i pairs row ``left[i]`` of `a` with row ``right[i]`` of `b`, both of shape (variables, paths).  The scratch
    `powers` has shape (2, largest exponent + 1, paths) and is filled with ones; `most` are the largest exponents of
    both sides.
    """
    widest_vectors()
    for i in range(left.size):
        n[i], mean[0, i], mean[1, i] = _centred(a[left[i]], b[right[i]], powers[0, 1], powers[1, 1], room[0])
        for side in range(2):
            for k in range(1, most[side]):
                lower, once, higher = powers[side, k], powers[side, 1], powers[side, k + 1]
                for p in range(lower.size):
                    higher[p] = lower[p] * once[p]
        for o in range(len(exponents)):
            sums[o, i] = _product_sum(powers[0, exponents[o, 0]], powers[1, exponents[o, 1]], room[0])


@lean
def _observed_together(
    columns: Floats, own: Ints, pairs: Ints, deviations: Floats, room: Floats, n: Floats, mean: Floats, single: Floats,
    pair_n: Floats, pair_mean: Floats, products: Floats,
) -> None:  # fmt: skip
    """The sums of `CentralSums.of_groups`, group by group: arrays of shape (groups, ...), (groups, 2, ...) for means.

    Deviations of a group's variables, shape (variables + 1, paths), serve its single sums and its pairs.
    """
    spare = len(own)
    for g in range(len(n)):
        base = g * (columns.shape[0] // len(n))
        for i in range(len(own)):
            u = columns[base + own[i]]
            n[g, i], mean[g, 0, i], mean[g, 1, i] = _centred(u, u, deviations[i], deviations[spare], room[0])
            _power_sums(deviations[i], room, single[g, i])
        for j in range(len(pairs)):
            first, second = pairs[j]
            pair_n[g, j], pair_mean[g, 0, j], pair_mean[g, 1, j] = n[g, first], mean[g, 0, first], mean[g, 0, second]
            products[g, j] = _product_sum(deviations[first], deviations[second], room[0])


@lean
def _about(
    n: Floats, mean: Floats, sums: Floats, centre: Floats, exponents: Ints, place: Ints, powers: Floats, out: Floats
) -> None:
    """Add to `out` the sums of one part, shifted to another centre by the binomial theorem (scratch `powers`)."""
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
                        continue  # deviations from a part's own mean sum to zero
                    inner = n[i] if j + k == 0 else sums[place[j, k], i]
                    out[o, i] += BINOMIAL[p, j] * BINOMIAL[q, k] * powers[0, p - j] * powers[1, q - k] * inner


def columns_of(values: Floats) -> Floats:
    """A block's values with the paths of each variable contiguous.

    Parameters
    ----------
    values : ndarray, shape (paths, ...)
        The axes after the first are flattened to variables.

    Returns
    -------
    ndarray, shape (variables, paths)
        Filled up with NaN to a multiple of `STRAND` paths.
    """
    rows = np.ascontiguousarray(values, dtype=float).reshape(len(values), -1)
    lanes = -(-len(rows) // STRAND) * STRAND
    lanes += STRAND if lanes % 512 == 0 else 0  # so that columns do not share lines of the cache
    columns = np.empty((rows.shape[1], lanes))
    columns[:, len(rows) :] = np.nan
    _transpose(rows, columns)
    return columns


def _room(columns: Floats) -> Floats:
    """Scratch of the sums over the paths of some columns."""
    return np.empty((len(SINGLE), columns.shape[1] // 8))


@dataclass(frozen=True)
class CentralSums:
    """Sums ``sum (a - mean_a)^p (b - mean_b)^q`` of two variables over observations, for many cells at once.

    Blocks are merged about the joint mean (Pebay 2008), always in block order, so that the result does not depend on
    the worker that computed a block.

    Attributes
    ----------
    orders : tuple of (p, q)
        Exponents of the sums that are kept; with each, all lower ones of degree 2 and more.
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
        """Sums of one block of paths.

        Parameters
        ----------
        a, b : ndarray, shape (paths, ...)
            The two variables of each cell; NaN marks a missing observation.
        orders : tuple of (p, q)
            Exponents.

        Returns
        -------
        CentralSums
            Cells of shape ``a.shape[1:]``.
        """
        cells = np.arange(a[0].size)
        return cls.of_columns(columns_of(a), columns_of(b), cells, cells, orders, a.shape[1:])

    @classmethod
    def of_columns(
        cls, a: Floats, b: Floats, left: Ints, right: Ints, orders: Orders, shape: tuple[int, ...]
    ) -> "CentralSums":
        """Sums of one block of paths, each cell over one variable of `a` and one of `b`.

        Parameters
        ----------
        a, b : ndarray, shape (variables, paths)
            As of `columns_of`.
        left, right : ndarray of int, shape (cells,)
            Variable of `a` and of `b` of each cell.
        orders : tuple of (p, q)
            Exponents.
        shape : tuple of int
            Shape of the cells in the result.

        Returns
        -------
        CentralSums
        """
        n, mean, sums = np.empty(left.size), np.empty((2, left.size)), np.empty((len(orders), left.size))
        exponents = np.array(orders)
        powers = np.ones((2, int(exponents.max()) + 1, a.shape[1]))
        _block_sums(a, b, left, right, exponents, exponents.max(axis=0), powers, _room(a), n, mean, sums)
        return cls(orders, n.reshape(shape), mean.reshape(2, *shape), sums.reshape(len(orders), *shape))

    @classmethod
    def of_groups(
        cls, columns: Floats, groups: int, own: Sequence[int], pairs: Sequence[tuple[int, int]]
    ) -> "tuple[CentralSums, CentralSums]":
        """Sums of single variables, and of pairs of them, that are observed together: in a path all of a group or none.

        Parameters
        ----------
        columns : ndarray, shape (groups * variables, paths)
            As of `columns_of`.
        groups : int
            Number of groups.
        own : sequence of int
            The variables of a group.
        pairs : sequence of (int, int)
            Pairs among them, by their place in `own`.

        Returns
        -------
        single, pairs : CentralSums
            Over the orders `SINGLE`, shape (groups, own), and `COVARIANCE`, shape (groups, pairs).
        """
        ones, twos = (groups, len(own)), (groups, len(pairs))
        n, mean, single = np.empty(ones), np.empty((groups, 2, len(own))), np.empty((*ones, len(SINGLE)))
        pair_n, pair_mean, products = np.empty(twos), np.empty((groups, 2, len(pairs))), np.empty(twos)
        deviations = np.empty((len(own) + 1, columns.shape[1]))
        _observed_together(
            columns, np.array(own), np.array(pairs), deviations, _room(columns), n, mean, single, pair_n, pair_mean,
            products,
        )  # fmt: skip
        return (
            cls(SINGLE, n, mean.swapaxes(0, 1).copy(), np.moveaxis(single, -1, 0).copy()),
            cls(COVARIANCE, pair_n, pair_mean.swapaxes(0, 1).copy(), products[None]),
        )

    def merged(self, other: "CentralSums") -> "CentralSums":
        """The sums over two sets of observations together.

        Parameters
        ----------
        other : CentralSums
            Of the same orders and shape.

        Returns
        -------
        CentralSums
        """
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
        """Central moment ``E[(a - E a)^p (b - E b)^q]``, without bias correction.

        Parameters
        ----------
        p, q : int
            Exponents, one of `orders`.

        Returns
        -------
        ndarray
            Of the cells' shape; NaN where nothing was observed.
        """
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
    """Mean, sd, skewness and excess kurtosis with standard errors.

    Skewness and excess kurtosis are the third and fourth cumulants in units of the sd.  Standard errors come from the
    influence functions (delta method) and hold for any distribution with eight moments.  A constant has sd 0 with error
    0 and no skewness.  ``se_skew`` and ``se_kurt`` are NaN where the sixth and the eighth power of the sd underflow:
    below about 1e-51 and 1e-38.

    Parameters
    ----------
    sums : CentralSums
        Over the orders `SINGLE`.

    Returns
    -------
    dict of str to ndarray
        ``mean, sd, skew, kurt``, each with ``se_...``; of the cells' shape.
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

    Parameters
    ----------
    sums : CentralSums
        Over the orders `PAIR`.

    Returns
    -------
    dict of str to ndarray
        ``cov, se_cov, rho, se_rho, se_z``; of the cells' shape.
    """
    n = sums.n
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c = sums.moment(2, 0), sums.moment(0, 2), sums.moment(1, 1)
        root = np.sqrt(np.where(a * b >= TINY, a * b, np.nan))
        rho = c / root
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
