"""Variance reduction for exact flights: the linearised path as control variate, and antithetic pairs."""

import time
from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from tqdm import tqdm

from rattle.montecarlo import default_step, simulate
from rattle.montecarlo.diagnostics.accuracy import smallest_sd
from rattle.montecarlo.kernel.block import Plan, sample
from rattle.montecarlo.settings.plan import plan_of
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene

Floats = NDArray[np.float64]

SIGMAS = (1e-3, 1e-2, 0.05, 0.1, 0.3, 1.5**0.5)
PATHS = 16_384
REPEATS = 3


def control_table(
    scene: Scene, *, impacts: int, seed: int, workers: int, sigmas: Sequence[float] = SIGMAS, paths: int = PATHS
) -> pd.DataFrame:
    """Variance without the control variate over variance with it, on the same paths.

    Returns: A row per noise intensity ``sigma``: median and smallest ratio of variances over the section means
    (``means_median, means_smallest``) and sds (``sds_median, sds_smallest``), without displacements at the wall,
    whose variance is due to off-itinerary paths alone; ``time_ratio``, the time of a path with the control
    variate over that without, so that a ratio of variances over ``time_ratio`` is the gain per second;
    ``antithetic_means, antithetic_sds``, the median gain of antithetic pairs, see `antithetic_gain`.
    """
    rows = []
    for sigma in tqdm(sigmas, desc="control variate", unit="sigma", disable=None, leave=False):
        own = scene.with_sigma(sigma)
        call = partial(
            simulate,
            own,
            paths=paths,
            impacts=impacts,
            scheme="exact-flight",
            rng=seed,
            workers=workers,
        )
        call(sampling=Sampling(control=True))
        times, runs = {False: np.inf, True: np.inf}, {}
        for _ in range(REPEATS):
            for control in (False, True):
                began = time.process_time()
                runs[control] = call(sampling=Sampling(control=control)).section
                times[control] = min(times[control], time.process_time() - began)
        plain, controlled = runs[False], runs[True]
        least = smallest_sd({str(name): plain[name].to_numpy() for name in plain})
        usable = {q: (plain["sd_" + q] > least[q]) & (q != "x" + plain["mesh"].astype(str)) for q in SECTION}
        row: dict[str, float] = {"sigma": sigma}
        for moment, prefix in (("means", "se_"), ("sds", "se_sd_")):
            ratios = np.concatenate([((plain[prefix + q] / controlled[prefix + q]) ** 2)[usable[q]] for q in SECTION])
            row |= {f"{moment}_median": float(np.median(ratios)), f"{moment}_smallest": float(ratios.min())}
        plan = plan_of(
            own, paths=paths, impacts=impacts, dt=default_step(own, "exact-flight"), scheme="exact-flight", rng=seed
        )
        gains = [np.median(gain[np.array(list(usable.values())).T]) for gain in antithetic_gain(plan)]
        row |= {"antithetic_means": float(gains[0]), "antithetic_sds": float(gains[1])}
        rows.append({**row, "time_ratio": times[True] / times[False]})
    return pd.DataFrame(rows)


def antithetic_gain(plan: Plan) -> tuple[Floats, Floats]:
    """Variance of independent paths over that of as many paths in antithetic pairs.

    The mean of a path and of its partner with negated noise, with correlation r, has the variance ``(1 + r) / 2`` times
    that of a path.  Two independent paths have 1 / 2, so the gain is ``1 / (1 + r)``.  For an sd, r is the correlation
    of the squared deviations.

    Shapes: result (impacts, 6).
    """
    both = np.stack(
        [
            np.concatenate([sample(one, block).rows[0, :, :, : len(SECTION)] for block in range(plan.blocks)])
            for one in (plan, plan._replace(mirrored=True))
        ]
    )
    gains = []
    for values in (both, (both - np.nanmean(both, axis=(0, 1))) ** 2):
        away = values - np.nanmean(values, axis=(0, 1))
        with np.errstate(invalid="ignore", divide="ignore"):
            gains.append(np.nanmean(away**2, axis=(0, 1)) / (2.0 * np.nanmean(away.mean(axis=0) ** 2, axis=0)))
    return gains[0], gains[1]
