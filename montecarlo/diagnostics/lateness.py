"""How far impacts that are detected at the end of a step put a path off, where noise does not
smooth it.

Such an impact is late by anything from nothing to a step.  Where impact times spread over several
steps the mean of that is smooth in the step, and extrapolation sees it.  Where they spread less,
all paths are detected at the same few ends of steps: the bias is a saw-tooth of the step, which no
three step sizes tell from a small one.
"""

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
    late = np.zeros((plan.impacts, 2 + 2 * plan.scene.stages))
    if not SCHEMES[plan.scheme].detects_at_end:
        return late
    # an impact keeps what those before it were late by
    rough = np.minimum.accumulate(sd_tau) < SMOOTH_SPREAD * COARSEST * plan.dt
    if not rough.any():
        return late
    exact = exact_orbit(plan)
    for share in STEPS_TRIED:
        path = noise_free_path(plan, plan.scheme, share * plan.dt)
        differs = np.logical_or.accumulate(path[:, -1] != exact[:, -1])
        error = np.abs(path - exact)[:, :-1]
        error[differs] = np.inf
        late[rough] = np.maximum(late, error)[rough]
    return late
