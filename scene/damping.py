"""What damping makes of a speed in a time: turned, dragged and left, and how two dampings differ, all to rounding.

No formula here divides by beta where beta is small, so ``beta = 0``, ``beta_1 = beta_2`` and dampings that differ by
little are ordinary values.  Times may be negative: `closure.refining` flies back.
"""

import math

import numpy as np

from scene.compiled import jit

__all__ = ["apart", "damped", "decay", "dragged", "turned"]

SMALL = 0.5  # beta t below which a difference would cancel, and a series is taken
DRAG_SERIES = np.array([1.0 / math.factorial(k) for k in range(18, 1, -1)])
"""Coefficients of ``phi_2(z) = 1/2 - z/3! + z^2/4! - ...``, the highest first: to rounding for |z| below `SMALL`."""


@jit
def turned(beta: float, t: float) -> float:
    """``E = (1 - exp(-beta t)) / beta``: what a unit speed travels in time t under damping beta.

    Examples
    --------
    >>> turned(0.0, 2.0), turned(1e3, 1e6)
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
    """`turned` and `decay` together.

    Examples
    --------
    >>> damped(0.0, 2.0)
    (2.0, 1.0)
    """
    e = turned(beta, t)
    return e, (1.0 - beta * e if abs(beta * t) < SMALL else decay(beta, t))


@jit
def dragged(beta: float, t: float) -> float:
    """``(t - E) / beta``: what a unit drag travels; by its series where the difference would cancel.

    Examples
    --------
    >>> dragged(0.0, 2.0)
    2.0
    """
    z = beta * t
    if abs(z) > SMALL:
        return t * t * ((z + math.expm1(-z)) / z / z)
    total = 0.0
    for coefficient in DRAG_SERIES:
        total = coefficient - z * total
    return t * t * total


@jit
def apart(beta1: float, beta2: float, t: float) -> tuple[float, float]:
    """``E(beta1, t) - E(beta2, t)`` and ``exp(-beta1 t) - exp(-beta2 t)``, to rounding however near both dampings are.

    With ``d = beta2 - beta1 > 0`` the second is ``exp(-beta1 t) (1 - exp(-d t))``, and the first ``(d E_1`` less that)
    over beta2; for little damping ``t d t sum (-1)^k h_k / (k + 2)!``, h_k the complete symmetric polynomial of degree
    k in ``beta_i t``.

    Examples
    --------
    >>> apart(0.5, 0.5, 3.0)
    (0.0, 0.0)
    >>> e, d = apart(0.1, 0.1 + 2.0**-40, 1e-3)  # a difference of 9e-13
    >>> round(e / (0.5e-6 * 2.0**-40), 3), round(d / (1e-3 * 2.0**-40), 3)
    (1.0, 1.0)
    """
    if beta1 == beta2:
        return 0.0, 0.0
    low, high = min(beta1, beta2), max(beta1, beta2)
    d = high - low
    left = -math.exp(-low * t) * math.expm1(-d * t)
    z = high * t
    if abs(z) < SMALL:
        y, h, power, total = low * t, 1.0, 1.0, 0.0
        for k in range(DRAG_SERIES.size - 1, -1, -1):
            total += DRAG_SERIES[k] * h
            power *= -z
            h = power - y * h
        gone = d * t * t * total
    else:
        gone = (d * turned(low, t) - left) / high
    return (gone, left) if beta1 < beta2 else (-gone, -left)
