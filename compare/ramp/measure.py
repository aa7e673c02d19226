"""The public entry `run_up`: constant speeds, the ramp itself, and the difference of the two."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd

from rattle.compare.ramp.curves import (
    RampSums,
    average_speeds,
    average_steady,
    follow_ramp,
    mean_of,
)
from rattle.compare.ramp.plan import RAMP_BURN_IN, RunUpPlan, plan_work
from rattle.compare.ramp.result import POWERS, QUANTITIES, RunUp
from rattle.compare.ramp.speed import SpeedRamp, read_ramp
from rattle.compare.report.json_text import Facts
from rattle.compare.stationary.measure import stationary
from rattle.compare.stationary.result import Stationary, unit_of
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.long_run import BurnInError
from rattle.montecarlo.long_run.estimates import groups, most_unseen
from rattle.montecarlo.long_run.paths import warm_up
from rattle.montecarlo.long_run.ramp import RampPaths, count_impacts
from rattle.montecarlo.looks import BUDGET_ENDED
from rattle.montecarlo.seed import Rng, child_seed, read_seed
from rattle.montecarlo.statistics.intervals import half_width, tail_of
from rattle.scene import Floats, InputError, Scene, compile_ahead, count, positive
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ESTIMATES, ProgressBar, do
from rattle.scene.threshold import rattle_threshold

RUN_UP_BUDGET = 60.0  # core-seconds
FEWEST_IN_A_POINT = 4  # periods of the ramp for each speed, to say anything there
COARSER = 2  # periods of the stretches of the coarser copy, which shows the error of the stretches
CLOCK_SPARE = (0.1, 1.0)
"""Share of the budget, and seconds, by which the clock may exceed what the counted plan expects."""
LEAST_RAMP_BUDGET = 1.0  # core-seconds that a constant speed may take once it is begun
STEADY_COLUMNS = ["value", "se", "low", "high", "effective_paths"]
AGAINST = "ramp against constant speeds"
HALVED = "stretches of one period against two"
# key of the random numbers that ramp and constant speeds share where gear sets differ
GEAR_SETS = 1


class SteadyRun(NamedTuple):
    """What was found at a constant speed."""

    rpm: float
    found: Stationary | None
    remark: str = ""  # why there is nothing


Known = dict[float, Stationary]
"""What was found, by the constant speed, in rising order."""


def _count_paths(found: Stationary) -> Floats | None:
    """What every path does a second, as the ramp counts it: 1/s, mm/s and mJ; None without paths
    that have forgotten their start.

    Shapes: result (paths, groups, number and speed above and energy).
    """
    run = found.run
    if run is None or run.widened > 1.0:
        return None
    assert run.scene.gears is not None
    units = run.scene.gears.units
    seconds = run.sums.time / run.scene.gears.omega
    counted = count_impacts(run.sums.main.sum(axis=1), run.scene.stages)
    return np.asarray(counted * np.array([1.0, units.speed, units.energy]) / seconds)


@numpy_defaults
def run_up(
    scene: Scene,
    *,
    rpm: tuple[float, float] = (600.0, 3000.0),
    seconds: float = 10.0,
    points: int = 12,
    slow: float = 0.1,
    budget: float = RUN_UP_BUDGET,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> RunUp:
    """Rattle while the driver's mean speed changes slowly.

    Impacts a second, power and speeds over the mean speed, with intervals: at constant speeds, and
    in the ramp itself, whose difference is stated.  The excitation keeps its order: its frequency
    is as many times the mean speed as in the file.  Its amplitude, torques and backlashes stay as
    they were typed, drag over speed is read at each speed, and `sigma` stays as it is.  The ramp
    also accelerates the mean rotation of the wheels, which adds to their drag.

    Parameters
    ----------
    scene : Scene
        Gears with a mean speed.
    rpm : pair of float
        Mean speed of the driver at the beginning and the end, 1/min; the second may be lower.
    seconds : float
        Duration of the ramp.
    points : int
        Speeds, evenly spaced from the first to the last.
    slow : float
        Speed below which an impact is slow, dimensionless at the file's speed; at all others it is
        the same in mm/s.
    budget : float
        Seconds of processor time, all threads together; compiling is not counted.  What does not
        fit is left out, and named.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed.
    workers : int
        Threads; the result does not depend on it.
    progress : str, optional
        Label of a progress bar on a terminal or in a notebook; with it the expected time is logged
        first.

    Returns
    -------
    RunUp

    Raises
    ------
    InputError
        For a scene without gears or without a speed, a speed that the drag over speed does not
        cover, or a ramp that is too short.

    Examples
    --------
    >>> from rattle import Gears
    >>> wheel = {"inertia1": 950.0, "radius1": 38.0, "backlash1": 0.12, "torque1": 40.0}
    >>> speed = {"speed_rpm": 800.0, "driver_radius": 32.0, "omega": 167.6}
    >>> gears = Gears.driven(amplitude=0.2, epsilon=0.9, **speed, **wheel)
    >>> scene = Scene.from_gears(gears, sigma=0.1, stages=1)
    >>> found = run_up(scene, rpm=(800.0, 1600.0), seconds=2.0, points=2, budget=1.0)
    >>> list(found.points["rpm"])
    [800.0, 1600.0]
    """
    ramp = read_ramp(scene, rpm, seconds, slow)
    count("points", points, least=2)
    count("workers", workers)
    positive("budget", budget)
    given = read_seed(rng)
    seed = np.random.SeedSequence(given) if isinstance(given, int) else given
    if ramp.periods < FEWEST_IN_A_POINT * points:
        why = f"is too short: {ramp.periods} periods of the excitation for {points} speeds"
        raise InputError("seconds", seconds, f"{why}; give more of them, or fewer points")
    ramp.stretches(COARSER)  # a speed that the gears cannot have is refused before any work
    compile_ahead.expect("stationary", len(scene.drive))
    limit = Budget(budget + CLOCK_SPARE[0] * budget + CLOCK_SPARE[1])
    do("run-up: compiling")
    with limit.pause():
        warm_up(scene, ramp.slow)
    speeds = np.linspace(ramp.first, ramp.last, points).tolist()
    do("run-up: counting impacts at every speed")
    plan = plan_work(ramp, speeds, budget, seed)
    if progress:
        ESTIMATES.info("%s: %s", progress, plan.sentence)
    runs = _run_steady(ramp, plan, limit, seed, workers, progress)
    known = {run.rpm: run.found for run in sorted(runs) if run.found is not None}
    fine = coarse = None
    if plan.ramp_paths and len(known) > 1:
        fine, coarse = _follow_twice(ramp, known, plan, limit, seed, workers, progress)
    table = _tabulate(known, fine, scene)
    whole = table["rpm"].isna()
    overall = pd.DataFrame()
    if fine is not None:
        table = _judge(table, list(known), plan.speeds)
        overall = _compare_overall(table[whole], fine, coarse)
    runs += [SteadyRun(rpm, None, "left out: beyond the budget") for rpm in plan.left_out]
    complete = plan.complete if plan.left_out or fine is None else 0.0
    if limit.remaining < 0.0:  # the plan has expected too little
        complete = max(plan.complete, 2.0 * budget)
    return RunUp(
        scene=scene,
        first=ramp.first,
        last=ramp.last,
        seconds=ramp.seconds,
        slow=ramp.slow,
        table=table[~whole].drop(columns="effective_paths").reset_index(drop=True),
        points=_tabulate_points(ramp, runs),
        thresholds=_find_thresholds(ramp, sorted(speeds)),
        overall=overall,
        added_torque=tuple(ramp.added_torque(wheel) for wheel in range(1, scene.stages + 1)),
        ramp_paths=plan.ramp_paths if fine is not None else 0,
        ramp_periods=ramp.periods,
        complete=complete,
    )


def _run_steady(
    ramp: SpeedRamp,
    plan: RunUpPlan,
    limit: Budget,
    seed: np.random.SeedSequence,
    workers: int,
    progress: str | None,
) -> list[SteadyRun]:
    """The long run at every constant speed of the plan."""
    runs: list[SteadyRun] = []
    number = len(plan.speeds)
    with ProgressBar(label=progress, unit=" speeds", total=number) as bar:
        for done, rpm in enumerate(plan.speeds):
            do(f"run-up: {rpm:.4g} 1/min")
            left = limit.remaining - plan.ramp_seconds
            if left < 0.0 and runs:
                runs.append(SteadyRun(rpm, None, BUDGET_ENDED))
                continue
            try:
                run = stationary(
                    ramp.scene_at(rpm),
                    periods=plan.periods,
                    paths=plan.paths,
                    slow=ramp.slow_at(rpm),
                    budget=max(left / (number - done), LEAST_RAMP_BUDGET),
                    closures=(),
                    rng=_seed_of(ramp.scene, seed, round(rpm)),
                    workers=workers,
                )
                runs.append(SteadyRun(rpm, run))
            except InputError as error:
                why = BUDGET_ENDED if error.field == "budget" else str(error)
                if isinstance(error, BurnInError):
                    why = f"no stationary motion within {error.value} periods of burn-in"
                runs.append(SteadyRun(rpm, None, why))
            bar.update()
    return runs


def _seed_of(scene: Scene, seed: np.random.SeedSequence, *keys: int) -> np.random.SeedSequence:
    """The seed of one of the runs: of its own, but where every path is a gear set the same one for
    all, so that the same gear sets are compared."""
    differs = scene.tolerance is not None and scene.tolerance.differs_by_set
    return child_seed(seed, GEAR_SETS) if differs else child_seed(seed, *keys)


def _follow_twice(
    ramp: SpeedRamp,
    known: Known,
    plan: RunUpPlan,
    limit: Budget,
    seed: np.random.SeedSequence,
    workers: int,
    progress: str | None,
) -> list[RampSums | None]:
    """The ramp in stretches of one period and of `COARSER`, with the same random numbers."""
    do("run-up: the ramp")
    knots = list(known)
    scenes = [steady.scene for steady in known.values()]
    total = 2 * (ramp.periods + RAMP_BURN_IN)
    copies = []
    with (
        ThreadPoolExecutor(workers) as pool,
        ProgressBar(label=progress, unit=" periods", total=total) as bar,
    ):
        for stretch in (1, COARSER):
            of_ramp = _seed_of(ramp.scene, seed, len(known), 1)
            paths = RampPaths(scenes, plan.ramp_paths, of_ramp)
            sums = follow_ramp(ramp, knots, stretch, paths, pool, limit, bar)
            copies.append(sums)
    return copies


def _tabulate(known: Known, sums: RampSums | None, scene: Scene) -> pd.DataFrame:
    """Every quantity at every speed, and last in the whole ramp: constant, in the ramp, and the
    difference."""
    steady = {rpm: run.table_in("physical") for rpm, run in known.items()}
    same_sets = _count_same_sets(known, scene)
    parts = []
    for (group, suffix), kind in product(groups(scene.stages), QUANTITIES):
        name = kind + suffix
        rows = [table.reindex([name])[STEADY_COLUMNS] for table in steady.values()]
        whole = pd.DataFrame(np.nan, index=[name], columns=STEADY_COLUMNS)
        part = pd.concat([*rows, whole], ignore_index=True)
        part.insert(0, "rpm", [*steady, np.nan])
        part.insert(1, "quantity", name)
        part["unit"] = unit_of(kind, scene.gears, "physical")[0]
        if sums is not None:
            compared = _compare(part, steady, same_sets, sums, kind, group, suffix)
            part = part.assign(**compared)
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def _count_same_sets(known: Known, scene: Scene) -> Floats | None:
    """What every gear set does a second at the constant speeds; None where paths are no gear sets,
    or a speed has no paths.

    Shapes: result (speeds, paths, groups, number and speed above and energy).
    """
    if scene.tolerance is None or not scene.tolerance.differs_by_set:
        return None
    counts = [_count_paths(run) for run in known.values()]
    return None if any(one is None for one in counts) else np.array(counts)


def _judge(table: pd.DataFrame, grid: list[float], planned: Sequence[float]) -> pd.DataFrame:
    """Whether ramp and constant speeds differ, with 95 % probability for all rows together; not
    beside a speed that was planned and has no result, nor then in the whole ramp."""
    missing = np.array([rpm for rpm in planned if rpm not in grid])
    between = np.searchsorted(grid, missing)
    beside = {rpm for i in between for rpm in grid[max(i - 1, 0) : i + 1]}
    unclear = table["rpm"].isin(beside) | (table["rpm"].isna() & bool(len(missing)))
    columns = table.columns[table.columns.str.contains("difference")]
    table[columns] = table[columns].mask(unclear)
    tested = max(int(table["se_difference"].gt(0.0).sum()), 1)
    widths = half_width(table["effective_paths"].fillna(2.0), tail_of(tested))
    bound = widths * table["se_difference"] + table["allowance"]
    return table.assign(differs=table["difference"].abs() > bound)


def _compare(
    part: pd.DataFrame,
    steady: dict[float, pd.DataFrame],
    same_sets: Floats | None,
    sums: RampSums,
    kind: str,
    group: int,
    suffix: str,
) -> Facts:
    """Columns of a quantity in the ramp, and of its difference from constant speeds."""

    def column(name: str, statistic: str) -> Floats:
        values = [table[statistic].get(name, np.nan) for table in steady.values()]
        return np.asarray(np.nan_to_num(np.array(values, dtype=float)))

    name = kind + suffix
    own = column(name, "value"), column(name, "se")
    if kind == "speed_above":
        rate = f"rate_above{suffix}"
        rates = column(rate, "value"), column(rate, "se")
        middle, error, allowance = average_speeds(sums, rates, own)
    else:
        middle, error, allowance = average_steady(sums, POWERS[kind], own)
    spreads = sums.spreads(QUANTITIES[kind], group)
    value, se, paths = np.array(spreads).T
    low, high = np.array([one.interval() for one in spreads]).T
    if kind != "speed_above":
        low = np.maximum(low, 0.0)
    if kind == "rate_above":
        unseen = [most_unseen(time * sums.counted.shape[1]) for time in sums.time]
        high = np.where(value == 0.0, unseen, high)
    effective = np.fmin(paths, part["effective_paths"].to_numpy())
    apart = np.hypot(se, error)
    difference = value - middle
    if same_sets is not None:  # set by set: how much they differ from each other drops out
        pairs = sums.differences(QUANTITIES[kind], group, same_sets)
        difference, apart, effective = np.array(pairs).T
    half = half_width(np.nan_to_num(effective, nan=2.0)) * apart + allowance
    return {
        "effective_paths": effective,
        "ramp_rpm": sums.weights @ sums.rpm,
        "ramp": value,
        "se_ramp": se,
        "ramp_low": low,
        "ramp_high": high,
        "difference": difference,
        "se_difference": apart,
        "allowance": allowance,
        "difference_low": difference - half,
        "difference_high": difference + half,
    }


def _compare_overall(whole: pd.DataFrame, fine: RampSums, coarse: RampSums | None) -> pd.DataFrame:
    """Shares by which the whole ramp differs from constant speeds, and by which halving its
    stretches changes it."""
    steady = whole["ramp"] - whole["difference"]
    bounds = whole[["difference", "difference_low", "difference_high"]].div(steady, axis=0)
    rows = [
        (AGAINST, name, *row)
        for name, row in zip(whole["quantity"], bounds.to_numpy(), strict=True)
        if name in POWERS and np.isfinite(row).all()
    ]
    for name in POWERS:
        one = fine.counted[-1, :, 0, QUANTITIES[name]]
        if coarse is not None and one.sum() > 0.0:
            halved = mean_of(one - coarse.counted[-1, :, 0, QUANTITIES[name]], one)
            rows.append((HALVED, name, halved.value, *halved.interval()))
    return pd.DataFrame(rows, columns=["what", "quantity", "change", "low", "high"])


def _tabulate_points(ramp: SpeedRamp, runs: list[SteadyRun]) -> pd.DataFrame:
    """Every speed: excitation, drag and threshold of each wheel, and what was run there."""
    rows = []
    for run in sorted(runs, key=lambda run: run.rpm):
        row: Facts = {"rpm": run.rpm, "omega": float(ramp.omega_at(np.array(run.rpm)))}
        for wheel in rattle_threshold(ramp.scene_at(run.rpm)):
            row[f"drag{wheel.wheel}"] = wheel.drag
            row[f"threshold{wheel.wheel}"] = wheel.least
        long_run = run.found.run if run.found else None
        row["kind"] = run.found.kind if run.found else ""
        row |= {name: getattr(long_run, name, 0) for name in ("paths", "periods")}
        row["burn_in"] = long_run.burn_in.periods if long_run else 0
        rows.append(row | {"remark": run.remark})
    return pd.DataFrame(rows)


def _find_thresholds(ramp: SpeedRamp, speeds: list[float]) -> pd.DataFrame:
    """Where closed teeth of each wheel begin to open over the speed; without a speed: nowhere, and
    whether they open everywhere."""
    rows: list[tuple[str, int, float, bool, str]] = []
    for motion, wheel in product(("constant speed", "ramp"), range(1, ramp.scene.stages + 1)):
        in_ramp = motion == "ramp"
        crossings = ramp.openings(wheel, speeds, in_ramp)
        if not crossings:
            opens = ramp.opens(wheel, speeds[0], in_ramp)
            crossings = [(np.nan, opens)]
        name = ramp.scene.wheel_names[wheel - 1]
        rows += [(motion, wheel, rpm, opens, name) for rpm, opens in crossings]
    return pd.DataFrame(rows, columns=["motion", "wheel", "rpm", "opens", "name"])
