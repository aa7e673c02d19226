"""Free flight (Eq. 3) exactly, its Jacobian, and the covariance its noise collects (Eqs. 5, 8).

A wheel's speed ``u_i = R_i phi_i' / (nu_1 omega)`` obeys ``u_i' = -beta_i u_i - gamma_i`` on its own, and
``y_1 = alpha cos tau - u_1``, ``y_2 = u_2 - u_1``.  No formula here divides by beta, so ``beta = 0`` and
``beta_1 = beta_2`` are ordinary values.
"""

import math

import numpy as np
from numpy.typing import NDArray

from scene.compiled import jit
from scene.scene import Constants

__all__ = [
    "decay",
    "field",
    "field_rate",
    "flow",
    "jacobian",
    "noise_covariance",
    "noise_rate",
    "system_matrix",
    "turned",
    "wheel_speeds",
]

Floats = NDArray[np.float64]
State = tuple[float, float, float, float]

# Gauss-Legendre on [0, 1]: with panels no longer than PANEL time units 16 nodes leave rounding only.
_nodes, _weights = np.polynomial.legendre.leggauss(16)
NODES, WEIGHTS = 0.5 * (_nodes + 1.0), 0.5 * _weights
PANEL = 2.0

SHORT = 0.5
"""Flights shorter than this have their displacement by terms that do not cancel; longer ones by what decays."""

LAG_SERIES = np.array([1.0 / math.factorial(k) for k in range(17, 2, -2)])
"""Coefficients of ``(t - sin t) / t^3 = 1/3! - t^2/5! + ...``, the highest first: to rounding for t below `SHORT`."""

DRAG_SERIES = np.array([1.0 / math.factorial(k) for k in range(16, 1, -1)])
"""Coefficients of ``phi_2(z) = 1/2 - z/3! + z^2/4! - ...``, the highest first: to rounding for z below 0.5."""


@jit
def turned(beta: float, t: float) -> float:
    """``E = (1 - exp(-beta t)) / beta``: what a unit speed travels in time t under damping beta."""
    z = beta * t
    if abs(z) < 1e-300:
        return t
    return -t * math.expm1(-z) / z


@jit
def dragged(beta: float, t: float) -> float:
    """``(t - E) / beta``: what a unit drag travels; by its series where the difference would cancel."""
    z = beta * t
    if z > 0.5:
        return t * t * (z + math.expm1(-z)) / (z * z)
    total = 0.0
    for coefficient in DRAG_SERIES:
        total = coefficient - z * total
    return t * t * total


@jit
def decay(beta: float, t: float) -> float:
    """``exp(-beta t)``."""
    return math.exp(-beta * t)


@jit
def wheel_speeds(c: Constants, tau: float, y1: float, y2: float) -> tuple[float, float]:
    """Speeds ``(u_1, u_2)`` of the two wheels."""
    u1 = c.alpha * math.cos(tau) - y1
    return u1, u1 + y2


@jit
def lag_of_sine(t: float) -> float:
    """``t - sin t``; by its series where the difference would cancel."""
    if t > SHORT:
        return t - math.sin(t)
    total, square = 0.0, t * t
    for coefficient in LAG_SERIES:
        total = coefficient - square * total
    return t * square * total


@jit
def flow(c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, t: float) -> State:
    """State after a flight of time `t` from `tau` (Eq. 3; Eq. 10 is this map after a mesh-1 impact).

    With ``x1 = x2 = 0`` the displacements have full relative precision however short the flight is: those of a
    flight below `SHORT` are ``y t`` and terms of second order in t.

    Examples
    --------
    >>> from scene import DAT21, Scene
    >>> c = Scene.from_gears(DAT21).constants
    >>> [round(v, 6) for v in flow(c, 0.0, 0.5, -1.8, 0.5, -1.8, 0.1)]
    [0.321405, -1.774437, 0.320514, -1.789725]
    """
    u1, u2 = wheel_speeds(c, tau, y1, y2)
    pull1 = c.beta1 * u1 + c.gamma1  # -u1'
    sine, half = math.sin(tau), math.sin(0.5 * t)
    if t < SHORT:
        slowed1 = pull1 * dragged(c.beta1, t)
        driven = -c.alpha * (2.0 * sine * half * half + math.cos(tau) * lag_of_sine(t))  # alpha cos(tau) t lies in y1 t
        x1 = x1 + (y1 * t + (slowed1 + driven))
    else:
        turn1 = u1 * turned(c.beta1, t) - c.gamma1 * dragged(c.beta1, t)
        x1 = x1 + (2.0 * c.alpha * math.cos(tau + 0.5 * t) * half - turn1)
    # the same of the velocity: alpha (cos(tau + t) - cos(tau)) without cancellation
    y1 = y1 + (pull1 * turned(c.beta1, t) - 2.0 * c.alpha * math.sin(tau + 0.5 * t) * half)
    if c.stages == 2:
        pull2 = c.beta2 * u2 + c.gamma2
        if t < SHORT:
            x2 = x2 + (y2 * t + (slowed1 - pull2 * dragged(c.beta2, t)))
        else:
            x2 = x2 + ((u2 * turned(c.beta2, t) - c.gamma2 * dragged(c.beta2, t)) - turn1)
        y2 = y2 + (pull1 * turned(c.beta1, t) - pull2 * turned(c.beta2, t))
    return x1, y1, x2, y2


