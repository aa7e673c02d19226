"""Errors of a closure's section moments and of its correlations at mid-flight, with intervals and
verdicts."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from rattle.closure import MeanMap
from rattle.closure.closure import describe_error
from rattle.compare.validation.verdict import DECIDED, JUDGED, Tolerances, Verdict, at_wall, judge
from rattle.montecarlo import Ensemble
from rattle.montecarlo.diagnostics.accuracy import FEWEST_PATHS, skewness_gain, smallest_sd
from rattle.montecarlo.diagnostics.unseen import (
    Unseen,
    find_unseen,
    unseen,
    unseen_columns,
    unseen_text,
)
from rattle.montecarlo.ensemble.simulate_rare import begin_rare
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.schemes.step_size import SCHEMES
from rattle.montecarlo.settings import NOISE_FREE, is_random
from rattle.montecarlo.statistics.intervals import half_width
from rattle.scene import SECTION, Floats, Ints, Scene
from rattle.scene.elementary import each
from rattle.scene.moments import Realizability, realizability

WORTH_A_WORD = 0.05
"""Share of a tolerance from which on what a branch could change is told."""

FEWEST_FOR_SD = 32
"""Least number of paths from which an sd is judged: the fourth moment of fewer says too little
about its error."""

TOO_FEW_FOR_INTERVAL = f"too few paths for an interval; that of an sd needs {FEWEST_FOR_SD}"
"""Remark on a row whose interval the sample cannot have."""

ON_ITINERARY = "itinerary"
"""The kind of the rows on the paths that have followed a closure's itinerary so far."""

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

ABSOLUTE = 1e-6
"""Tolerance, relative to size, where nothing varies
(`rattle.montecarlo.diagnostics.accuracy.smallest_sd`)."""

BY_SIZE = f"sd is 0, or too small for doubles: compared with {ABSOLUTE:g} of the quantity's size"
"""Remark on the rows of such quantities."""


NEAR_BRANCHES = "decided by other paths, a part of them near rare branches"
"""Remark on rows of `decide_near_branches`."""

SPARE_PATHS = 2.0
"""How many times the paths that are expected to decide its rows `judge_again` takes: a branch
widens their errors."""


class Claimed(Protocol):
    """Section moments of a closure or of a user's own model, in the columns of
    `rattle.closure.MeanMap.section`."""

    @property
    def closure(self) -> str:
        """Its name; a run may have the agreement with its itinerary under this name."""

    @property
    def section(self) -> pd.DataFrame:
        """A row for each impact (index ``impact``); NaN where a moment is not predicted."""


class NamedSection(NamedTuple):
    """Section moments under a name, to be judged as those of a closure are."""

    closure: str
    section: pd.DataFrame


class Simulated(Protocol):
    """Section moments of a simulation: a `rattle.montecarlo.Ensemble`, or the tables stored of
    one."""

    @property
    def scene(self) -> Scene:
        """What was modelled."""

    @property
    def section(self) -> pd.DataFrame:
        """As `Ensemble.section`."""

    @property
    def step_bias(self) -> pd.DataFrame:
        """As `Ensemble.step_bias`."""

    @property
    def agreement(self) -> pd.DataFrame:
        """As `Ensemble.agreement`."""


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
    section = run.section
    steps = run.step_bias
    impact = steps["impact"]
    moment = steps["quantity"].where(steps["moment"] == "mean", "sd_" + steps["quantity"])
    simulated = _simulated_rows(run, tolerances)
    parts = []
    for prediction in predictions:
        predicted = _pick(prediction.section, impact, moment)
        agreement = run.agreement.get(prediction.closure, section["agreement"])
        rows = simulated.assign(closure=prediction.closure, predicted=predicted)
        rows["error"] = predicted - steps["corrected"]
        rows["agreement"] = agreement.loc[impact].to_numpy()
        parts.append(rows)
    return pd.concat(parts, ignore_index=True)


