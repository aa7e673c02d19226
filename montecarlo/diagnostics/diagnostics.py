"""Diagnostics of a run: sentences that say where its numbers may be wrong, and what to do about
it."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from rattle.montecarlo.diagnostics.accuracy import error_bound
from rattle.montecarlo.schemes.step_size import SCHEMES, usual_step
from rattle.montecarlo.schemes.step_state import MOST_IN_A_STEP
from rattle.montecarlo.settings import DEFAULT_STEPS, is_random, noise_free_path
from rattle.montecarlo.statistics.section_statistics import SectionColumns, ratio_or_zero
from rattle.scene import Floats, Scene, section_names

UNSEEN_ERROR = 0.1
"""Largest error from branches that were not sampled, in sds, that is not diagnosed."""
UNSEARCHED = (
    "Rare branches are searched for with white noise only: whether this sample misses one is not"
    " known."
)
SEARCHED = 60  # most impacts for which rare branches are looked for: a second
BIAS_TOLERANCE = 0.05
"""Largest bias that is not diagnosed, in `motion_units`."""

SMALLEST_UNIT = 0.01  # an error unit is at least this share of the scale of the motion
# dt over the step of the comparison; for order 1, dt against dt / 4 shows 3/4 of the bias: times
# 4/3
STEP_RATIO = 4
WITHOUT_BIAS = "exact-flight, which has no such bias"
COLLAPSE = math.exp(-math.pi / math.sqrt(3.0))
"""Restitution below which white noise makes impacts accumulate: inelastic collapse (Cornell, Swift,
Bray 1998)."""


def motion_units(columns: SectionColumns, scene: Scene) -> dict[str, Floats]:
    """Unit of each section quantity's errors: its sd, or 1 % of flight time, half gap or speed
    where that is more.

    Shapes: result (impacts,).
    """
    flight = np.abs(columns["flight"])
    fastest = 0.0
    scale = {"tau": flight, "flight": flight}
    for i, wheel in enumerate(scene.tree, 1):
        speed = np.hypot(columns[f"y{i}"], columns[f"sd_y{i}"])
        fastest = np.nanmax(speed, initial=fastest)
        scale[f"x{i}"] = np.full_like(flight, wheel.gap)
    for i in range(1, scene.stages + 1):
        scale[f"y{i}"] = np.full_like(flight, fastest)
    return {q: np.fmax(columns["sd_" + q], SMALLEST_UNIT * size) for q, size in scale.items()}


def orbit_shift(run: Any) -> tuple[float, str]:
    """How far the step shifts the noise-free path, in `motion_units` of the run, and where most.

    The noise-free path is followed at dt and at dt / 4, as long as at least half of the paths share
    its itinerary.  A scheme that detects impacts at the end of a step is late by half a step on
    average, at every impact.
    """
    plan = run.plan
    unit = motion_units(run.columns, run.scene)
    coarse, fine = (noise_free_path(plan, plan.scheme, plan.dt / n) for n in (1, STEP_RATIO))
    shared = np.logical_and.accumulate(run.columns["agreement"] >= 0.5)
    parted = shared & (coarse[:, -1] != fine[:, -1])
    if parted.any():
        return math.inf, f"the mesh of impact {int(parted.argmax()) + 1}"
    quantities = section_names(run.scene.stages)
    shifts = np.zeros((plan.impacts, 1 + len(quantities)))
    if SCHEMES[plan.scheme].detects_at_end:
        late = 0.5 * plan.dt * np.arange(1, plan.impacts + 1)
        shifts[:, 0] = np.nan_to_num(ratio_or_zero(late, unit["tau"]))
    units = np.column_stack([unit[q] for q in quantities])
    shift = ratio_or_zero(abs(coarse - fine)[:, :-1], units) * STEP_RATIO / (STEP_RATIO - 1)
    shifts[shared, 1:] = np.nan_to_num(shift[shared])
    if not shifts.any():
        return 0.0, "nothing moves"
    worst, column = np.unravel_index(shifts.argmax(), shifts.shape)
    return float(shifts.max()), f"{('tau', *quantities)[column]} at impact {worst + 1}"


def diagnose(run: Any) -> tuple[str, ...]:
    """What may be wrong with the numbers of a run."""
    accuracy, *impacts = _list_counted(run)
    step = diagnose_short_step(run), *_of_step(run)
    return tuple(filter(None, (accuracy, *step, *impacts, diagnose_rare_branch(run))))


def list_counted(run: Any) -> tuple[str, ...]:
    """Those diagnostics that take no computation: what the run itself has counted."""
    return tuple(filter(None, _list_counted(run)))


def diagnose_rare_branch(run: Any) -> str:
    """The diagnostic of a rare branch that may be missing from the sample.

    Returns: Empty if no such branch matters, and where an accuracy was asked for, which counts
    them.
    """
    if run.reach is not None or run.plan.impacts > SEARCHED:
        return ""
    if run.scene.correlation_time and run.scene.sigma:
        return UNSEARCHED
    bound = error_bound(run)
    if bound.error - bound.sampled <= UNSEEN_ERROR or not bound.remark:
        return ""
    return f"{bound.remark[0].upper()}{bound.remark[1:]} ({bound.rare})."


def diagnose_short_step(run: Any) -> str:
    """The diagnostic of a step that is shorter than the scheme's default because the scene requires
    it."""
    allowed, why = usual_step(run.scene, run.plan.scheme, run.plan.levels > 1)
    usual = SCHEMES[run.plan.scheme].step
    if not run.plan.dt == allowed < usual:
        return ""
    return f"dt = {allowed:.3g} in place of the scheme's {usual:.3g}: {why}."


def _of_step(run: Any) -> Iterator[str]:
    scene = run.scene
    scheme = run.plan.scheme
    if not SCHEMES[scheme].has_step_bias:
        return
    if run.plan.levels > 1:
        yield _of_measured_bias(run)
        return
    limit, why = SCHEMES[scheme].trusted_step(scene)
    if run.plan.dt > limit:
        remedy = (
            f"dt = {limit:.2g} would do" if limit * DEFAULT_STEPS > 1.0 else f"take {WITHOUT_BIAS}"
        )
        bias = f"{BIAS_TOLERANCE:.0%} of an sd"
        yield f"The step may bias moments by more than {bias}: {why}; {remedy}."
    shift, where = orbit_shift(run)
    if shift > BIAS_TOLERANCE:
        by = f"{shift:.2g} sd" if is_random(scene) else f"{SMALLEST_UNIT * shift:.2%}"
        yield (
            f"The step moves the noise-free path by {by} ({where}):"
            f" shorten it, or take {WITHOUT_BIAS}."
        )


def _of_measured_bias(run: Any) -> str:
    """The largest measured step bias, where it is more than `BIAS_TOLERANCE` and its own error."""
    unit = motion_units(run.columns, run.scene)
    steps = run.step_bias
    scale = np.array(
        [unit[q][k - 1] for k, q in zip(steps["impact"], steps["quantity"], strict=True)]
    )
    bias = steps["bias"].abs().to_numpy(float)
    error = np.nan_to_num(steps["se_bias"].to_numpy(float))
    shares = np.where(bias > 3.0 * error, ratio_or_zero(np.nan_to_num(bias), scale), 0.0)
    share = float(shares.max())
    worst = steps.iloc[int(shares.argmax())]
    if share <= BIAS_TOLERANCE:
        return ""
    where = f"{worst['moment']} of {worst['quantity']} at impact {worst['impact']}"
    return (
        f"The step biases the {where} by {share:.2g} sd, as measured (columns bias_...; the moments"
        f" are not corrected): shorten the step, or take {WITHOUT_BIAS}."
    )


def _list_counted(run: Any) -> Iterator[str]:
    """First what an accuracy is missed by, or nothing."""
    scene = run.scene
    plan = run.plan
    yield "" if run.reach is None or run.reach.reached else run.reach.sentence
    if scene.sigma > 0.0 and scene.constants.wheels["epsilon"].min() < COLLAPSE:
        yield (
            f"Noise at a restitution below {COLLAPSE:.3f} lets impacts accumulate without end: the"
            " later an impact, the more its number depends on the step."
        )
    # else the path has had all its impacts by then
    if run.sticking_steps and (plan.impacts > MOST_IN_A_STEP or plan.fixed_steps.size):
        yield (
            f"In {run.sticking_steps:,} path-steps a mesh stayed closed to the end of the step:"
            " completed chatter, or a sticking phase."
        )
    if run.unfinished:
        yield (
            f"{run.unfinished:,} of {run.paths:,} paths did not finish before the time limit, "
            f"{plan.most_steps * plan.dt:.3g} after the start; the moments are those of the others."
        )