@jit
def field(c: Constants, tau: float, y1: float, y2: float) -> Floats:
    """Time derivative of ``(x1, y1, x2, y2)`` in flight (Eq. 3), shape (4,)."""
    u1, u2 = wheel_speeds(c, tau, y1, y2)
    drag1 = c.beta1 * u1 + c.gamma1
    f = np.zeros(4)
    f[0], f[1] = y1, -c.alpha * math.sin(tau) + drag1
    if c.stages == 2:
        f[2], f[3] = y2, drag1 - c.beta2 * u2 - c.gamma2
    return f


@jit
def field_rate(c: Constants, tau: float) -> Floats:
    """Partial derivative of `field` with respect to time, shape (4,)."""
    f = np.zeros(4)
    f[1] = -c.alpha * (math.cos(tau) + c.beta1 * math.sin(tau))
    if c.stages == 2:
        f[3] = c.alpha * (c.beta2 - c.beta1) * math.sin(tau)
    return f


@jit
def system_matrix(c: Constants) -> Floats:
    """``A`` of the linear flight ``s' = A s + ...`` (Eq. 8), shape (4, 4)."""
    a = np.zeros((4, 4))
    a[0, 1], a[1, 1] = 1.0, -c.beta1
    if c.stages == 2:
        a[2, 3], a[3, 1], a[3, 3] = 1.0, c.beta2 - c.beta1, -c.beta2
    return a


@jit
def jacobian(c: Constants, t: float) -> Floats:
    """``exp(A t)``, the derivative of `flow` with respect to ``(x1, y1, x2, y2)``, shape (4, 4)."""
    j = np.eye(4)
    e1, d1 = turned(c.beta1, t), decay(c.beta1, t)
    e2, d2 = turned(c.beta2, t), decay(c.beta2, t)
    j[0, 1], j[1, 1] = e1, d1
    j[2, 1], j[2, 3] = e1 - e2, e2
    j[3, 1], j[3, 3] = d1 - d2, d2
    return j


@jit
def noise_rate(c: Constants, tau: float) -> tuple[float, float]:
    """What the one noise ``sigma eta`` does to ``(y_1, y_2)`` per unit time (Eq. 5)."""
    cosine = math.cos(tau)
    return -math.sin(tau) + c.beta1 * cosine, (c.beta1 - c.beta2) * cosine


@jit
def noise_covariance(c: Constants, tau: float, t: float) -> Floats:
    """Covariance of ``(x1, y1, x2, y2)`` that the noise adds in a flight of time `t` from `tau`, shape (4, 4).

    ``sigma^2 int exp(A r) m m' exp(A' r) dr`` over the lag r before the end of the flight, ``m`` the
    modulation of Eq. 5; by Gauss-Legendre to rounding.  Panels start at the scale of the damping
    and double, for the memory of a damped speed lies within ``1 / beta`` of the end.
    """
    q = np.zeros((4, 4))
    g = np.zeros(4)
    fastest = max(c.beta1, c.beta2)
    panel = min(PANEL, 2.0 / fastest) if fastest > 0.0 else PANEL
    lag = 0.0
    while lag < t:
        h = min(panel, t - lag)
        for n in range(NODES.size):
            r = lag + h * NODES[n]
            m1, m2 = noise_rate(c, tau + t - r)
            e1, d1 = turned(c.beta1, r), decay(c.beta1, r)
            g[0], g[1] = e1 * m1, d1 * m1
            if c.stages == 2:
                e2, d2 = turned(c.beta2, r), decay(c.beta2, r)
                g[2], g[3] = (e1 - e2) * m1 + e2 * m2, (d1 - d2) * m1 + d2 * m2
            w = c.sigma * c.sigma * h * WEIGHTS[n]
            for i in range(4):
                for j in range(i + 1):
                    q[i, j] += w * g[i] * g[j]
        lag += h
        panel = min(PANEL, 2.0 * panel)
    for i in range(4):
        for j in range(i):
            q[j, i] = q[i, j]
    return q
