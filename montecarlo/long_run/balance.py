"""The energy balance of a long run (docs/model.md section 10): what impacts take is what noise and drive supply."""

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.long_run.result import LongRun
from rattle.montecarlo.long_run.sums import ENERGY

Floats = NDArray[np.float64]


def balance(run: LongRun) -> tuple[Floats, Floats]:
    """Energy lost in impacts, and energy supplied, per unit of time on each path.

    Returns: Their means agree within the standard error of the mean of their difference, as long as no mesh is
    closed. Shapes: result (paths,).

    Examples
    --------
    >>> from rattle.montecarlo.long_run.run import long_run
    >>> from rattle.scene import Scene
    >>> scene = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, sigma=1.0, stages=1)
    >>> lost, supplied = balance(long_run(scene, periods=64, paths=64))
    >>> float(supplied[0]), abs(float(lost.mean()) - 0.25) < 0.02
    (0.25, True)
    """
    c, (y1, v2, drive1, drive2) = run.scene.constants, run.averages.T
    lost = run.sums.main[:, :, ENERGY].sum(axis=1) / run.sums.time
    supplied = 0.25 * c.sigma**2 * (1.0 + c.beta1**2) - c.beta1 * y1 + c.alpha * drive1
    if c.stages == 2:
        mass = c.mu / (1.0 - c.mu)
        supplied += mass * (0.25 * c.sigma**2 * (1.0 + c.beta2**2) - c.beta2 * v2 - c.alpha * drive2)
    return lost, supplied
