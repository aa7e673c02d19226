"""The paper's closure with its algebra corrected (docs/model.md sections 5, 6, 9).

Linear flow, restitution maps at the orbit's own impact times and additive noise keep ``(xi_1,
zeta_1, xi_2, zeta_2)`` exactly Gaussian: only the covariance has to be propagated, raw moments of
any order follow from it, and ``|rho| <= 1`` always.  The means are shifted by the window means of
Eqs. 20 and 21.
"""

from functools import partial

import numpy as np

from rattle.closure.edgeworth import window_shift
from rattle.closure.moments import Trace, check_row, check_white, gap_moments
from rattle.scene import Constants, Floats, Scene
from rattle.scene.elementary import unknown
from rattle.scene.flight import jacobian, noise_covariance
from rattle.scene.impact import contact_matrix
from rattle.scene.linear_algebra import product, total, transform
from rattle.scene.moments import semidefinite
from rattle.scene.orbit import Orbit, follow, last_until


def check(scene: Scene) -> None:
    """Refuse what the paper does not cover: another gearbox than its own, noise with a memory."""
    check_row("corrected", scene)
    check_white(scene)


def gap_shifts(raw: Floats, state: Floats, windows: tuple[float, ...]) -> Floats:
    """Shift of the means, from the raw moments (wheels, order + 1, order + 1) of the gaps."""
    shift = np.zeros(state.size)
    for i, window in enumerate(windows):
        shift[2 * i : 2 * i + 2] = window_shift(raw[i], state[2 * i], window, False)
    return shift


def _fly(
    c: Constants, mesh: int, covariance: Floats, tau: float, t: float
) -> tuple[Floats, Floats]:
    """Covariance a time t after an impact, from that before it; and the sds of its terms, for
    rounding."""
    j = product(jacobian(c, t), contact_matrix(c, mesh, 0.0))
    noise = noise_covariance(c, tau, t)
    terms = np.column_stack(
        [np.sqrt(np.diagonal(noise)), np.abs(j) * np.sqrt(np.abs(np.diagonal(covariance)))]
    )
    return transform(j, covariance) + noise, total(terms)


def trace(scene: Scene, impacts: int, order: int) -> Trace:
    """Follow the corrected closure."""
    c = scene.constants
    orbit = follow(scene, impacts).until_sticking
    tau = orbit.tau
    windows = scene.windows
    # just before each impact
    states = orbit.before.shape[1]
    computed = np.zeros((impacts + 1, states, states))
    scale = np.zeros((impacts + 1, states))
    for k in range(1, orbit.found + 1):
        computed[k], scale[k] = _fly(
            c, orbit.mesh[k - 1], computed[k - 1], tau[k - 1], tau[k] - tau[k - 1]
        )
    computed[orbit.found + 1 :] = np.nan
    covariance = np.array([semidefinite(p, s) for p, s in zip(computed, scale, strict=True)])
    raw = gap_moments(covariance, order)
    mean = orbit.before.copy()
    for k in range(1, impacts + 1):
        mean[k] += gap_shifts(raw[k], orbit.before[k], windows)
    # no sd of tau or flight: this closure has no spread of impact times
    sd = unknown(impacts + 1, 2 + states)
    sd[:, 2:] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    skew = np.where(sd > 0.0, 0.0, np.nan)

    at = partial(_in_flight, c, orbit, covariance, order, windows)
    return Trace(
        orbit.tau,
        orbit.mesh,
        orbit.side,
        mean,
        sd,
        skew,
        covariance,
        raw,
        at,
        orbit.found,
        orbit.stopped,
    )


def _in_flight(
    c: Constants,
    orbit: Orbit,
    covariance: Floats,
    order: int,
    windows: tuple[float, ...],
    time: float,
) -> tuple[Floats, Floats]:
    """Mean and covariance of the state at a local time, from the covariance before each impact."""
    k = last_until(orbit.tau, time)
    cov = semidefinite(*_fly(c, orbit.mesh[k], covariance[k], orbit.tau[k], time - orbit.tau[k]))
    state = orbit.state(time)
    return state + gap_shifts(gap_moments(cov[None], order)[0], state, windows), cov
