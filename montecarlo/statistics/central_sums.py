"""Mergeable central sums over a stream of blocks of paths, in constant memory.

Sums over the paths of a block are taken in an order that the source fixes, whatever the width of
the processor's vectors.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import binom

from rattle.montecarlo.statistics.section_statistics import (
    SINGLE,
    Orders,
    Pairs,
    ratio_or_zero,
    undefined,
)
from rattle.scene import Floats, Ints
from rattle.scene.compiled import (
    inline,
    lean,
    lean_internal,
    splice,
    vector_memory,
    widest_vectors,
)

Strands = tuple[Floats, ...]

COVARIANCE: Orders = ((1, 1),)
"""A covariance alone."""

VARIANCE: Orders = ((2, 0),)
"""A variance alone."""

HIGHEST = 8  # largest exponent
# [n, k] = n over k
BINOMIAL = binom.outer(np.arange(HIGHEST + 1.0), np.arange(HIGHEST + 1.0))

STRAND = 64  # numbers of paths are filled up to a multiple of it: eight strands of whole vectors


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


@splice
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
    rows = values.reshape(len(values), -1)
    lanes = -(-len(rows) // STRAND) * STRAND
    lanes += STRAND if lanes % 512 == 0 else 0  # so that columns do not share lines of the cache
    columns = vector_memory((rows.shape[1], lanes), np.nan)
    columns[:, : len(rows)] = rows.T
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
def _add_about(powers: Floats, known: Floats, orders: Ints, out: Floats) -> None:
    """Add the sums of two parts about another centre, by the binomial theorem.

    Shapes: `powers` (exponents, parts, 2, cells), of the shifts of both variables; `known`
    (exponents, exponents, parts, cells); `orders` (orders, 2); `out` (orders, cells).
    """
    for o in range(len(orders)):
        p, q = orders[o]
        for part in range(known.shape[2]):
            for j in range(p + 1):
                for k in range(q + 1):
                    factor = BINOMIAL[p, j] * BINOMIAL[q, k]
                    for i in range(out.shape[1]):
                        u = powers[p - j, part, 0, i]
                        v = powers[q - k, part, 1, i]
                        out[o, i] += factor * u * v * known[j, k, part, i]


def _room(columns: Floats) -> Floats:
    """Scratch of the sums over the paths of some columns."""
    return vector_memory((len(SINGLE), columns.shape[1] // 8))


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
    def of_pairs(
        cls,
        groups: int,
        values: Floats,
        pairs: Pairs,
        orders: Orders,
        other: Floats | None = None,
    ) -> "CentralSums":
        """Sums of one block of paths, over pairs of the variables of each group, the second of each
        pair from `other` if given.

        Shapes: `values`, `other` (groups * variables, paths).
        """
        other = values if other is None else other
        base = len(values) // groups * np.arange(groups)[:, None]
        cells = np.ascontiguousarray((base + np.array(pairs).T[:, None]).reshape(2, -1))
        exponents = np.array(orders)
        n = np.empty((groups, len(pairs)))
        mean = np.empty((2, *n.shape))
        sums = np.empty((len(orders), *n.shape))
        powers = vector_memory((2, int(exponents.max()) + 1, values.shape[1]), 1.0)
        _block_sums(
            values,
            other,
            cells,
            exponents,
            powers,
            _room(values),
            n.reshape(-1),
            mean.reshape(2, -1),
            sums.reshape(len(orders), -1),
        )
        return cls(orders, n, mean, sums)

    @classmethod
    def of_groups(
        cls, columns: Floats, groups: int, variables: int, pairs: Pairs
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
        deviations = vector_memory((variables + 1, columns.shape[1]))
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
        weight = ratio_or_zero(other.n, n)
        mean = self.mean + (other.mean - self.mean) * weight
        shift = np.stack([self.mean - mean, other.mean - mean]).reshape(2, 2, -1)
        exponents = np.array(self.orders)
        size = exponents.max() + 1
        steps = np.broadcast_to(shift, (size - 1, *shift.shape))
        powers = np.multiply.accumulate([np.ones_like(shift), *steps])
        # sums of each part about its own mean, where deviations sum to zero
        known = np.zeros((size, size, 2, n.size))
        known[0, 0] = self.n.ravel(), other.n.ravel()
        for o, (p, q) in enumerate(self.orders):
            known[p, q] = self.sums[o].ravel(), other.sums[o].ravel()
        sums = np.zeros((len(self.orders), n.size))
        _add_about(powers, known, exponents, sums)
        return CentralSums(self.orders, n, mean, sums.reshape(self.sums.shape))

    def until(self, rows: int) -> "CentralSums":
        """The sums of the first rows of cells; the others have no observations."""
        seen = np.arange(len(self.n)) < rows
        shape = seen.reshape(-1, *(1,) * (self.n.ndim - 1))
        return CentralSums(self.orders, self.n * shape, self.mean, self.sums * shape)

    def moment(self, p: int, q: int) -> Floats:
        """Central moment ``E[(a - E a)^p (b - E b)^q]``, without bias correction."""
        with undefined():
            return np.asarray(self.sums[self.orders.index((p, q))] / self.n)
