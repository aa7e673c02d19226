"""What paths cost, and how many an accuracy takes: the one estimate that every command, page and
refusal states.

Work is counted - steps, impacts and sticking steps of paths - at the stated nanoseconds of each
scheme.  No clock is asked, so that what a cost decides is the same on every machine and in every
run.  Compiling is not counted.

The step's bias is measured from dt, 2 dt and 4 dt on the same Brownian paths, or, where nothing is
random, against the exact orbit; of exact flights it is the noise that a step leaves out.  Row by
row there is the bound of each section mean and sd by itself, and the dearest of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.diagnostics.accuracy import (
    BOUND_MOMENTS,
    FEWEST_PATHS,
    absolute_errors,
    count_paths,
    errors_by_row,
    explain_shift,
    find_exceedance,
    name_row,
    smallest_sd,
    unit_rows,
    unseen_shifts,
)
from rattle.montecarlo.diagnostics.reach import Candidate, Row
from rattle.montecarlo.diagnostics.unseen import Added, branches_between, find_unseen
from rattle.montecarlo.diagnostics.unseen_text import share_of
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.looks import USUAL_LOOKS, share_of_look
from rattle.montecarlo.schemes.step_size import SCHEMES, neglected_noise
from rattle.montecarlo.settings import count_followed, exact_orbit, is_random
from rattle.montecarlo.statistics.intervals import widest
from rattle.montecarlo.statistics.section_statistics import quantity_at, stack_section, undefined
from rattle.scene import Floats, duration_text

RATIO_STEP = 8.0  # largest ratio of two bounds that is followed at once
RATIO_FOUND = 1.02  # ratio to which the number is found
ENDLESS_PATHS = 1e15  # paths from which on the number does not matter any longer
VECTOR_GAIN = 32.0  # cost of a path-step of a single path over that in a full block of vector lanes
STICKING_NS = 110.0  # measured time of a path-step in which a mesh sticks
NO_SUCH_IMPACT = 1e3  # error of a path that has an impact more, or less, than it should
MOST_OF = 0.5  # share of a bound from which on one cause is named for it
STATED_SHARE = 0.9  # of the rows that are stated apart from the dearest
MOST_ROOT = 1e100  # square root of the largest number of paths
DEARER = 3.0  # times as many paths from which on the dearest row is named


class ExpectedPaths(NamedTuple):
    """Paths that an accuracy is expected to take."""

    paths: float  # number of paths
    # the rare branch for which most of them are needed, in words; empty if there is none
    branch: str


def expect_paths(
    run: Ensemble, accuracy: float, share: float = share_of_look(USUAL_LOOKS)
) -> ExpectedPaths:
    """Paths from which on `error_bound` is expected to be within an accuracy.

    Errors of what was sampled fall with the square root of the number of paths.  A branch that the
    run cannot have seen but that more paths will see adds to the variance and, by its fourth power,
    to the error of the sd; one that they cannot see either shifts the bound.

    `accuracy`: Bound that is wanted for sampling and unseen branches, in units of each quantity's
    sd.
    """
    columns = run.columns
    drawn = (run.plan.mixture, run.dt)
    begun = count_paths(columns)
    error = absolute_errors(columns)
    if not (error > 0.0).any():
        return ExpectedPaths(float(begun), "")
    unit = unit_rows(run)
    least = find_exceedance(error / unit, 0.0 * error, share)
    plain = begun * min(least / max(accuracy, 5e-324), 1e100) ** 2

    sd = np.nan_to_num(stack_section(columns, "sd_"))
    varies = np.array(list(smallest_sd(columns).values()))

    def bound(paths: float) -> tuple[float, Added]:
        added = branches_between(run.scene, columns, begun, int(paths), *drawn)
        wider = np.sqrt(sd**2 + added.square.T)
        # displacements at a struck wall, and what does not vary
        size = np.where(unit == sd, wider, unit)
        with undefined():
            shrunk = np.nan_to_num(sd / wider, nan=1.0)
            new = np.where(wider > varies, added.fourth.T / (4.0 * wider**2), 0.0)
        mean = np.sqrt((error[0] ** 2 * begun + added.noise.T) / paths)
        spread = np.sqrt(((error[1] * shrunk) ** 2 * begun + new) / paths)
        shift = unseen_shifts(find_unseen(run.scene, columns, int(paths), *drawn))
        return find_exceedance(np.stack([mean, spread]) / size, shift / size, share), added

    fewer = paths = max(plain, 1.0)
    while (found := bound(paths))[0] > RATIO_FOUND * accuracy and paths < ENDLESS_PATHS:
        fewer = paths
        paths = paths * min(found[0] / accuracy, RATIO_STEP) ** 2
    while (
        paths > RATIO_FOUND * fewer
    ):  # branches come into reach at once: the bound is not a power of the paths
        middle = math.sqrt(paths * fewer)
        if bound(middle)[0] > RATIO_FOUND * accuracy:
            fewer = middle
        else:
            paths = middle
    added = bound(paths)[1]
    if paths <= 1.5 * plain:
        return ExpectedPaths(paths, "")
    if not added.probabilities.size:
        return ExpectedPaths(paths, "branches that are not known")
    return ExpectedPaths(
        paths, f"a rare branch ({share_of(float(added.probabilities.min()))} paths)"
    )


def cost_of(run: Ensemble, paths: int, dt: float | None = None) -> Candidate:
    """Work of a number of paths like those of a run, at its step or another one."""
    kind = SCHEMES[run.scheme]
    # times are those of two wheels, and taken for one; with each more a step takes a third more,
    # the covariances of an impact grow faster (`rattle check speed`)
    longer = max((1.0 + run.scene.stages) / 3.0, 1.0)
    dt = run.dt if dt is None else dt
    finer = run.dt / dt
    followed = run.plan.paths
    steps = run.path_steps / followed * finer  # over all step sizes run side by side
    levels = 3.0 if run.plan.levels > 1 else 1.0
    each = (
        steps * kind.step_ns * longer * (VECTOR_GAIN if followed == 1 else 1.0)
        + run.impacts * kind.impact_ns * longer**1.5 * levels
    )
    each += run.sticking_steps / followed * finer * STICKING_NS * longer
    branches = 0 if run.plan.mixture is None else len(run.plan.mixture.unit)
    return Candidate(run.scheme, dt, paths, paths * steps, 1e-9 * paths * each, branches)


def cost_to(run: Ensemble, accuracy: float) -> Candidate:
    """Step, paths and work that `rattle.montecarlo.simulate_to` is expected to need with the scheme
    of a run.

    Where the run has a step bias, half of the accuracy is left to it: order 1 is asymptotic.
    """
    biased = SCHEMES[run.scheme].has_step_bias
    dt = run.dt
    bias = step_error(run)[0] if biased else 0.0
    if biased:
        dt *= min(1.0, max(0.5 * accuracy / max(bias, 1e-300), 1e-100))
    paths = count_to(run, 0.5 * accuracy if bias else accuracy)
    return cost_of(run, count_followed(run.scene, paths), dt)


def count_to(run: Ensemble, accuracy: float) -> int:
    """Paths, in whole blocks, that an accuracy is expected to take; at least `FEWEST_PATHS`."""
    wanted = max(expect_paths(run, accuracy).paths, FEWEST_PATHS)
    return math.ceil(wanted / BLOCK) * BLOCK


def step_error(run: Ensemble) -> tuple[float, float]:
    """Largest step bias of the section means and sds, in units of each quantity's sd, over the
    impacts that occurred.

    Where nothing is random the exact orbit is known, and the bias is the difference from it:
    extrapolation cannot see that a step strikes another mesh.
    """
    if not SCHEMES[run.scheme].has_step_bias:
        return neglected_noise(run.scene, run.dt), 0.0
    if not is_random(run.scene):
        return _distance_from_orbit(run), 0.0
    bias, error = _biases(run)
    return float(bias.max()), float(error.flat[bias.argmax()])


def _distance_from_orbit(run: Ensemble) -> float:
    """Largest difference of a path without noise from the exact orbit; `NO_SUCH_IMPACT` where one
    of them has ended."""
    exact = exact_orbit(run.plan)
    struck = exact[:, -1] != 0.0
    columns = run.phase_reduced.columns
    if not (struck == (columns["mesh"] != 0)).all():
        return NO_SUCH_IMPACT
    exact[:, 0] = run.scene.phase_reduced.to_absolute_time(exact[:, 0])
    errors = np.abs(stack_section(columns) - exact[:, :-1].T) / unit_rows(run)
    return float(np.max(errors[:, struck], initial=0.0))


def find_missed_rows(run: Ensemble, accuracy: float, share: float) -> tuple[Row, ...]:
    """The section means and sds whose own bound is above an accuracy, the worst first.

    `share`: Probability of a wrong statement on all rows together; each has an equal part of it
    (Bonferroni).
    """
    if not is_random(run.scene):
        return ()
    error, shift, hidden = errors_by_row(run)
    bias, _ = _biases(run)
    bound = shift + bias + _z(error, share) * error
    missed = []
    for place in zip(*np.nonzero(bound > accuracy), strict=True):
        why = "too few paths"
        if shift[place] > MOST_OF * bound[place]:
            why = explain_shift(hidden, shift, place)
        elif bias[place] > MOST_OF * bound[place]:
            why = "bias of the step"
        moment, i, k = place
        quantity = quantity_at(int(i))
        missed.append(Row(BOUND_MOMENTS[moment], quantity, int(k) + 1, float(bound[place]), why))
    return tuple(sorted(missed, key=lambda row: -row.bound))


def name_dearest_row(run: Ensemble, accuracy: float, share: float) -> str:
    """Which row takes most of the paths of an accuracy, and what the others take; empty where all
    are alike."""
    error, shift, hidden = errors_by_row(run)
    varies = error > 0.0
    if not varies.any():
        return ""
    with np.errstate(over="ignore"):
        paths = (
            count_paths(run.columns)
            * np.minimum(_z(error, share) * error / accuracy, MOST_ROOT) ** 2
        )
    branch = np.broadcast_to(hidden.needed.T, error.shape)
    paths = np.where(shift > MOST_OF * accuracy, np.maximum(paths, branch), paths)
    dearest = np.unravel_index(np.argmax(np.where(varies, paths, 0.0)), paths.shape)
    with np.errstate(invalid="ignore"):  # between rows that no number of paths settles
        most = float(np.quantile(paths[varies], STATED_SHARE))
    if not paths[dearest] > DEARER * most:
        return ""
    seconds = duration_text(cost_of(run, max(math.ceil(most), 1)).core_seconds)
    return f"the dearest is the {name_row(dearest)}; nine in ten of the others would take {seconds}"


def _z(error: Floats, share: float) -> float:
    return widest(int((error > 0.0).sum()), share)


def _biases(run: Ensemble) -> Floats:
    """Bias of the step of all rows and its standard error, in their units, shape (2, 2, quantities,
    impacts)."""
    steps = np.abs(run.step_bias[["bias", "se_bias"]].to_numpy().T)
    rows = np.nan_to_num(steps).reshape(2, len(BOUND_MOMENTS), -1, run.impacts)
    return np.asarray(rows / unit_rows(run))