def judge_errors(table: pd.DataFrame, z: float) -> pd.DataFrame:
    """Give each row of `list_errors` its interval of `z` standard errors, its verdict, and a remark
    where it has none."""
    rows = table.assign(noise=z * table["noise"])
    student = half_width(rows["paths"], float(ndtr(-z))) * table["noise"]
    half = student + rows["rest"]
    # Hall's correction, see `skewness_gain`
    lean = student * rows["lean"] * (2.0 * z**2 + 1.0) / (6.0 * z)
    rows["low"] = rows["error"] - half - lean.clip(lower=0.0) - rows["unseen_low"]
    rows["high"] = rows["error"] + half - lean.clip(upper=0.0) + rows["unseen_high"]
    rows = judge(rows)
    rows["remark"] = rows["remark"].where(rows["remark"] != "", remarks(rows))
    return rows


def _simulated_rows(run: Simulated, tolerances: Tolerances) -> pd.DataFrame:
    """The rows of `list_errors` without a prediction."""
    section = run.section
    steps = run.step_bias
    impact = steps["impact"]
    quantity = steps["quantity"]
    is_mean = steps["moment"] == "mean"
    name = quantity.where(is_mean, "sd_" + quantity)
    sd = steps[~is_mean].set_index(["impact", "quantity"])
    own = sd.loc[pd.MultiIndex.from_arrays([impact, quantity])].reset_index(drop=True)
    unit = own["corrected"].where(own["corrected"] > 0.0, _pick(section, impact, "sd_" + quantity))
    sizes = {
        q: float(np.hypot(section[q], section["sd_" + q]).max())
        for q in quantity.unique()
        if q != "tau"
    }
    size = quantity.map(sizes | {"tau": sizes["flight"]}).astype(float).fillna(0.0)
    columns = {str(name): section[name].to_numpy() for name in section}
    few = (
        ~is_mean & is_random(run.scene) & (section["paths"].loc[impact].to_numpy() < FEWEST_FOR_SD)
    )
    least = pd.DataFrame(smallest_sd(columns), index=section.index)
    still = np.where(unit > _pick(least, impact, quantity), 0.0, ABSOLUTE * size)
    up, down, needed, chance = _shift_unseen(
        unseen(run.scene, columns, int(section["paths"].max())), steps
    )
    return pd.DataFrame(
        {
            "closure": "",
            "kind": "section",
            "impact": impact,
            "quantity": quantity,
            "moment": steps["moment"],
            "predicted": np.nan,
            "simulated": _pick(section, impact, name),
            "se": _pick(section, impact, "se_" + name),
            "bias": steps["bias"],
            "error": np.nan,
            "noise": steps["se_corrected"].where(~few),
            "rest": steps["rest"],
            "unit": unit,
            "se_unit": own["se_corrected"],
            "tolerance": np.maximum(
                np.where(is_mean, tolerances.mean, tolerances.sd) * unit, still
            ),
            "still": still,
            "judged": ~at_wall(quantity, section["mesh"].loc[impact].to_numpy()),
            "agreement": np.nan,
            "paths": section["paths"].loc[impact].to_numpy(),
            "lean": find_lean(columns, steps),
            "unseen_low": up,
            "unseen_high": down,
            "unseen_share": chance,
            "unseen_paths": np.where(few, np.fmax(needed, FEWEST_FOR_SD), needed),
            "remark": "",
        }
    )


def itinerary_errors(
    prediction: MeanMap, run: Ensemble, z: float, tolerances: Tolerances
) -> pd.DataFrame:
    """`section_errors` of the paths alone that have followed the closure's itinerary up to each
    impact.

    Returns: Rows as of `section_errors`, of kind ``itinerary``.  They are excluded where fewer
    than `HALF_OF_PATHS` of the paths follow it, and their remark says so.
    """
    name = prediction.closure
    on = followers_of(run, name)
    own = np.array(run.plan.itineraries[name])
    return judge_errors(follower_errors(prediction.on_itinerary(), on, tolerances, own, own), z)


