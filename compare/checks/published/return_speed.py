"""A randomly accelerated particle at a wall: its speed on return, and the restitution below which it collapses."""

import math

import numpy as np
from scipy.integrate import quad

from rattle.compare.checks.check import Check, Result
from rattle.compare.checks.published.returning import Floats, log_speeds

MEAN = math.pi / math.sqrt(3.0)
"""E ln rho, rho being the ratio of consecutive speeds, with the density ``3 / (2 pi) rho^(3/2) / (1 + rho^3)``."""

VARIANCE = 4.0 * math.pi**2 / 9.0
"""Var ln rho."""

RETURNS = 300_000
ORDERS = (-0.6, -0.3, 0.1)
"""Orders s of the moments E rho^s; E rho^(4 s) is finite too, so that standard errors can be estimated."""
BELOW, ABOVE = 0.12, 0.22  # restitutions below and above the critical one, exp(-MEAN) = 0.163
PATHS, BOUNCES = 20_000, 8


def _moments(ln: Floats, mean: float, variance: float, slower: float) -> list[Check]:
    n, own = ln.size, float(ln.var())
    fourth = float(((ln - ln.mean()) ** 4).mean())
    share = float((ln < 0.0).mean())
    return [
        Check("E ln rho", float(ln.mean()), mean, math.sqrt(own / n)),
        Check("Var ln rho", own, variance, math.sqrt((fourth - own**2) / n)),
        Check("P(rho < 1)", share, slower, math.sqrt(share * (1.0 - share) / n)),
    ]


def return_speed(seed: int = 0, workers: int = 2) -> Result:
    """Check mean and variance of ln rho, and P(rho < 1), over `RETURNS` flights that start at speed 1."""
    ln = log_speeds(1.0, RETURNS, 1, seed)[:, 0]
    slower = quad(lambda r: 1.5 / math.pi * r**1.5 / (1.0 + r**3), 0.0, 1.0)[0]
    return Result(
        "return speed",
        "McKean 1963; Cornell, Swift & Bray 1998",
        "a randomly accelerated particle that leaves a wall at speed v returns at speed rho v: steps of "
        "rattle.montecarlo.coupling.dyadic, rescaled before each, without a time limit",
        _moments(ln, MEAN, VARIANCE, slower),
        {
            "mean 3 % larger": _moments(ln, 1.03 * MEAN, VARIANCE, slower),
            "variance 3 % smaller": _moments(ln, MEAN, 0.97 * VARIANCE, slower),
            "an impact that keeps 97 %": _moments(ln + math.log(0.97), MEAN, VARIANCE, slower),
        },
    )


def return_moments(seed: int = 0, workers: int = 2) -> Result:
    """Check moments of the ratio of consecutive speeds, ``E rho^s = 1 / (2 cos(pi (1 + s) / 3))``."""
    ln = log_speeds(1.0, RETURNS, 1, seed + 2)[:, 0]

    def checks(wrong: float = 1.0, shifted: float = 0.0) -> list[Check]:
        out = []
        for s in ORDERS:
            power = np.exp(s * ln)
            truth = wrong / (2.0 * math.cos(math.pi * (1.0 + s + shifted) / 3.0))
            out.append(Check(f"E rho^{s:g}", float(power.mean()), truth, float(power.std()) / math.sqrt(ln.size)))
        return out

    return Result(
        "return moments",
        "McKean 1963",
        "moments of the ratio of speeds on return and on leaving, -5/2 < s < 1/2: the flights of the return speed, of "
        "another seed",
        checks(),
        {
            "moments 1 % larger": checks(wrong=1.01),
            "orders 0.02 larger": checks(shifted=0.02),
        },
    )


def _drift(epsilon: float, seed: int) -> tuple[float, float]:
    """Mean change of ln speed per bounce, and its standard error."""
    whole = log_speeds(epsilon, PATHS, BOUNCES, seed)[:, -1] / BOUNCES
    return float(whole.mean()), float(whole.std()) / math.sqrt(PATHS)


def critical_restitution(seed: int = 0, workers: int = 2) -> Result:
    """Check the drift of ln speed per bounce below and above the critical restitution, and where it is zero."""
    (d0, s0), (d1, s1) = _drift(BELOW, seed), _drift(ABOVE, seed + 1)
    span = math.log(ABOVE / BELOW)
    share = -d0 / (d1 - d0)  # linear interpolation in ln epsilon to zero drift
    zero = BELOW * math.exp(span * share)
    se = zero * span / (d1 - d0) * float(np.hypot((1.0 - share) * s0, share * s1))

    def checks(power: float, mean: float) -> list[Check]:
        return [
            Check(f"drift per bounce at epsilon {BELOW:g}", d0, power * math.log(BELOW) + mean, s0),
            Check(f"drift per bounce at epsilon {ABOVE:g}", d1, power * math.log(ABOVE) + mean, s1),
            Check("critical restitution", zero if d0 < 0.0 < d1 else math.nan, math.exp(-mean / power), se),
        ]

    return Result(
        "critical restitution",
        "Cornell, Swift & Bray 1998",
        "ln speed drifts by ln epsilon + pi / sqrt(3) per bounce: collapse below exp(-pi / sqrt(3)) = 0.163; the same "
        "flights, joined by the restitution map",
        checks(1.0, MEAN),
        {
            "mean 3 % larger": checks(1.0, 1.03 * MEAN),
            "epsilon squared": checks(2.0, MEAN),
        },
    )
