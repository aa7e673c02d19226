"""Errors of a closure's section moments and of its correlations at mid-flight, with intervals and
verdicts."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.special import ndtr

from rattle.closure import MeanMap
from rattle.closure.closure import describe_error
from rattle.compare.judge.rows import (
    BY_STEP,
    TOO_FEW_FOR_INTERVAL,
    Claimed,
    compare_rows,
    judge_errors,
    waits_for_branch,
)
from rattle.compare.judge.verdict import DECIDED, Tolerances, judge
from rattle.compare.report.texts import read_texts
from rattle.montecarlo import Ensemble
from rattle.montecarlo.diagnostics.accuracy import FEWEST_PATHS
from rattle.montecarlo.diagnostics.reference import Simulated, list_reference
from rattle.montecarlo.diagnostics.unseen import find_unseen, unseen_columns
from rattle.montecarlo.ensemble.simulate_rare import begin_rare
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.schemes.step_size import SCHEMES
from rattle.montecarlo.settings import NOISE_FREE
from rattle.montecarlo.statistics.intervals import half_width
from rattle.scene import Floats, Ints, Scene
from rattle.scene.elementary import each
from rattle.scene.moments import Realizability, realizability

RULE: str = read_texts("validation")["rule"]
"""Which rows `rattle.montecarlo.diagnostics.reference.at_wall` excludes, and why, as pages state
it."""

ON_ITINERARY = "itinerary"
"""The kind of the rows on the paths that have followed a closure's itinerary so far."""

LARGEST_DIFFERENCE = 2.0  # between two correlations
HALF_OF_PATHS = 0.5
"""Share of all paths that must follow an itinerary for these paths to be judged alone."""

TOO_FEW_FOLLOW = (
    "fewer than half of the paths follow this itinerary up to here: judged over all paths only"
)
"""Remark on the rows of the others."""

NO_ITINERARY = "the closure's itinerary ends before this impact: judged over all paths only"
"""Remark where there is none any more, as of an orbit at rest."""

OTHER_ITINERARY = (
    "the closure follows another itinerary than the noise-free path: judged over all paths only"
)
"""Remark where the paths apart are those of the noise-free itinerary, and the closure has left it.
"""

NEAR_BRANCHES = "decided by other paths, a part of them near rare branches"
"""Remark on rows of `decide_near_branches`."""

SPARE_PATHS = 2.0
"""How many times the paths that are expected to decide its rows `judge_again` takes: a branch
widens their errors."""


def section_errors(
    predictions: Sequence[Claimed], run: Simulated, z: float, tolerances: Tolerances
) -> pd.DataFrame:
    """Errors of predicted section moments with intervals and verdicts.

    Both sides are moments on the Poincaré section at the impacts: of the state of each path at its
    own k-th impact.

    Returns: A row for each prediction, impact, quantity and moment.  ``simulated`` is the simulated
    value with its standard error ``se`` and the measured step ``bias``.  ``error`` is the predicted
    minus the bias-corrected value; ``low`` and ``high`` bound it: ``noise`` is `z` standard errors
    of the corrected value (the interval has Student's t in place of `z`, which is wider where paths
    are few), ``rest`` bounds the bias that the correction may have left. ``unit`` is the sd of the
    quantity, ``se_unit`` its standard error. ``still`` is the tolerance of a quantity that does not
    vary, `ABSOLUTE` times its largest size over the impacts (for times, that of a flight), and 0
    where it varies. ``agreement`` is the share of paths on the closure's itinerary if the run has
    it, else on the noise-free one. ``judged`` is False for the rows that `RULE` excludes.
    ``unseen_low`` and ``unseen_high`` are how far branches that the sample cannot have seen widen
    the interval on either side, and ``unseen_paths`` how many paths would show them
    (`rattle.montecarlo.diagnostics.unseen`); ``remark`` says so in words where they leave a row
    undecided, and is `BY_SIZE` where ``still`` is the tolerance. The interval of a sampled value is
    longer on the side to which its own sampling distribution is skewed; ``lean`` is that skewness
    over sqrt(n). Verdicts are those of `judge`.
    """
    return judge_errors(list_errors(predictions, run, tolerances), z)


def list_errors(
    predictions: Sequence[Claimed], run: Simulated, tolerances: Tolerances
) -> pd.DataFrame:
    """The rows of `section_errors` before they are judged: ``noise`` is one standard error."""
    rows = compare_rows(predictions, list_reference(run), tolerances, "impact")
    for name, agreement in run.agreement.items():
        of_closure = rows["closure"] == name
        rows.loc[of_closure, "agreement"] = agreement.loc[rows.loc[of_closure, "impact"]].to_numpy()
    return rows