def followers_of(run: Ensemble, name: str = NOISE_FREE) -> Ensemble:
    """`Ensemble.on_itinerary`, with what it cannot have seen."""
    on = run.on_itinerary(name)
    itinerary = run.plan.itineraries[name]
    hidden = find_unseen(run.scene, on.columns, run.paths, run.plan.mixture, run.dt, itinerary)
    return replace(on, unseen=unseen_columns(hidden))


def follower_errors(
    prediction: Claimed, on: Simulated, tolerances: Tolerances, own: Floats, followed: Floats
) -> pd.DataFrame:
    """The rows of `itinerary_errors` before they are judged, of moments on an itinerary.

    `own`, `followed`: ``mesh * side`` of the closure and of the paths apart, 0 where it has ended;
    (impacts,).
    """
    table = list_errors([prediction], on, tolerances).assign(kind=ON_ITINERARY)
    at = table["impact"] - 1
    other = np.logical_or.accumulate((own != followed) & (own != 0))
    few = (table["agreement"] < HALF_OF_PATHS) | other[at]
    table["judged"] &= ~few | table["predicted"].isna()
    why = np.select([own[at] == 0, other[at]], [NO_ITINERARY, OTHER_ITINERARY], TOO_FEW_FOLLOW)
    table["remark"] = np.where(few, why, "")
    return table


def remarks(table: pd.DataFrame) -> NDArray[Any]:
    """What decides a row besides its sd, in words: the size of what does not vary, and what the
    sample has not seen."""
    shift = np.maximum(table["unseen_low"], table["unseen_high"])
    by_size = (table["still"] > 0.0) & table["verdict"].isin(JUDGED)
    few = table["low"].isna() & (table["verdict"] == Verdict.UNDECIDED)
    said = waits_for_branch(table)
    out = np.select([few, by_size], [TOO_FEW_FOR_INTERVAL, BY_SIZE], "").astype(object)
    columns = table["moment"], table["unseen_share"], shift / table["unit"], table["unseen_paths"]
    out[said] = list(map(unseen_text, *(column[said] for column in columns)))
    return out


def waits_for_branch(table: pd.DataFrame) -> "pd.Series[bool]":
    """Whether a row is undecided for a rare branch that the sample cannot have seen."""
    shift = np.maximum(table["unseen_low"], table["unseen_high"])
    open_row = (table["verdict"] == Verdict.UNDECIDED) & table["low"].notna()
    return open_row & (shift > WORTH_A_WORD * table["tolerance"])


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


def find_lean(columns: Mapping[str, NDArray[Any]], steps: pd.DataFrame) -> Floats:
    """Skewness of what is averaged in each row of a table over sqrt(n), as `skewness_gain` has it.

    Shapes: result (rows,).
    """
    gains = np.array(
        [[skewness_gain(columns, q, of_sd, 1.0) for q in SECTION] for of_sd in (False, True)]
    )
    at = _number(steps["quantity"]), steps["impact"].to_numpy() - 1
    # of z = 1 the gain is lean (2 + 1) / 6
    return np.asarray(2.0 * gains[(steps["moment"] == "sd").to_numpy(int), *at])


def _shift_unseen(hidden: Unseen, steps: pd.DataFrame) -> tuple[Floats, ...]:
    """Shifts up and down, paths that would tell and probability of the branch, of the rows of a
    table."""
    at = steps["impact"].to_numpy() - 1, _number(steps["quantity"])
    mean = (steps["moment"] == "mean").to_numpy()
    up = np.where(mean, hidden.mean_up[at], hidden.sd_up[at])
    down = np.where(mean, hidden.mean_down[at], hidden.sd_down[at])
    return up, down, hidden.needed[at], hidden.probability[at]


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


def _pick(table: pd.DataFrame, impact: pd.Series, column: pd.Series) -> Floats:
    """Entries of a table by row and column; NaN where it has none."""
    code, names = pd.factorize(column)
    values = table.reindex(index=range(1, int(impact.max()) + 1), columns=names).to_numpy(float)
    return np.asarray(values[impact.to_numpy() - 1, code])


