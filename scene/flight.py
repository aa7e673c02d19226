"""Exact free flight (Eq. 3), its Jacobian, its drift, and the noise that drives it (Eqs. 5, 8).

A wheel's speed ``u_i = R_i phi_i' / (nu_1 omega)`` obeys ``u_i' = -beta_i u_i - gamma_i``
independently of the other, and ``y_1 = alpha f' - u_1``, ``y_2 = u_2 - u_1``, f the driver's
motion, ``sin tau`` or a sum of orders (`rattle.scene.drive`).  Increments over a flight are summed
from terms that vanish with the flight time, so the relative accuracy is the same for flight times
of 1e-12 and of 1e6.
"""

import math
from typing import Any

import numpy as np

from rattle.scene.compiled import internal, jit, splice
from rattle.scene.damping import Pair, pair
from rattle.scene.drive import (
    acceleration,
    excite,
    highest_order,
    jerk,
    velocity,
    velocity_acceleration,
)
from rattle.scene.elementary import gauss_legendre
from rattle.scene.linear_algebra import congruence
from rattle.scene.types import Constants, Floats

State = tuple[float, float, float, float]

# Gauss-Legendre on [0, 1]: 16 nodes are exact to rounding on panels of at most PANEL time units.
_nodes, _weights = gauss_legendre(16)
NODES = 0.5 * (_nodes + 1.0)
WEIGHTS = 0.5 * _weights
PANEL = 2.0
TURN = 2.0 * math.pi


@jit
def wheel_speeds(c: Constants, tau: float, y1: float, y2: float) -> tuple[float, float]:
    """Speeds ``(u_1, u_2)`` of the two wheels at their base circles."""
    u1 = c.alpha * velocity(c.drive, tau) - y1
    return u1, u1 + y2


@internal
def displacement(c: Constants, tau: float, y1: float, y2: float, t: float) -> State:
    """Increments of ``x_1`` and ``x_2`` over a flight of time `t` from `tau`, and the velocities at
    its end (Eq. 3).

    Returns: Increments of the displacements, and final velocities; ``dx2 = 0`` and `y2` unchanged
    for a single stage.
    """
    p = pair(c.beta1, c.beta2, t)
    moved, gained, driver = excite(c.drive, c.beta1, p, tau, t)
    dx1 = y1 * p.e1 + c.gamma1 * p.g1 + c.alpha * moved
    z1 = y1 * p.d1 + c.gamma1 * p.e1 + c.alpha * gained
    if c.stages == 1:
        return dx1, z1, 0.0, y2
    u1 = c.alpha * driver - y1
    dx2 = y2 * p.e2 - u1 * p.e12 + (c.gamma1 * p.g1 - c.gamma2 * p.g2)
    return dx1, z1, dx2, y2 * p.d2 - u1 * p.d12 + (c.gamma1 * p.e1 - c.gamma2 * p.e2)


@jit
def flow(c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, t: float) -> State:
    """State after a flight of time `t` from `tau` (Eq. 3; Eq. 10 is this map after a mesh-1
    impact)."""
    dx1, y1, dx2, y2 = displacement(c, tau, y1, y2, t)
    return x1 + dx1, y1, x2 + dx2, y2


@internal
def field(c: Constants, tau: float, y1: float, y2: float) -> Floats:
    """The drift, ``d(x1, y1, x2, y2) / d tau`` in flight without noise (Eq. 3).

    Shapes: result (4,).
    """
    u1, _ = wheel_speeds(c, tau, y1, y2)
    drag1 = c.beta1 * u1 + c.gamma1
    f = np.zeros(4)
    f[0], f[1] = y1, c.alpha * acceleration(c.drive, tau) + drag1
    if c.stages == 2:
        f[2] = y2
        f[3] = (c.beta1 - c.beta2) * u1 - c.beta2 * y2 + (c.gamma1 - c.gamma2)
    return f


@internal
def field_rate(c: Constants, tau: float) -> Floats:
    """Partial derivative of the drift `field` with respect to time.

    Shapes: result (4,).
    """
    f = np.zeros(4)
    second = acceleration(c.drive, tau)
    f[1] = c.alpha * (jerk(c.drive, tau) + c.beta1 * second)
    if c.stages == 2:
        f[3] = c.alpha * (c.beta1 - c.beta2) * second
    return f


@internal
def system_matrix(c: Constants) -> Floats:
    """``A`` of the linear flight ``s' = A s + ...`` (Eq. 8).

    Shapes: result (4, 4).
    """
    a = np.zeros((4, 4))
    a[0, 1] = 1.0
    a[1, 1] = -c.beta1
    if c.stages == 2:
        a[2, 3] = 1.0
        a[3, 1] = c.beta2 - c.beta1
        a[3, 3] = -c.beta2
    return a


