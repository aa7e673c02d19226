"""Sums over the paths of a block, in an order that the source fixes whatever the width of the processor's vectors."""

import numpy as np

from rattle.scene.compiled import lean, widest_vectors
from rattle.scene.types import Floats

STRAND = 64  # numbers of paths are filled up to a multiple of it: eight strands of whole vectors


@lean
def _transpose(rows: Floats, columns: Floats) -> None:
    """Copy `rows`, shape (paths, variables), to `columns`, shape (variables, paths), eight paths at a time."""
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


@lean
def _fold(x: Floats, n: int) -> float:
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
    return _fold(room, n)


@lean
def product_sum(u: Floats, v: Floats, room: Floats) -> float:
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
    return _fold(room, n)


@lean
def power_sums(d: Floats, room: Floats, sums: Floats) -> None:
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
        sums[o] = _fold(room[o], n)


@lean
def _first_seen(u: Floats, v: Floats) -> int:
    """Index of the first path where both variables are finite; the last if there is none."""
    for p in range(u.size):
        if np.isfinite(u[p]) and np.isfinite(v[p]):
            return p
    return u.size - 1


@lean
def centre(u: Floats, v: Floats, da: Floats, db: Floats, room: Floats) -> tuple[float, float, float]:
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
