"""What paths cost, and how many an accuracy takes: the one estimate that every command, page and refusal states.

Work is counted - steps, impacts and sticking steps of paths - at the stated nanoseconds of each scheme.  No clock is
asked, so that what a cost decides is the same on every machine and in every run.  Compiling is not counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.accuracy.step_error import step_error
from rattle.montecarlo.diagnostics.accuracy import (
    LEAST,
    absolute_errors,
    count_paths,
    find_exceedance,
    share_of_look,
    smallest_sd,
    units_by_quantity,
    unseen_shifts,
)
from rattle.montecarlo.diagnostics.reach import Candidate
from rattle.montecarlo.diagnostics.unseen import Added, branches_between, find_unseen, share_of
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.schemes.table import SCHEMES
from rattle.montecarlo.settings.plan import count_followed
from rattle.scene.moments import SECTION
from rattle.scene.types import Floats

if TYPE_CHECKING:
    from rattle.montecarlo.ensemble.result import Ensemble


STEP = 8.0  # largest ratio of two bounds that is followed at once
TOUCH = 1.02  # ratio to which the number is found
MOST = 1e15  # paths from which on the number does not matter any longer
LOOKS = 2  # after which a run to an accuracy ends as a rule
VECTOR_GAIN = 32.0  # cost of a path-step of a single path over that in a full block of vector lanes
STICKING_NS = 110.0  # measured time of a path-step in which a mesh sticks


class ExpectedPaths(NamedTuple):
    """Paths that an accuracy is expected to take."""

    paths: float  # number of paths
    branch: str  # the rare branch for which most of them are needed, in words; empty if there is none


def expect_paths(run: Ensemble, accuracy: float, share: float) -> ExpectedPaths:
    """Paths from which on `error_bound` is expected to be within an accuracy.

    Errors of what was sampled fall with the square root of the number of paths.  A branch that the run cannot have seen
    but that more paths will see adds to the variance and, by its fourth power, to the error of the sd; one that they
    cannot see either shifts the bound.

    `accuracy`: Bound that is wanted for sampling and unseen branches, in units of each quantity's sd.
    """
    columns, drawn = run.columns, (run.plan.mixture, run.dt)
    begun, error = count_paths(columns), absolute_errors(columns)
    if not (error > 0.0).any():
        return ExpectedPaths(float(begun), "")
    unit = np.array(list(units_by_quantity(run).values()))
    least = find_exceedance(error / unit, 0.0 * error, share)
    plain = begun * min(least / max(accuracy, 5e-324), 1e100) ** 2

    def bound(paths: float) -> tuple[float, Added]:
        added = branches_between(run.scene, columns, begun, int(paths), *drawn)
        errors, sizes = _foreseen(columns, unit, error, added, begun, paths)
        shift = unseen_shifts(find_unseen(run.scene, columns, int(paths), *drawn))
        return find_exceedance(errors / sizes, shift / sizes, share), added

    fewer = paths = max(plain, 1.0)
    while (found := bound(paths))[0] > TOUCH * accuracy and paths < MOST:
        fewer, paths = paths, paths * min(found[0] / accuracy, STEP) ** 2
    while paths > TOUCH * fewer:  # branches come into reach at once: the bound is not a power of the paths
        middle = math.sqrt(paths * fewer)
        if bound(middle)[0] > TOUCH * accuracy:
            fewer = middle
        else:
            paths = middle
    added = bound(paths)[1]
    if paths <= 1.5 * plain:
        return ExpectedPaths(paths, "")
    if not added.probabilities.size:
        return ExpectedPaths(paths, "branches that are not known")
    return ExpectedPaths(paths, f"a rare branch ({share_of(float(added.probabilities.min()))} paths)")


def _foreseen(
    columns: Mapping[str, NDArray[Any]], unit: Floats, error: Floats, added: Added, begun: int, paths: float
) -> tuple[Floats, Floats]:
    """Errors of `paths` paths, as `absolute_errors`, and the units in which they count."""
    sd = np.nan_to_num([columns["sd_" + q] for q in SECTION])
    wider = np.sqrt(sd**2 + added.square.T)
    varies = np.array(list(smallest_sd(columns).values()))
    size = np.where(unit == sd, wider, unit)  # displacements at a struck wall, and what does not vary
    with np.errstate(divide="ignore", invalid="ignore"):
        shrunk = np.nan_to_num(sd / wider, nan=1.0)
        new = np.where(wider > varies, added.fourth.T / (4.0 * wider**2), 0.0)
    mean = np.sqrt((error[0] ** 2 * begun + added.noise.T) / paths)
    spread = np.sqrt(((error[1] * shrunk) ** 2 * begun + new) / paths)
    return np.stack([mean, spread]), size


def cost_of(run: Ensemble, paths: int, dt: float | None = None) -> Candidate:
    """Work of a number of paths like those of a run, at its step or another one."""
    kind, dt = SCHEMES[run.scheme], run.dt if dt is None else dt
    finer, followed = run.dt / dt, run.plan.paths
    steps = run.path_steps / followed * finer  # over all step sizes run side by side
    levels = 3.0 if run.plan.levels > 1 else 1.0
    each = steps * kind.step_ns * (VECTOR_GAIN if followed == 1 else 1.0) + run.impacts * kind.impact_ns * levels
    each += run.sticking_steps / followed * finer * STICKING_NS
    branches = 0 if run.plan.mixture is None else len(run.plan.mixture.unit)
    return Candidate(run.scheme, dt, paths, paths * steps, 1e-9 * paths * each, branches)


def cost_to(run: Ensemble, accuracy: float) -> Candidate:
    """Step, paths and work that `rattle.montecarlo.simulate_to` is expected to need with the scheme of a run.

    Where the run has a step bias, half of the accuracy is left to it: order 1 is asymptotic.
    """
    biased, dt = SCHEMES[run.scheme].has_step_bias, run.dt
    bias = step_error(run)[0] if biased else 0.0
    if biased:
        dt *= min(1.0, max(0.5 * accuracy / max(bias, 1e-300), 1e-100))
    wanted = expect_paths(run, 0.5 * accuracy if bias else accuracy, share_of_look(LOOKS)).paths
    paths = max(LEAST // BLOCK, math.ceil(wanted / BLOCK)) * BLOCK
    return cost_of(run, count_followed(run.scene, paths), dt)
