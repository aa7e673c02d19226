"""The image of a Gaussian of section states ``e = (tau, x1, y1, x2, y2, ...)`` at the next impact, to second order."""

import math
from typing import NamedTuple

import numpy as np

from rattle.closure.branching.mixture import Mixture
from rattle.closure.branching.split import event
from rattle.closure.flanks import PLAIN, column
from rattle.closure.orbit import Floats
from rattle.closure.section_map import derivatives
from rattle.scene.compiled import internal, jit
from rattle.scene.constants import Constants
from rattle.scene.eigen import eigen
from rattle.scene.flight import field, jacobian
from rattle.scene.small_matrices import apply, block, inner, put, quadratic, times, times_transposed
from rattle.scene.small_vectors import dot, norm, put_row

STRAIGHT = 0.1  # ratio of second-order to first-order sd from which two sigma points replace the Taylor expansion
GRAZE = 2.0  # slowest impact at which derivatives are taken, in units of the speed that the Gaussian's spread allows


class Image(NamedTuple):
    """Images of Gaussian components just before their next impact."""

    section: Mixture  # section states; the label is ``mesh * side`` of the impact, 0 for none
    flight: Floats  # mean and variance of the flight time; (components, 2)
    # covariance of the section state at the start of the flight, its noise included, with the time of the impact;
    # (components, d)
    crossing: Floats


@jit
def _derivatives(
    c: Constants, code: int, centre: Floats, axes: Floats, t: float, before: Floats
) -> tuple[Floats, Floats]:
    """Derivatives of the section map along the axes; near a graze, those at a slightly faster impact.

    Near a graze the impact speed is proportional to the square root of the distance by which the flight would pass the
    wall, and its derivative is unbounded.  So the impact speed is bounded below by what the Gaussian's own sd of that
    distance produces.
    """
    mesh, side, d = abs(code), 1 if code > 0 else -1, centre.size
    i = 0 if mesh == 1 else 2
    flown = jacobian(c, t)[i]
    early = before[i + 1] - dot(flown, field(c, centre[0], centre[2], centre[4]))
    passing = np.zeros(axes.shape[1])
    for k in range(passing.size):
        for m in range(4):
            passing[k] += flown[m] * axes[1 + m, k]
        passing[k] += early * axes[0, k]
        if d > PLAIN:
            passing[k] -= side * axes[column(mesh, side), k]
    pull = field(c, centre[0] + t, before[1], before[3])[i + 1]
    slowest = GRAZE * math.sqrt(2.0 * abs(pull) * norm(passing)) + 1e-9
    regular = before.copy()
    regular[i + 1] = side * max(slowest, side * before[i + 1])
    first, second = derivatives(c, mesh, side, centre[0], centre[1:PLAIN], t, regular, d)
    linear = times(block(first, d, 0, d), axes)
    curve = np.zeros((PLAIN, axes.shape[1], axes.shape[1]))
    for j in range(PLAIN):
        put(curve[j], quadratic(block(second[j], d, 0, d), axes))
    return linear, curve


@internal
def _most_bent(linear: Floats, curve: Floats) -> tuple[float, Floats]:
    """Largest ratio of second-order to first-order variance over the outputs, and the direction of that curvature."""
    u = np.zeros(linear.shape[1])
    worst, at = 0.0, 0
    for j in range(PLAIN):
        variance = inner(linear[j : j + 1], linear[j : j + 1], 0)
        if variance > 1e-24:
            bend = 0.5 * inner(curve[j], curve[j], 0) / variance
            if bend > worst:
                worst, at = bend, j
    if worst > 0.0:
        values, vectors = eigen(curve[at])
        most = values.size - 1 if values[-1] > -values[0] else 0
        for k in range(u.size):
            u[k] = vectors[k, most]
    return worst, u


@internal
def _trace(square: Floats) -> float:
    """Trace of a square matrix."""
    total = 0.0
    for k in range(square.shape[0]):
        total += square[k, k]
    return total


@internal
def propagate(c: Constants, centre: Floats, axes: Floats, to: Image, at: int, before: Floats) -> tuple[float, Floats]:
    """Propagate a Gaussian to its next impact, to second order in its spread.

    Shapes: `centre` (d,); `axes` (d, rank); `before` (4,); `u` (rank,).
    """
    t, code = event(c, centre, before)
    to.section.label[at] = code
    d, rank = axes.shape
    mean, spread, flight = to.section.mean[at], to.section.covariance[at], to.flight[at]
    mean[0] = centre[0] + t
    for k in range(4):
        mean[1 + k] = before[k]
    for k in range(PLAIN, d):
        mean[k] = centre[k]
    for j in range(d):
        for k in range(d):
            spread[j, k] = 0.0
    flight[0], flight[1] = t, 0.0
    for j in range(d):
        to.crossing[at, j] = 0.0
    if code == 0 or rank == 0:
        return 0.0, np.zeros(rank)
    linear, curve = _derivatives(c, code, centre, axes, t, before)
    bend, u = _most_bent(linear, curve)
    straight = bend < STRAIGHT**2
    own, image = np.empty(rank), apply(linear, u)  # own: derivative of the flight time
    if not straight:  # treat the most curved direction by two sigma points, at one sd to either side
        for j in range(d):
            for k in range(rank):
                linear[j, k] -= image[j] * u[k]
    tilt, v = dot(axes[0], u), apply(axes, u)
    for k in range(rank):
        own[k] = linear[0, k] - axes[0, k] + (0.0 if straight else tilt * u[k])
    put(spread, times_transposed(linear, linear))
    put_row(to.crossing[at], apply(axes, linear[0]))
    flight[1] = dot(own, own)
    if straight:
        for j in range(PLAIN):
            mean[j] += 0.5 * _trace(curve[j])
            for k in range(PLAIN):
                spread[j, k] += 0.5 * inner(curve[j], curve[k], 0)
        flight[0] += 0.5 * _trace(curve[0])
        flight[1] += 0.5 * inner(curve[0], curve[0], 0)
        return bend, u
    ends, times, met = np.empty((2, d)), np.empty(2), 0
    for k in range(2):
        end = ends[k]
        for j in range(d):
            end[j] = centre[j] + (v[j] if k == 0 else -v[j])
        times[k], there = event(c, end, before)
        met += there == code
        end[0] += times[k]
        for j in range(4):
            end[1 + j] = before[j]
    if met == 2:
        for j in range(d):
            mean[j] = 0.5 * (ends[0, j] + ends[1, j])
            for k in range(d):
                spread[j, k] += 0.25 * ((ends[0, j] - ends[1, j]) * (ends[0, k] - ends[1, k]))
        flight[0] = 0.5 * (times[0] + times[1])
        flight[1] += 0.25 * (times[0] - times[1]) ** 2
        for j in range(d):
            to.crossing[at, j] += 0.5 * (ends[0, 0] - ends[1, 0]) * v[j]
    return bend, u
