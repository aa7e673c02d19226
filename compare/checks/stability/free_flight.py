"""Exact flights without walls compared with the exact distribution: the covariance accumulated by the noise."""

from dataclasses import replace

import numpy as np
import pandas as pd

from rattle.compare.checks.stability.axes import AXES
from rattle.compare.validation.verdict import widest
from rattle.montecarlo import Record, largest_step, simulate
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Start
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import STATE

FLIGHT = 0.2  # flight time from tau = 0, where the noise has no modulation yet: the most demanding flight
OPEN = 1e6  # half gap that no path crosses
SHARES = (1 / 8, 1.0)  # time steps, in units of the longest admissible one
TOLERANCE = 0.10  # admissible relative error of an sd, as for the sds of the map


def covariance_table(*, points: int = 7, paths: int, seed: int, workers: int) -> pd.DataFrame:
    """Compare simulated sds after a flight with `rattle.scene.flight.noise_covariance`, for each damping of the map.

    Returns: Columns ``beta, dt, share`` (dt over the longest admissible step); for the quantity with the largest
    error ``quantity, error`` (relative, of its sd) and ``half`` (half width of its interval); ``holds`` (whether
    all quantities are within 10 %).
    """
    values = AXES["beta"].values[:points]
    z = widest(len(values) * len(SHARES) * len(STATE))
    rows = []
    for beta in values:
        start = Start(0.0, 0.0, 0.0, 0.0, 0.0, mesh=0)
        scene = replace(AXES["beta"].scene(beta), gap1=OPEN, gap2=OPEN, start=start)
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
                sampling=Sampling(horizon=1.5 * FLIGHT),
                workers=workers,
                record=Record(times=[FLIGHT]),
            )
            table = run.at_times().iloc[0]
            exact = np.diag(noise_covariance(scene.constants, 0.0, FLIGHT))
            found = np.array([table[f"cov_{q}_{q}"] for q in STATE])
            se = np.array([table[f"se_cov_{q}_{q}"] for q in STATE])
            varies = exact > 1e-12 * exact.max()
            error = np.where(varies, np.sqrt(found / np.where(varies, exact, 1.0)) - 1.0, 0.0)
            half = np.where(varies, z * se / np.where(varies, 2.0 * exact, 1.0), 0.0)
            k = int((np.abs(error) + half).argmax())
            rows.append(
                {
                    "beta": beta,
                    "dt": run.dt,
                    "share": share,
                    "quantity": STATE[k],
                    "error": float(error[k]),
                    "half": float(half[k]),
                    "holds": bool((np.abs(error) + half <= TOLERANCE).all()),
                }
            )
    return pd.DataFrame(rows)
