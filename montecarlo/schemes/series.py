"""Damping within a step, where it does little (``beta t <= 0.2``, what the door lets through): series to rounding."""

from math import factorial

from rattle.scene.compiled import inlined

__all__ = ["short_apart", "short_phi1", "short_phi2"]

TURNED = tuple(1.0 / factorial(k + 1) for k in range(12, -1, -1))
"""Coefficients of ``(1 - exp(-z)) / z = 1 - z/2! + z^2/3! - ...``, the highest first; what is left out is 2e-18."""

DRAGGED = tuple(1.0 / factorial(k + 2) for k in range(12, -1, -1))


@inlined
def short_phi1(beta: float, t: float) -> float:
    """`rattle.scene.damping.phi1`."""
    z, total = -beta * t, 0.0
    for coefficient in TURNED:
        total = coefficient + z * total
    return t * total


@inlined
def short_phi2(beta: float, t: float) -> float:
    """`rattle.scene.damping.phi2`."""
    z, total = -beta * t, 0.0
    for coefficient in DRAGGED:
        total = coefficient + z * total
    return t * t * total


@inlined
def short_apart(beta1: float, beta2: float, t: float) -> tuple[float, float]:
    """``E(beta1, t)`` and ``E(beta1, t) - E(beta2, t)``: Horner's scheme for a value and a divided difference."""
    z1, z2, value, slope = -beta1 * t, -beta2 * t, 0.0, 0.0
    for coefficient in TURNED:
        slope = value + z2 * slope
        value = coefficient + z1 * value
    return t * value, (beta2 - beta1) * t * t * slope
