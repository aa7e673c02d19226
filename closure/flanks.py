"""Random backlash as columns of the section state: ``(tau, x1, y1, x2, y2)`` and the deviations of +1, -1, +2, -2.

Flank ``side`` of a mesh stands at ``side (g + c)``, c its column.  A closure that carries Gaussians gives c the mean
and the variance of its law: what the law's shape does beyond that is left out.
"""

from typing import NamedTuple

import numpy as np

from closure.orbit import Floats
from scene.compiled import jit
from scene.scene import Constants, Scene

__all__ = ["PLAIN", "Flanks", "between", "column", "flanks_of", "renew"]

PLAIN = 5  # quantities of the section state where no flank varies
NARROWEST = 0.01  # of a nominal half gap: the tail of a Gaussian never closes it


class Flanks(NamedTuple):
    """How flanks vary.

    Attributes
    ----------
    start : ndarray, shape (d, d)
        Covariance of the section state after the start; d is 5 where no flank varies, else 9.
    variance : ndarray, shape (4,)
        Of the deviations of +1, -1, +2, -2.
    redrawn : bool
        Whether the deviation opposite to an impact is drawn anew.
    """

    start: Floats
    variance: Floats
    redrawn: bool


def flanks_of(scene: Scene) -> Flanks:
    """How the flanks of a scene vary.

    Examples
    --------
    >>> from scene import DAT21, Scene, Tolerance
    >>> flanks = flanks_of(Scene.from_gears(DAT21, tolerance=Tolerance(0.03, 0.06)))
    >>> flanks.variance.round(6).tolist(), flanks.start.shape
    ([0.0003, 0.0003, 0.0012, 0.0012], (9, 9))
    """
    tolerance = scene.tolerance
    if tolerance is None or tolerance.law == "fixed":
        return Flanks(np.zeros((PLAIN, PLAIN)), np.zeros(4), False)
    variance = np.repeat(tolerance.variances, 2)
    if scene.stages == 1:
        variance[2:] = 0.0
    per_path = tolerance.draw == "path"
    flanks = np.diag(variance)
    if per_path:  # both flanks of a mesh have one deviation
        flanks[[0, 1], [1, 0]], flanks[[2, 3], [3, 2]] = variance[0], variance[2]
    placed = np.zeros((9, 4))
    placed[5:] = np.eye(4)
    for row, x, gap, flank in ((1, scene.start.x1, scene.gap1, 0), (3, scene.start.x2, scene.gap2, 2)):
        if abs(x) == gap:  # the start lies on each path's own flank
            placed[row, flank + (0 if x > 0.0 else 1)] = np.sign(x)
    return Flanks(placed @ flanks @ placed.T, variance, not per_path)


@jit
def column(mesh: int, side: int) -> int:
    """Place of a flank's deviation in the section state.

    Examples
    --------
    >>> [column(mesh, side) for mesh in (1, 2) for side in (1, -1)]
    [5, 6, 7, 8]
    """
    return 3 + 2 * mesh + (0 if side > 0 else 1)


@jit
def between(c: Constants, e: Floats) -> tuple[Constants, float, float]:
    """The scene between flanks of its own, shape (9,): its half gaps, and where the middles of the gaps are.

    Examples
    --------
    >>> from scene import DAT21, Scene
    >>> e = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.03, 0.01, 0.0, 0.0])
    >>> c, middle1, middle2 = between(Scene.from_gears(DAT21).constants, e)
    >>> round(c.wall1, 12), round(middle1, 12), middle2
    (0.52, 0.01, 0.0)
    """
    wall1 = max(c.wall1 + 0.5 * (e[5] + e[6]), NARROWEST * c.wall1)
    wall2 = max(c.wall2 + 0.5 * (e[7] + e[8]), NARROWEST * c.wall2)
    own = Constants(
        c.alpha, c.epsilon, c.beta1, c.beta2, c.gamma1, c.gamma2, c.mu, wall1, wall2, c.sigma, c.stages
    )  # fmt: skip
    return own, 0.5 * (e[5] - e[6]), 0.5 * (e[7] - e[8])


@jit
def renew(flank: int, variance: float, mean: Floats, covariance: Floats) -> None:
    """Draw a flank anew: whatever was known of the deviation in column `flank` is forgotten.

    Examples
    --------
    >>> mean, covariance = np.full(9, 0.1), np.ones((9, 9))
    >>> renew(6, 4.0, mean, covariance)
    >>> mean[6], covariance[6, 5:].tolist(), covariance[5, 5:].tolist()
    (0.0, [0.0, 4.0, 0.0, 0.0], [1.0, 0.0, 1.0, 1.0])
    """
    mean[flank] = 0.0
    for i in range(mean.size):
        covariance[flank, i] = covariance[i, flank] = 0.0
    covariance[flank, flank] = variance
