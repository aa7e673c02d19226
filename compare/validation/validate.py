"""Validation of closures: compares them with an ensemble of the same scene and gives a verdict on
every moment."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from rattle.closure import Closure, MeanMap, Orbit, closures_for, follow
from rattle.closure.mean_map import closure_seconds, find_closures, predict
from rattle.compare.judge.judge import COLUMNS_AFTER, COLUMNS_BEFORE
from rattle.compare.judge.rows import NamedSection
from rattle.compare.judge.verdict import Tolerances, Verdict
from rattle.compare.validation import errors
from rattle.compare.validation.comparison import (
    Comparison,
    Sweep,
    find_validities,
    measure_speeds,
    simulation_costs,
)
from rattle.compare.validation.result import Validation
from rattle.montecarlo import SCHEMES, Ensemble, Record, check_settings, default_step, simulate
from rattle.montecarlo.accuracy.cost import cost_of
from rattle.montecarlo.seed import Rng, read_seed
from rattle.montecarlo.settings import Sampling
from rattle.montecarlo.statistics.intervals import AGAIN, FAMILY_ERROR, widest
from rattle.scene import (
    InputError,
    Ints,
    Scene,
    check_scene,
    choice,
    compile_ahead,
    section_names,
)
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ProgressBar

PILOT_PATHS = 64  # paths of the pilot run that bounds the time of the last impact
# the bound is this many times the pilot's time to its last impact; later fixed times are not
# compared
TIME_MARGIN = 10.0

OF_SAMPLES_ALONE = ("paths", "enough_paths")
"""Columns of `rattle.judge` that a validation leaves to its `Validation.run`."""

TABLE_COLUMNS = (
    *COLUMNS_BEFORE,
    "impact",
    "time",
    *(name for name in COLUMNS_AFTER if name not in OF_SAMPLES_ALONE),
)


@numpy_defaults
def validate(
    scene: Scene,
    *,
    impacts: int = 12,
    closures: Sequence[str | Closure | Callable[..., Any]] | None = None,
    paths: int = 256_000,
    dt: float | None = None,
    scheme: str = "exact-flight",
    rng: Rng = 0,
    workers: int = 1,
    order: int = 4,
    tolerances: Tolerances | None = None,
    fixed_times: bool = True,
    progress: str | None = None,
) -> Validation:
    """Compare closures with a Monte Carlo simulation of the same scene.

    Parameters
    ----------
    scene : Scene
        The system, its noise and its start.
    impacts : int
        Number of impacts after the start that are compared.
    closures : sequence of str, Closure or callable, optional
        Names of the closures, or closures of one's own: functions ``(scene, impacts)``, each a
        `rattle.closure.Closure` or taken for one; by default all of the package that can be applied
        to the scene.  If a function raises an exception, its rows are not predicted and their
        remark says why.
    paths, dt, scheme, rng, workers, progress
        Settings of the simulation, see `rattle.montecarlo.simulate`.  If the scheme has a step
        bias, 2 dt and 4 dt run on the same Brownian paths to measure it; if it has none, the
        linearised path may serve as control variate.
    order : int
        Order of the closures' moments.
    tolerances : Tolerances, optional
        What counts as accurate: 5 % of an sd for means, 10 % for sds, 0.05 for correlations.
    fixed_times : bool
        Whether the correlations at fixed times, in the middle of the orbit's flights, are compared
        as well.

    Returns
    -------
    Validation
        Rows of its table of kind ``section`` and ``fixed time`` are about all paths; those of kind
        ``itinerary`` about the paths alone that have followed the closure's itinerary (its sequence
        of meshes and sides) up to the impact.

    Raises
    ------
    InputError
        For any setting that cannot be run, and where a function of one's own returns no such table;
        nothing has started then.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=0.01)
    >>> v = validate(scene, impacts=2, closures=["saltation"], paths=20_000, rng=7)
    >>> row = v.table.query("quantity == 'tau' and moment == 'mean' and impact == 1").iloc[0]
    >>> row["verdict"], bool(row["low"] < 0.0 < row["high"])
    ('accurate', True)
    """
    check_scene(scene)
    compile_ahead.expect("validate", len(scene.drive))
    methods = find_closures("closures", closures_for(scene) if closures is None else closures)
    limits = tolerances or Tolerances()
    # both sides are computed phase-reduced, so that a late start loses no digits of the times that
    # are compared
    given = scene
    scene = scene.phase_reduced
    biased = SCHEMES[choice("scheme", scheme, SCHEMES)].has_step_bias
    dt = default_step(scene, scheme, biased) if dt is None else dt
    seed = read_seed(rng)
    check_settings(
        scene,
        paths=paths,
        impacts=impacts,
        dt=dt,
        scheme=scheme,
        rng=seed,
        workers=workers,
        step_bias=biased,
    )
    predictions = {method.name: predict(given, method, impacts, order) for method in methods}
    maps = [m.phase_reduced for m in predictions.values()]
    sample = partial(
        simulate, scene, impacts=impacts, dt=dt, scheme=scheme, rng=seed, workers=workers
    )
    orbit = follow(scene, impacts)
    record, sampling = _plan_records(orbit, predictions, sample, biased, fixed_times)
    run = sample(paths=paths, sampling=sampling, progress=progress, record=record)
    # the impact of the noise-free orbit that ends the flight of each fixed time
    flights = np.searchsorted(orbit.tau[: orbit.found + 1], run.at_times().index.to_numpy(float))
    z, table, second_look = _judge_rows(predictions, maps, run, flights, limits, workers)
    valid = errors.judge_correlation(maps, run, flights)
    run = replace(run, plan=run.plan._replace(scene=given))
    return Validation(
        given,
        predictions,
        run,
        errors.to_absolute_time(table, given),
        valid,
        z,
        limits,
        second_look,
    )


def _judge_rows(
    predictions: Mapping[str, MeanMap],
    maps: list[MeanMap],
    run: Ensemble,
    flights: Ints,
    limits: Tolerances,
    workers: int,
) -> tuple[float, pd.DataFrame, Ensemble | None]:
    """Half width of all intervals in standard errors, the rows of the table, and the paths of a
    second look.

    `maps`: The predictions of the phase-reduced scene. `flights`: The impact of the noise-free
    orbit that ends the flight of each fixed time.
    """
    stages = run.scene.stages
    moments = 2 * len(section_names(stages)) * run.impacts * len(maps)
    checks = moments + stages * run.impacts * len(maps)
    z = widest(checks)
    section = errors.section_errors(maps, run, z, limits)
    again = widest(checks, AGAIN * FAMILY_ERROR)
    section, second_look = errors.judge_again(section, maps, run, again, limits, workers)
    parts = [section]
    if run.scene.sigma > 0.0 and flights.size:
        parts += [errors.mid_flight_errors(m, run, flights, z, limits) for m in maps]
    parts.append(errors.itinerary_errors(maps, run, widest(moments), limits))
    table = pd.concat(parts, ignore_index=True).reindex(columns=TABLE_COLUMNS)
    raised = {name: m.stopped for name, m in predictions.items() if m.trace.raised}
    remarks = zip(table["closure"], table["remark"].fillna(""), strict=True)
    table["remark"] = [raised.get(name, remark) for name, remark in remarks]
    return z, table, second_look


def _plan_records(
    orbit: Orbit,
    predictions: Mapping[str, MeanMap],
    sample: "partial[Ensemble]",
    biased: bool,
    fixed_times: bool,
) -> tuple[Record, Sampling]:
    """What the simulation that closures are compared with records: of all paths, of those on each
    closure's itinerary, and at fixed times in the middle of the flights of the noise-free orbit;
    and whether it has a control variate."""
    (scene,) = sample.args
    tau = orbit.tau[: orbit.found + 1]
    last = _last_impact(scene, sample)
    times: Any = ()
    if fixed_times:
        # fixed times are rounded to it; a flight shorter than it may contain none
        grid = (4.0 if biased else 1.0) * sample.keywords["dt"]
        middle = (0.5 * (tau[1:] + tau[:-1]))[np.diff(tau) > grid]
        times = middle[(middle - scene.phase > grid) & (middle <= last)]
    record = Record(
        step_bias=biased,
        histogram=True,
        energy=scene.gears is not None,
        times=times,
        on_itinerary=True,
        itineraries={name: m.itinerary for name, m in predictions.items()},
    )
    control = not biased and not scene.correlation_time and tau[-1] <= last
    return record, Sampling(control=control)


def _last_impact(scene: Scene, sample: "partial[Ensemble]") -> float:
    """Generous upper bound of the time of every path's last impact, from a pilot run; at most when
    paths are abandoned.

    If the noise-free orbit flies much longer than the paths do, nothing can be compared at its
    later times, and simulating up to them may take millions of steps.
    """
    pilot = sample(paths=PILOT_PATHS)
    at = pilot.section.iloc[-1]
    horizon = scene.phase + (pilot.plan.most_steps - 1) * pilot.dt
    latest = scene.phase + TIME_MARGIN * (at["tau"] + 6.0 * at["sd_tau"] - scene.phase)
    return float(min(horizon, math.inf if math.isnan(latest) else latest))


SCHEME_COLUMNS = [
    "sigma",
    "method",
    "dt",
    "paths",
    "bias_mean",
    "bias_sd",
    "error_mean",
    "error_sd",
    "core_seconds",
]
BESIDE_PATHS = 32_768  # of each scheme that is shown beside the simulation
DEFAULT_SCHEME = "exact-flight"
"""Has no step bias, which would exceed the tolerances at small sigma, as they are shares of the
sds."""


def check_sweep(scene: Scene, sigmas: Sequence[float], **settings: Any) -> None:
    """Validate the input of a sweep before any work starts."""
    for sigma in sigmas:
        try:
            swept = scene.with_sigma(sigma)
            check_settings(
                swept,
                scheme=DEFAULT_SCHEME,
                dt=default_step(swept, DEFAULT_SCHEME),
                step_bias=False,
                **settings,
            )
        except InputError as error:
            raise InputError(
                "validity", sigma, f"cannot be run ({error}); change the range, or leave it out"
            ) from None


STRIDES = (4, 2, 1)
"""Of how many neighbouring noise intensities one is validated, in each round of a sweep: a part of
it is of use."""
FEWEST_SIGMAS = 2
"""Of a sweep, whatever its budget: a range has two ends."""
BESIDES = 1.0
"""Core-seconds that a validation takes besides its paths and closures: its tables, and paths near
rare branches.

