"""One damped, noisy stage between elastic walls: its distribution is that of the free stage, folded into the box.

At ``epsilon = 1`` an impact changes the sign of y.  Damping and white noise are symmetric under this reflection.  So
``x = fold(X), y = +-Y`` in distribution, exactly and at any time, with the free stage
``Y' = -beta Y + sigma (-sin tau + beta cos tau) eta, X' = Y`` (Eq. 5).  The modulated noise makes the distribution
periodic in time, not stationary: ``V = E y^2`` obeys ``V' = -2 beta V + sigma^2 m^2`` and y is Gaussian.  Once X has
spread over many boxes, x is uniform and independent of y.
"""

import math

import numpy as np

from rattle.compare.checks.check import Check, Result
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Scene, Start

BETA, SIGMA, HALF = 0.5, 1.0, 0.5
PATHS, IMPACTS = 100_000, 64
TIMES = (8.0, 8.8, 9.6)  # by then X has an sd of 4 boxes, and the folded density is uniform up to exp(-80)
LOSSY = 0.97  # restitution of the negative control


def speed_variance(tau: float, beta: float, sigma: float) -> float:
    """Compute the periodic solution of ``V' = -2 beta V + sigma^2 m^2`` with ``m = -sin tau + beta cos tau``.

    It follows from ``m^2 = (1 + beta^2) / 2 + a cos 2 tau + b sin 2 tau``.

    Examples
    --------
    >>> round(speed_variance(0.0, 0.5, 1.0), 6)
    0.75
    """
    a, b = -0.5 * (1.0 - beta**2), -beta
    wave = ((beta * a - b) * math.cos(2.0 * tau) + (a + beta * b) * math.sin(2.0 * tau)) / (2.0 * (beta**2 + 1.0))
    return sigma**2 * ((1.0 + beta**2) / (4.0 * beta) + wave)


def _run(epsilon: float, seed: int, workers: int) -> Ensemble:
    start = Start(0.0, 0.0, 0.0)
    scene = Scene(alpha=0.0, epsilon=epsilon, beta1=BETA, gamma1=0.0, gap1=HALF, sigma=SIGMA, start=start, stages=1)
    return simulate(
        scene,
        paths=PATHS,
        impacts=IMPACTS,
        scheme="exact-flight",
        rng=np.random.SeedSequence([seed, 5]),
        sampling=Sampling(horizon=TIMES[-1] + 0.1),
        workers=workers,
        record=Record(times=TIMES),
    )


def _checks(run: Ensemble, sigma: float, phase: float) -> list[Check]:
    table, sums = run.at_times(), run.result.sums["fixed"]
    yy = [name for name in table.columns if name.startswith("cov_")].index("cov_y1_y1")
    out = [Check("paths followed to the end", float(sums.n[:, yy].min()), PATHS)]
    variance, fourth = sums.moment(2, 0)[:, yy], sums.moment(4, 0)[:, yy]
    for k, (t, row) in enumerate(table.iterrows()):
        at, time = f" at {float(t):.2f}", float(t)  # type: ignore[arg-type]
        decay = math.exp(-2.0 * BETA * time)
        v = speed_variance(time + phase, BETA, sigma) - decay * speed_variance(phase, BETA, sigma)
        out += [
            Check("E x" + at, float(row["x1"]), 0.0, float(row["se_x1"])),
            Check("E x^2" + at, float(row["cov_x1_x1"]), HALF**2 / 3.0, float(row["se_cov_x1_x1"])),
            Check("E x y" + at, float(row["cov_x1_y1"]), 0.0, float(row["se_cov_x1_y1"])),
            Check("E y" + at, float(row["y1"]), 0.0, float(row["se_y1"])),
            Check("E y^2" + at, float(row["cov_y1_y1"]), v, float(row["se_cov_y1_y1"])),
            Check("kurtosis of y" + at, fourth[k] / variance[k] ** 2 - 3.0, 0.0, math.sqrt(24.0 / PATHS)),
        ]
    return out


def elastic_box(seed: int = 0, workers: int = 2) -> Result:
    """Check that displacement is uniform and velocity Gaussian with a closed-form variance, at three fixed times."""
    run = _run(1.0, seed, workers)
    return Result(
        "elastic damped box",
        "Uhlenbeck & Ornstein 1930, folded by reflection",
        "at epsilon = 1 x is uniform, y Gaussian, and E y^2 that of the free linear stage under the modulated noise: "
        "simulate(), exact-flight",
        _checks(run, SIGMA, 0.0),
        {
            f"restitution {LOSSY:g}": _checks(_run(LOSSY, seed, workers), SIGMA, 0.0),
            "2 % more noise": _checks(run, 1.02 * SIGMA, 0.0),
            "modulation 0.1 late": _checks(run, SIGMA, -0.1),
        },
    )
