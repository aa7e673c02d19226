"""Lyapunov exponents of the symmetric orbit of the impact pair, whose linear map from impact to impact is known."""

import math

from rattle.compare.chaos.exponents import lyapunov
from rattle.compare.checks.published.impact_pair import HALF, symmetric_orbit
from rattle.compare.checks.published.result import Check, Measured, NegativeControl
from rattle.scene import Scene

CASES = ((0.35, 0.4), (0.35, 0.25), (0.15, 0.35))  # alpha, epsilon; stable, with two different exponents each
IMPACTS = 10_000
ROUNDING = 1e-10


def _exponents(alpha: float, epsilon: float) -> tuple[float, float]:
    """Both exponents, from trace and determinant of the map of (dx, dy) from one impact to the next.

    A flight of pi takes dx to dx + pi dy.  An impact at the speed v and the acceleration a towards the gap takes
    (dx, dy) to -(epsilon dx, epsilon dy - (1 + epsilon) a dx / v).
    """
    tau, speed = symmetric_orbit(alpha, epsilon, HALF)
    half = 0.5 * math.pi * (1.0 + epsilon) * -alpha * math.sin(tau) / speed - epsilon
    split = math.sqrt(half**2 - epsilon**2)
    first, second = sorted((abs(half + split), abs(half - split)), reverse=True)
    return math.log(first) / math.pi, math.log(second) / math.pi


def _without_saltation(alpha: float, epsilon: float) -> tuple[float, float]:
    """The same where an impact takes (dx, dy) to (dx, -epsilon dy)."""
    return 0.0, math.log(epsilon) / math.pi


def orbit_exponents(seed: int = 0, workers: int = 2) -> Measured:
    """Check both exponents of three symmetric orbits: the tangent frames through flights and impacts."""
    found = {}
    for alpha, epsilon in CASES:
        scene = Scene(alpha=alpha, epsilon=epsilon, beta1=0.0, gamma1=0.0, gap1=HALF, stages=1)
        found[alpha, epsilon] = lyapunov(scene, impacts=IMPACTS).value

    def checks(truth: dict[tuple[float, float], tuple[float, float]]) -> list[Check]:
        return [
            Check(f"exponent {i + 1}, alpha {a}, eps {e}", float(found[a, e][i]), truth[a, e][i], 0.0, ROUNDING)
            for a, e in CASES
            for i in range(2)
        ]

    return Measured(
        "orbit exponents",
        "Masri & Caughey 1966; Mueller 1995 (saltation)",
        "each exponent of the impact pair's symmetric orbit is that of its map from impact to impact: lyapunov()",
        checks({case: _exponents(*case) for case in CASES}),
        [
            NegativeControl("impacts without the saltation term", checks({c: _without_saltation(*c) for c in CASES})),
            NegativeControl("restitution 0.1 % larger", checks({(a, e): _exponents(a, 1.001 * e) for a, e in CASES})),
        ],
    )
