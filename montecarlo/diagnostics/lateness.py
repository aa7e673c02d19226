"""How far the step puts the impacts of a path off, where noise does not smooth it.

An impact that is detected at the end of a step is late by anything from nothing to a step.  Where
impact times spread over several steps the mean of that is smooth in the step, and extrapolation
sees it.  Where they spread less, all paths are detected at the same few ends of steps: the bias is
a saw-tooth of the step, which no three step sizes tell from a small one.
"""

from collections.abc import Sequence

import numpy as np

from rattle.montecarlo.kernel.block import Plan
from rattle.montecarlo.schemes.step_size import COARSEST, SCHEMES
from rattle.montecarlo.settings import exact_orbit, noise_free_path
from rattle.scene import Floats

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
    late = SCHEMES[plan.scheme].detects_at_end
    errors = _find_errors(plan, sd_tau, STEPS_TRIED if late else ())
    return np.asarray(np.fmax.reduce(np.abs(errors), initial=0.0))


def find_kinks(plan: Plan, sd_tau: Floats) -> Floats:
    """Error of the path without noise at the step of a plan, where noise does not smooth what the
    step does to it; NaN elsewhere.

    A scheme that locates its impacts has flights that end within a step.  The error of that last
    part is another one at each step size, and of a flight of few steps it is so much of the whole
    that extrapolation may miss it.

    Shapes: `sd_tau` (impacts,); result (impacts, quantities).
    """
    scheme = SCHEMES[plan.scheme]
    located = scheme.has_step_bias and not scheme.detects_at_end
    errors = _find_errors(plan, sd_tau, (1.0,) if located else ())
    return np.asarray(np.fmax.reduce(errors, initial=np.nan))


def _find_errors(plan: Plan, sd_tau: Floats, shares: Sequence[float]) -> Floats:
    """What paths without noise, at shares of the step of a plan, are off the exact orbit: infinite
    from where one strikes another flank, NaN where noise smooths it.

    Times of an impact that spread over less than the steps are not smooth, and it keeps what those
    before it were off by.  Shapes: result (shares, impacts, quantities).
    """
    errors = np.full((len(shares), plan.impacts, 2 + 2 * plan.scene.stages), np.nan)
    rough = np.minimum.accumulate(sd_tau) < SMOOTH_SPREAD * COARSEST * plan.dt
    if not len(shares) or not rough.any():
        return errors
    exact = exact_orbit(plan)
    for error, share in zip(errors, shares, strict=True):
        path = noise_free_path(plan, plan.scheme, share * plan.dt)
        off = (path - exact)[:, :-1]
        off[np.logical_or.accumulate(path[:, -1] != exact[:, -1])] = np.inf
        error[rough] = off[rough]
    return errors
