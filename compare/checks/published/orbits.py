"""Periodic orbits that are known: the impact pair's phase, speed and spread, Lyapunov exponents, basins of attraction.

The impact pair's symmetric orbit has two impacts a period.  The sum of all exponents is the rate at which damping and
impacts contract volumes of state space.

Basins are those of a published gear-rattling model.  De Souza and Caldas (2001): ``s'' + beta s' = gamma + alpha (sin t
- beta cos t)`` between walls at -1 and 0.  With ``x1 = s + 1/2`` and ``tau = t + pi`` that is one stage of this model.
Equation, values and the figure are taken from Wagemakers, "The Basins Zoo" (2025), arXiv:2504.01580, whose figure has
1200 x 1200 starts.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from rattle.closure.long_orbit import PERIOD, LongOrbit, attractor
from rattle.closure.stationary import linear_law
from rattle.compare.chaos.exponents import drift_exponents, lyapunov
from rattle.compare.checks.check import Check, Found, self_test
from rattle.compare.report.texts import read_file
from rattle.montecarlo.long_run import long_run
from rattle.scene import DAT21, Scene, Start
from rattle.scene.types import Floats

HALF = 0.5
CASES = ((0.25, 0.5), (0.2, 0.6), (0.3, 0.4))  # alpha, epsilon; with half gaps of 0.5 these orbits are stable
WEAK, PERIODS = 1e-3, 256  # noise and periods of the noisy run, of the first case
SLACK = 2e-6  # orbits are found to 1e-8 of their state

IMPACTS, SIGMA = 20_000, 0.1  # of the sum of the exponents, and of its noisy path
PAIRS = ((0.35, 0.4), (0.35, 0.25), (0.15, 0.35))  # alpha, epsilon; stable, with two different exponents each
PAIR_IMPACTS = 10_000
ROUNDING = 1e-10


def symmetric_orbit(alpha: float, epsilon: float, gap: float) -> tuple[float, float]:
    """Phase and speed of the impacts of the symmetric orbit (Masri and Caughey 1966)."""
    k = 0.5 * math.pi * (1.0 + epsilon) / (1.0 - epsilon)
    tau = math.asin(gap / (alpha * math.hypot(1.0, k))) - math.atan(k)
    return tau, 2.0 * alpha * math.cos(tau) / (1.0 - epsilon)


def _pair(alpha: float, epsilon: float, sigma: float = 0.0) -> Scene:
    return Scene(alpha=alpha, epsilon=epsilon, beta1=0.0, gamma1=0.0, gap1=HALF, sigma=sigma, stages=1)


@self_test
def impact_pair(seed: int = 0, workers: int = 2) -> Found:
    """Check phase and speed of the impacts of three symmetric orbits, and the sds that weak noise gives them."""
    orbits = {case: attractor(_pair(*case)) for case in CASES}
    noisy = _pair(*CASES[0], WEAK)
    law = linear_law(noisy, orbits[CASES[0]])
    found = long_run(noisy, periods=PERIODS, rng=seed, workers=workers).estimates

    def states(factor: float = 1.0) -> list[Check]:
        """Phase (modulo half a period) and speed of the impacts."""
        out = []
        for (alpha, epsilon), a in orbits.items():
            tau, speed = symmetric_orbit(alpha, factor * epsilon, HALF)
            phase = float((a.tau[-1] - tau + 0.5 * math.pi) % math.pi - 0.5 * math.pi)
            name = f"alpha {alpha}, eps {epsilon}"
            out.append(Check(f"phase less its truth, {name}", phase, 0.0, 0.0, 2e-7))
            out.append(Check(f"speed, {name}", float(np.abs(a.before[-1, 1])), speed, 0.0, 2e-7 * speed))
        return out

    def spreads(factor: float = 1.0) -> list[Check]:
        out = []
        for q, sds in (("sd_speed", law.sd_speed), ("sd_flight", law.sd_flight)):
            truth = float(np.sqrt((law.weight * sds**2).sum()))
            name = f"{q} / sigma, alpha {CASES[0][0]}, eps {CASES[0][1]}"
            out.append(Check(name, found[q].value / WEAK, factor * truth / WEAK, found[q].se / WEAK, SLACK))
        return out

    return states() + spreads(), {"restitution 0.1 % larger": states(1.001), "sds 2 % larger": spreads(1.02)}


@self_test
def exponent_sum(seed: int = 0, workers: int = 2) -> Found:
    """Check the sum of the four exponents of DAT21: of the orbit, and of the drift along a noisy path."""
    scene = Scene.from_gears(DAT21)
    records = lyapunov(scene, impacts=IMPACTS), drift_exponents(scene.with_sigma(SIGMA), impacts=IMPACTS, seed=seed)
    both = scene.beta1 + scene.beta2

    def checks(power: float = 2.0, damping: float = both) -> list[Check]:
        out = []
        for found in records:
            truth = -damping + found.rate * power * math.log(scene.epsilon)
            out.append(Check(f"sum of exponents, {found.of}", float(found.value.sum()), truth, 0.0, ROUNDING))
        return out

    return checks(), {
        "epsilon to the first power": checks(power=1.0),
        "damping of one stage alone": checks(damping=scene.beta1),
        "1 % more damping": checks(damping=1.01 * both),
    }


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


@self_test
def orbit_exponents(seed: int = 0, workers: int = 2) -> Found:
    """Check both exponents of three symmetric orbits: the tangent frames through flights and impacts."""
    found = {case: lyapunov(_pair(*case), impacts=PAIR_IMPACTS).value for case in PAIRS}

    def checks(truth: Callable[[float, float], tuple[float, float]]) -> list[Check]:
        return [
            Check(f"exponent {i + 1}, alpha {a}, eps {e}", float(found[a, e][i]), truth(a, e)[i], 0.0, ROUNDING)
            for a, e in PAIRS
            for i in range(2)
        ]

    return checks(_exponents), {
        "impacts without the saltation term": checks(_without_saltation),
        "restitution 0.1 % larger": checks(lambda alpha, epsilon: _exponents(alpha, 1.001 * epsilon)),
    }


GEARS = Scene(alpha=0.48, epsilon=0.9, beta1=0.1, gamma1=0.1, stages=1)
FRAME = (-0.99, -0.02), (-1.0, 1.0)  # of the figure of basins: s from left to right, its velocity from bottom to top
FIGURE = read_file("checks.published", "basins.md")
"""The figure: impacts a period of the motion at each place whose surroundings have one colour."""
SHARE, PIXELS = 0.3821, 334  # of the coloured pixels of the figure as printed; a side of it
STARTS = 6000
STRETCH, LONGEST = 120, 24  # impacts of a stretch, and the most stretches until an orbit repeats
SAME = 1e-6


def _impacts_a_period(scene: Scene, starts: Iterable[Any], phase: float = math.pi) -> Floats:
    """Impacts in a period of the motion that is reached from each start ``(s, s')``; NaN for another one."""
    found = []
    for s, velocity in starts:
        orbit = LongOrbit(replace(scene, start=Start(phase, s + 0.5, velocity)))
        found.append(math.nan)
        for _ in range(LONGEST):
            flight = orbit.stretch(STRETCH, tangent=False).flight
            if flight.size < STRETCH:  # at rest
                break
            number = STRETCH / 2 * PERIOD / flight[STRETCH // 2 :].sum()
            if abs(number - round(number)) < SAME:
                found[-1] = round(number)
                break
    return np.array(found)


def _in_frame(across: Floats, up: Floats) -> Floats:
    """Starts at places of the figure, 0 to 1; shape (starts, 2)."""
    (left, right), (bottom, top) = FRAME
    return np.column_stack([left + (right - left) * across, bottom + (top - bottom) * up])


@self_test
def gear_rattle_basins(seed: int = 0, workers: int = 2) -> Found:
    """Check from which starts each of two coexisting motions is reached, and the share of all starts."""
    lines = FIGURE.split()
    cells = [(i, j, int(c)) for i, line in enumerate(lines) for j, c in enumerate(line) if c != "."]
    row, column, printed = np.array(cells).T
    places = _in_frame((column + 0.5) / len(lines), 1.0 - (row + 0.5) / len(lines))

    def differ(scene: Scene = GEARS, phase: float = math.pi) -> list[Check]:
        other = _impacts_a_period(scene, places, phase) != printed
        return [Check(f"places of {len(cells)} that differ from the figure", float(other.sum()), 0.0)]

    rng = np.random.default_rng(seed)
    three = _impacts_a_period(GEARS, _in_frame(*rng.uniform(size=(2, STARTS)))) == 3.0
    se = float(three.std()) * math.sqrt(1.0 / STARTS + 1.0 / PIXELS**2)
    share = Check("share of starts that end in three impacts a period", float(three.mean()), SHARE, se)
    return (
        [*differ(), share],
        {
            "restitution 0.88": differ(replace(GEARS, epsilon=0.88)),
            "drive 5 % smaller": differ(replace(GEARS, alpha=0.95 * GEARS.alpha)),
            "drag 20 % larger": differ(replace(GEARS, gamma1=1.2 * GEARS.gamma1)),
            "drag on the other flank": differ(phase=0.0),
        },
    )