def itinerary_errors(
    predictions: Sequence[MeanMap], run: Ensemble, z: float, tolerances: Tolerances
) -> pd.DataFrame:
    """`section_errors` of the paths alone that have followed each closure's itinerary up to each
    impact; closures of one itinerary are compared with the same paths.

    Returns: Rows as of `section_errors`, of kind ``itinerary``.  They are excluded where fewer
    than `HALF_OF_PATHS` of the paths follow it, and their remark says so.
    """
    by_itinerary: dict[tuple[int, ...], list[MeanMap]] = {}
    for prediction in predictions:
        followed = run.plan.itineraries[prediction.closure]
        by_itinerary.setdefault(followed, []).append(prediction)
    parts = []
    for followed, those in by_itinerary.items():
        on = followers_of(run, those[0].closure)
        own = np.array(followed)
        followers = [prediction.on_itinerary() for prediction in those]
        parts.append(judge_errors(follower_errors(followers, on, tolerances, own, own), z))
    order = [prediction.closure for prediction in predictions]
    table = pd.concat(parts, ignore_index=True)
    return table.iloc[table["closure"].map(order.index).argsort(kind="stable")]


def followers_of(run: Ensemble, name: str = NOISE_FREE) -> Ensemble:
    """`Ensemble.on_itinerary`, with what it cannot have seen."""
    on = run.on_itinerary(name)
    itinerary = run.plan.itineraries[name]
    hidden = find_unseen(run.scene, on.columns, run.paths, run.plan.mixture, run.dt, itinerary)
    return replace(on, unseen=unseen_columns(hidden))


def follower_errors(
    predictions: Sequence[Claimed],
    on: Simulated,
    tolerances: Tolerances,
    own: Floats,
    followed: Floats,
) -> pd.DataFrame:
    """The rows of `itinerary_errors` before they are judged, of moments on an itinerary.

    `own`, `followed`: ``mesh * side`` of the closures and of the paths apart, 0 where it has ended;
    (impacts,).
    """
    table = list_errors(predictions, on, tolerances).assign(kind=ON_ITINERARY)
    at = table["impact"] - 1
    other = np.logical_or.accumulate((own != followed) & (own != 0))
    few = (table["agreement"] < HALF_OF_PATHS) | other[at]
    table["judged"] &= ~few | table["predicted"].isna()
    why = np.select([own[at] == 0, other[at]], [NO_ITINERARY, OTHER_ITINERARY], TOO_FEW_FOLLOW)
    table["remark"] = np.where(few, why, "")
    return table


def judge_again(
    table: pd.DataFrame,
    predictions: list[MeanMap],
    run: Ensemble,
    z: float,
    tolerances: Tolerances,
    workers: int,
) -> tuple[pd.DataFrame, Ensemble | None]:
    """A table of `section_errors`, its rows that wait for a rare branch decided by paths of which a
    part is near it.

    They are independent of the run, which only says how many are needed.  What they leave undecided
    stays as it was.

    Returns: The table, and the run of these paths, None where there is none.
    """
    rare = None

    def judge_near(waiting: pd.DataFrame) -> pd.DataFrame | None:
        nonlocal rare
        rare = begin_rare(run, _count_again(waiting, run.paths), in_threads(workers))
        return None if rare is None else section_errors(predictions, rare, z, tolerances)

    if not SCHEMES[run.scheme].has_step_bias:
        table = decide_near_branches(table, run.scene, judge_near)
    return table, rare


def _count_again(rows: pd.DataFrame, paths: int) -> int:
    """Paths that are expected to decide all rows that so many can decide; at least
    `FEWEST_PATHS`.
    """
    margin = (rows["tolerance"] - rows["error"].abs()).abs()
    needed = SPARE_PATHS * paths * ((rows["noise"] + rows["rest"]) / margin) ** 2
    most = float(needed.where(needed <= paths, 0.0).max())
    return max(math.ceil(most), FEWEST_PATHS)


def decide_near_branches(
    table: pd.DataFrame,
    scene: Scene,
    judge_near: Callable[[pd.DataFrame], pd.DataFrame | None],
    most: int = 0,
) -> pd.DataFrame:
    """A table, its rows that wait for a rare branch as other paths decide them, a part of which is
    near it.

    `judge_near`: The whole table from such paths, for the rows that wait; None where there are no
    such paths. `most`: Number of plain paths that are still to come; what they show is left to
    them.
    """
    waits = waits_for_branch(table) & ~(table["paths_needed"] <= most)
    if scene.correlation_time or not waits.any():
        return table
    again = judge_near(table[waits])
    if again is None:
        return table
    decided = waits & again["verdict"].isin(DECIDED)
    return table.where(~decided, again.assign(remark=NEAR_BRANCHES))


def to_absolute_time(table: pd.DataFrame, scene: Scene) -> pd.DataFrame:
    """Convert the times in a table of errors from phase-reduced (`Scene.phase_reduced`) to absolute
    time.

    Returns: Mean impact times and ``time`` are shifted; errors, intervals and verdicts are the same
    in both times.
    """
    late = (table["quantity"] == "tau") & (table["moment"] == "mean")
    sides = ("predicted", "simulated")
    columns = {
        name: np.where(late, scene.to_absolute_time(table[name].to_numpy(float)), table[name])
        for name in sides
    }
    if "time" in table:
        columns["time"] = scene.to_absolute_time(table["time"].to_numpy(float))
    return table.assign(**columns)


SIMULATED = "monte carlo"

RHO_COLUMNS = ["closure", "impact", "stage", *Realizability._fields[2:], "realizable", "reason"]


