"""Cost of accuracy: every scheme at every accuracy, measured or extrapolated, and every closure.

The error of a scheme is what with 95 % probability no section mean or sd is off by more than, in units of each
quantity's sd (`rattle.montecarlo.diagnostics.accuracy`).  The error of a closure is its worst difference from the
reference simulation, the run of exact flights with most paths.  Time is processor time, summed over threads.
"""

import math
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NoReturn

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from tqdm import tqdm

from rattle.closure import closures_for, mean_map
from rattle.closure.cost import closure_seconds
from rattle.compare.tradeoff.cost_model import CostModel, CostPoint, time_run
from rattle.compare.tradeoff.multilevel import Levels, measure_levels
from rattle.compare.validation.verdict import widest
from rattle.montecarlo import SCHEMES, AccuracyWarning, Ensemble, simulate, simulate_to
from rattle.montecarlo.diagnostics.accuracy import LEAST, units
from rattle.scene.errors import InputError
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene
from rattle.scene.validate import positive

Floats = NDArray[np.float64]

ACCURACIES = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
CALLS = 3  # timings of a closure, of which the least counts
BUSY = 10.0  # wall time allowed for a point over its processor time, as other processes may occupy the cores
HAND_TUNED_NS = 10.7
"""Nanoseconds of a path-step of plain Euler-Maruyama in hand-tuned numba code, on the machine of the README."""


@dataclass(frozen=True)
class Tradeoff:
    """Results of a comparison of costs."""

    points: pd.DataFrame  # rows of `rattle.compare.tradeoff.cost_model.CostPoint`
    models: dict[str, CostModel]  # by scheme
    levels: dict[str, Levels]  # multilevel analysis, by Euler scheme
    reference: Ensemble  # the simulation with which closures are compared


def check_accuracies(accuracies: Sequence[float]) -> tuple[float, ...]:
    """Validate accuracies and sort them."""
    if not accuracies:
        raise InputError("accuracy", accuracies, "give at least one")
    return tuple(sorted({positive("accuracy", a) for a in accuracies}, reverse=True))


def _scheme_points(
    model: CostModel,
    accuracies: Sequence[float],
    budget: float,
    asked: Callable[..., Ensemble],
    bar: "tqdm[NoReturn]",
) -> list[tuple[CostPoint, Ensemble | None]]:
    """Points of a scheme, with the run of each that was measured."""
    points: list[tuple[CostPoint, Ensemble | None]] = []
    for accuracy in accuracies:
        bar.set_postfix_str(f"{model.scheme}, {accuracy:g}")
        point, measured = model.at(accuracy), None
        if point.work <= budget:  # counted, so that no clock decides which rows are measured
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)  # a run that misses it is replaced by the model
                call = partial(asked, accuracy=accuracy, scheme=model.scheme, budget=BUSY * budget)
                run, seconds = time_run(call)
            model.learn(run)
            reach = run.reach
            assert reach is not None
            point = model.at(accuracy)
            if reach.reached:
                measured = run
                point = CostPoint(
                    model.scheme,
                    "scheme",
                    accuracy,
                    run.dt,
                    run.paths,
                    seconds,
                    reach.sampling,
                    reach.step,
                    reach.bound,
                    True,
                    work=model.work(run, run.paths, run.dt),
                )
        points.append((point, measured))
        bar.update()
    return points


def _section_rows(scene: Scene) -> list[tuple[str, str]]:
    """Column and quantity of every section mean and sd of a scene."""
    return [(prefix + q, q) for q in SECTION[: 2 + 2 * scene.stages] for prefix in ("", "sd_")]


def _differences(section: pd.DataFrame, reference: Ensemble) -> Floats:
    """Section means and sds minus those of a simulation, in units of its sds, shape (rows, impacts)."""
    unit, own = units(reference), section.reindex(reference.section.index)
    return np.array([(own[name] - reference.section[name]) / unit[q] for name, q in _section_rows(reference.scene)])


def closure_points(scene: Scene, impacts: int, reference: Ensemble) -> list[CostPoint]:
    """Worst and median error of every closure that can be applied to the scene, and its time."""
    columns, unit = _section_rows(scene), units(reference)
    closures = closures_for(scene)
    z = widest(len(columns) * impacts * len(closures))
    half = z * np.array([reference.section["se_" + name] / unit[q] for name, q in columns])
    points = []
    for closure in closures:
        call = partial(mean_map, scene, impacts=impacts, closure=closure)
        found = call()
        error = np.abs(_differences(found.section, reference))
        seen = np.isfinite(error)
        error, noise = error[seen], half[seen]
        worst = int(error.argmax())
        resolved = bool(error[worst] > noise[worst])
        bound = float(error[worst] if resolved else (error + noise).max())
        points.append(
            CostPoint(
                closure,
                "closure",
                math.nan,
                math.nan,
                0,
                min(_seconds(call) for _ in range(CALLS)),
                float(noise[worst]),
                0.0,
                bound,
                True,
                float(np.median(error)),
                resolved,
                error.size,
                work=closure_seconds(found),
            )
        )
    return points


