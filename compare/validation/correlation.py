"""Correlation of displacement and velocity: realizability for closures and simulation, and its error at mid-flight."""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from rattle.closure import MeanMap
from rattle.compare.validation.verdict import Tolerances, judge
from rattle.montecarlo import Ensemble
from rattle.montecarlo.long_run.intervals import half_width
from rattle.scene.elementary import each
from rattle.scene.moments import realizability

Ints = NDArray[np.int64]

SIMULATED = "monte carlo"

NUMBERS = ("variance_x", "variance_y", "rho", "smallest_eigenvalue")
COLUMNS = ("closure", "impact", "stage", *NUMBERS, "realizable", "reason")


def judge_correlation(predictions: list[MeanMap], run: Ensemble, flights: Ints) -> pd.DataFrame:
    """Realizability of each stage's second moments.

    A closure is judged just before its impacts.  The simulation is judged at mid-flight before the same impacts,
    because at the mean impact time about half of the paths have already rebounded.

    Returns: A row for each closure (or ``monte carlo``), impact and stage: ``closure, impact, stage, variance_x,
    variance_y, rho, smallest_eigenvalue, realizable, reason``. Shapes: `flights` (fixed times,).
    """
    stages = range(1, run.scene.stages + 1)
    found = [
        (prediction.closure, impact, stage, prediction.stage_covariance(impact, stage))
        for prediction in predictions
        if prediction.trace.parts is None  # a mixture describes paths at their own impacts: no perturbation, no moments
        for impact in range(1, prediction.trace.found + 1)
        for stage in stages
    ]
    for impact, (_, row) in zip(flights, run.at_times().iterrows(), strict=True):
        for stage in stages:
            xx, xy, yy = (row[f"cov_{a}{stage}_{b}{stage}"] for a, b in ("xx", "xy", "yy"))
            found.append((SIMULATED, int(impact), stage, np.array([[xx, xy], [xy, yy]])))
    records = [
        {"closure": closure, "impact": impact, "stage": stage, **realizability(covariance)._asdict()}
        for closure, impact, stage, covariance in found
    ]
    return pd.DataFrame(records, columns=COLUMNS).astype({"realizable": bool})


def first_failure(table: pd.DataFrame, closure: str) -> tuple[int, int, str] | None:
    """The first impact, and there the first stage, at which a closure's second moments are not realizable."""
    failed = table[(table["closure"] == closure) & ~table["realizable"]].sort_values(["impact", "stage"])
    if failed.empty:
        return None
    row = failed.iloc[0]
    return int(row["impact"]), int(row["stage"]), str(row["reason"])


def mid_flight_errors(
    prediction: MeanMap, run: Ensemble, flights: Ints, z: float, tolerances: Tolerances
) -> pd.DataFrame:
    """Errors of the correlation ``rho`` at the run's fixed times, in the middle of the orbit's flights.

    The interval of the simulated value is symmetric in Fisher's z = artanh rho, whose standard error is measured (for
    a Gaussian pair it is ``1 / sqrt(paths)``); it is widened by the change from 2 dt to dt where there is a step bias.

    Returns: Rows as of `rattle.compare.validation.section_errors`; ``time`` is the fixed time, ``impact``
    the one that ends its flight. Shapes: `flights` (fixed times,).
    """
    fixed = run.at_times()
    reached = fixed.index.to_numpy(float)
    predicted = prediction.at_times(reached[reached <= prediction.trace.span[1]])
    parts = []
    for stage in range(1, run.scene.stages + 1):
        rho = fixed[f"rho{stage}"]
        fisher = each(math.atanh, rho.clip(-1.0 + 1e-15, 1.0 - 1e-15))
        half = half_width(run.paths, float(ndtr(-z))) * fixed[f"se_z_rho{stage}"]
        bias = fixed.get(f"coarse_rho{stage}", rho) - rho
        value = predicted[f"rho{stage}"].reindex(fixed.index)
        low = value - each(math.tanh, fisher + half) - bias.abs()
        high = value - each(math.tanh, fisher - half) + bias.abs()
        parts.append(
            pd.DataFrame(
                {
                    "closure": prediction.closure,
                    "kind": "fixed time",
                    "impact": flights,
                    "time": fixed.index,
                    "quantity": f"rho{stage}",
                    "moment": "rho",
                    "predicted": value,
                    "simulated": rho,
                    "se": fixed[f"se_rho{stage}"],
                    "bias": bias,
                    "error": value - rho,
                    "noise": 0.5 * (high - low) - bias.abs(),
                    "rest": bias.abs(),
                    "unit": 1.0,
                    "tolerance": tolerances.rho,
                    "agreement": run.agreement[prediction.closure].to_numpy()[flights - 1],
                    "paths": run.paths,
                    "low": low,
                    "high": high,
                }
            )
        )
    return judge(pd.concat(parts, ignore_index=True))
