"""The reference of a cell of the map: exact flights with a short step, or the orbit itself without noise."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.compare.validation.verdict import at_wall
from rattle.montecarlo import Ensemble, default_step, simulate
from rattle.montecarlo.diagnostics.diagnostics import motion_units
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Scene
from rattle.scene.impact import next_impact, struck
from rattle.scene.moments import SECTION

Floats = NDArray[np.float64]

IMPACTS = 4
FINER = 4.0  # the default step of exact flights over the step of the reference
MOST_KURTOSIS = 30.0  # excess kurtosis above which too few paths contribute to an sd for a reliable error
CROSSINGS = 40.0  # horizon of a path, in crossings of a half gap at the speed of the start


class Reference(NamedTuple):
    """Reference section moments of a cell."""

    columns: Mapping[str, NDArray[Any]]  # means, sds and their standard errors, as `Ensemble.columns`
    # units of the errors, see `rattle.montecarlo.diagnostics.diagnostics.motion_units`; NaN where none is judged
    unit: dict[str, Floats]
    late: float  # share of the paths that did not complete their impacts before the horizon

    @property
    def moments(self) -> int:
        """Number of means and sds that are judged."""
        return 2 * sum(int(np.isfinite(unit).sum()) for unit in self.unit.values())


def horizon_of(scene: Scene) -> float:
    """Compute the time after which a path is abandoned."""
    return CROSSINGS * scene.gap1 / abs(scene.start.y1)


def reference(scene: Scene, *, paths: int, seed: int, workers: int) -> Reference:
    """Compute the reference by exact flights at a quarter of their default step, or by root finding without noise.

    Not judged are the quantities that `rattle.compare.validation.verdict.RULE` leaves out, and those whose variance
    comes from less than about 3 % of the paths, for which standard errors are unreliable.
    """
    if scene.sigma == 0.0:
        columns: Mapping[str, NDArray[Any]] = _orbit(scene)
        late = 0.0
    else:
        run: Ensemble = simulate(
            scene,
            paths=paths,
            impacts=IMPACTS,
            scheme="exact-flight",
            sampling=Sampling(horizon=horizon_of(scene)),
            dt=default_step(scene, "exact-flight") / FINER,
            rng=seed,
            workers=workers,
        )
        columns, late = run.columns, run.unfinished / run.paths
    unit = motion_units(columns, scene)
    for q in SECTION:
        rare = np.nan_to_num(columns["kurt_" + q]) > MOST_KURTOSIS
        unit[q] = np.where(at_wall(q, columns["mesh"]) | rare | np.isnan(columns[q]), np.nan, unit[q])
    return Reference(columns, unit, late)


def _orbit(scene: Scene) -> dict[str, Floats]:
    """The noise-free path by root finding, in the columns of an ensemble."""
    c, tau = scene.constants, scene.start.tau
    x1, y1, x2, y2 = scene.start_state
    if scene.start.mesh:
        y1, y2 = struck(c, scene.start.mesh, y1, y2)
    rows = np.full((IMPACTS, len(SECTION) + 1), np.nan)
    for k in range(IMPACTS):
        t, mesh, _, x1, y1, x2, y2 = next_impact(c, tau, x1, y1, x2, y2, horizon_of(scene))
        if mesh <= 0:
            break
        tau += t
        rows[k] = tau, t, x1, y1, x2, y2, mesh
        y1, y2 = struck(c, mesh, y1, y2)
    columns = {q: rows[:, i] for i, q in enumerate(SECTION)} | {"mesh": rows[:, -1]}
    nothing = np.zeros(IMPACTS)
    return columns | {prefix + q: nothing for q in SECTION for prefix in ("sd_", "se_", "se_sd_", "kurt_")}