@internal
def jacobian(c: Constants, t: float) -> Floats:
    """``exp(A t)``, the derivative of `flow` with respect to ``(x1, y1, x2, y2)``.

    Shapes: result (4, 4).
    """
    j = np.zeros((4, 4))
    p = pair(c.beta1, c.beta2, t)
    j[0, 0] = 1.0
    j[0, 1] = p.e1
    j[1, 1] = p.d1
    j[2, 2] = 1.0
    j[2, 3] = p.e2
    j[3, 3] = p.d2
    j[2, 1] = p.e12
    j[3, 1] = p.d12
    return j


@internal
def noise_rate(c: Constants, tau: float) -> tuple[float, float]:
    """Noise coefficients of ``(y_1, y_2)`` for the one white noise ``sigma eta`` (Eq. 5), for
    ``sigma = 1``."""
    first, second = velocity_acceleration(c.drive, tau)
    return second + c.beta1 * first, (c.beta1 - c.beta2) * first


@internal
def _responses(c: Constants, p: Pair, sine: float, cosine: float, relative: bool) -> State:
    """Response of ``(x1, y1, x2, y2)`` to unit noise a lag earlier (`relative`: see
    `noise_covariance`).

    `sine` and `cosine` are of the phase at which the noise acts, or ``-f''`` and ``f'`` of several
    orders there.
    """
    m1 = c.beta1 * cosine - sine
    if c.stages == 1:
        return p.e1 * m1, p.d1 * m1, 0.0, 0.0
    if relative:
        m = sine - c.beta2 * cosine
        return p.e1 * m1, p.d1 * m1, p.e2 * m, p.d2 * m
    d = c.beta1 - c.beta2
    # beta_1 d1 - beta_2 d2
    faster = d * p.d1 + c.beta2 * p.d12 if d > 0.0 else d * p.d2 + c.beta1 * p.d12
    return p.e1 * m1, p.d1 * m1, -cosine * p.d12 - sine * p.e12, cosine * faster - sine * p.d12


@splice
def _harmonics(c: Constants, h: float, relative: bool) -> Floats:
    """Covariance of unit noise over a time h: the terms in ``sin^2``, ``sin cos`` and ``cos^2`` of
    the initial phase.

    Shape (3, 4, 4); by Gauss-Legendre quadrature over the lag before the end.
    """
    q = np.zeros((3, 4, 4))
    g = np.empty((2, 4))
    for n in range(NODES.size):
        lag = h * NODES[n]
        since = h * NODES[NODES.size - 1 - n]
        sine = math.sin(since)
        cosine = math.cos(since)
        p = pair(c.beta1, c.beta2, lag)
        g[0, 0], g[0, 1], g[0, 2], g[0, 3] = _responses(c, p, cosine, -sine, relative)
        g[1, 0], g[1, 1], g[1, 2], g[1, 3] = _responses(c, p, sine, cosine, relative)
        w = h * WEIGHTS[n]
        for i in range(2 * c.stages):
            for j in range(i + 1):
                q[0, i, j] += w * g[0, i] * g[0, j]
                q[1, i, j] += w * (g[0, i] * g[1, j] + g[1, i] * g[0, j])
                q[2, i, j] += w * g[1, i] * g[1, j]
    for i in range(4):
        for j in range(i):
            q[0, j, i], q[1, j, i], q[2, j, i] = q[0, i, j], q[1, i, j], q[2, i, j]
    return q


@internal
def _forward(c: Constants, t: float, relative: bool) -> Floats:
    """`jacobian` in the coordinates of `_responses`."""
    j = jacobian(c, t)
    if relative:
        j[2, 1] = j[3, 1] = 0.0
    return j


@splice
def _double(c: Constants, q: Floats, h: float, relative: bool) -> Floats:
    """`_harmonics` of twice the time: first half propagated through the second, plus the second,
    its phase shifted."""
    j = _forward(c, h, relative)
    s = math.sin(h)
    k = math.cos(h)
    size = 2 * c.stages
    out = np.zeros((3, 4, 4))
    for a in range(size):
        for b in range(a + 1):
            out[0, a, b] = k * k * q[0, a, b] - k * s * q[1, a, b] + s * s * q[2, a, b]
            out[1, a, b] = 2.0 * k * s * (q[0, a, b] - q[2, a, b]) + (k - s) * (k + s) * q[1, a, b]
            out[2, a, b] = s * s * q[0, a, b] + k * s * q[1, a, b] + k * k * q[2, a, b]
            for m in range(size):
                for n in range(size):
                    carried = j[a, m] * j[b, n]
                    for part in range(3):
                        out[part, a, b] += carried * q[part, m, n]
            for part in range(3):
                out[part, b, a] = out[part, a, b]
    return out


