"""What damping makes of a speed in a time: turned, dragged and left, and how two dampings differ, all to rounding.

No formula here divides by beta where beta is small, so ``beta = 0``, ``beta_1 = beta_2`` and dampings that differ by
little are ordinary values.  Times may be negative: `rattle.closure.branching.refine` flies back.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.scene.compiled import jit

__all__ = ["Pair", "damped", "decay", "pair", "phi1", "phi2"]

SMALL = 0.5  # beta t below which a difference would cancel, and a series is taken
DRAG_SERIES = np.array([1.0 / math.factorial(k) for k in range(18, 1, -1)])
"""Coefficients of ``phi_2(z) = 1/2 - z/3! + z^2/4! - ...``, the highest first: to rounding for |z| below `SMALL`."""


@jit
def phi1(beta: float, t: float) -> float:
    """``E = (1 - exp(-beta t)) / beta``: what a unit speed travels in time t under damping beta.

    Examples
    --------
    >>> phi1(0.0, 2.0), phi1(1e3, 1e6)
    (2.0, 0.001)
    """
    z = beta * t
    if abs(z) < 1e-300:
        return t
    return -t * math.expm1(-z) / z


@jit
def decay(beta: float, t: float) -> float:
    """``exp(-beta t)``."""
    return math.exp(-beta * t)


@jit
def damped(beta: float, t: float) -> tuple[float, float]:
    """`phi1` and `decay` together.

    Examples
    --------
    >>> damped(0.0, 2.0)
    (2.0, 1.0)
    """
    e = phi1(beta, t)
    return e, (1.0 - beta * e if abs(beta * t) < SMALL else decay(beta, t))


@jit
def phi2(beta: float, t: float) -> float:
    """``(t - E) / beta``: what a unit drag travels; by its series where the difference would cancel.

    Examples
    --------
    >>> phi2(0.0, 2.0)
    2.0
    """
    z = beta * t
    if abs(z) > SMALL:
        return t * t * ((z + math.expm1(-z)) / z / z)
    total = 0.0
    for coefficient in DRAG_SERIES:
        total = coefficient - z * total
    return t * t * total


class Pair(NamedTuple):
    """Two dampings over one time.

    Attributes
    ----------
    e1, e2 : float
        `phi1`.
    d1, d2 : float
        `decay`.
    g1, g2 : float
        `phi2`.
    e12, d12 : float
        ``e1 - e2`` and ``d1 - d2``, to rounding however near both dampings are.
    """

    e1: float
    d1: float
    g1: float
    e2: float
    d2: float
    g2: float
    e12: float
    d12: float


@jit
def pair(beta1: float, beta2: float, t: float) -> Pair:
    """All of two dampings.

    For little damping by the series of `phi2`: Horner's scheme for a value and a divided difference, and from these
    ``E = t - beta (t - E) / beta`` and so on, where nothing cancels.  Else ``d1 - d2`` is ``exp(-beta1 t) (1 - exp(-d
    t))`` with ``d = beta2 - beta1 > 0``, and ``e1 - e2`` is ``(d e1`` less that) over beta2.

    Examples
    --------
    >>> p = pair(0.1, 0.1 + 2.0**-40, 1e-3)  # a difference of 9e-13
    >>> round(p.e12 / (0.5e-6 * 2.0**-40), 3), round(p.d12 / (1e-3 * 2.0**-40), 3)
    (1.0, 1.0)
    """
    d = beta2 - beta1
    if max(beta1, beta2) * abs(t) < SMALL:
        z1, z2, value, slope = -beta1 * t, -beta2 * t, 0.0, 0.0
        for coefficient in DRAG_SERIES:
            slope = value + z2 * slope
            value = coefficient + z1 * value
        g1, g12 = t * t * value, d * t * t * t * slope
        e1, e12 = t - beta1 * g1, d * g1 - beta2 * g12
        d1, d12 = 1.0 - beta1 * e1, d * e1 - beta2 * e12
        return Pair(e1, d1, g1, e1 - e12, d1 - d12, g1 - g12, e12, d12)
    e1, d1 = damped(beta1, t)
    e2, d2 = damped(beta2, t)
    less = -math.exp(-min(beta1, beta2) * t) * math.expm1(-abs(d) * t)
    gone = (abs(d) * (e1 if d > 0.0 else e2) - less) / max(beta1, beta2)
    sign = 1.0 if d > 0.0 else -1.0
    return Pair(e1, d1, phi2(beta1, t), e2, d2, phi2(beta2, t), sign * gone, sign * less)
