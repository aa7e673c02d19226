"""Validity of the correlation of displacement and velocity, on both sides, and its error at mid-flight."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.closure import MeanMap
from rattle.compare.validation.verdict import Tolerances, judge
from rattle.montecarlo import Ensemble
from rattle.scene.moments import realizability

Ints = NDArray[np.int64]

__all__ = ["first_failure", "mid_flight_errors", "validity"]

SIMULATED = "monte carlo"

COLUMNS = (
    "closure", "impact", "stage", "variance_x", "variance_y", "rho", "smallest_eigenvalue", "realizable", "reason",
)  # fmt: skip


def validity(predictions: list[MeanMap], run: Ensemble, flights: Ints) -> pd.DataFrame:
    """Realizability of each stage's second moments; one row per closure, impact and stage.

    A closure is judged just before its impacts; the simulation at mid-flight, before the same impacts, for at an
    impact's own instant half of the paths have already been thrown back.  `flights` tells for each instant of the
    run's fixed times which impact ends the flight.  Columns: ``closure, impact, stage, variance_x, variance_y, rho,
    smallest_eigenvalue, realizable, reason``.
    """
    rows = []
    stages = range(1, run.scene.stages + 1)
    for prediction in predictions:
        if prediction.trace.parts is not None:
            continue  # a mixture of paths at their own impacts has no moments of a perturbation
        for impact in range(1, prediction.trace.found + 1):
            for stage in stages:
                rows.append((prediction.closure, impact, stage, prediction.stage_covariance(impact, stage)))
    for impact, (_, row) in zip(flights, run.at_times().iterrows(), strict=True):
        for stage in stages:
            x, y = f"x{stage}", f"y{stage}"
            cross = row[f"cov_{x}_{y}"]
            rows.append(
                (SIMULATED, int(impact), stage, np.array([[row[f"cov_{x}_{x}"], cross], [cross, row[f"cov_{y}_{y}"]]]))
            )
    records = []
    for closure, impact, stage, covariance in rows:
        r = realizability(covariance)
        records.append(
            {
                "closure": closure,
                "impact": impact,
                "stage": stage,
                "variance_x": r.variance_x,
                "variance_y": r.variance_y,
                "rho": r.rho,
                "smallest_eigenvalue": r.smallest_eigenvalue,
                "realizable": r.realizable,
                "reason": r.reason,
            }
        )
    return pd.DataFrame(records, columns=COLUMNS).astype({"realizable": bool})


def first_failure(table: pd.DataFrame, closure: str) -> tuple[int, int, str] | None:
    """Impact, stage and reason of the first row of a closure that is not realizable, or None."""
    failed = table[(table["closure"] == closure) & ~table["realizable"]].sort_values(["impact", "stage"])
    if failed.empty:
        return None
    row = failed.iloc[0]
    return int(row["impact"]), int(row["stage"]), str(row["reason"])


def mid_flight_errors(
    prediction: MeanMap, run: Ensemble, flights: Ints, z: float, tolerances: Tolerances
) -> pd.DataFrame:
    """Error of ``rho`` at the run's fixed times, in the middle of the orbit's flights; tidy.

    The Monte Carlo interval is Fisher's, with the standard error of artanh rho measured (for a Gaussian pair it is
    ``1 / sqrt(paths)``), widened by the change that doubling the step makes where the step has a bias.  Rows as in
    `section_errors`; ``impact`` is the one that ends the flight (`flights`), ``time`` the instant.
    """
    fixed = run.at_times()
    reached = fixed.index.to_numpy(float)
    predicted = prediction.at_times(reached[reached <= prediction.trace.span[1]])
    parts = []
    for stage in range(1, run.scene.stages + 1):
        rho = fixed[f"rho{stage}"]
        fisher = np.arctanh(rho.clip(-1.0 + 1e-15, 1.0 - 1e-15))
        half = z * fixed[f"se_z_rho{stage}"]
        bias = fixed.get(f"coarse_rho{stage}", rho) - rho
        value = predicted[f"rho{stage}"].reindex(fixed.index)
        low, high = value - np.tanh(fisher + half) - bias.abs(), value - np.tanh(fisher - half) + bias.abs()
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
