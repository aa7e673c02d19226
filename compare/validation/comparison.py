"""What a validation and a sweep found, as data: range of validity of each closure, its cause, and
what it saves.

An accuracy is that of `rattle.montecarlo.simulate_to`: with 95 % probability no section mean or sd
is off by more. Work is counted at nominal costs (`rattle.montecarlo.accuracy.cost`,
`rattle.closure.mean_map`): no clock decides what is advised.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import pandas as pd

from rattle.closure import MeanMap
from rattle.closure.closure import RAISED
from rattle.closure.mean_map import closure_seconds, predict
from rattle.compare.judge.result import Verdicts
from rattle.compare.judge.rows import PREFIX
from rattle.compare.judge.verdict import (
    Tolerances,
    Verdict,
    is_accurate,
    is_inaccurate,
    unbroken,
    want,
)
from rattle.compare.report.texts import read_texts
from rattle.compare.validation.errors import ON_ITINERARY, first_failure
from rattle.montecarlo import Ensemble
from rattle.montecarlo.accuracy.cost import cost_of
from rattle.montecarlo.accuracy.pilots import PilotRun, sample_branches
from rattle.montecarlo.diagnostics.accuracy import FEWEST_PATHS
from rattle.montecarlo.diagnostics.reach import Candidate
from rattle.montecarlo.ensemble.leaving import ENOUGH_EXITS, expect_leaving, interval
from rattle.montecarlo.ensemble.simulate_rare import begin_rare
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.settings import NOISE_FREE, begins, is_random
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import Scene
from rattle.scene.numpy_errors import numpy_defaults


@numpy_defaults
@dataclass(frozen=True)
class Comparison(Verdicts):
    """The fields of a `Validation`, where they are explained."""

    scene: Scene
    predictions: dict[str, MeanMap]
    run: Ensemble
    table: pd.DataFrame
    correlation: pd.DataFrame
    z: float
    tolerances: Tolerances
    second_look: Ensemble | None = None

    def section_rows(self, closure: str, kind: str = "section") -> pd.DataFrame:
        """The rows of ``table`` on the section moments of a closure."""
        return self.table[(self.table["closure"] == closure) & (self.table["kind"] == kind)]

    @property
    def meshes(self) -> range:
        """The numbers of the wheels, each with its mesh, from 1 on."""
        return range(1, self.scene.stages + 1)

    @property
    def of_all_paths(self) -> pd.DataFrame:
        """The rows of ``table`` that are about all paths."""
        return self.table[self.table["kind"] != ON_ITINERARY]

    @property
    def closure_names(self) -> list[str]:
        """The closures in their order."""
        return list(self.predictions)

    @property
    def failed(self) -> dict[str, str]:
        """Closures of one's own that raised an exception, and what it said."""
        rows = self.table[self.table["remark"].str.startswith(RAISED)]
        return dict(zip(rows["closure"], rows["remark"], strict=True))

    @cached_property
    def validity(self) -> "dict[str, Validity]":
        """Range of validity of each closure."""
        return {closure: find_validity(self, closure) for closure in self.predictions}

    @cached_property
    def near_branches(self) -> Ensemble | None:
        """Paths by the simulation's scheme of which a part is drawn near the rare branches that
        matter, if any does."""
        return self.second_look or begin_rare(self.run, FEWEST_PATHS, in_threads(1))

    def foresee(self, accuracy: float) -> PilotRun:
        """What `rattle.montecarlo.simulate_to` is expected to take by the simulation's scheme."""
        return sample_branches(PilotRun.of(self.run), accuracy, lambda: self.near_branches)

    def leaving(self, closure: str) -> tuple[float, float, float]:
        """Probability of having left a closure's itinerary by its last impact, with a 95 %
        interval."""
        run = self.run
        itinerary = run.plan.itineraries[closure]
        impacts = int(np.count_nonzero(itinerary))
        if impacts == 0:  # nothing to follow
            return 1.0, 1.0, 1.0
        if not is_random(run.scene):
            return 0.0, 0.0, 0.0
        noise_free = begins(itinerary, run.plan.itineraries[NOISE_FREE])
        if not noise_free or run.paths * expect_leaving(run, impacts) >= ENOUGH_EXITS:
            left = run.paths * (1.0 - float(run.agreement[closure].loc[impacts]))
            low, high = interval(left, left, 1.0)
            return left / run.paths, low / run.paths, min(high / run.paths, 1.0)
        rows = run.leaving[run.leaving["impact"] <= impacts]
        if rows.empty:
            return 0.0, 0.0, interval(0.0, 0.0, 1.0 / run.paths)[1]
        # mean weight of a path
        weight = (rows["probability"] / rows["paths"]).fillna(1.0 / run.paths)
        total = float(rows["probability"].sum())
        low, high = interval(
            total, float((rows["probability"] * weight).sum()), float(weight.max())
        )
        return min(total, 1.0), low, min(high, 1.0)


