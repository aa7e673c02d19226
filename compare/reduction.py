"""What the linearised path is worth as a control variate of exact flights, per path and per second."""

import time
from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd
from tqdm import tqdm

from montecarlo import simulate
from montecarlo.accuracy import STILL
from scene.moments import SECTION
from scene.scene import Scene

__all__ = ["SIGMAS", "control_table"]

SIGMAS = (1e-3, 1e-2, 0.05, 0.1, 0.3, 1.5**0.5)
PATHS = 16_384
REPEATS = 3


def control_table(
    scene: Scene, *, impacts: int, seed: int, workers: int, sigmas: Sequence[float] = SIGMAS, paths: int = PATHS
) -> pd.DataFrame:
    """Variance without the control over variance with it, on the same paths; a row per noise intensity.

    Columns: ``sigma``; median and smallest ratio over the section ``means`` and over the ``sds`` that vary by more than
    strays; ``time_ratio``, the time of a path with the control over that without.  A ratio of variances over
    ``time_ratio`` is what a second is worth.
    """
    rows = []
    for sigma in tqdm(sigmas, desc="control variate", unit="sigma", disable=None, leave=False):
        own = scene.with_sigma(sigma)
        call = partial(
            simulate, own, paths=paths, impacts=impacts, scheme="exact-flight", rng=seed,
            workers=workers,
        )  # fmt: skip
        call(control=True)
        times, runs = {False: np.inf, True: np.inf}, {}
        for _ in range(REPEATS):
            for control in (False, True):
                began = time.process_time()
                runs[control] = call(control=control).section
                times[control] = min(times[control], time.process_time() - began)
        plain, controlled = runs[False], runs[True]
        row: dict[str, float] = {"sigma": sigma}
        for moment, prefix in (("means", "se_"), ("sds", "se_sd_")):
            ratios = np.concatenate([
                ((plain[prefix + q] / controlled[prefix + q]) ** 2)[
                    (plain["sd_" + q] > STILL) & (q != "x" + plain["mesh"].astype(str))
                ]
                for q in SECTION
            ])  # fmt: skip
            row |= {f"{moment}_median": float(np.median(ratios)), f"{moment}_smallest": float(ratios.min())}
        rows.append({**row, "time_ratio": times[True] / times[False]})
    return pd.DataFrame(rows)
