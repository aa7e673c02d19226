"""Gaussian motions: of two stages without walls, and of one stage between elastic walls, which fold it into the box.

Without walls the state is Gaussian, with the moments of a linear SDE that is driven by one modulated noise.

Between elastic walls an impact changes the sign of y.  Damping and white noise are symmetric under this reflection.  So
``x = fold(X), y = +-Y`` in distribution, exactly and at any time, with the free stage
``Y' = -beta Y + sigma (-sin tau + beta cos tau) eta, X' = Y`` (Eq. 5).  The modulated noise makes the distribution
periodic in time, not stationary: ``V = E y^2`` obeys ``V' = -2 beta V + sigma^2 m^2`` and y is Gaussian.  Once X has
spread over many boxes, x is uniform and independent of y.
"""

import math
from collections.abc import Mapping
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from rattle.compare.checks.check import Check, Found, self_test
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Scene, Start
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import STATE
from rattle.scene.types import Floats

PATHS = 100_000
FLIGHT = 3.3  # time of the flight without walls
ROUNDING = 1e-9  # error of its moments from the ODE solver
LEFT_OUT = 1e-6  # error of a simulated moment by the step: h^4 / 720 at the default step of exact flights, and rounding
PAIRS = list(combinations_with_replacement(range(4), 2))
START = Start(0.3, 0.1, -0.4, -0.2, 0.5)
OPEN: dict[str, Any] = {"gap1": 1e6, "gap2": 1e6, "start": START}  # half gaps that no path crosses
SCENE = Scene(alpha=1.5, epsilon=0.9, beta1=0.083, beta2=0.9, gamma1=0.057, gamma2=0.029, mu=0.6, sigma=0.4, **OPEN)
"""Two stages that are driven by the same noise with different modulations."""

BETA, SIGMA, HALF = 0.5, 1.0, 0.5  # of the box
IMPACTS = 64
TIMES = (8.0, 8.8, 9.6)  # by then X has an sd of 4 boxes, and the folded density is uniform up to exp(-80)
LOSSY = 0.97  # restitution of the negative control


def _compare(row: Any, truths: Mapping[str, tuple[str, float]], slack: float = 0.0) -> list[Check]:
    """Check entries of a row of moments at a fixed time, each given by its column, with its name and its truth."""
    return [Check(name, float(row[q]), truth, float(row["se_" + q]), slack) for q, (name, truth) in truths.items()]