def _seconds(call: Callable[[], object]) -> float:
    """Processor time of a call that is compiled already."""
    began = time.process_time()
    call()
    return time.process_time() - began


def _compare(point: CostPoint, run: Ensemble | None, model: CostModel, reference: Ensemble) -> list[CostPoint]:
    """A point with its actual error; if it missed its accuracy, followed by the point extrapolated from the model."""
    if run is None or run.paths >= reference.paths:
        return [point]
    actual = float(np.nanmax(np.abs(_differences(run.section, reference))))
    point = point._replace(actual_error=actual)
    if actual <= point.accuracy * (1.0 + math.sqrt(run.paths / reference.paths)):
        return [point]
    return [point._replace(missed=True, error=actual), model.at(point.accuracy)._replace(rows=point.rows)]


def bound_of_means(standard_error: float, scene: Scene, impacts: int) -> float:
    """What with 95 % probability none of the section means is off by more than, from their largest standard error."""
    return widest(len(_section_rows(scene)) // 2 * impacts) * standard_error


def multilevel_points(
    levels: dict[str, Levels], accuracies: Sequence[float], scene: Scene, impacts: int
) -> list[CostPoint]:
    """Cost of the cheapest multilevel estimator of the means for each Euler scheme, from the analysis of its levels."""
    points = []
    for scheme, found in levels.items():
        for a in accuracies:
            e = found.estimate(a)
            dt = found.table["dt"].iloc[0] / 2.0**e.last
            error = bound_of_means(a, scene, impacts) + a
            points.append(CostPoint(f"multilevel {scheme}", "multilevel", a, dt, 0, e.seconds, a, a, error, False))
    return points


def means_seconds(model: CostModel, accuracy: float, *, control: bool, typical: bool = False) -> float:
    """Core-seconds of exact flights for the section means alone."""
    unit, section = units(model.best), model.best.section
    n = section["paths"].to_numpy(float)[:, None]
    spread = np.sqrt(model.best.result.sums["section"].moment(2, 0))
    errors = section[["se_" + q for q in SECTION]].to_numpy() * np.sqrt(n) if control else spread
    share = errors / unit.to_numpy()
    one = float(np.nanmedian(share) if typical else np.nanmax(share))
    return (one / accuracy) ** 2 * model.path_alone(accuracy)


def slope(points: pd.DataFrame, method: str, measured: bool) -> tuple[float, int]:
    """Exponent with which the cost of a method grows with the accuracy, fitted to the logarithms.

    Points so rough that the minimal number of paths determines their cost are left out.
    """
    rows = points[(points["method"] == method) & (points["paths"] > LEAST) & ~points["missed"]]
    rows = rows[rows["measured"]] if measured else rows
    if len(rows) < 2:
        return math.nan, len(rows)
    return float(np.polyfit(np.log(rows["accuracy"]), np.log(rows["core_seconds"]), 1)[0]), len(rows)


def measure(
    scene: Scene, *, impacts: int, accuracies: Sequence[float], budget: float, seed: int, workers: int
) -> Tradeoff:
    """Measure the cost of every scheme and closure at several accuracies.

    The cost of multilevel estimators is estimated from runs at halved steps.  Closures are compared with the run of
    exact flights that has most paths.
    """
    scene = scene.phase_reduced  # so that a late start loses no digits of the times
    again = partial(simulate, scene, impacts=impacts, rng=seed, workers=workers)
    asked = partial(simulate_to, scene, impacts=impacts, rng=seed, workers=workers)
    models: dict[str, CostModel] = {}
    found: dict[str, list[tuple[CostPoint, Ensemble | None]]] = {}
    exact_first = sorted(SCHEMES, key=lambda name: SCHEMES[name].has_step_bias)
    with tqdm(total=len(SCHEMES) * len(accuracies), desc="accuracy", unit="point", disable=None) as bar:
        for scheme in exact_first:
            model = models[scheme] = CostModel.from_pilots(scene, scheme, again)
            model.shared = models[exact_first[0]].best
            found[scheme] = _scheme_points(model, accuracies, budget, asked, bar)
    reference = models[exact_first[0]].best
    levels = {
        scheme: measure_levels(scene, scheme, impacts=impacts, seed=seed, workers=workers) for scheme in exact_first[1:]
    }
    rows = len(_section_rows(scene)) * impacts
    points = []
    for scheme in SCHEMES:
        for point, run in found[scheme]:
            points += _compare(point._replace(rows=rows), run, models[scheme], reference)
    points += multilevel_points(levels, accuracies, scene, impacts) + closure_points(scene, impacts, reference)
    models = {scheme: models[scheme] for scheme in SCHEMES}
    return Tradeoff(pd.DataFrame(points, columns=list(CostPoint._fields)), models, levels, reference)
