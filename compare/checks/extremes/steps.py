"""A step of exact flight, from the shortest to the longest admissible step."""

import math
from collections.abc import Iterator

import mpmath as mp
import numpy as np

from rattle.compare.checks.extremes import truth
from rattle.compare.checks.extremes.extreme import extreme, farthest, spread
from rattle.compare.checks.extremes.flights import constants
from rattle.montecarlo.schemes import short_flight as short
from rattle.scene.constants import Constants

LONGEST_DAMPED = 0.2  # largest admissible beta dt
LONGEST = 0.1  # largest admissible dt
STATE = (0.1, -0.4, -0.2, 0.5)


def _scenes_and_steps() -> list[tuple[Constants, float]]:
    """Scenes with a step each, up to the longest admissible one."""
    out = []
    for beta1 in spread(1e-9, 1e3, 5, 0.0):
        for beta2 in (0.0, beta1, beta1 * (1.0 + 1e-9), 2.0, 1e3):
            longest = min(LONGEST, LONGEST_DAMPED / max(beta1, beta2, 1e-300))
            out += [(constants(beta1=beta1, beta2=beta2), h) for h in (1e-12, 1e-3 * longest, longest)]
    return out


@extreme("phase of a step", "tau", "1e-9 to 1e6, and multiples of pi / 4", "mpmath in 40 digits", unit="1")
def step_phase() -> Iterator[float]:
    """Sine and cosine by the project's own operations."""
    for tau in (*spread(1e-9, 1e6, 200, 0.0), *(-0.25 * math.pi * k for k in range(1, 40))):
        with mp.workdps(40):
            exact = float(mp.sin(mp.mpf(tau))), float(mp.cos(mp.mpf(tau)))
        yield farthest(short.sine_cosine(tau), exact)


@extreme(
    "exact flight: a part of a step",
    "beta, beta1 = beta2",
    "beta 0 to 1e3, beta h up to 0.2, h up to 0.1",
    "MODEL 2 in 400 digits",
    unit="sum of the terms",
)
def step_flight() -> Iterator[float]:
    """Flight of a part of a step without noise: what it adds to the displacements, and the velocities after it."""
    for c, h in _scenes_and_steps():
        tau, (_, y1, _, y2) = 2.2, STATE
        exact, sizes = truth.flight(c, tau, y1, y2, h)
        found, _ = short.short_flight(c, short.sine_cosine(tau), h, (0.0, y1, 0.0, y2), 0.0, 0.0)
        yield farthest(found, exact, sizes)


@extreme(
    "exact flight: noise of a step",
    "beta, beta1 = beta2",
    "as above, by increment and by space-time Lévy area",
    "Gauss-Legendre in 30 digits",
    allowed=1e-8,
    unit="modulation, (times time)",
)
def step_noise() -> Iterator[float]:
    """Noise of a step from its Brownian increment and space-time Lévy area."""
    for c, h in _scenes_and_steps()[1::3] + _scenes_and_steps()[2::3]:
        for first, slope in ((1.0, 0.0), (0.0, 1.0)):
            exact = _integral(c, 0.4, h, first, slope)
            found = short.kick(c, 0.4, h, first, slope / 12.0)
            m = 1.0 + c.beta1
            size = [m * h, m, abs(c.beta1 - c.beta2) * (1.0 + h) * h, abs(c.beta1 - c.beta2) * (1.0 + h)]
            yield farthest(found, exact, np.maximum(size, 1e-300))


def _integral(c: Constants, tau: float, h: float, first: float, slope: float) -> list[float]:
    with mp.workdps(30):
        nodes = [(mp.mpf(x), mp.mpf(w)) for x, w in mp.calculus.quadrature.GaussLegendre(mp.mp).calc_nodes(2, 110)]
    total = np.zeros(4)
    for x, w in nodes:
        share = float((x + 1) / 2)
        weight = float(w / 2) * c.sigma * (first + slope * (share - 0.5))
        total += weight * np.array(truth.unit_noise(c, tau + h, h * (1.0 - share)))
    return total.tolist()


ROWS = (step_phase, step_flight, step_noise)
