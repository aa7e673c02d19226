"""Exits of a randomly accelerated particle from a gap, their mean time and their side; and gaps that are random."""

import math
from dataclasses import replace

import numpy as np
from scipy.special import betainc, gamma, hyp2f1
from scipy.stats import truncnorm

from rattle.compare.checks.check import Check, Found, self_test
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Scene, Start, Tolerance

HALF = 1e-3  # half gap; an exit takes about 0.02, in which the modulation of the noise (1 at -pi/2) falls by 3e-4
PATHS = 20_000
STRONGER = 1.05  # factor on the noise in the negative control

# time step, and bound of the relative error of the mean time: by step and modulation for the Euler schemes, by the
# modulation alone for exact flights
SCHEMES = {"euler-maruyama": (1e-5, 2e-3), "euler-maruyama-located": (2e-5, 2e-3), "exact-flight": (1e-2, 3e-4)}

DRAG = 1e-4  # which turns the orbit without noise to one side; a random path moves by 2e-5 of the gap for it
LEFT = 1e-4  # share of paths that this may change
SIDES = (0.1, 0.25, 0.5, 0.75)  # starting points of exits whose side is checked, as fractions of the gap

WIDTH = 0.1  # of the tolerance
SPREADS = {"uniform": 1.0 / math.sqrt(3.0), "normal": 0.5 * float(truncnorm(-2.0, 2.0).std())}
"""Sd of a gap by its distribution, in widths of the tolerance; normal ones are cut at two sds."""


def particle(share: float, half: float, sigma: float, drag: float = 0.0) -> Scene:
    """Build ``x'' = sigma eta`` from rest at a fraction of a gap, at the phase where the modulation is stationary."""
    start = Start(-0.5 * math.pi, half * (2.0 * share - 1.0), 0.0)
    return Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=drag, gap1=half, sigma=sigma, start=start, stages=1)


def mean_exit_time(start: float, gap: float, sigma: float) -> float:
    """Compute the mean time after which ``x'' = sigma eta``, starting at zero velocity, leaves a gap.

    Masoliver and Porra 1995; docs/model.md section 8.

    Examples
    --------
    >>> round(mean_exit_time(0.5, 1.0, 1.0) / mean_exit_time(0.5, 1.0, 8.0), 12)
    4.0
    """
    z = start / gap
    both = hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, z) + hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, 1.0 - z)
    scale = (4.0 / 3.0) ** (1.0 / 6.0) / gamma(7.0 / 3.0) * (2.0 * gap**2 / sigma**2) ** (1.0 / 3.0)
    return float(scale * (z * (1.0 - z)) ** (1.0 / 6.0) * both)


@self_test
def exit_time(seed: int = 0, workers: int = 2) -> Found:
    """Check the mean exit time from three starting points, for all three schemes of `montecarlo.simulate`."""

    def check(scheme: str, share: float, sigma: float = 1.0) -> Check:
        (dt, left), scene = SCHEMES[scheme], particle(share, HALF, sigma)
        rng, sampling = np.random.SeedSequence([seed, 1]), Sampling(horizon=1.0)
        chosen = {"scheme": scheme, "dt": dt, "sampling": sampling, "record": Record(step_bias=False)}
        run = simulate(scene, paths=PATHS, impacts=1, rng=rng, workers=workers, **chosen)  # type: ignore[arg-type]
        tau, se = float(run.columns["tau"][0]), float(run.columns["se_tau"][0])
        truth = mean_exit_time(2.0 * HALF * share, 2.0 * HALF, 1.0)
        return Check(f"mean exit time from {share:g}, {scheme}", tau - scene.start.tau, truth, se, left * truth)

    return [check(scheme, share) for scheme in SCHEMES for share in (0.1, 0.25, 0.5)], {
        f"{STRONGER - 1.0:.0%} more noise, {scheme}": [check(scheme, 0.5, STRONGER)] for scheme in SCHEMES
    }


@self_test
def exit_side(seed: int = 0, workers: int = 2) -> Found:
    """Check the share of paths that leave a gap on the side of the orbit without noise (its agreement)."""
    found = {}
    for i, share in enumerate(SIDES):
        run = simulate(particle(share, HALF, 1.0, DRAG), paths=PATHS, impacts=1, rng=seed + i, workers=workers)
        found[share] = float(run.columns["agreement"][0])

    def checks(truth: dict[float, float]) -> list[Check]:
        return [
            Check(f"agreement from {z:g}", a, truth[z], math.sqrt(truth[z] * (1.0 - truth[z]) / PATHS), LEFT)
            for z, a in found.items()
        ]

    side = {z: float(betainc(1.0 / 6.0, 1.0 / 6.0, z)) for z in SIDES}
    return checks(side), {
        "the other side": checks({z: 1.0 - p for z, p in side.items()}),
        "a share linear in the start, as of Brownian motion": checks({z: z for z in SIDES}),
    }


@self_test
def random_gap(seed: int = 0, workers: int = 2) -> Found:
    """Check mean and sd of the wall that coasting paths strike first, for both distributions of the gap."""
    coasting = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, stages=1, start=Start(0.0, 0.0, 1.0))
    found = {}
    for name in SPREADS:
        scene = replace(coasting, tolerance=Tolerance(WIDTH, distribution=name))
        found[name] = simulate(scene, paths=PATHS, impacts=1, rng=seed, workers=workers).columns

    def checks(spreads: dict[str, float], width: float = WIDTH) -> list[Check]:
        out = []
        for name, columns in found.items():
            mean, se_mean, sd, se_sd = (float(columns[c][0]) for c in ("x1", "se_x1", "sd_x1", "se_sd_x1"))
            out.append(Check(f"mean wall, {name}", mean, 0.5, se_mean))
            out.append(Check(f"sd of the wall, {name}", sd, spreads[name] * width, se_sd))
        return out

    return checks(SPREADS), {
        "the other distribution": checks(dict(zip(SPREADS, reversed(SPREADS.values()), strict=True))),
        "a tolerance 5 % wider": checks(SPREADS, 1.05 * WIDTH),
    }
