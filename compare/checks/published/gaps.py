"""What a random gap and a random side of exit do to the section of the first impact: both in closed form."""

import math
from typing import Any

from scipy.special import betainc
from scipy.stats import truncnorm

from rattle.compare.checks.check import Check, Result
from rattle.montecarlo import simulate
from rattle.scene import Scene, Start, Tolerance

PATHS = 20_000
WIDTH = 0.1  # of the tolerance
HALF = 1e-3  # half gap; an exit takes about 0.02
DRAG = 1e-4  # which turns the orbit without noise to one side; a random path moves by 2e-5 of the gap for it
LEFT = 1e-4  # share of paths that this may change
SHARES = (0.1, 0.25, 0.5, 0.75)
SPREADS = {"uniform": 1.0 / math.sqrt(3.0), "normal": 0.5 * float(truncnorm(-2.0, 2.0).std())}
"""Sd of a gap by its distribution, in widths of the tolerance; normal ones are cut at two sds."""


def random_gap(seed: int = 0, workers: int = 2) -> Result:
    """Check mean and sd of the wall that coasting paths strike first, for both distributions of the gap."""
    common: dict[str, Any] = {
        "alpha": 0.0,
        "epsilon": 0.5,
        "beta1": 0.0,
        "gamma1": 0.0,
        "stages": 1,
        "start": Start(0.0, 0.0, 1.0),
    }
    found = {}
    for name in SPREADS:
        scene = Scene(tolerance=Tolerance(WIDTH, distribution=name), **common)
        found[name] = simulate(scene, paths=PATHS, impacts=1, rng=seed, workers=workers).columns

    def checks(spreads: dict[str, float], width: float = WIDTH) -> list[Check]:
        out = []
        for name, columns in found.items():
            mean, se_mean, sd, se_sd = (float(columns[c][0]) for c in ("x1", "se_x1", "sd_x1", "se_sd_x1"))
            out.append(Check(f"mean wall, {name}", mean, 0.5, se_mean))
            out.append(Check(f"sd of the wall, {name}", sd, spreads[name] * width, se_sd))
        return out

    other = dict(zip(SPREADS, reversed(SPREADS.values()), strict=True))
    return Result(
        "random gap",
        "moments of a uniform and of a cut normal distribution",
        "coasting paths strike walls with the mean and sd of their gaps: simulate() with a Tolerance",
        checks(SPREADS),
        {
            "the other distribution": checks(other),
            "a tolerance 5 % wider": checks(SPREADS, 1.05 * WIDTH),
        },
    )


def exit_side(seed: int = 0, workers: int = 2) -> Result:
    """Check the share of paths that leave a gap on the side of the orbit without noise (its agreement)."""
    found = {}
    for i, share in enumerate(SHARES):
        start = Start(-0.5 * math.pi, HALF * (2.0 * share - 1.0), 0.0)
        scene = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=DRAG, gap1=HALF, sigma=1.0, start=start, stages=1)
        run = simulate(scene, paths=PATHS, impacts=1, rng=seed + i, workers=workers)
        found[share] = float(run.columns["agreement"][0])

    def checks(truth: dict[float, float]) -> list[Check]:
        return [
            Check(f"agreement from {z:g}", a, truth[z], math.sqrt(truth[z] * (1.0 - truth[z]) / PATHS), LEFT)
            for z, a in found.items()
        ]

    side = {z: float(betainc(1.0 / 6.0, 1.0 / 6.0, z)) for z in SHARES}
    return Result(
        "side of exit",
        "Bicout & Burkhardt 2000",
        "x'' = sigma eta leaves a gap at one end with the incomplete beta function of its start, of order 1/6: the "
        "agreement of simulate()",
        checks(side),
        {
            "the other side": checks({z: 1.0 - p for z, p in side.items()}),
            "a share linear in the start, as of Brownian motion": checks({z: z for z in SHARES}),
        },
    )
