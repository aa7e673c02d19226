"""The paper's closure with its algebra mended (MODEL sections 5, 6, 9).

The deterministic part is the event-driven orbit.  Linear flow, linear contact laws taken at the orbit's own
instants, and additive noise keep ``(xi_1, zeta_1, xi_2, zeta_2)`` exactly Gaussian: every cumulant beyond the
second starts at zero and is only ever mapped linearly.  So the covariance is all there is to carry, raw
moments of any order follow from it, and ``|rho| <= 1`` always.  The means are shifted by the window means
of Eqs. 20 and 21.
"""

import numpy as np

from closure.edgeworth import coefficients, window_means
from closure.orbit import Floats, Ints, follow
from closure.raw_moments import stage_raw_moments
from closure.trace import Trace
from scene.compiled import jit
from scene.flight import jacobian, noise_covariance
from scene.impact import contact_matrix
from scene.scene import Constants, Scene

__all__ = ["trace"]


@jit
def window_shift(raw: Floats, x: float, half_window: float) -> tuple[float, float]:
    """Shift of a stage's mean displacement and velocity (Eqs. 20, 21) for a wall at ``+-half_window``.

    Zero where a variance is not positive: no window mean can be formed there.
    """
    vx, vy = raw[2, 0], raw[0, 2]
    if not (vx > 0.0 and vy > 0.0):
        return 0.0, 0.0
    sd_x, sd_y = np.sqrt(vx), np.sqrt(vy)
    return window_means(coefficients(raw, sd_x, sd_y), sd_x, sd_y, -half_window - x, half_window - x)


@jit
def stage_shifts(raw: Floats, state: Floats, windows: tuple[float, float], stages: int) -> Floats:
    """Shift of the four means, from the raw moments (2, order + 1, order + 1) of the stages."""
    shift = np.zeros(4)
    for i in range(stages):
        j = 2 * i
        shift[j], shift[j + 1] = window_shift(raw[i], state[j], windows[i])
    return shift


@jit
def _carry(c: Constants, tau: Floats, mesh: Ints, found: int) -> Floats:
    """Covariance just before each impact, shape (impacts + 1, 4, 4)."""
    covariance = np.full((tau.size, 4, 4), np.nan)
    covariance[0] = 0.0
    for k in range(1, found + 1):
        t = tau[k] - tau[k - 1]
        j = jacobian(c, t) @ contact_matrix(c, mesh[k - 1])
        covariance[k] = j @ covariance[k - 1] @ j.T + noise_covariance(c, tau[k - 1], t)
    return covariance


@jit
def _means(before: Floats, raw: Floats, windows: tuple[float, float], stages: int) -> Floats:
    mean = before.copy()
    for k in range(1, len(before)):
        mean[k] += stage_shifts(raw[k], before[k], windows, stages)
    return mean


def trace(scene: Scene, impacts: int, order: int) -> Trace:
    """Follow the mended closure through `impacts` impacts."""
    c, orbit = scene.constants, follow(scene, impacts).until_rest
    windows = scene.windows
    covariance = _carry(c, orbit.tau, orbit.mesh, orbit.found)
    raw = stage_raw_moments(covariance, order)
    mean = _means(orbit.before, raw, windows, c.stages)
    sd = np.full((impacts + 1, 6), np.nan)  # no sd of tau or of a flight: the impact time does not vary here
    sd[:, 2:] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    skew = np.where(sd > 0.0, 0.0, np.nan)

    def at(time: float) -> tuple[Floats, Floats]:
        k = int(np.searchsorted(orbit.tau[: orbit.found + 1], time, side="right")) - 1
        t = time - orbit.tau[k]
        j = jacobian(c, t) @ contact_matrix(c, orbit.mesh[k])
        cov = j @ covariance[k] @ j.T + noise_covariance(c, orbit.tau[k], t)
        state = orbit.state(time)
        return state + stage_shifts(stage_raw_moments(cov[None], order)[0], state, windows, c.stages), cov

    return Trace(orbit.tau, orbit.mesh, orbit.side, mean, sd, skew, covariance, raw, at, orbit.found, orbit.stopped)
