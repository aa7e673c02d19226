"""Validation of closures: compares them with an ensemble of the same scene and gives a verdict on every moment."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from rattle.closure import CLOSURES, closures_for, follow, mean_map
from rattle.compare.validation.correlation import judge_correlation, mid_flight_errors
from rattle.compare.validation.result import Validation
from rattle.compare.validation.section_errors import section_errors, to_absolute_time
from rattle.compare.validation.verdict import Tolerances, widest
from rattle.montecarlo import SCHEMES, Record, check_settings, default_step, simulate
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene.errors import InputError
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene
from rattle.scene.validate import choice

__all__ = ["COLUMNS", "validate"]

PILOT = 64  # paths of the pilot run that bounds the time of the last impact
MARGIN = 10.0  # the bound is this many times the pilot's time to its last impact; later fixed times are not compared

COLUMNS = (
    *("closure", "kind", "impact", "time", "quantity", "moment", "predicted", "simulated", "se", "bias"),
    *("error", "low", "high", "unit", "tolerance", "verdict", "paths_needed", "agreement", "remark"),
)


def validate(
    scene: Scene,
    *,
    impacts: int = 12,
    closures: Sequence[str] | None = None,
    paths: int = 256_000,
    dt: float | None = None,
    scheme: str = "exact-flight",
    rng: int | np.random.SeedSequence = 0,
    workers: int = 1,
    order: int = 4,
    tolerances: Tolerances | None = None,
    progress: str | None = None,
) -> Validation:
    """Compare closures with a Monte Carlo simulation of the same scene.

    Parameters
    ----------
    scene : Scene
        The system, its noise and its start.
    impacts : int
        Number of impacts after the start that are compared.
    closures : sequence of str, optional
        Names of the closures; by default all that can be applied to the scene.
    paths, dt, scheme, rng, workers, progress
        Settings of the simulation, see `rattle.montecarlo.simulate`.  If the scheme has a step bias, 2 dt and 4 dt run
        on the same Brownian paths to measure it; if it has none, the linearised path may serve as control variate.
    order : int
        Order of the closures' moments.
    tolerances : Tolerances, optional
        What counts as accurate: 5 % of an sd for means, 10 % for sds, 0.05 for correlations.

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        For any setting that cannot be run; nothing has started then.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> v = validate(Scene.from_gears(DAT21, sigma=0.01), impacts=2, closures=["saltation"], paths=20_000, rng=7)
    >>> row = v.table.query("quantity == 'tau' and moment == 'mean' and impact == 1").iloc[0]
    >>> row["verdict"], bool(row["low"] < 0.0 < row["high"])
    ('accurate', True)
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "give a Scene")
    closures = closures_for(scene) if closures is None else closures
    if not isinstance(closures, list | tuple) or not closures:
        raise InputError("closures", closures, "give a list of " + ", ".join(CLOSURES))
    for closure in closures:
        choice("closures", closure, CLOSURES)
    limits = tolerances or Tolerances()
    # both sides are computed phase-reduced, so that a late start loses no digits of the times that are compared
    given, scene = scene, scene.phase_reduced
    biased = SCHEMES[choice("scheme", scheme, SCHEMES)].has_step_bias
    dt = default_step(scene, scheme, biased) if dt is None else dt
    common: dict[str, Any] = {"impacts": impacts, "dt": dt, "scheme": scheme, "rng": rng}
    check_settings(scene, paths=paths, workers=workers, step_bias=biased, **common)
    predictions = {c: mean_map(scene, impacts=impacts, closure=c, order=order) for c in dict.fromkeys(closures)}
    orbit = follow(scene, impacts)
    tau = orbit.tau[: orbit.found + 1]
    grid = (4.0 if biased else 1.0) * dt  # fixed times are rounded to it; a flight shorter than it may contain none
    middle = (0.5 * (tau[1:] + tau[:-1]))[np.diff(tau) > grid]
    last = _last_impact(scene, **common)
    run = simulate(
        scene,
        paths=paths,
        workers=workers,
        sampling=Sampling(control=not biased and tau[-1] <= last),
        progress=progress,
        **common,
        record=Record(
            step_bias=biased,
            histogram=True,
            energy=scene.gears is not None,
            times=middle[(middle - scene.phase > grid) & (middle <= last)],
            itineraries={name: m.itinerary for name, m in predictions.items()},
        ),
    )
    # the impact that ends the flight of each fixed time
    flights = np.searchsorted(tau, run.at_times().index.to_numpy(float))
    per_impact = 2 * (len(SECTION) - (0 if scene.stages == 2 else 2)) + scene.stages
    z = widest(per_impact * impacts * len(predictions))
    parts = [section_errors(m, run, z, limits) for m in predictions.values()]
    if scene.sigma > 0.0 and len(run.at_times()):
        parts += [mid_flight_errors(m, run, flights, z, limits) for m in predictions.values()]
    table = pd.concat(parts, ignore_index=True).reindex(columns=list(COLUMNS))
    table["remark"] = table["remark"].fillna("")
    valid = judge_correlation(list(predictions.values()), run, flights)
    predictions = {name: replace(m, scene=given) for name, m in predictions.items()}
    run = replace(run, plan=run.plan._replace(scene=given))
    return Validation(given, predictions, run, to_absolute_time(table, given), valid, z, limits)


def _last_impact(scene: Scene, **settings: Any) -> float:
    """Generous upper bound of the time of every path's last impact, from a pilot run; at most when paths are abandoned.

    If the noise-free orbit flies much longer than the paths do, nothing can be compared at its later times, and
    simulating up to them may take millions of steps.
    """
    pilot = simulate(scene, paths=PILOT, **settings)
    at, horizon = pilot.section.iloc[-1], scene.phase + (pilot.plan.most_steps - 1) * pilot.dt
    latest = scene.phase + MARGIN * (at["tau"] + 6.0 * at["sd_tau"] - scene.phase)
    return float(min(horizon, math.inf if math.isnan(latest) else latest))
