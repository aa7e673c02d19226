"""The bias that the step gives to section means and sds, in units of each quantity's sd.

It is measured from dt, 2 dt and 4 dt on the same Brownian paths, or, where nothing is random, against the exact orbit.
Of exact flights it is the noise that a step leaves out.
"""

import numpy as np

from rattle.montecarlo.diagnostics.accuracy import units_by_quantity
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.kernel.neglected_noise import neglected_noise
from rattle.montecarlo.schemes.table import SCHEMES
from rattle.montecarlo.settings.plan import exact_orbit, is_random
from rattle.scene.moments import SECTION

NO_SUCH_IMPACT = 1e3  # error of a path that has an impact more, or less, than it should


def step_error(run: Ensemble) -> tuple[float, float]:
    """Largest step bias of the section means and sds, in units of each quantity's sd, over the impacts that occurred.

    Where nothing is random the exact orbit is known, and the bias is the difference from it: extrapolation cannot see
    that a step strikes another mesh.
    """
    if not SCHEMES[run.scheme].has_step_bias:
        return neglected_noise(run.scene, run.dt), 0.0
    if not is_random(run.scene):
        return _distance_from_orbit(run), 0.0
    unit, bias = units_by_quantity(run), run.step_bias
    scale = np.array([unit[q][k - 1] for k, q in zip(bias["impact"], bias["quantity"], strict=True)])
    share = (bias["bias"].abs() / scale).fillna(0.0)
    worst = int(share.to_numpy().argmax())
    return float(share.iloc[worst]), float(np.nan_to_num(bias["se_bias"].iloc[worst] / scale[worst]))


def _distance_from_orbit(run: Ensemble) -> float:
    """Largest difference of a path without noise from the exact orbit; `NO_SUCH_IMPACT` where one of them has ended."""
    exact, unit = exact_orbit(run.plan), units_by_quantity(run)
    struck, columns = exact[:, 6] != 0.0, run.phase_reduced.columns
    if not (struck == (columns["mesh"] != 0)).all():
        return NO_SUCH_IMPACT
    exact[:, 0] = run.scene.phase_reduced.to_absolute_time(exact[:, 0])
    of = SECTION if run.scene.stages == 2 else SECTION[:4]
    errors = [np.abs(columns[q] - exact[:, i])[struck] / unit[q][struck] for i, q in enumerate(of)]
    return float(np.max(errors, initial=0.0))
