"""Cost of accuracy: every scheme at every accuracy, measured or extrapolated by a cost model, and
every closure.

The error of a scheme is what with 95 % probability no section mean or sd is off by more than, in
units of each quantity's sd (`rattle.montecarlo.diagnostics.accuracy`).  The error of a closure is
its worst difference from the reference simulation, the run of exact flights with most paths.  Time
is processor time, summed over threads.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from operator import attrgetter
from typing import NamedTuple, TypeVar

import numpy as np
import pandas as pd

from rattle.closure import closures_for, mean_map
from rattle.closure.mean_map import closure_seconds
from rattle.compare.tradeoff.multilevel import (
    LEVEL_PATHS,
    MEASURED_SIGMAS,
    Levels,
    control_table,
    level_steps,
    measure_levels,
    time_run,
)
from rattle.compare.tradeoff.weak_order import (
    ORDER_IMPACTS,
    ORDER_PATHS,
    REPLICATES,
    STEP_PAIRS,
    WeakOrders,
    orders_over,
)
from rattle.montecarlo import SCHEMES, AccuracyWarning, Ensemble, Record, simulate, simulate_to
from rattle.montecarlo.accuracy.cost import cost_of, count_to, step_error
from rattle.montecarlo.accuracy.pilots import PilotRun, pilot, sample_branches
from rattle.montecarlo.diagnostics.accuracy import FEWEST_PATHS, sampling_error, units
from rattle.montecarlo.ensemble.simulate_rare import begin_rare
from rattle.montecarlo.kernel.blocks import Budget, in_threads
from rattle.montecarlo.looks import CountedWork
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import Floats, Scene, section_names
from rattle.scene.progress import ProgressBar

T = TypeVar("T")
# ratio of the steps of both pilot runs, which separates the time of steps from that of impacts
PILOT_STEP_RATIO = 8.0
TIMINGS = 3  # timings of a pilot run and of a closure, of which the least counts


class CostPoint(NamedTuple):
    """Error and cost of a method at a requested accuracy; errors are in units of each quantity's
    sd.

    An accuracy is that of `rattle.montecarlo.simulate_to`: with 95 % probability no section mean or
    sd is off by more.
    """

    method: str  # name of a scheme, of a closure, or ``multilevel`` and a scheme
    kind: str  # ``scheme``, ``multilevel`` (section means only) or ``closure``
    accuracy: float  # as requested; NaN for a closure
    dt: float
    paths: int
    core_seconds: float  # processor time, pilot runs included
    # sampling_error, step_error: worst standard error and worst step bias; of a closure the half
    # width of the worst row's interval, and 0
    sampling_error: float
    step_error: float
    # as drawn: the bound that was reached if measured, the accuracy if extrapolated,
    # ``actual_error`` if ``missed``; of a closure its worst error
    error: float
    measured: bool  # whether it was run, rather than extrapolated
    median_error: float = math.nan  # of a closure
    # whether the worst error of a closure is larger than its interval; if not, ``error`` is an
    # upper bound
    resolved: bool = True
    rows: int = 0  # number of section means and sds to which the errors refer
    # worst difference of a measured run from the reference simulation
    actual_error: float = math.nan
    # whether that is more than the accuracy and the error of the reference explain
    missed: bool = False
    # nominal core-seconds of the counted work: what decides which method is cheapest.  NaN for
    # multilevel methods
    work: float = math.nan


@dataclass
class CostModel:
    """Cost model of a scheme: paths as its runs foresee them, error ``bias * dt``, time linear in
    paths and steps."""

    scheme: str
    first: Ensemble  # the pilot run
    # path_seconds, step_seconds: seconds of a path without its steps, and of each step (counting
    # those of dt, 2 dt and 4 dt)
    path_seconds: float
    step_seconds: float
    pilot_seconds: float  # seconds of the pilot run, which are part of every cost
    bias: float  # worst step bias over dt, in sds; 0 for a scheme without step bias
    best: Ensemble  # the run with most paths
    # A plain run of another scheme that foresees the paths if it has more: heavy tails show only in
    # many
    shared: Ensemble | None = None

    @classmethod
    def from_pilots(
        cls, scene: Scene, scheme: str, again: Callable[..., Ensemble], timings: int
    ) -> "CostModel":
        """Fit the model to pilot runs: one for a scheme without step bias, else a second one with a
        shorter step."""
        call = partial(pilot, scene, scheme, again)
        first, seconds = _least(call, call, timings)
        if not SCHEMES[scheme].has_step_bias:
            return cls(scheme, first, 0.0, seconds / first.path_steps, seconds, 0.0, first)
        longer = partial(again, paths=first.paths, scheme=scheme, dt=first.dt / PILOT_STEP_RATIO)
        call = partial(longer, record=Record(step_bias=True))
        finer, more = _least(call, call, timings)
        step = (more - seconds) / (finer.path_steps - first.path_steps)
        path = max(0.0, seconds - step * first.path_steps) / first.paths
        model = cls(scheme, first, path, step, seconds, step_error(first)[0] / first.dt, first)
        model.learn(finer)
        return model

    def learn(self, run: Ensemble) -> None:
        """Update the model: what foresees the paths from a run with more, the bias where it is
        significant."""
        if run.paths >= self.best.paths:
            self.best = run
        if self.bias:
            step, se = step_error(run)
            if step > 3.0 * se:
                self.bias = step / run.dt

    def steps(self, dt: float) -> float:
        """Number of steps of a path, summed over the step sizes dt, 2 dt and 4 dt that run in
        parallel."""
        return self.first.path_steps / self.first.paths * self.first.dt / dt

    def at(self, accuracy: float) -> CostPoint:
        """Extrapolate to an accuracy, half of which is left to the bias of a scheme that has one.

        `accuracy`: Error that with 95 % probability no section mean or sd exceeds, in sds.
        """
        room = 0.5 * accuracy if self.bias else accuracy
        run = max(self.best, self.shared or self.best, key=attrgetter("paths"))
        paths = count_to(run, room)
        dt = min(self.first.dt, room / self.bias) if self.bias else self.first.dt
        path_seconds = self.path_seconds + self.step_seconds * self.steps(dt)
        return CostPoint(
            self.scheme,
            "scheme",
            accuracy,
            dt,
            paths,
            core_seconds=self.pilot_seconds + paths * path_seconds,
            sampling_error=sampling_error(run)[0] * math.sqrt(run.paths / paths),
            step_error=self.bias * dt,
            error=accuracy,
            measured=False,
            work=self.work(self.first, paths, dt),
        )

    def work(self, run: Ensemble, paths: int, dt: float) -> float:
        """Nominal core-seconds of the pilot run and of paths like those of a run."""
        return (
            cost_of(self.first, self.first.paths).core_seconds
            + cost_of(run, paths, dt).core_seconds
        )

    def path_alone(self, accuracy: float, step_ns: float | None = None) -> float:
        """Seconds of a path at an accuracy, without the steps of 2 dt and 4 dt that measure the
        bias.

        `step_ns`: Nanoseconds of a step, in place of the measured times; impacts are then free.
        """
        share = 4.0 / 7.0 if self.bias else 1.0  # 1 : 1/2 : 1/4 steps of dt, 2 dt and 4 dt
        steps = self.steps(self.at(accuracy).dt) * share
        if step_ns:
            return 1e-9 * step_ns * steps
        return self.path_seconds * share + self.step_seconds * steps


def _least(compiles: Callable[[], T], call: Callable[[], T], timings: int) -> tuple[T, float]:
    """The result of a call and the shortest of several timings, after one that compiles."""
    compiles()
    timed = [time_run(call) for _ in range(timings)]
    return timed[0][0], min(seconds for _, seconds in timed)


ACCURACIES = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
# wall time allowed for a point over its processor time, as other processes may occupy the cores
BUSY = 10.0
LEAST_SECONDS = 1e-3  # of a budget; what is spent already leaves none
HAND_TUNED_NS = 10.7
"""Nanoseconds of a path-step of plain Euler-Maruyama in hand-tuned numba code, on the machine of
the README."""


@dataclass(frozen=True)
class Tradeoff:
    """Results of a comparison of costs."""

    points: pd.DataFrame  # rows of `rattle.compare.tradeoff.measure.CostPoint`
    accuracies: Sequence[float]  # from the roughest to the finest
    models: dict[str, CostModel]  # by scheme
    levels: dict[str, Levels]  # multilevel analysis, by Euler scheme
    reference: Ensemble  # the simulation with which closures are compared
    # what the control variate is worth, see `control_table`; empty for noise with memory
    control: pd.DataFrame
    orders: WeakOrders | None  # measured weak orders, if asked for
    reduced: str = ""  # what the budget has made smaller, as a sentence


# of the budget: the most that a point may take, and all points together
POINT_SHARE = 0.25
POINTS_SHARE = 0.7
# of the budget: the levels of both schemes, the table of the control variate, and the weak orders
LEVELS_SHARE = 0.1
CONTROL_SHARE = 0.05
ORDERS_SHARE = 0.15
FEWEST_SHARED = 1024  # paths of a run of these, which the budget makes smaller
FIXED_SECONDS = 4.0  # of pilot runs, closures and the smallest tables
RUN_SECONDS = 0.03  # of a run besides its paths: its plan and its tables
BRANCHES_SECONDS = 0.5  # of a search for rare branches along the motion without noise
SECONDS_OF_A_TIMING = 20.0  # of the budget for each time that something is timed


class Allowance(CountedWork):
    """What is left of the budget for the points, which come first; the tables have shares of their
    own."""

    def __init__(self, budget: float) -> None:
        super().__init__(max(budget, LEAST_SECONDS), POINTS_SHARE)
        self.left -= POINTS_SHARE * min(FIXED_SECONDS, budget)
        self.limit = Budget(budget)
        self.searches = 0  # for rare branches, so far

    @property
    def of_point(self) -> float:
        """Core-seconds that the next point may take."""
        return min(POINT_SHARE * self.budget, self.left)

    @property
    def timings(self) -> int:
        """How often what is timed is repeated."""
        return max(1, min(TIMINGS, int(self.budget / SECONDS_OF_A_TIMING)))

    @property
    def remaining(self) -> float:
        """Seconds after which a run is ended that takes longer than was counted."""
        return max(min(BUSY * self.budget, self.limit.remaining), LEAST_SECONDS)

    def allow_search(self) -> bool:
        """Charge a search for rare branches; the first one is part of `FIXED_SECONDS`."""
        allowed = self.searches == 0 or self.left >= BRANCHES_SECONDS
        if allowed and self.searches > 0:
            self.left -= BRANCHES_SECONDS
        self.searches += allowed
        return allowed

    def scale(self, what: str, share: float, paths: int, work: float, runs: int) -> int:
        """Paths of each of some runs, which all together are expected to take so much work; 0 where
        there is no room for the runs themselves."""
        room = share * self.budget - runs * RUN_SECONDS
        if room <= 0.0:
            self.reduced.append(f"no {what}")
            return 0
        points = self.left
        number = self.fit(f"paths for {what}", paths, FEWEST_SHARED, work / paths, room)
        self.left = points
        return number


def _measure_point(
    model: CostModel, accuracy: float, allowance: Allowance, asked: Callable[..., Ensemble]
) -> tuple[CostPoint, Ensemble | None]:
    """The point of a scheme at an accuracy, with its run if it was measured."""
    budget = allowance.of_point
    point = model.at(accuracy)
    # as a run to that accuracy would go on
    if point.work > budget and not model.bias and allowance.allow_search():
        begin = partial(begin_rare, model.best, FEWEST_PATHS, in_threads(1))
        model.best = sample_branches(PilotRun.of(model.best), accuracy, begin).run
        point = model.at(accuracy)
    if point.work > budget:  # counted, so that no clock decides which rows are measured
        return point, None
    with warnings.catch_warnings():
        # a run that misses it is replaced by the model
        warnings.simplefilter("ignore", AccuracyWarning)
        run, seconds = time_run(
            partial(asked, accuracy=accuracy, scheme=model.scheme, budget=allowance.remaining)
        )
    allowance.left -= point.work
    model.learn(run)
    reach = run.reach
    assert reach is not None
    if not reach.reached:
        return model.at(accuracy), None
    measured = point._replace(
        dt=run.dt,
        paths=run.paths,
        core_seconds=seconds,
        sampling_error=reach.sampling,
        step_error=reach.step,
        error=reach.bound,
        work=model.work(run, run.paths, run.dt),
        measured=True,
    )
    return measured, run


def _moments(scene: Scene) -> list[str]:
    """Columns of every section mean and sd of a scene."""
    return [prefix + q for q in section_names(scene.stages) for prefix in ("", "sd_")]


def _in_sds(table: pd.DataFrame, reference: Ensemble, prefix: str = "") -> Floats:
    """What a table holds of each section mean and sd, in units of the sds of a simulation, shape
    (rows, impacts)."""
    unit = units(reference)
    names = _moments(reference.scene)
    return np.array([table[prefix + name] / unit[name.removeprefix("sd_")] for name in names])


def _errors(section: pd.DataFrame, reference: Ensemble) -> Floats:
    """Distances of section means and sds from those of a simulation, in its sds, shape (rows,
    impacts)."""
    aligned = section.reindex(reference.section.index)
    return np.abs(_in_sds(aligned - reference.section, reference))


def closure_points(
    scene: Scene, impacts: int, reference: Ensemble, timings: int = TIMINGS
) -> Iterator[CostPoint]:
    """Worst and median error of every closure that can be applied to the scene, and its time."""
    closures = closures_for(scene)
    z = widest(len(_moments(scene)) * impacts * len(closures))
    half = z * _in_sds(reference.section, reference, "se_")
    for closure in closures:
        predict = partial(mean_map, scene, closure=closure)
        prediction, seconds = _least(
            partial(predict, impacts=1), partial(predict, impacts=impacts), timings
        )
        error = _errors(prediction.section, reference)
        seen = np.isfinite(error)
        error = error[seen]
        noise = half[seen]
        worst = error.argmax()
        resolved = error[worst] > noise[worst]
        yield CostPoint(
            closure,
            "closure",
            accuracy=math.nan,
            dt=math.nan,
            paths=0,
            core_seconds=seconds,
            sampling_error=noise[worst],
            step_error=0.0,
            error=error[worst] if resolved else (error + noise).max(),
            measured=True,
            median_error=np.median(error),
            resolved=resolved,
            rows=error.size,
            work=closure_seconds(prediction),
        )


def _compare(
    point: CostPoint, run: Ensemble | None, model: CostModel, reference: Ensemble
) -> list[CostPoint]:
    """A point with its actual error; if it missed its accuracy, followed by the point extrapolated
    from the model."""
    if run is None or run.paths >= reference.paths:
        return [point]
    actual = np.nanmax(_errors(run.section, reference))
    point = point._replace(actual_error=actual)
    if actual <= point.accuracy * (1.0 + math.sqrt(run.paths / reference.paths)):
        return [point]
    return [
        point._replace(missed=True, error=actual),
        model.at(point.accuracy)._replace(rows=point.rows),
    ]


def bound_of_means(standard_error: float, scene: Scene, impacts: int) -> float:
    """What with 95 % probability none of the section means is off by more than, from their largest
    standard error."""
    return widest(len(_moments(scene)) // 2 * impacts) * standard_error


def multilevel_points(
    levels: dict[str, Levels], accuracies: Sequence[float], scene: Scene, impacts: int
) -> Iterator[CostPoint]:
    """Cost of the cheapest multilevel estimator of the means for each Euler scheme, from the
    analysis of its levels."""
    for (scheme, differences), a in product(levels.items(), accuracies):
        e = differences.estimate(a)
        error = bound_of_means(a, scene, impacts) + a
        dt = differences.table["dt"].iloc[0] / 2.0**e.last
        yield CostPoint(
            f"multilevel {scheme}", "multilevel", a, dt, 0, e.seconds, a, a, error, False
        )


def means_seconds(
    model: CostModel, accuracy: float, *, control: bool, typical: bool = False
) -> float:
    """Nominal core-seconds of the counted work of exact flights for the section means alone.

    `control`: Whether by the standard errors of the run, with the control variate or with paths
    near rare branches.
    """
    section = model.best.section
    quantities = section_names(model.best.scene.stages)
    error = section[["sd_" + q for q in quantities]].to_numpy()
    if control:
        paths = section["paths"].to_numpy(float)[:, None]
        error = section[["se_" + q for q in quantities]].to_numpy() * np.sqrt(paths)
    share = error / units(model.best).to_numpy()
    one = float(np.nanmedian(share) if typical else np.nanmax(share))
    return (one / accuracy) ** 2 * cost_of(model.first, 1).core_seconds


def slope(points: pd.DataFrame, method: str, measured: bool) -> tuple[float, int]:
    """Exponent with which the cost of a method grows with the accuracy, fitted to the logarithms.

    Points so rough that the minimal number of paths determines their cost are left out.
    """
    rows = points.query("method == @method and paths > @FEWEST_PATHS and not missed")
    if measured:
        rows = rows.query("measured")
    if len(rows) < 2:
        return math.nan, len(rows)
    power, _ = np.polyfit(np.log(rows["accuracy"]), np.log(rows["core_seconds"]), 1)
    return power, len(rows)


def _measure_schemes(
    scene: Scene,
    schemes: Sequence[str],
    impacts: int,
    accuracies: Sequence[float],
    allowance: Allowance,
    seed: int,
    workers: int,
) -> tuple[dict[str, CostModel], dict[str, list[tuple[CostPoint, Ensemble | None]]]]:
    """The cost model of each scheme, and its point at each accuracy with its run; exact flights
    come first."""
    again, asked = (
        partial(run, scene, impacts=impacts, rng=seed, workers=workers)
        for run in (simulate, simulate_to)
    )
    models: dict[str, CostModel] = {}
    runs: dict[str, list[tuple[CostPoint, Ensemble | None]]] = {scheme: [] for scheme in schemes}
    exact = schemes[0]
    with ProgressBar(label="accuracy", total=len(schemes) * len(accuracies), unit="point") as bar:
        for scheme in schemes:
            model = models[scheme] = CostModel.from_pilots(scene, scheme, again, allowance.timings)
            shared = [models[exact].first, *(run for _, run in runs[exact] if run)]
            # what paths near rare branches need says nothing of schemes that have none
            plain = (run for run in shared if run.plan.mixture is None)
            model.shared = max(plain, key=attrgetter("paths"))
            for accuracy in accuracies:
                bar.set_postfix_str(f"{scheme}, {accuracy:g}")
                runs[scheme].append(_measure_point(model, accuracy, allowance, asked))
                bar.update()
    return models, runs


def measure(
    base: Scene,
    *,
    impacts: int,
    accuracies: Sequence[float],
    budget: float,
    seed: int,
    workers: int,
    orders: bool,
) -> Tradeoff:
    """Measure the cost of every scheme and closure at several accuracies.

    The cost of multilevel estimators is estimated from runs at halved steps.  Closures are compared
    with the run of exact flights that has most paths.

    `budget`: Core-seconds of counted work of all: points that do not fit are extrapolated, and the
    other tables rest on fewer paths. `orders`: Whether to measure the weak orders of the schemes
    too, at the noise of the scene and of the paper.
    """
    scene = base.phase_reduced  # so that a late start loses no digits of the times
    allowance = Allowance(budget)
    exact, *euler = sorted(SCHEMES, key=lambda name: SCHEMES[name].has_step_bias)
    models, runs = _measure_schemes(
        scene, (exact, *euler), impacts, accuracies, allowance, seed, workers
    )
    reference = models[exact].best
    firsts = {scheme: model.first for scheme, model in models.items()}
    steps = {scheme: level_steps(scene, scheme) for scheme in euler}
    work = sum(cost_of(firsts[s], LEVEL_PATHS, dt).core_seconds for s in euler for dt in steps[s])
    number = allowance.scale("the levels", LEVELS_SHARE, LEVEL_PATHS, work, 0)
    run_levels = partial(
        measure_levels, scene, impacts=impacts, seed=seed, workers=workers, paths=number
    )
    levels = {scheme: run_levels(scheme) for scheme in euler}
    points = []
    for scheme in SCHEMES:
        for point, run in runs[scheme]:
            point = point._replace(rows=len(_moments(scene)) * impacts)
            points += _compare(point, run, models[scheme], reference)
    points += multilevel_points(levels, accuracies, scene, impacts)
    points += closure_points(scene, impacts, reference, allowance.timings)
    noises = () if base.correlation_time else MEASURED_SIGMAS
    timed = len(noises) * (1 + 2 * allowance.timings)  # runs of the table
    work = timed * cost_of(firsts[exact], LEVEL_PATHS).core_seconds
    number = allowance.scale("the control variate", CONTROL_SHARE, LEVEL_PATHS, work, 0)
    control = control_table(
        base,
        impacts=impacts,
        seed=seed,
        workers=workers,
        sigmas=noises,
        paths=number,
        timings=allowance.timings,
    )
    measured = None
    if orders:
        measured = _measure_orders(base, firsts, euler, allowance, seed, workers)
    return Tradeoff(
        pd.DataFrame(points, columns=CostPoint._fields),
        accuracies,
        {name: models[name] for name in SCHEMES},
        levels,
        reference,
        control,
        measured,
        allowance.describe(),
    )


def _measure_orders(
    base: Scene,
    firsts: dict[str, Ensemble],
    euler: Sequence[str],
    allowance: Allowance,
    seed: int,
    workers: int,
) -> WeakOrders | None:
    """The weak orders at the scene's own noise and the paper's, from as many paths as fit."""
    sigmas = sorted({base.sigma, base.alpha**0.5})
    paths = ORDER_PATHS * REPLICATES * len(sigmas)
    runs = [(firsts[scheme], 0.5 * step) for scheme in euler for step in STEP_PAIRS]
    work = sum(cost_of(run, paths, dt).core_seconds / run.impacts for run, dt in runs)
    number = allowance.scale(
        "weak orders", ORDERS_SHARE, ORDER_PATHS, ORDER_IMPACTS * work, REPLICATES * len(runs)
    )
    return orders_over(base, sigmas, paths=number, rng=seed, workers=workers) if number else None
