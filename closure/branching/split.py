"""Splitting a Gaussian: by the plane where the next impact changes, or in three across a direction.

The next impact is a function of a point ``e = (tau, x1, y1, x2, y2)``, with the deviations of the flanks where they
vary; a Gaussian component is a centre and a square root of its covariance, the `axes`.
"""

import math

import numpy as np

from rattle.closure.flanks import PLAIN, between
from rattle.closure.orbit import Floats
from rattle.scene.compiled import internal, jit
from rattle.scene.constants import Constants
from rattle.scene.eigen import eigen
from rattle.scene.impact import next_impact
from rattle.scene.small_matrices import apply
from rattle.scene.small_vectors import beyond, norm, put_row, put_scaled

BISECTIONS = 6  # steps to locate a boundary
LONGEST = 100.0  # longest flight; a component without an impact by then is discarded
# A standard normal approximated by three Gaussians of equal width: weight of the outer ones, width, and their distance.
THIRD_WEIGHT, THIRD_WIDTH = 0.2252246249, 0.6715662887
THIRD_CENTRE = math.sqrt(0.5 * (1.0 - THIRD_WIDTH**2) / THIRD_WEIGHT)


@jit
def event(c: Constants, e: Floats, before: Floats) -> tuple[float, int]:
    """The next impact from a point.

    Shapes: `e` (5,) or (9,); `before` (4,).
    """
    middle1 = middle2 = 0.0
    if e.size > PLAIN:
        c, middle1, middle2 = between(c, e)
    t, mesh, side, x1, y1, x2, y2 = next_impact(c, e[0], e[1] - middle1, e[2], e[3] - middle2, e[4], LONGEST)
    before[0], before[1], before[2], before[3] = x1 + middle1, y1, x2 + middle2, y2
    return t, (mesh * side if mesh > 0 else 0)


@internal
def root(sigma: Floats) -> tuple[int, Floats]:
    """Square root of a covariance by its principal axes.

    Components of the flanks are scaled differently before the eigendecomposition: two flanks of equal variance have no
    unique principal axes, and rounding would choose them.  The sign of each axis is fixed too.

    Shapes: `sigma` (d, d); `axes` (d, d).
    """
    d = sigma.shape[0]
    weight, weighed = np.ones(d), sigma
    if d > PLAIN:
        weighed = np.empty((d, d))
        for i in range(PLAIN, d):
            weight[i] += (i - PLAIN) / 8.0
        for i in range(d):
            for k in range(d):
                weighed[i, k] = weight[i] * sigma[i, k] * weight[k]
    values, vectors = eigen(weighed)
    columns = np.zeros((d, d))
    rank = 0
    for i in range(d - 1, -1, -1):
        if values[i] > 1e-14 * values[d - 1] and values[i] > 0.0:
            sense = 0.0
            for k in range(d):
                sense += (k + 1) * vectors[k, i]
            for k in range(d):
                columns[k, rank] = math.copysign(math.sqrt(values[i]), sense) * vectors[k, i] / weight[k]
            rank += 1
    return rank, columns


@internal
def _boundary(
    c: Constants, centre: Floats, axes: Floats, u: Floats, code: int, ignored: int, far: float, before: Floats
) -> tuple[float, int]:
    """Distance (in sds, up to `far`) along a unit vector at which the next impact changes from `code`, and to which."""
    direction = apply(axes, u)
    found = event(c, beyond(centre, far, direction), before)[1]
    if found == code:
        return np.inf, code
    low, high = 0.0, far
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        met = event(c, beyond(centre, middle, direction), before)[1]
        if met == code:
            low = middle
        else:
            high, found = middle, met
    if ignored & (1 << (found + 2)):
        return np.inf, code
    return max(high, 1e-3), found


@jit
def cut_plane(
    c: Constants, centre: Floats, axes: Floats, code: int, ignored: int, reach: float, before: Floats
) -> tuple[int, Floats]:
    """The nearest boundary to another next impact, as a plane ``q z = 1`` with z along the principal axes.

    The nearest point of the boundary is searched for as in the first-order reliability method (Hasofer and Lind 1974):
    from the best axis, along the normal of the plane through nearby points of the boundary.

    Shapes: `centre` (d,); `axes` (d, rank); `before` (4,); `q` (rank,).
    """
    rank = axes.shape[1]
    far = 1.6 * reach  # a slanted plane within reach cuts one of the axes there
    nearest, other = np.inf, code
    u, trial = np.zeros(rank), np.zeros(rank)
    for ray in range(2 * rank):
        for i in range(rank):
            trial[i] = 0.0
        trial[ray // 2] = 1.0 if ray % 2 == 0 else -1.0
        distance, found = _boundary(c, centre, axes, trial, code, ignored, far, before)
        if distance < nearest:
            nearest, other = distance, found
            put_row(u, trial)
    if other == code:
        return code, u
    for _ in range(2):
        q = np.zeros(rank)
        for i in range(rank):
            put_row(trial, u)
            trial[i] += 0.5
            length = norm(trial)
            put_scaled(trial, trial, length)
            distance, found = _boundary(c, centre, axes, trial, code, ignored, far, before)
            q[i] = 2.0 * ((length / distance if found == other else 0.0) - 1.0 / nearest)
        length = norm(q)
        if length == 0.0:
            break
        put_scaled(trial, q, length)
        distance, found = _boundary(c, centre, axes, trial, code, ignored, far, before)
        if not (found == other and distance < nearest):
            break
        nearest = distance
        put_row(u, trial)
    if nearest > reach:
        return code, u
    put_scaled(u, u, nearest)
    return other, u


@jit
def half(depth: float, inner: bool) -> tuple[float, float, float]:
    """Moments of a standard normal restricted to one side of a plane."""
    beyond = 0.5 * math.erfc(depth / math.sqrt(2.0))
    weight = 1.0 - beyond if inner else beyond
    rate = math.exp(-0.5 * depth * depth) / math.sqrt(2.0 * math.pi) / weight * (-1.0 if inner else 1.0)
    return weight, rate, 1.0 + depth * rate - rate * rate
