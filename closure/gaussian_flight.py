"""What the flight makes of one Gaussian of points ``e = (tau, x1, y1, x2, y2)``, up to second order."""

import math
from typing import NamedTuple

import numpy as np

from closure.cutting import event
from closure.mixture import Mixture
from closure.orbit import Floats
from closure.section_map import derivatives
from scene.compiled import jit
from scene.flight import field, jacobian
from scene.scene import Constants

__all__ = ["Landing", "lead"]

STRAIGHT = 0.1  # second-order sd, as a share of the first-order one, from which two points replace the expansion
GRAZE = 2.0  # slowest impact that derivatives are taken at, in speeds that the spread of a Gaussian makes at a graze


class Landing(NamedTuple):
    """Gaussians of the section state just before the next event, its code the label; mean and variance of flights."""

    section: Mixture
    flight: Floats


@jit
def _derivatives(
    c: Constants, code: int, centre: Floats, axes: Floats, t: float, before: Floats
) -> tuple[Floats, Floats]:
    """Derivatives of the section map along the axes; near a graze, those of the slowest impact that is resolved.

    At a graze the impact speed goes as the square root of how far the flight would pass the wall, and its derivative
    has no bound; a Gaussian sees that far as its own sd of the passing distance reaches.
    """
    mesh, side = abs(code), 1 if code > 0 else -1
    i = 0 if mesh == 1 else 2
    flown = jacobian(c, t)[i]
    passing = flown @ np.ascontiguousarray(axes[1:])
    passing += (before[i + 1] - flown @ field(c, centre[0], centre[2], centre[4])) * axes[0]
    pull = field(c, centre[0] + t, before[1], before[3])[i + 1]
    slowest = GRAZE * math.sqrt(2.0 * abs(pull) * math.sqrt(passing @ passing)) + 1e-9
    steady = before.copy()
    steady[i + 1] = side * max(slowest, side * before[i + 1])
    first, second = derivatives(c, mesh, side, centre[0], centre[1:], t, steady, 5)
    linear = np.ascontiguousarray(first[:, :5]) @ axes
    curve = np.zeros((5, axes.shape[1], axes.shape[1]))
    for j in range(5):
        curve[j] = axes.T @ np.ascontiguousarray(second[j, :5, :5]) @ axes
    return linear, curve


@jit
def _most_bent(linear: Floats, curve: Floats) -> tuple[float, Floats]:
    """Second-order variance of the output that is bent most, as a share of its first-order one, and the direction."""
    u = np.zeros(linear.shape[1])
    worst, at = 0.0, 0
    for j in range(5):
        variance = (linear[j] ** 2).sum()
        if variance > 1e-24:
            bend = 0.5 * (curve[j] ** 2).sum() / variance
            if bend > worst:
                worst, at = bend, j
    if worst > 0.0:
        values, vectors = np.linalg.eigh(curve[at])
        u[:] = vectors[:, -1] if values[-1] > -values[0] else vectors[:, 0]
    return worst, u


@jit
def lead(c: Constants, centre: Floats, axes: Floats, to: Landing, at: int, before: Floats) -> tuple[float, Floats]:
    """Carry a Gaussian to its next event; the result goes to place `at`.

    Parameters
    ----------
    axes : ndarray, shape (5, rank)
        Root of the covariance.

    Returns
    -------
    bend : float
        Second-order variance of the output that is bent most, as a share of its first-order one.
    u : ndarray, shape (rank,)
        The direction in which it is bent.
    """
    t, code = event(c, centre, before)
    to.section.label[at] = code
    rank = axes.shape[1]
    mean, spread = to.section.mean[at], to.section.covariance[at]
    mean[0], mean[1:] = centre[0] + t, before
    spread[:] = 0.0
    to.flight[at, 0], to.flight[at, 1] = t, 0.0
    if code == 0 or rank == 0:
        return 0.0, np.zeros(rank)
    linear, curve = _derivatives(c, code, centre, axes, t, before)
    bend, u = _most_bent(linear, curve)
    if bend < STRAIGHT**2:
        own = linear[0] - axes[0]
        spread[:] = linear @ linear.T
        for j in range(5):
            mean[j] += 0.5 * np.trace(curve[j])
            for k in range(5):
                spread[j, k] += 0.5 * (curve[j] * curve[k]).sum()
        to.flight[at, 0] += 0.5 * np.trace(curve[0])
        to.flight[at, 1] = own @ own + 0.5 * (curve[0] ** 2).sum()
        return bend, u
    # the rest to first order, the bent direction by the events at one sd to either side
    linear -= np.outer(linear @ u, u)
    own = linear[0] - axes[0] + (axes[0] @ u) * u
    spread[:] = linear @ linear.T
    to.flight[at, 1] = own @ own
    v = axes @ u
    high, low = np.empty(5), np.empty(5)
    high_t, high_code = event(c, centre + v, before)
    high[0], high[1:] = centre[0] + v[0] + high_t, before
    low_t, low_code = event(c, centre - v, before)
    low[0], low[1:] = centre[0] - v[0] + low_t, before
    if high_code == code and low_code == code:
        mean[:] = 0.5 * (high + low)
        spread += 0.25 * np.outer(high - low, high - low)
        to.flight[at, 0] = 0.5 * (high_t + low_t)
        to.flight[at, 1] += 0.25 * (high_t - low_t) ** 2
    return bend, u
