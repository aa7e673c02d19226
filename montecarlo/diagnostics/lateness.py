"""How far the step puts the impacts of a path off, where noise does not smooth it.

An impact that is detected at the end of a step is late by anything from nothing to a step.  Where
impact times spread over several steps the mean of that is smooth in the step, and extrapolation
sees it.  Where they spread less, all paths are detected at the same few ends of steps: the bias is
a saw-tooth of the step, which no three step sizes tell from a small one.
"""

import numpy as np

from rattle.montecarlo.kernel.block import Plan
from rattle.montecarlo.schemes.step_size import COARSEST, SCHEMES
from rattle.montecarlo.settings import exact_orbit, noise_free_path
from rattle.scene import Bools, Floats

# sd of impact times, in steps, above which lateness is smooth: a normal distribution of this sd
# leaves exp(-2 pi^2 / 4), less than 1 % of the saw-tooth
SMOOTH_SPREAD = 0.5
# steps that are tried, as shares of the given one: their ends have little in common, so that the
# largest error of a path without noise is about that of the worst step
STEPS_TRIED = tuple(1.0 / (1.0 + 0.037 * n) for n in range(8))


def find_lateness(plan: Plan, sd_tau: Floats) -> Floats:
    """Bound of what late detection does to the section quantities of each impact; 0 where it is
    smooth.

    It is the largest difference of paths without noise from the exact orbit, infinite where one
    strikes another flank.

    Shapes: `sd_tau` (impacts,); result (impacts, quantities).
    """
    late = np.zeros((plan.impacts, 2 + 2 * plan.scene.stages))
    rough = _is_rough(plan, sd_tau)
    if not SCHEMES[plan.scheme].detects_at_end or not rough.any():
        return late
    exact = exact_orbit(plan)
    for share in STEPS_TRIED:
        late[rough] = np.maximum(late, np.abs(_noise_free_error(plan, share, exact)))[rough]
    return late


def find_kinks(plan: Plan, sd_tau: Floats) -> Floats:
    """Error of the path without noise at the step of a plan, where noise does not smooth what the
    step does to it; NaN elsewhere.

    A scheme that locates its impacts has flights that end within a step.  The error of that last
    part is another one at each step size, and of a flight of few steps it is so much of the whole
    that extrapolation may miss it.

    Shapes: `sd_tau` (impacts,); result (impacts, quantities).
    """
    rough = _is_rough(plan, sd_tau)
    scheme = SCHEMES[plan.scheme]
    error = np.full((plan.impacts, 2 + 2 * plan.scene.stages), np.nan)
    if scheme.has_step_bias and not scheme.detects_at_end and rough.any():
        error[rough] = _noise_free_error(plan, 1.0, exact_orbit(plan))[rough]
    return error


def _is_rough(plan: Plan, sd_tau: Floats) -> Bools:
    """Whether the times of each impact spread over less than the steps: an impact keeps what those
    before it were off by."""
    return np.minimum.accumulate(sd_tau) < SMOOTH_SPREAD * COARSEST * plan.dt


def _noise_free_error(plan: Plan, share: float, exact: Floats) -> Floats:
    """What a path without noise, at a share of the step of a plan, is off the exact orbit; infinite
    from where it strikes another flank."""
    path = noise_free_path(plan, plan.scheme, share * plan.dt)
    error = (path - exact)[:, :-1]
    error[np.logical_or.accumulate(path[:, -1] != exact[:, -1])] = np.inf
    return error
