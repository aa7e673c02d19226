"""The impact pair: its symmetric orbit with two impacts a period, and how weak noise spreads it."""

import math

import numpy as np

from rattle.closure.attractor import Attractor, attractor
from rattle.closure.stationary import Law, linear_law
from rattle.compare.checks.check import Check, Result
from rattle.montecarlo.long_run import LongRun, long_run
from rattle.scene import Scene

CASES = ((0.25, 0.5), (0.2, 0.6), (0.3, 0.4))  # alpha, epsilon; with half gaps of 0.5 these orbits are stable
HALF = 0.5
SIGMA, PERIODS = 1e-3, 256  # of the noisy run, of the first case
SLACK = 2e-6  # orbits are found to 1e-8 of their state


def symmetric_orbit(alpha: float, epsilon: float, gap: float) -> tuple[float, float]:
    """Phase and speed of the impacts of the symmetric orbit (Masri and Caughey 1966)."""
    k = 0.5 * math.pi * (1.0 + epsilon) / (1.0 - epsilon)
    tau = math.asin(gap / (alpha * math.hypot(1.0, k))) - math.atan(k)
    return tau, 2.0 * alpha * math.cos(tau) / (1.0 - epsilon)


def _scene(alpha: float, epsilon: float, sigma: float = 0.0) -> Scene:
    return Scene(alpha=alpha, epsilon=epsilon, beta1=0.0, gamma1=0.0, gap1=HALF, sigma=sigma, stages=1)


def _orbit(a: Attractor, alpha: float, epsilon: float, factor: float = 1.0) -> list[Check]:
    """Phase (modulo half a period) and speed of the impacts of an orbit."""
    tau, speed = symmetric_orbit(alpha, factor * epsilon, HALF)
    phase = float((a.tau[-1] - tau + 0.5 * math.pi) % math.pi - 0.5 * math.pi)
    name = f"alpha {alpha}, eps {epsilon}"
    return [
        Check(f"phase less its truth, {name}", phase, 0.0, 0.0, 2e-7),
        Check(f"speed, {name}", float(np.abs(a.before[-1, 1])), speed, 0.0, 2e-7 * speed),
    ]


def _spread(run: LongRun, law: Law, name: str, factor: float = 1.0) -> list[Check]:
    found = run.estimates
    flight = float(np.sqrt((law.weight * law.sd_flight**2).sum()))
    speed = float(np.sqrt((law.weight * law.sd_speed**2).sum()))
    return [
        Check(f"{q} / sigma, {name}", found[q].value / SIGMA, factor * truth / SIGMA, found[q].se / SIGMA, SLACK)
        for q, truth in (("sd_speed", speed), ("sd_flight", flight))
    ]


def impact_pair(seed: int = 0, workers: int = 2) -> Result:
    """Check phase and speed of the impacts of three symmetric orbits, and the sds that weak noise gives them."""
    orbits = {case: attractor(_scene(*case)) for case in CASES}
    noisy = _scene(*CASES[0], SIGMA)
    law, run = linear_law(noisy, orbits[CASES[0]]), long_run(noisy, periods=PERIODS, rng=seed, workers=workers)

    def checks(epsilon: float = 1.0, sd: float = 1.0) -> list[Check]:
        out = [check for case, a in orbits.items() for check in _orbit(a, *case, epsilon)]
        return out + _spread(run, law, f"alpha {CASES[0][0]}, eps {CASES[0][1]}", sd)

    exact = 2 * len(CASES)  # checks without a statistical error
    return Result(
        "impact pair",
        "Masri & Caughey 1966; Lyapunov's equation",
        "the symmetric orbit has its impacts at tau0 + n pi at the speed 2 alpha cos tau0 / (1 - epsilon): follow(); "
        "its stationary sds under weak noise by a discrete Lyapunov equation: long_run()",
        checks(),
        {
            "restitution 0.1 % larger": checks(epsilon=1.001)[:exact],
            "sds 2 % larger": checks(sd=1.02)[exact:],
        },
    )
