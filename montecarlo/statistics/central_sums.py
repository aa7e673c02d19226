"""Mergeable central sums over a stream of blocks of paths, in constant memory.

Sums over the paths of a block are taken in an order that the source fixes, whatever the width of
the processor's vectors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from rattle.montecarlo.statistics.section_statistics import SINGLE, Orders
from rattle.scene import Floats, Ints
from rattle.scene.compiled import inline, lean, lean_internal, widest_vectors

Strands = tuple[Floats, ...]

COVARIANCE: Orders = ((1, 1),)
"""A covariance alone."""

VARIANCE: Orders = ((2, 0),)
"""A variance alone."""

# [n, k] = n over k
BINOMIAL = np.array([[comb(n, k) for k in range(9)] for n in range(9)], dtype=float)

STRAND = 64  # numbers of paths are filled up to a multiple of it: eight strands of whole vectors


@lean
def _transpose(rows: Floats, columns: Floats) -> None:
    """Copy `rows`, shape (paths, variables), to `columns`, shape (variables, paths), eight paths at
    a time."""
    paths, variables = rows.shape
    whole = paths // 8 * 8
    for p in range(0, whole, 8):
        for i in range(variables):
            out = columns[i][p : p + 8]
            for k in range(8):
                out[k] = rows[p + k, i]
    for p in range(whole, paths):
        for i in range(variables):
            columns[i, p] = rows[p, i]


@inline
def _strands(x: Floats, n: int) -> Strands:
    """Eight strands of n numbers each."""
    return (
        x[:n],
        x[n : 2 * n],
        x[2 * n : 3 * n],
        x[3 * n : 4 * n],
        x[4 * n : 5 * n],
        x[5 * n : 6 * n],
        x[6 * n : 7 * n],
        x[7 * n : 8 * n],
    )


@lean_internal
def _add_strands(x: Floats, n: int, out: Floats) -> None:
    """Add eight strands of n numbers each, in pairs; `out` may be the first of them."""
    widest_vectors()
    a, b, c, d, e, f, g, h = _strands(x, n)
    for i in range(n):
        out[i] = ((a[i] + b[i]) + (c[i] + d[i])) + ((e[i] + f[i]) + (g[i] + h[i]))


@lean_internal
def _fold(x: Floats, n: int) -> float:
    """Sum of the first n numbers of an array, n a multiple of 8, which is overwritten.

    The order of summation is that of the source, whatever the width of the processor's vectors:
    eight strands, added in pairs, then one after another.
    """
    _add_strands(x, n // 8, x)
    total = 0.0
    for i in range(n // 8):
        total += x[i]
    return total


@lean_internal
def _sum(u: Floats, room: Floats) -> float:
    """Sum of numbers in a fixed order; their number is a multiple of `STRAND`, and `room` has an
    eighth of it."""
    n = u.size // 8
    _add_strands(u, n, room)
    return _fold(room, n)


@lean_internal
def product_sum(u: Floats, v: Floats, room: Floats) -> float:
    """Sum of products in the order of `_sum`."""
    widest_vectors()
    n = u.size // 8
    a, b, c, d, e, f, g, h = _strands(u, n)
    a2, b2, c2, d2, e2, f2, g2, h2 = _strands(v, n)
    for i in range(n):
        room[i] = ((a[i] * a2[i] + b[i] * b2[i]) + (c[i] * c2[i] + d[i] * d2[i])) + (
            (e[i] * e2[i] + f[i] * f2[i]) + (g[i] * g2[i] + h[i] * h2[i])
        )
    return _fold(room, n)


@lean_internal
def power_sums(d: Floats, room: Floats, sums: Floats) -> None:
    """Sums of ``d^2`` to ``d^8`` in a fixed order; `room` has seven rows, each an eighth as long as
    d."""
    widest_vectors()
    n = d.size // 8
    room.fill(0.0)
    s2 = room[0]
    s3 = room[1]
    s4 = room[2]
    s5 = room[3]
    s6 = room[4]
    s7 = room[5]
    s8 = room[6]
    for k in range(8):
        part = d[k * n : (k + 1) * n]
        for i in range(n):
            x = part[i]
            square = x * x
            cube = square * x
            fourth = square * square
            s2[i] += square
            s3[i] += cube
            s4[i] += fourth
            s5[i] += fourth * x
            s6[i] += fourth * square
            s7[i] += fourth * cube
            s8[i] += fourth * fourth
    for o in range(7):
        sums[o] = _fold(room[o], n)


@lean_internal
def _first_seen(u: Floats, v: Floats) -> int:
    """Index of the first path where both variables are finite; the last if there is none."""
    for p in range(u.size):
        if np.isfinite(u[p]) and np.isfinite(v[p]):
            return p
    return u.size - 1


@lean
def centre(
    u: Floats, v: Floats, da: Floats, db: Floats, room: Floats
) -> tuple[float, float, float]:
    """Deviations of both variables from their means, 0 where either is not finite; the count and
    the means.

    Means are taken about the first value, so that a constant comes out exact.
    """
    widest_vectors()
    origin = _first_seen(u, v)
    first_u = u[origin]
    first_v = v[origin]
    count = 0
    for p in range(u.size):
        seen = np.isfinite(u[p]) & np.isfinite(v[p])
        da[p], db[p] = u[p] - first_u if seen else 0.0, v[p] - first_v if seen else 0.0
        count += seen
    if count == 0:
        return 0.0, 0.0, 0.0
    shift_u = _sum(da, room) / count
    shift_v = _sum(db, room) / count
    for p in range(u.size):
        seen = np.isfinite(u[p]) & np.isfinite(v[p])
        da[p] -= shift_u if seen else 0.0
        db[p] -= shift_v if seen else 0.0
    return float(count), first_u + shift_u, first_v + shift_v


def columns_of(values: Floats) -> Floats:
    """A block's values with the paths of each variable contiguous.

    Shapes: `values` (paths, ...); result (variables, paths).
    """
    rows = np.ascontiguousarray(values, dtype=float).reshape(len(values), -1)
    lanes = -(-len(rows) // STRAND) * STRAND
    lanes += STRAND if lanes % 512 == 0 else 0  # so that columns do not share lines of the cache
    columns = np.empty((rows.shape[1], lanes))
    columns[:, len(rows) :] = np.nan
    _transpose(rows, columns)
    return columns


@lean
def _block_sums(
    a: Floats,
    b: Floats,
    cells: Ints,
    orders: Ints,
    powers: Floats,
    room: Floats,
    n: Floats,
    mean: Floats,
    sums: Floats,
) -> None:
    """Counts (cells), means (2, cells) and sums of ``da^p db^q`` (orders, cells) over the paths
    where both are finite.

    Cell i pairs row ``cells[0, i]`` of `a` with row ``cells[1, i]`` of `b`, both of shape
    (variables, paths).  The scratch `powers` has shape (2, largest exponent + 1, paths) and is
    filled with ones.
    """
    widest_vectors()
    for i in range(n.size):
        n[i], mean[0, i], mean[1, i] = centre(
            a[cells[0, i]], b[cells[1, i]], powers[0, 1], powers[1, 1], room[0]
        )
        for side in range(2):
            for k in range(1, powers.shape[1] - 1):
                lower = powers[side, k]
                once = powers[side, 1]
                higher = powers[side, k + 1]
                for p in range(lower.size):
                    higher[p] = lower[p] * once[p]
        for o in range(len(orders)):
            sums[o, i] = product_sum(powers[0, orders[o, 0]], powers[1, orders[o, 1]], room[0])


@lean
def _observe_groups(
    columns: Floats,
    pairs: Ints,
    apart: Floats,
    room: Floats,
    n: Floats,
    mean: Floats,
    sums: Floats,
    products: Floats,
) -> None:
    """The sums of `CentralSums.of_groups`, group by group: arrays of shape (groups, ...).

    Deviations `apart` of a group's variables, shape (variables + 1, paths), serve its single sums
    and its pairs.
    """
    groups, variables = n.shape
    for g in range(groups):
        for i in range(variables):
            u = columns[g * (columns.shape[0] // groups) + i]
            n[g, i], mean[g, i], _ = centre(u, u, apart[i], apart[variables], room[0])
            power_sums(apart[i], room, sums[g, i])
        for j in range(len(pairs)):
            products[g, j] = product_sum(apart[pairs[j, 0]], apart[pairs[j, 1]], room[0])


@lean
def _about(
    n: Floats,
    mean: Floats,
    sums: Floats,
    centre: Floats,
    exponents: Ints,
    place: Ints,
    powers: Floats,
    out: Floats,
) -> None:
    """Add to `out` the sums of one part, shifted to another centre by the binomial theorem (scratch
    `powers`)."""
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
                    out[o, i] += (
                        BINOMIAL[p, j]
                        * BINOMIAL[q, k]
                        * powers[0, p - j]
                        * powers[1, q - k]
                        * inner
                    )


def _room(columns: Floats) -> Floats:
    """Scratch of the sums over the paths of some columns."""
    return np.empty((len(SINGLE), columns.shape[1] // 8))


@dataclass(frozen=True)
class CentralSums:
    """Sums ``sum (a - mean_a)^p (b - mean_b)^q`` of two variables over observations, for many cells
    at once.

    Blocks are merged about the joint mean (Pebay 2008), always in block order, so that the result
    does not depend on the worker that computed a block.
    """

    # exponents of the sums that are kept; with each, all lower ones of degree 2 and more
    orders: Orders
    n: Floats  # number of observations of each cell
    mean: Floats  # means of both variables; (2, ...)
    sums: Floats  # the sums; (orders, ...)

    @classmethod
    def of_columns(
        cls, a: Floats, b: Floats, cells: Ints, orders: Orders, shape: tuple[int, ...]
    ) -> "CentralSums":
        """Sums of one block of paths, each cell over one variable of `a` and one of `b`.

        Shapes: `a`, `b` (variables, paths); `cells` (2, cells).
        """
        size = cells.shape[1]
        exponents = np.array(orders)
        n = np.empty(size)
        mean = np.empty((2, size))
        sums = np.empty((len(orders), size))
        powers = np.ones((2, int(exponents.max()) + 1, a.shape[1]))
        _block_sums(a, b, cells, exponents, powers, _room(a), n, mean, sums)
        return cls(
            orders, n.reshape(shape), mean.reshape(2, *shape), sums.reshape(len(orders), *shape)
        )

    @classmethod
    def of_groups(
        cls, columns: Floats, groups: int, variables: int, pairs: Sequence[tuple[int, int]]
    ) -> "tuple[CentralSums, CentralSums]":
        """Sums of the first variables of each group, and of pairs of them, observed together: in a
        path all or none.

        Shapes: `columns` (groups * variables or more, paths).
        """
        n = np.empty((groups, variables))
        mean = np.empty((groups, variables))
        both = np.array(pairs)
        sums = np.empty((groups, variables, len(SINGLE)))
        products = np.empty((groups, len(pairs)))
        deviations = np.empty((variables + 1, columns.shape[1]))
        _observe_groups(columns, both, deviations, _room(columns), n, mean, sums, products)
        return (
            cls(SINGLE, n, np.stack([mean, mean]), np.moveaxis(sums, -1, 0).copy()),
            cls(
                COVARIANCE, n[:, both[:, 0]], np.stack([mean[:, i] for i in both.T]), products[None]
            ),
        )

    def merge(self, other: "CentralSums") -> "CentralSums":
        """The sums over two sets of observations together."""
        n = self.n + other.n
        weight = np.divide(other.n, n, out=np.zeros_like(n), where=n > 0)
        mean = self.mean + (other.mean - self.mean) * weight
        out = np.zeros((len(self.orders), n.size))
        place = np.zeros((9, 9), np.int64)
        powers = np.empty((2, 9))
        for o, (p, q) in enumerate(self.orders):
            place[p, q] = o
        centre = mean.reshape(2, -1)
        exponents = np.array(self.orders)
        for part in (self, other):
            own = part.mean.reshape(2, -1)
            sums = part.sums.reshape(len(self.orders), -1)
            _about(part.n.ravel(), own, sums, centre, exponents, place, powers, out)
        return CentralSums(self.orders, n, mean, out.reshape(self.sums.shape))

    def until(self, rows: int) -> "CentralSums":
        """The sums of the first rows of cells; the others have no observations."""
        seen = np.arange(len(self.n)) < rows
        shape = seen.reshape(-1, *(1,) * (self.n.ndim - 1))
        return CentralSums(self.orders, self.n * shape, self.mean, self.sums * shape)

    def moment(self, p: int, q: int) -> Floats:
        """Central moment ``E[(a - E a)^p (b - E b)^q]``, without bias correction."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.sums[self.orders.index((p, q))] / self.n)