def linear_moments(scene: Scene, tau: float, coupled: bool = True) -> tuple[Floats, Floats]:
    """Compute mean and covariance of ``(x1, y1, x2, y2)`` without walls by integrating the moment equations.

    ``s' = A s + f`` and ``P' = A P + P A' + sigma^2 m m'``, from Eqs. 5 and 8.  The matrices are written out here
    independently of `rattle.scene.flight`.

    `coupled`: Whether the noise acts on the second stage directly; false only for a negative control. Shapes:
    `mean` (4,); `covariance` (4, 4).

    Examples
    --------
    >>> mean, covariance = linear_moments(SCENE, 0.3)
    >>> mean.tolist(), covariance.any()
    ([0.1, -0.4, -0.2, 0.5], np.False_)
    """
    b1, b2, start = scene.beta1, scene.beta2, scene.start
    a = np.array([[0, 1, 0, 0], [0, -b1, 0, 0], [0, 0, 0, 1], [0, b2 - b1, 0, -b2]], dtype=float)
    drag = np.array([0.0, scene.gamma1, 0.0, scene.gamma1 - scene.gamma2])

    def rate(t: float, s: Floats) -> Floats:
        m = np.array([0.0, -math.sin(t) + b1 * math.cos(t), 0.0, (b1 - b2) * math.cos(t)])
        noise = m if coupled else m * [0.0, 1.0, 0.0, 0.0]
        p = s[4:].reshape(4, 4)
        spread = a @ p + p @ a.T + scene.sigma**2 * np.outer(noise, noise)
        return np.concatenate([a @ s[:4] + drag + scene.alpha * m, spread.ravel()])

    first = np.concatenate([[start.x1, start.y1, start.x2, start.y2], np.zeros(16)])
    if tau == start.tau:
        return first[:4], np.zeros((4, 4))
    solved = solve_ivp(rate, (start.tau, tau), first, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    return solved[:4], solved[4:].reshape(4, 4)


@self_test
def free_flight(seed: int = 0, workers: int = 2) -> Found:
    """Check the first four moments of `montecarlo.simulate`, and the covariance of `rattle.scene.flight`."""
    rng, sampling = np.random.SeedSequence([seed, 7]), Sampling(horizon=FLIGHT + 0.1)
    chosen: dict[str, Any] = {"scheme": "exact-flight", "rng": rng, "sampling": sampling, "workers": workers}
    run = simulate(SCENE, paths=PATHS, impacts=1, record=Record(times=[SCENE.start.tau + FLIGHT]), **chosen)
    table, sums = run.at_times(), run.result.sums["fixed"]
    row, tau = table.iloc[0], float(table.index[0])
    columns = [name for name in table.columns if name.startswith("cov_")]
    computed = noise_covariance(SCENE.constants, SCENE.start.tau, tau - SCENE.start.tau)

    def checks(scene: Scene, coupled: bool = True) -> list[Check]:
        mean, p = linear_moments(scene, tau, coupled)
        names = {(i, j): f"cov {STATE[i]} {STATE[j]}" for i, j in PAIRS}
        truths = {q: (f"E {q}", mean[i]) for i, q in enumerate(STATE)}
        truths |= {name.replace(" ", "_"): (name, p[pair]) for pair, name in names.items()}
        return _compare(row, truths, LEFT_OUT) + [
            Check(f"{name}, scene.flight", float(computed[pair]), p[pair], 0.0, ROUNDING)
            for pair, name in names.items()
        ]

    def shape(skewness: float, kurtosis: float) -> list[Check]:
        out = []
        for q in STATE:
            k = columns.index(f"cov_{q}_{q}")
            m2, m3, m4 = (float(sums.moment(p, 0)[0, k]) for p in (2, 3, 4))
            out.append(Check(f"skewness of {q}", m3 / m2**1.5, skewness, math.sqrt(6.0 / PATHS)))
            out.append(Check(f"kurtosis of {q}", m4 / m2**2 - 3.0, kurtosis, math.sqrt(24.0 / PATHS)))
        return out

    return [*checks(SCENE), *shape(0.0, 0.0)], {
        "2 % more noise": checks(SCENE.with_sigma(1.02 * SCENE.sigma)),
        "a second stage that the noise does not reach": checks(SCENE, coupled=False),
        "skewness 0.05": shape(0.05, 0.0),
        "kurtosis 0.1": shape(0.0, 0.1),
    }


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
    start, sampling = Start(0.0, 0.0, 0.0), Sampling(horizon=TIMES[-1] + 0.1)
    scene = Scene(alpha=0.0, epsilon=epsilon, beta1=BETA, gamma1=0.0, gap1=HALF, sigma=SIGMA, start=start, stages=1)
    rng = np.random.SeedSequence([seed, 5])
    chosen: dict[str, Any] = {"scheme": "exact-flight", "rng": rng, "sampling": sampling, "workers": workers}
    return simulate(scene, paths=PATHS, impacts=IMPACTS, record=Record(times=TIMES), **chosen)


def _checks(run: Ensemble, sigma: float = SIGMA, phase: float = 0.0) -> list[Check]:
    table, sums = run.at_times(), run.result.sums["fixed"]
    yy = [name for name in table.columns if name.startswith("cov_")].index("cov_y1_y1")
    out = [Check("paths followed to the end", float(sums.n[:, yy].min()), PATHS)]
    variance, fourth = sums.moment(2, 0)[:, yy], sums.moment(4, 0)[:, yy]
    for k, (t, row) in enumerate(table.iterrows()):
        at, time = f" at {float(t):.2f}", float(t)  # type: ignore[arg-type]
        decay = math.exp(-2.0 * BETA * time)
        v = speed_variance(time + phase, BETA, sigma) - decay * speed_variance(phase, BETA, sigma)
        truths = {"x1": ("E x", 0.0), "cov_x1_x1": ("E x^2", HALF**2 / 3.0), "cov_x1_y1": ("E x y", 0.0)}
        truths |= {"y1": ("E y", 0.0), "cov_y1_y1": ("E y^2", v)}
        out += _compare(row, {q: (name + at, truth) for q, (name, truth) in truths.items()})
        out.append(Check("kurtosis of y" + at, fourth[k] / variance[k] ** 2 - 3.0, 0.0, math.sqrt(24.0 / PATHS)))
    return out


@self_test
def elastic_box(seed: int = 0, workers: int = 2) -> Found:
    """Check that displacement is uniform and velocity Gaussian with a closed-form variance, at three fixed times."""
    run = _run(1.0, seed, workers)
    return _checks(run), {
        f"restitution {LOSSY:g}": _checks(_run(LOSSY, seed, workers)),
        "2 % more noise": _checks(run, 1.02 * SIGMA),
        "modulation 0.1 late": _checks(run, phase=-0.1),
    }
