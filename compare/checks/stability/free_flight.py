"""Exact flights against the exact law of a flight without walls: the covariance that the noise collects."""

import numpy as np
import pandas as pd

from rattle.compare.checks.stability.axes import AXES
from rattle.compare.validation.verdict import widest
from rattle.montecarlo import Record, largest_step, simulate
from rattle.scene import Scene, Start
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import STATE

__all__ = ["covariance_table"]

FLIGHT = 0.2  # from tau = 0, where the variance begins from nothing: the hardest flight there is
OPEN = 1e6  # half gap that no path crosses
SHARES = (1 / 8, 1.0)  # of the largest step
TOLERANCE = 0.10  # of an sd, as for the sds of the map


def covariance_table(*, points: int = 7, paths: int, seed: int, workers: int) -> pd.DataFrame:
    """Sds of the state after a flight over sds by `rattle.scene.flight.noise_covariance`, for each damping of the map.

    Columns ``beta, dt, share`` of the largest step, and of the quantity that is furthest off ``quantity, error``, the
    ratio less 1, and ``half``, half the width of its interval; ``holds`` says whether all of them are within 10 %.

    Examples
    --------
    >>> covariance_table(points=1, paths=2000, seed=0, workers=1)["holds"].tolist()
    [True, True]
    """
    values = AXES["beta"].values[:points]
    z = widest(len(values) * len(SHARES) * len(STATE))
    rows = []
    for beta in values:
        scene = _open(AXES["beta"].scene(beta))
        largest, _ = largest_step(scene, "exact-flight")
        for share in SHARES:
            steps = np.ceil(FLIGHT / (share * largest))
            run = simulate(
                scene,
                paths=paths,
                impacts=1,
                scheme="exact-flight",
                dt=FLIGHT / steps,
                rng=seed,
                horizon=1.5 * FLIGHT,
                workers=workers,
                record=Record(times=[FLIGHT]),
            )
            table = run.at_times().iloc[0]
            law = np.diag(noise_covariance(scene.constants, 0.0, FLIGHT))
            found = np.array([table[f"cov_{q}_{q}"] for q in STATE])
            se = np.array([table[f"se_cov_{q}_{q}"] for q in STATE])
            varies = law > 1e-12 * law.max()
            error = np.where(varies, np.sqrt(found / np.where(varies, law, 1.0)) - 1.0, 0.0)
            half = np.where(varies, z * se / np.where(varies, 2.0 * law, 1.0), 0.0)
            k = int((np.abs(error) + half).argmax())
            rows.append({
                "beta": beta, "dt": run.dt, "share": share, "quantity": STATE[k], "error": float(error[k]),
                "half": float(half[k]), "holds": bool((np.abs(error) + half <= TOLERANCE).all()),
            })  # fmt: skip
    return pd.DataFrame(rows)


def _open(scene: Scene) -> Scene:
    """The same without walls within reach, at rest at tau = 0."""
    c = scene.constants
    return Scene(
        alpha=c.alpha, epsilon=c.epsilon, beta1=c.beta1, beta2=c.beta2, gamma1=c.gamma1, gamma2=c.gamma2, mu=c.mu,
        gap1=OPEN, gap2=OPEN, sigma=c.sigma, start=Start(0.0, 0.0, 0.0, 0.0, 0.0, mesh=0),
    )  # fmt: skip