def _number(quantity: pd.Series) -> NDArray[np.intp]:
    """Place of each quantity in `SECTION`."""
    return np.asarray(pd.Index(SECTION).get_indexer(pd.Index(quantity)))


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
    found = [
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
            found.append(
                (SIMULATED, int(impact), stage, *realizability(np.array([[xx, xy], [xy, yy]])))
            )
    table = pd.DataFrame(found, columns=["closure", "impact", "stage", *Realizability._fields])
    table = table.astype({"realizable": bool})
    known = table[["variance_x", "variance_y", "rho"]].notna().any(axis=1)
    return table.loc[known | ~table["realizable"], RHO_COLUMNS].reset_index(drop=True)


def first_failure(table: pd.DataFrame, closure: str) -> tuple[int, int, str] | None:
    """The first impact, and there the first stage, at which a closure's second moments are not
    realizable."""
    failed = table[(table["closure"] == closure) & ~table["realizable"]].sort_values(
        ["impact", "stage"]
    )
    rows = failed[["impact", "stage", "reason"]].itertuples(index=False, name=None)
    return next(rows, None)


def mid_flight_errors(
    prediction: MeanMap, run: Ensemble, flights: Ints, z: float, tolerances: Tolerances
) -> pd.DataFrame:
    """Errors of the correlation ``rho`` at the run's fixed times, in the middle of the orbit's
    flights.

    The interval of the simulated value is symmetric in Fisher's z = artanh rho, whose standard
    error is measured (for a Gaussian pair it is ``1 / sqrt(paths)``); it is widened by the change
    from 2 dt to dt where there is a step bias.

    Returns: Rows as of `rattle.compare.validation.errors`; ``time`` is the fixed time, ``impact``
    the one that ends its flight. Shapes: `flights` (fixed times,).
    """
    fixed = run.at_times()
    reached = fixed.index.to_numpy(float)
    predicted, remark = _at_times(prediction, reached[reached <= prediction.trace.span[1]])
    common: dict[str, Any] = {
        "closure": prediction.closure,
        "kind": "fixed time",
        "moment": "rho",
        "unit": 1.0,
    }
    common |= {
        "impact": flights,
        "time": fixed.index,
        "tolerance": tolerances.rho,
        "paths": run.paths,
    }
    common["agreement"] = run.agreement[prediction.closure].to_numpy()[flights - 1]
    parts = []
    for stage in range(1, run.scene.stages + 1):
        rho = fixed[f"rho{stage}"]
        fisher = each(math.atanh, rho.clip(-1.0 + 1e-15, 1.0 - 1e-15))
        half = half_width(run.paths, float(ndtr(-z))) * fixed[f"se_z_rho{stage}"]
        bias = fixed.get(f"coarse_rho{stage}", rho) - rho
        value = predicted[f"rho{stage}"].reindex(fixed.index)
        low = value - each(math.tanh, fisher + half) - bias.abs()
        high = value - each(math.tanh, fisher - half) + bias.abs()
        own: dict[str, Any] = {
            "quantity": f"rho{stage}",
            "predicted": value,
            "simulated": rho,
            "error": value - rho,
        }
        own |= {
            "se": fixed[f"se_rho{stage}"],
            "bias": bias,
            "rest": bias.abs(),
            "low": low,
            "high": high,
        }
        own |= {"noise": 0.5 * (high - low) - bias.abs()}
        own["remark"] = np.where(
            half.isna() & value.notna() & rho.notna(), TOO_FEW_FOR_INTERVAL, remark
        )
        parts.append(pd.DataFrame(common | own))
    return judge(pd.concat(parts, ignore_index=True))


def _at_times(prediction: MeanMap, times: Floats) -> tuple[pd.DataFrame, str]:
    """A closure's moments at fixed times, and what a function of one's own raised in place of
    them."""
    try:
        return prediction.at_times(times), ""
    except (Exception, SystemExit) as error:
        if not prediction.method.own:
            raise
        return pd.DataFrame(np.nan, index=times, columns=["rho1", "rho2"]), describe_error(error)