With it the processor time of 26 validations of 13 scenes was 0.6 to 1.8 times the counted work, but
for two of 2.5 and 4.5 times, where pilots look for rare ways to leave the itinerary.
"""


def sweep(
    scene: Scene,
    sigmas: Sequence[float],
    *,
    workers: int,
    budget: float = math.inf,
    **settings: Any,
) -> Sweep:
    """Validate a scene at each noise intensity against exact flights, all from one seed.

    `sigmas`: Noise intensities.  All use the same random numbers, so that the sample does not
    change along the grid. `budget`: Core-seconds of counted work; what it does not allow is left
    out.
    """
    order = list(dict.fromkeys(sigma for stride in STRIDES for sigma in sigmas[::stride]))
    validations = list[Validation]()
    work = 0.0
    with ProgressBar(order, label="range of validity", unit="intensities") as bar:
        for sigma in bar:
            v = validate(
                scene.with_sigma(sigma),
                scheme=DEFAULT_SCHEME,
                fixed_times=False,
                workers=workers,
                **settings,
            )
            validations.append(v)
            latest = count_work(v)
            work += latest
            if work + latest > budget and len(validations) >= FEWEST_SIGMAS:
                break
    left_out = len(order) - len(validations)
    all_work = work / len(validations) * len(order)
    validations.sort(key=lambda v: v.scene.sigma)
    return Sweep(
        find_validities(validations),
        measure_speeds(validations),
        simulation_costs(validations),
        left_out,
        all_work,
    )


def count_work(v: Comparison) -> float:
    """Core-seconds of a validation, from counted work; functions of one's own, whose work nobody
    counts, are free."""
    closures = sum(closure_seconds(m) for m in v.predictions.values() if not m.method.own)
    return BESIDES + closures + cost_of(v.run, v.run.paths).core_seconds


def compare_schemes(
    validations: Sequence[Comparison], schemes: Sequence[str], workers: int
) -> pd.DataFrame:
    """Simulate each scene of some validations by each of these schemes; a row for each of them and
    for each closure."""
    rows = []
    at = ["impact", "quantity", "moment"]
    for v in validations:
        for scheme in dict.fromkeys((v.run.scheme, *schemes)):
            seed = np.random.SeedSequence(v.run.seed.entropy, spawn_key=(*v.run.seed.spawn_key, 1))
            sample = partial(
                simulate,
                v.scene.phase_reduced,
                impacts=v.run.impacts,
                scheme=scheme,
                rng=seed,
                workers=workers,
            )
            sample(paths=2)  # compiles
            began = time.process_time()
            run = sample(paths=BESIDE_PATHS)
            took = time.process_time() - began
            sampled = NamedSection(scheme, run.section)
            table = errors.section_errors([sampled], v.run.phase_reduced, v.z, v.tolerances)
            error = _largest(table, "error")
            bias = _largest(
                table.drop(columns="bias").merge(run.step_bias[[*at, "bias"]], on=at), "bias"
            )
            rows.append((v.scene.sigma, scheme, run.dt, BESIDE_PATHS, *bias, *error, took))
        for closure, prediction in v.predictions.items():
            table = v.section_rows(closure)
            error = _largest(table.assign(judged=table["verdict"] != Verdict.EXCLUDED), "error")
            not_sampled = (np.nan, 0, np.nan, np.nan)
            took = closure_seconds(prediction)
            rows.append((v.scene.sigma, closure, *not_sampled, *error, took))
    return pd.DataFrame(rows, columns=SCHEME_COLUMNS)


def _largest(table: pd.DataFrame, column: str) -> list[float]:
    """The largest value of a mean and of an sd, in sds of the quantity, over the rows that are
    judged."""
    rows = table[table["judged"] & (table["unit"] > 0.0)]
    shares = rows[column].abs() / rows["unit"]
    return [shares[rows["moment"] == moment].max() for moment in ("mean", "sd")]