@jit
def _covariance(drive: Any, c: Constants, tau: float, t: float, relative: bool) -> Floats:
    """`noise_covariance` in the coordinates of `_responses`."""
    fastest = max(c.beta1, c.beta2)
    square = c.sigma * c.sigma
    panel = min(PANEL, 2.0 / fastest) if fastest > 0.0 else PANEL
    if len(drive) != 0:
        out = _over_orders(c, tau, t, min(panel, PANEL / highest_order(drive)), relative)
        for i in range(4):
            for j in range(4):
                out[i, j] *= square
        return out
    h = t
    doublings = 0
    while h > panel:
        h *= 0.5
        doublings += 1
    q = _harmonics(c, h, relative)
    for _ in range(doublings):
        q = _double(c, q, h, relative)
        h *= 2.0
    sine = math.sin(tau)
    cosine = math.cos(tau)
    out = np.empty((4, 4))
    for i in range(4):
        for j in range(4):
            out[i, j] = square * (
                sine * (sine * q[0, i, j] + cosine * q[1, i, j]) + cosine * cosine * q[2, i, j]
            )
    return out


@internal
def _over_panels(c: Constants, tau: float, t: float, panel: float, relative: bool) -> Floats:
    """Covariance of unit noise by Gauss-Legendre quadrature on panels, each propagated through the
    next."""
    panels = max(1, math.ceil(t / panel))
    h = t / panels
    j = _forward(c, h, relative)
    q = np.zeros((4, 4))
    g = np.zeros(4)
    for k in range(panels):
        if k > 0:
            q = congruence(j, q)
        for n in range(NODES.size):
            first, second = velocity_acceleration(
                c.drive, tau + (k + NODES[NODES.size - 1 - n]) * h
            )
            p = pair(c.beta1, c.beta2, h * NODES[n])
            g[0], g[1], g[2], g[3] = _responses(c, p, -second, first, relative)
            for a in range(2 * c.stages):
                for b in range(2 * c.stages):
                    q[a, b] += h * WEIGHTS[n] * (g[a] * g[b])
    return q


@internal
def _over_orders(c: Constants, tau: float, t: float, panel: float, relative: bool) -> Floats:
    """Covariance of unit noise for a drive of several orders: whole periods by doubling, then the
    rest of the time."""
    periods = int(t / TURN)
    rest = t - periods * TURN
    out = np.zeros((4, 4))
    if periods > 0:
        q = _over_panels(c, tau, TURN, panel, relative)
        h = TURN
        while True:
            if periods & 1:
                out = congruence(_forward(c, h, relative), out) + q
            periods >>= 1
            if periods == 0:
                break
            q = congruence(_forward(c, h, relative), q) + q
            h *= 2.0
        out = congruence(_forward(c, rest, relative), out)
    return out + _over_panels(c, tau, rest, panel, relative)


@internal
def noise_covariance(c: Constants, tau: float, t: float) -> Floats:
    """Covariance of ``(x1, y1, x2, y2)`` that the noise adds in a flight of time `t` from `tau`.

    ``sigma^2 int exp(A r) m m' exp(A' r) dr`` over the lag r before the end of the flight, ``m``
    the modulation of Eq. 5.  The flight is halved until Gauss-Legendre quadrature is exact to
    rounding, then doubled again: a flight of time 1e6 takes twenty doublings.  With several orders
    a period is summed panel by panel, and then doubled.

    Where the dampings differ much over the time for which speeds last, noise is integrated in
    relative coordinates ``(x1, y1, x2 - x1, y2 - y1)``, which decouple the two wheels.  Elsewhere
    x2 and y2 are integrated themselves: their small variances would be lost as a difference.

    Shapes: result (4, 4).
    """
    most = max(c.beta1, c.beta2)
    relative = (
        c.stages == 2 and abs(c.beta1 - c.beta2) * (min(t, 1.0 / most) if most > 0.0 else t) > 0.5
    )
    out = _covariance(c.drive, c, tau, t, relative)
    if relative:  # back to x2 and y2
        for i in range(2):
            for j in range(4):
                out[2 + i, j] += out[i, j]
            for j in range(4):
                out[j, 2 + i] += out[j, i]
    return out
