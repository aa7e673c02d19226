"""Mean exit time of a randomly accelerated particle from a gap."""

import math
from typing import Any

import numpy as np
from scipy.special import gamma, hyp2f1

from rattle.compare.checks.check import Check, Result
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Scene, Start

SIGMA = 1.0
HALF = 1e-3  # half gap; an exit takes about 0.02, in which the modulation of the noise (1 at -pi/2) falls by 3e-4
PATHS = 20_000
SHARES = (0.1, 0.25, 0.5)  # starting points, as fractions of the gap
STRONGER = 1.05  # factor on the noise in the negative control

# time step, and bound of the relative error of the mean time: by step and modulation for the Euler schemes, by the
# modulation alone for exact flights
SCHEMES = {"euler-maruyama": (1e-5, 2e-3), "euler-maruyama-located": (2e-5, 2e-3), "exact-flight": (1e-2, 3e-4)}


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


def _check(scheme: str, share: float, sigma: float, seed: int, workers: int) -> Check:
    dt, left = SCHEMES[scheme]
    start = Start(-0.5 * math.pi, HALF * (2.0 * share - 1.0), 0.0)
    scene = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, gap1=HALF, sigma=sigma, start=start, stages=1)
    rng = np.random.SeedSequence([seed, 1])
    common: dict[str, Any] = {"rng": rng, "workers": workers, "record": Record(step_bias=False)}
    run = simulate(scene, paths=PATHS, impacts=1, dt=dt, sampling=Sampling(horizon=1.0), scheme=scheme, **common)
    tau, se = float(run.columns["tau"][0]), float(run.columns["se_tau"][0])
    truth = mean_exit_time(2.0 * HALF * share, 2.0 * HALF, SIGMA)
    return Check(f"mean exit time from {share:g}, {scheme}", tau - start.tau, truth, se, left * truth)


def exit_time(seed: int = 0, workers: int = 2) -> Result:
    """Check the mean exit time from three starting points, for all three schemes of `montecarlo.simulate`."""
    return Result(
        "mean exit time",
        "Masoliver & Porra 1995",
        "x'' = sigma eta leaves a gap after the closed-form mean time: simulate(), all schemes, at the phase where the "
        "modulation is stationary",
        [_check(scheme, share, SIGMA, seed, workers) for scheme in SCHEMES for share in SHARES],
        {
            f"{STRONGER - 1.0:.0%} more noise, {scheme}": [_check(scheme, 0.5, STRONGER, seed, workers)]
            for scheme in SCHEMES
        },
    )