def judge_correlation(predictions: list[MeanMap], run: Ensemble, flights: Ints) -> pd.DataFrame:
    """Realizability of each stage's second moments.

    A closure is judged just before its impacts.  The simulation is judged at mid-flight before the
    same impacts, because at the mean impact time about half of the paths have already rebounded.

    Returns: A row for each closure (or ``monte carlo``), impact and stage: ``closure, impact,
    stage, variance_x, variance_y, rho, smallest_eigenvalue, realizable, reason``. Shapes: `flights`
    (fixed times,).
    """
    stages = range(1, run.scene.stages + 1)
    rows = [
        (prediction.closure, impact, stage, *prediction.stage_realizability(impact, stage))
        for prediction in predictions
        # a mixture describes paths at their own impacts: no perturbation, no moments
        if prediction.trace.parts is None
        for impact in range(1, prediction.trace.found + 1)
        for stage in stages
    ]
    for impact, (_, row) in zip(flights, run.at_times().iterrows(), strict=True):
        for stage in stages:
            xx, xy, yy = (row[f"cov_{a}{stage}_{b}{stage}"] for a, b in ("xx", "xy", "yy"))
            rows.append(
                (SIMULATED, int(impact), stage, *realizability(np.array([[xx, xy], [xy, yy]])))
            )
    table = pd.DataFrame(rows, columns=["closure", "impact", "stage", *Realizability._fields])
    table = table.astype({"realizable": bool})
    known = table[["variance_x", "variance_y", "rho"]].notna().any(axis=1)
    return table.loc[known | ~table["realizable"], RHO_COLUMNS].reset_index(drop=True)


def first_failure(table: pd.DataFrame, closure: str) -> tuple[int, int, str] | None:
    """The first impact, and there the first stage, at which a closure's second moments are not
    realizable."""
    failed = table.query("closure == @closure and not realizable")[["impact", "stage", "reason"]]
    rows = failed.sort_values(["impact", "stage"]).itertuples(index=False, name=None)
    return next(rows, None)


def mid_flight_errors(
    prediction: MeanMap, run: Ensemble, flights: Ints, z: float, tolerances: Tolerances
) -> pd.DataFrame:
    """Errors of the correlation ``rho`` at the run's fixed times, in the middle of the orbit's
    flights.

    The interval of the simulated value is symmetric in Fisher's z = artanh rho, whose standard
    error is measured (for a Gaussian pair it is ``1 / sqrt(paths)``); it is widened by the change
    from 2 dt to dt where there is a step bias, and covers everything after impacts that are
    detected late.

    Returns: Rows as of `rattle.compare.validation.errors`; ``time`` is the fixed time, ``impact``
    the one that ends its flight. Shapes: `flights` (fixed times,).
    """
    fixed = run.at_times()
    reached = fixed.index.to_numpy(float)
    predicted, remark = _at_times(prediction, reached[reached <= prediction.trace.span[1]])
    late = np.r_[False, run.lateness.any(axis=1)][flights - 1]  # at the start of each flight
    parts = []
    for stage in range(1, run.scene.stages + 1):
        rho = fixed[f"rho{stage}"]
        value = predicted[f"rho{stage}"].reindex(fixed.index)
        fisher = each(math.atanh, rho.clip(-1.0 + 1e-15, 1.0 - 1e-15))
        half = half_width(run.paths, float(ndtr(-z))) * fixed[f"se_z_rho{stage}"]
        bias = fixed.get(f"coarse_rho{stage}", rho) - rho
        rest = bias.abs().where(~late, LARGEST_DIFFERENCE)
        few = half.isna() & value.notna() & rho.notna()
        part = pd.DataFrame(
            {
                "time": fixed.index,
                "impact": flights,
                "agreement": run.agreement[prediction.closure].to_numpy()[flights - 1],
                "quantity": f"rho{stage}",
                "predicted": value,
                "simulated": rho,
                "error": value - rho,
                "se": fixed[f"se_rho{stage}"],
                "bias": bias,
                "rest": rest,
                "low": value - each(math.tanh, fisher + half) - rest,
                "high": value - each(math.tanh, fisher - half) + rest,
                "remark": np.select([few, late], [TOO_FEW_FOR_INTERVAL, BY_STEP], remark),
            }
        )
        parts.append(part.assign(noise=0.5 * (part["high"] - part["low"]) - rest))
    table = pd.concat(parts, ignore_index=True).assign(
        closure=prediction.closure,
        kind="fixed time",
        moment="rho",
        unit=1.0,
        tolerance=tolerances.rho,
        paths=run.paths,
    )
    return judge(table)


def _at_times(prediction: MeanMap, times: Floats) -> tuple[pd.DataFrame, str]:
    """A closure's moments at fixed times, and what a function of one's own raised in place of
    them."""
    try:
        return prediction.at_times(times), ""
    except (Exception, SystemExit) as error:
        if not prediction.method.own:
            raise
        rhos = [f"rho{i}" for i in range(1, prediction.scene.stages + 1)]
        return pd.DataFrame(np.nan, index=times, columns=rhos), describe_error(error)
