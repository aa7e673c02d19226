"""A step of exact flight, from the shortest to the longest admissible step."""

import math

import mpmath as mp
import numpy as np

from rattle.compare.checks.extremes import truth
from rattle.compare.checks.extremes.flights import constants
from rattle.compare.checks.extremes.row import ROUNDING, Extreme, farthest, spread, worst_of
from rattle.montecarlo.schemes import exact_flight
from rattle.montecarlo.schemes import series as short
from rattle.scene.constants import Constants

__all__ = ["ROWS"]

LONGEST_DAMPED = 0.2  # largest admissible beta dt
LONGEST = 0.1  # largest admissible dt


def _tried() -> list[tuple[Constants, float]]:
    """Scenes with a step each, up to the longest admissible one."""
    out = []
    for beta1 in spread(1e-9, 1e3, 5, 0.0):
        for beta2 in (0.0, beta1, beta1 * (1.0 + 1e-9), 2.0, 1e3):
            longest = min(LONGEST, LONGEST_DAMPED / max(beta1, beta2, 1e-300))
            out += [(constants(beta1=beta1, beta2=beta2), h) for h in (1e-12, 1e-3 * longest, longest)]
    return out


def short_damping() -> Extreme:
    """Series of the phi-functions for short times."""
    errors = []
    for c, h in _tried():
        j = truth.jacobian(c, h)
        drag = truth.flight(c._replace(alpha=0.0, gamma1=1.0), 0.0, 0.0, 0.0, h)[0][0]
        e1, e12 = short.short_apart(c.beta1, c.beta2, h)
        found = [short.short_phi1(c.beta1, h), short.short_phi2(c.beta1, h), e1, e12]
        exact = np.array([j[0][1], drag, j[0][1], j[2][1]])
        errors.append(farthest(found, exact, np.maximum(np.abs(exact), 1e-300)))
    return Extreme(
        "phi-functions of a short step", "beta", "beta 0 to 1e3, nearly equal too; beta h 0 to 0.2",
        "MODEL 2 in 400 digits", worst_of(errors), ROUNDING, "its value",
    )  # fmt: skip


def noise_response() -> Extreme:
    """Response of the state to a unit noise impulse after a lag: the integrand of the noise of a step."""
    errors = []
    for c, h in _tried():
        for end in (0.0, 0.5 * math.pi, 2.2):
            exact = np.array(truth.unit_noise(c, end, h))
            phase = end - h
            found = exact_flight.node(c, math.sin(phase), math.cos(phase), h)
            m = 1.0 + c.beta1
            size = [m * h, m, abs(c.beta1 - c.beta2) * (1.0 + h) * h, abs(c.beta1 - c.beta2) * (1.0 + h)]
            errors.append(farthest(found, exact, np.maximum(size, 1e-300)))
    return Extreme(
        "exact flight: response to noise", "beta, beta1 = beta2", "beta 0 to 1e3, beta h up to 0.2, h up to 0.1",
        "sums of exponentials in 400 digits", worst_of(errors), ROUNDING, "modulation, (times time)",
    )  # fmt: skip


def step_noise() -> Extreme:
    """Noise of a step from its Brownian increment and space-time Lévy area.

    Three quadrature nodes leave an error of 2e-8 at the longest step, less than that of using increment and area alone.
    """
    errors = []
    for c, h in _tried()[1::3] + _tried()[2::3]:
        for first, slope in ((1.0, 0.0), (0.0, 1.0)):
            exact = _integral(c, 0.4, h, first, slope)
            found = exact_flight.kick(c, 0.4, h, first, slope)
            m = 1.0 + c.beta1
            size = [m * h, m, abs(c.beta1 - c.beta2) * (1.0 + h) * h, abs(c.beta1 - c.beta2) * (1.0 + h)]
            errors.append(farthest(found, exact, np.maximum(size, 1e-300)))
    return Extreme(
        "exact flight: noise of a step", "beta, beta1 = beta2", "as above, by increment and by space-time Lévy area",
        "Gauss-Legendre in 30 digits", worst_of(errors), 1e-7, "modulation, (times time)",
    )  # fmt: skip


def _integral(c: Constants, tau: float, h: float, first: float, slope: float) -> list[float]:
    with mp.workdps(30):
        nodes = [(mp.mpf(x), mp.mpf(w)) for x, w in mp.calculus.quadrature.GaussLegendre(mp.mp).calc_nodes(2, 110)]
    total = np.zeros(4)
    for x, w in nodes:
        share = float((x + 1) / 2)
        weight = float(w / 2) * c.sigma * (first + slope * (share - 0.5))
        total += weight * np.array(truth.unit_noise(c, tau + h, h * (1.0 - share)))
    return total.tolist()


ROWS = (short_damping, noise_response, step_noise)