class Sweep(NamedTuple):
    """Ranges of validity and speed-ups of all closures at all noise intensities."""

    validity: pd.DataFrame  # columns of `Validity`
    speed: pd.DataFrame  # columns of `Speed`
    simulation: pd.DataFrame  # from `simulation_costs`, a row for each noise intensity
    left_out: int = 0  # noise intensities for which the budget was too small
    all_work: float = 0.0  # core-seconds of counted work that all of them are expected to take


CAUSES: dict[str, str] = read_texts("validation")["causes"]
"""What limits the range of validity: key in the tables, and phrase."""

DIVERGED = 0.99  # agreement below which no closure along a single orbit can be accurate
# the same for saltation, else exact to first order: a few distant paths already change an sd
OFF_ITINERARY = 0.9999
# mean impact speed, in its sds, below which a Gaussian has a part of the paths miss the wall
# (grazing)
SLOW_SPEED = 3.0


class Validity(NamedTuple):
    """Range of validity of a closure at one noise intensity; which rows are judged is stated in
    `errors.RULE`."""

    closure: str
    sigma: float  # noise intensity
    accurate: int  # last impact up to which every section mean and sd that it predicts is accurate
    # last impact up to which none is inaccurate; beyond ``accurate`` some are undecided
    not_inaccurate: int
    cause: str  # what limits the range, a key of `CAUSES`
    why: str  # the evidence for the cause
    # last impact up to which 99 % of the paths have followed the closure's itinerary
    on_itinerary: int
    paths: int
    dt: float  # of the simulation
    # the same two for the moments of the paths on its itinerary, and the probability of having left
    # it by its last impact, with a 95 % interval
    itinerary_accurate: int = 0
    itinerary_not_inaccurate: int = 0
    leaving: float = math.nan
    leaving_low: float = math.nan
    leaving_high: float = math.nan


def find_validity(v: Comparison, closure: str) -> Validity:
    """Range of validity of one closure of a validation."""
    rows = rows_to_judge(v, closure)
    impacts = range(1, len(v.run.section) + 1)
    accurate, not_inaccurate = _reach(rows, impacts)
    on_itinerary = unbroken(impacts, v.run.agreement[closure] >= DIVERGED) or 0
    if accurate == len(impacts):
        cause = "holds"
        why = CAUSES["holds"]
    elif not_inaccurate == len(impacts):
        cause = "undecided"
        why = f"{want(rows)} from impact {accurate + 1} on"
    else:
        cause, why = _why(v, closure, not_inaccurate + 1)
    followers = rows_to_judge(v, closure, ON_ITINERARY)
    return Validity(
        closure,
        v.scene.sigma,
        accurate,
        not_inaccurate,
        cause,
        why,
        on_itinerary,
        v.run.paths,
        v.run.dt,
        *_reach(followers, impacts),
        *v.leaving(closure),
    )


def _reach(rows: pd.DataFrame, impacts: range) -> tuple[int, int]:
    """The last impacts up to which all rows are accurate, and none is inaccurate."""
    by_impact = rows.groupby("impact")["verdict"].agg(set)
    verdicts = [by_impact.get(impact, set()) for impact in impacts]
    accurate = unbroken(impacts, map(is_accurate, verdicts)) or 0
    return accurate, unbroken(
        impacts, [not is_inaccurate(at_impact) for at_impact in verdicts]
    ) or 0


def find_validities(validations: Sequence[Comparison]) -> pd.DataFrame:
    """Ranges of validity of all closures at all noise intensities."""
    return pd.DataFrame([validity for v in validations for validity in v.validity.values()])


def rows_to_judge(v: Comparison, closure: str, kind: str = "section") -> pd.DataFrame:
    """The section rows of a closure that are judged, see
    `rattle.compare.validation.errors.RULE`."""
    rows = v.section_rows(closure, kind)
    return rows[rows["verdict"] != Verdict.EXCLUDED]


def _why(v: Comparison, closure: str, impact: int) -> tuple[str, str]:
    """Why a closure is not accurate at an impact: cause and evidence; of several causes the first
    in this order."""
    prediction = v.predictions[closure]
    failed, _, reason = first_failure(v.correlation, closure) or (math.inf, 0, "")
    if failed <= impact:
        return "not realizable", f"not realizable at impact {failed}: {reason}"
    if prediction.trace.found < impact:
        return "ended", prediction.stopped
    worst = _worst(v, closure, impact)
    if prediction.trace.parts is not None:
        why = f"{worst}: {CAUSES['mixture']}"
        lost = prediction.section["discarded"].loc[impact]
        if lost >= 5e-4:
            why += f", and {lost:.1%} of the probability was discarded so far"
        return "mixture", why
    agreement = v.run.agreement[closure].loc[impact]
    limit = prediction.method.limit
    if agreement < (OFF_ITINERARY if limit == "second order" else DIVERGED):
        return "off itinerary", f"{worst}: {1.0 - agreement:.2%} of the {CAUSES['off itinerary']}"
    if slow := _slowest(prediction, impact):
        number, speed = slow
        why = f"impact {number} grazes (its mean speed is {speed:.1f} of its sds)"
        return "grazing", f"{worst}: {why}"
    return limit, f"{worst}{', at any noise' if limit == 'fixed time' else ''}: {CAUSES[limit]}"


