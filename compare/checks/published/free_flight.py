"""Without walls the state is Gaussian, with the moments of a linear SDE that is driven by one modulated noise."""

import math
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rattle.compare.checks.check import Check, Result
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Scene, Start
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import STATE

Floats = NDArray[np.float64]

SCENE = Scene(
    alpha=1.5,
    epsilon=0.9,
    beta1=0.083,
    beta2=0.9,
    gamma1=0.057,
    gamma2=0.029,
    mu=0.6,
    sigma=0.4,
    gap1=1e6,
    gap2=1e6,
    start=Start(0.3, 0.1, -0.4, -0.2, 0.5),
)
"""Two stages that are driven by the same noise with different modulations."""

TIME = 3.3
PATHS = 100_000
ROUNDING = 1e-9  # error of the moments from the ODE solver
LEFT_OUT = 1e-6  # error of a simulated moment by the step: h^4 / 720 at the default step of exact flights, and rounding
PAIRS = list(combinations_with_replacement(range(4), 2))


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


def free_flight(seed: int = 0, workers: int = 2) -> Result:
    """Check the first four moments of `montecarlo.simulate`, and the covariance of `rattle.scene.flight`."""
    rng = np.random.SeedSequence([seed, 7])
    run = simulate(
        SCENE,
        paths=PATHS,
        impacts=1,
        scheme="exact-flight",
        rng=rng,
        sampling=Sampling(horizon=TIME + 0.1),
        workers=workers,
        record=Record(times=[SCENE.start.tau + TIME]),
    )
    table, sums = run.at_times(), run.result.sums["fixed"]
    row, tau = table.iloc[0], float(table.index[0])
    columns = [name for name in table.columns if name.startswith("cov_")]
    computed = noise_covariance(SCENE.constants, SCENE.start.tau, tau - SCENE.start.tau)

    def checks(scene: Scene, coupled: bool = True) -> list[Check]:
        mean, p = linear_moments(scene, tau, coupled)
        return [
            *(Check(f"E {q}", float(row[q]), mean[i], float(row[f"se_{q}"]), LEFT_OUT) for i, q in enumerate(STATE)),
            *(
                Check(
                    f"cov {STATE[i]} {STATE[j]}",
                    float(row[f"cov_{STATE[i]}_{STATE[j]}"]),
                    p[i, j],
                    float(row[f"se_cov_{STATE[i]}_{STATE[j]}"]),
                    LEFT_OUT,
                )
                for i, j in PAIRS
            ),
            *(
                Check(f"cov {STATE[i]} {STATE[j]}, scene.flight", float(computed[i, j]), p[i, j], 0.0, ROUNDING)
                for i, j in PAIRS
            ),
        ]

    def shape(skewness: float, kurtosis: float) -> list[Check]:
        out = []
        for q in STATE:
            k = columns.index(f"cov_{q}_{q}")
            m2, m3, m4 = (float(sums.moment(p, 0)[0, k]) for p in (2, 3, 4))
            out.append(Check(f"skewness of {q}", m3 / m2**1.5, skewness, math.sqrt(6.0 / PATHS)))
            out.append(Check(f"kurtosis of {q}", m4 / m2**2 - 3.0, kurtosis, math.sqrt(24.0 / PATHS)))
        return out

    return Result(
        "free-flight covariance",
        "Wang & Uhlenbeck 1945; docs/model.md section 8",
        "without walls the state is Gaussian with covariance int exp(A s) m m' exp(A' s) sigma^2 ds: simulate() and "
        "rattle.scene.flight against an ODE",
        [*checks(SCENE), *shape(0.0, 0.0)],
        {
            "2 % more noise": checks(SCENE.with_sigma(1.02 * SCENE.sigma)),
            "a second stage that the noise does not reach": checks(SCENE, coupled=False),
            "skewness 0.05": shape(0.05, 0.0),
            "kurtosis 0.1": shape(0.0, 0.1),
        },
    )
