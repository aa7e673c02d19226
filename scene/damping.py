"""The phi-functions of linear damping, ``t phi1(-beta t)`` and ``t^2 phi2(-beta t)``, for one
damping and for two.

In exponential integrators ``phi1(z) = (exp(z) - 1) / z`` and ``phi2(z) = (exp(z) - 1 - z) / z^2``.
Everything here is accurate to rounding.  No formula divides by beta where beta is small, so ``beta
= 0``, ``beta_1 = beta_2`` and dampings that differ by little need no special case.  Times may be
negative: `rattle.closure.branching.advance` flies backwards.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.scene.compiled import internal, jit

SMALL_DECAY = 0.5  # beta t below which the differences cancel and the series is summed instead
PHI2_SERIES = np.array([1.0 / math.factorial(k) for k in range(18, 1, -1)])
"""Coefficients of ``phi2(-z) = 1/2 - z/3! + z^2/4! - ...``, highest power first: to rounding for
|z| < `SMALL_DECAY`."""


@internal
def phi1(beta: float, t: float) -> float:
    """``E = t phi1(-beta t) = (1 - exp(-beta t)) / beta``: displacement of a unit initial speed
    under damping."""
    z = beta * t
    if abs(z) < 1e-300:
        return t
    return -t * math.expm1(-z) / z


@internal
def decay(beta: float, t: float) -> float:
    """``exp(-beta t)``: what is left of a unit speed."""
    return math.exp(-beta * t)


@internal
def damp(beta: float, t: float) -> tuple[float, float]:
    """`phi1` and `decay` together, with one exponential for both where ``beta t`` is small."""
    e = phi1(beta, t)
    return e, (1.0 - beta * e if abs(beta * t) < SMALL_DECAY else decay(beta, t))


@internal
def phi2(beta: float, t: float) -> float:
    """``t^2 phi2(-beta t) = (t - E) / beta``: displacement under a unit constant acceleration from
    zero speed.

    Summed as a series where the difference would cancel.
    """
    z = beta * t
    if abs(z) > SMALL_DECAY:
        return t * t * ((z + math.expm1(-z)) / z / z)
    total = 0.0
    for coefficient in PHI2_SERIES:
        total = coefficient - z * total
    return t * t * total


class Damped(NamedTuple):
    """The phi-functions of one damping over a time."""

    e: float  # `phi1`
    d: float  # `decay`
    g: float  # `phi2`


@internal
def damped(beta: float, t: float) -> Damped:
    """The phi-functions of a damping: for small ``beta t`` each from the one before, from the
    series of `phi2` on."""
    g = phi2(beta, t)
    if abs(beta * t) > SMALL_DECAY:
        return Damped(phi1(beta, t), decay(beta, t), g)
    e = t - beta * g
    return Damped(e, 1.0 - beta * e, g)


class Pair(NamedTuple):
    """The phi-functions of two dampings over one time."""

    e1: float  # e1, e2: `phi1` of each damping
    d1: float  # d1, d2: `decay` of each damping
    g1: float  # g1, g2: `phi2` of each damping
    e2: float
    d2: float
    g2: float
    # e12, d12: ``e1 - e2`` and ``d1 - d2``, accurate to rounding however close the dampings are
    e12: float
    d12: float


@jit
def pair(beta1: float, beta2: float, t: float) -> Pair:
    """The phi-functions of two dampings and their differences.

    For small ``beta t`` from the series of `phi2`: Horner's scheme for a value and a divided
    difference, and from these ``E = t - beta (t - E) / beta`` and so on, where nothing cancels.
    Otherwise, with ``d = beta2 - beta1 > 0``, ``d1 - d2 = exp(-beta1 t) (1 - exp(-d t))`` and ``e1
    - e2 = (d e1 - (d1 - d2)) / beta2``.
    """
    d = beta2 - beta1
    if max(beta1, beta2) * abs(t) < SMALL_DECAY:
        z1 = -beta1 * t
        z2 = -beta2 * t
        value = 0.0
        slope = 0.0
        for coefficient in PHI2_SERIES:
            slope = value + z2 * slope
            value = coefficient + z1 * value
        g1 = t * t * value
        g12 = d * t * t * t * slope
        e1 = t - beta1 * g1
        e12 = d * g1 - beta2 * g12
        d1 = 1.0 - beta1 * e1
        d12 = d * e1 - beta2 * e12
        return Pair(e1, d1, g1, e1 - e12, d1 - d12, g1 - g12, e12, d12)
    e1, d1 = damp(beta1, t)
    e2, d2 = damp(beta2, t)
    d_gap = -math.exp(-min(beta1, beta2) * t) * math.expm1(-abs(d) * t)  # |d1 - d2|
    e_gap = (abs(d) * (e1 if d > 0.0 else e2) - d_gap) / max(beta1, beta2)  # |e1 - e2|
    sign = 1.0 if d > 0.0 else -1.0
    return Pair(e1, d1, phi2(beta1, t), e2, d2, phi2(beta2, t), sign * e_gap, sign * d_gap)