def _worst(v: Comparison, closure: str, impact: int) -> str:
    rows = rows_to_judge(v, closure)
    rows = rows.query("impact == @impact and verdict == 'inaccurate'")
    if rows.empty:
        return f"nothing to compare at impact {impact}"
    row = rows.iloc[(rows["error"] / rows["tolerance"]).abs().argmax()]
    return f"{row['moment']} of {row['quantity']} wrong at impact {impact}"


def _slowest(prediction: MeanMap, impact: int) -> tuple[int, float] | None:
    """The first impact up to a given one whose mean speed is below `SLOW_SPEED` of its own sds, and
    that ratio."""
    numbers = range(1, impact + 1)
    column = np.where(prediction.trace.mesh[numbers] == 1, 1, 3)
    speed = np.abs(prediction.trace.mean[numbers, column])
    sd = prediction.trace.sd[numbers, column + 2]
    slow = np.flatnonzero((speed < SLOW_SPEED * sd) & (SLOW_SPEED * sd < np.inf))
    return (slow[0] + 1, speed[slow[0]] / sd[slow[0]]) if slow.size else None


WANTED = 0.01  # accuracy, in sds, for which the cost of a simulation is stated


class Speed(NamedTuple):
    """Nominal time of a closure and of a simulation of equal accuracy, both on one core."""

    closure: str
    sigma: float  # noise intensity
    impacts: int  # the impact up to which the closure is accurate; both sides are counted up to it
    # worst, median: worst and median error of the closure's section means and sds, in units of the
    # quantities' sds
    worst: float
    median: float
    # whether the interval of the worst error excludes zero; if not, the error may be smaller and
    # the speed-up larger
    resolved: bool
    # closure_seconds, simulation_seconds: nominal seconds on one core; that of a closure of one's
    # own is measured
    closure_seconds: float
    paths: int  # paths that bound all errors by the worst error of the closure
    simulation_seconds: float
    # ratio of the two times; NaN where one was measured: a clock must decide nothing
    speed_up: float


def paths_for(rows: pd.DataFrame, error: float) -> int:
    """Number of paths for which with 95 % probability no moment is off by more than `error`.

    `rows`: A row for each moment: ``unit``, the sd of its quantity, and ``se``, its standard error
    for a single path.
    """
    half = widest(len(rows)) * rows["se"]
    return math.ceil(round(float(((half / (error * rows["unit"])) ** 2).max()), 6))


def simulation_costs(validations: Sequence[Comparison]) -> pd.DataFrame:
    """What `rattle.montecarlo.simulate_to` takes to an accuracy of `WANTED` with the scheme of each
    validation."""
    return pd.DataFrame(
        {"sigma": v.scene.sigma, "impacts": v.run.impacts} | v.foresee(WANTED).at(WANTED)._asdict()
        for v in validations
    )


def measure_speeds(validations: Sequence[Comparison]) -> pd.DataFrame:
    """`measure_speed` of every closure of some validations that is accurate at the first impact."""
    speeds = [
        s for v in validations for closure in v.predictions if (s := measure_speed(v, closure))
    ]
    return pd.DataFrame(speeds, columns=Speed._fields)


def measure_speed(v: Comparison, closure: str) -> Speed | None:
    """Count the work of a closure up to the last impact at which it is accurate; None if there is
    none, or no sd."""
    reached = v.validity[closure].accurate
    prediction = v.predictions[closure]
    rows = rows_to_judge(v, closure)
    rows = rows.query("impact <= @reached and unit > 0.0 and verdict != 'not predicted'")
    if rows.empty:
        return None
    errors = rows["error"].abs() / rows["unit"]
    worst = float(errors.max())
    row = rows.iloc[errors.argmax()]
    own = prediction.method.own
    if own:  # again: its first call may have compiled something
        prediction = predict(v.scene, prediction.method, reached, prediction.order)
    costs = [_cost_of_rows(run, rows, worst) for run in (v.run, v.foresee(worst).run)]
    cheapest = min(costs, key=attrgetter("core_seconds"))
    seconds = closure_seconds(prediction, reached)
    cost = cheapest.core_seconds * reached / v.run.impacts
    return Speed(
        closure,
        v.scene.sigma,
        reached,
        worst,
        median=errors.median(),
        resolved=row["low"] > 0.0 or row["high"] < 0.0,
        closure_seconds=seconds,
        paths=cheapest.paths,
        simulation_seconds=cost,
        speed_up=math.nan if own else cost / seconds,
    )


def _cost_of_rows(run: Ensemble, rows: pd.DataFrame, error: float) -> Candidate:
    """Work of paths like those of a run with which none of some rows is off by more than
    `error`."""
    at = rows[["moment", "quantity", "impact"]].itertuples(index=False)
    se = [
        run.columns[f"se_{PREFIX[moment]}{quantity}"][impact - 1] for moment, quantity, impact in at
    ]
    return cost_of(run, paths_for(rows.assign(se=np.array(se) * math.sqrt(run.paths)), error))
