"""The phi-functions as Taylor series, for ``beta t <= 0.2``: guaranteed by the longest admissible step.

Here ``phi_k(z) = sum_n z^n / (n + k)!``; the functions return ``t phi_1(-beta t)`` and ``t^2 phi_2(-beta t)``.
"""

from math import factorial

from rattle.scene.compiled import inlined

__all__ = ["short_apart", "short_phi1", "short_phi2"]

PHI1_SERIES = tuple(1.0 / factorial(k + 1) for k in range(12, -1, -1))
"""Coefficients ``1 / (k + 1)!`` of ``phi_1``, the highest first; the truncation error is 2e-18 for |z| <= 0.2."""

PHI2_SERIES = tuple(1.0 / factorial(k + 2) for k in range(12, -1, -1))
"""Coefficients ``1 / (k + 2)!`` of ``phi_2``, the highest first."""


@inlined
def short_phi1(beta: float, t: float) -> float:
    """``t phi_1(-beta t) = (1 - exp(-beta t)) / beta``, as `rattle.scene.damping.phi1`.

    Parameters
    ----------
    beta : float
        Damping.
    t : float
        Time, ``beta t <= 0.2``.

    Returns
    -------
    float
    """
    z, total = -beta * t, 0.0
    for coefficient in PHI1_SERIES:
        total = coefficient + z * total
    return t * total


@inlined
def short_phi2(beta: float, t: float) -> float:
    """``t^2 phi_2(-beta t)``, as `rattle.scene.damping.phi2`.

    Parameters
    ----------
    beta : float
        Damping.
    t : float
        Time, ``beta t <= 0.2``.

    Returns
    -------
    float
    """
    z, total = -beta * t, 0.0
    for coefficient in PHI2_SERIES:
        total = coefficient + z * total
    return t * t * total


@inlined
def short_apart(beta1: float, beta2: float, t: float) -> tuple[float, float]:
    """`short_phi1` of one damping, and its difference to that of another, without cancellation.

    Horner's scheme for a value and a divided difference.

    Parameters
    ----------
    beta1, beta2 : float
        Dampings.
    t : float
        Time, both ``beta t <= 0.2``.

    Returns
    -------
    value, difference : float
        ``E(beta1, t)`` and ``E(beta1, t) - E(beta2, t)`` with ``E = t phi_1(-beta t)``.
    """
    z1, z2, value, slope = -beta1 * t, -beta2 * t, 0.0, 0.0
    for coefficient in PHI1_SERIES:
        slope = value + z2 * slope
        value = coefficient + z1 * value
    return t * value, (beta2 - beta1) * t * t * slope
