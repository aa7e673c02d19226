"""The paper's mean map as it stands: Eqs. 10, 14-17, 20-22 with misprints corrected only
(docs/model.md section 9).

Errors of the paper that are kept: the moments of both stages follow the mesh-2 rules (15) and (17)
at every impact, with ``-eps m_np`` where ``(-eps)^p m_np`` is right; the noise of Eq. 14 is not
modulated; the flight after every impact is the one after a mesh-1 impact; the next impact is where
``E[x_i]`` has changed its sign (counter meshes); the ``y_2`` line of Eq. 22; ``+psi_0`` in the
fourth-order term of A and C.

Choices where the paper is silent: ``B_k`` and ``D_k`` go with the standard deviations of impact k;
the shift of a stage whose variance is not positive is left out, and the map goes on.
"""

from functools import partial
from math import comb

import numpy as np

from rattle.closure.edgeworth import window_shift
from rattle.closure.moments import Trace, check_row, check_white
from rattle.scene import Constants, Floats, InputError, Scene
from rattle.scene.compiled import jit, little_code
from rattle.scene.damping import decay, phi1
from rattle.scene.elementary import unknown
from rattle.scene.flight import flow, noise_covariance
from rattle.scene.impact import strike
from rattle.scene.linear_algebra import beyond, put
from rattle.scene.moments import gaussian_raw_moments
from rattle.scene.orbit import last_until
from rattle.scene.parts import SINE_ALONE
from rattle.scene.wheel import complete_wheels

SCAN = 0.05  # time step of the search for a counter mesh; E[x_i] moves about a tenth of a gap in it
LONGEST_MAPPED_FLIGHT = 20.0  # longest flight; the map ends if there is no counter mesh in it
BINOMIALS = np.array([[comb(n, k) for k in range(7)] for n in range(7)], dtype=float)


@jit
def _in_flight(
    c: Constants,
    last: Constants,
    tau: float,
    mean: Floats,
    shift: Floats,
    raw: Floats,
    t: float,
    windows: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Mean (Eq. 22), its shift, and the raw moments of both stages, a time `t` after the impact at
    `tau`; `last`: of `last_wheel_alone`."""
    little_code()
    first = c.wheels[0]
    # the unperturbed x, y of Eqs. 7 and 10
    state = beyond(mean, -1.0, shift)
    strike(c, 1, state)
    mean_t = flow(c, tau, state, t)  # Eq. 10
    raw_t = np.zeros(raw.shape)
    put(raw_t[0], after_flight(raw[0], first.beta, t, noise_covariance(c, tau, t)))  # Eq. 16
    if c.wheels.size == 2:
        # Eq. 14; its term with E[zeta_1] stays zero, for every first moment starts at zero
        beta2 = c.wheels[1].beta
        put(raw_t[1], after_flight(raw[1], beta2, t, noise_covariance(last, tau, t)))
    shift_t = np.zeros(mean.size)
    for i in range(c.wheels.size):
        x = 2 * i
        shift_t[x], shift_t[x + 1] = window_shift(raw_t[i], mean_t[x], windows[i], True)
        mean_t[x] += shift_t[x]
        mean_t[x + 1] += shift_t[x + 1]
    if c.wheels.size == 2:
        second = c.wheels[1]
        d1 = decay(first.beta, t)
        d2 = decay(second.beta, t)
        driver = c.alpha * np.cos(tau)
        mean_t[3] = (  # Eq. 22, last line
            (mean[3] - (1.0 + first.epsilon) * mean[1] - driver) * d1
            + (mean[3] - mean[1] + driver) * d2
            + first.gamma * phi1(first.beta, t)
            - second.gamma * phi1(second.beta, t)
            + shift_t[3]
            - 2.0 * d2 * shift[3]
            + ((1.0 + first.epsilon) * d1 + d2) * shift[1]
        )
    return mean_t, shift_t, raw_t


def last_wheel_alone(c: Constants) -> Constants:
    """The last wheel by itself, under noise on its velocity that is not modulated, as in Eq. 14."""
    wheels = c.wheels[-1:].copy()
    wheels["parent"] = -1
    wheels["sign"] = 1.0
    wheels["own"] = 1.0
    wheels["alone"] = 0.0
    complete_wheels(wheels, c.drive)
    return c._replace(wheels=wheels, modulates=0.0)


def after_impact(c: Constants, raw: Floats) -> Floats:
    """Eqs. 15 and 17 for ``p != 0``; what has ``p = 0`` stays (a single stage follows Eq. 15)."""
    out = raw.copy()
    n, p = np.indices(raw.shape[1:])
    changed = (p > 0) & (n + p < raw.shape[1])
    last = c.wheels[-1]
    out[-1, changed] = -last.epsilon * raw[-1, changed]
    if c.wheels.size == 2:
        kappa = (1.0 + last.epsilon) * last.share
        out[0, changed] = raw[0, changed] - kappa * raw[1, changed]
    return out


@np.errstate(all="ignore")  # a level bracket has no secant: NaN, as in compiled code
def _counter_mesh(
    c: Constants,
    last: Constants,
    tau: float,
    mean: Floats,
    shift: Floats,
    raw: Floats,
    windows: Floats,
) -> tuple[float, int]:
    """The smaller time at which ``E[x_i] = -E[x_i]_k``, and its stage; stage 0 if there is none."""
    earlier = 0.0
    before = mean + mean
    while earlier < LONGEST_MAPPED_FLIGHT:
        later = earlier + SCAN
        now = _in_flight(c, last, tau, mean, shift, raw, later, windows)[0] + mean
        best = np.inf
        stage = 0
        for i in range(c.wheels.size):
            f_low = before[2 * i]
            f_high = now[2 * i]
            if not f_low * f_high <= 0.0:
                continue
            low = earlier
            high = later
            for _ in range(60):  # regula falsi (Illinois variant)
                t = (low * f_high - high * f_low) / (f_high - f_low)
                f = _in_flight(c, last, tau, mean, shift, raw, t, windows)[0][2 * i] + mean[2 * i]
                if f * f_high < 0.0:
                    low = high
                    f_low = f_high
                else:
                    f_low *= 0.5
                high = t
                f_high = f
                if f == 0.0 or abs(high - low) < 1e-14 * (1.0 + t) or abs(f) < 1e-15 * windows[i]:
                    break
            if high < best and high > 0.0:
                best = high
                stage = i + 1
        if stage:
            return best, stage
        earlier = later
        before = now
    return LONGEST_MAPPED_FLIGHT, 0


def _covariance(raw: Floats) -> Floats:
    """Second moments of the state as a matrix; NaN across the gaps, where this closure has none."""
    states = 2 * raw.shape[-3]
    out = unknown(*raw.shape[:-3], states, states)
    x = np.arange(0, states, 2)
    y = x + 1
    out[..., x, x] = raw[..., 2, 0]
    out[..., y, y] = raw[..., 0, 2]
    out[..., x, y] = out[..., y, x] = raw[..., 1, 1]
    return out


def check(scene: Scene) -> None:
    """Refuse what Eq. 10 does not cover: another gearbox than the paper's, noise with a memory,
    another drive, a start without an impact at mesh 1."""
    check_row("published", scene)
    check_white(scene)
    if scene.drive != SINE_ALONE:
        raise InputError(
            "drive",
            f"{len(scene.drive)} orders",
            "the published closure is for one order only, sin tau",
        )
    if scene.start.mesh != 1:
        raise InputError(
            "start.mesh", scene.start.mesh, "the published closure needs a start at mesh 1 (Eq. 10)"
        )


def trace(scene: Scene, impacts: int, order: int) -> Trace:
    """Follow the published mean map."""
    c = scene.constants
    alone = last_wheel_alone(c)
    windows = np.array(scene.windows)
    tau = unknown(impacts + 1)
    mesh, side = np.zeros((2, impacts + 1), np.int64)
    gaps = len(windows)
    mean, shift = unknown(2, impacts + 1, 2 * gaps)
    before, after = raw = unknown(2, impacts + 1, gaps, order + 1, order + 1)
    tau[0] = scene.phase
    mesh[0] = 1
    mean[0] = scene.start_state
    side[0] = np.copysign(1, mean[0, 0])
    shift[0] = 0.0
    raw[:, 0] = 0.0
    raw[:, 0, :, 0, 0] = 1.0
    reached = 0
    while reached < impacts:
        last = tau[reached], mean[reached], shift[reached], after[reached]
        t, stage = _counter_mesh(c, alone, *last, windows)
        if stage == 0:
            break
        reached += 1
        tau[reached] = last[0] + t
        mesh[reached] = stage
        mean[reached], shift[reached], before[reached] = _in_flight(c, alone, *last, t, windows)
        side[reached] = np.copysign(1, mean[reached, 2 * stage - 2])
        after[reached] = after_impact(c, before[reached])
    covariance = _covariance(before)
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    sd = unknown(impacts + 1, 2 + 2 * gaps)
    sd[:, 2:] = np.sqrt(np.where(variance >= 0.0, variance, np.nan))

    ended = (
        f"the other mesh is not struck within {LONGEST_MAPPED_FLIGHT:g} time units"
        f" after impact {reached}"
    )
    stopped = "" if reached == impacts else ended
    at = partial(_at, c, alone, windows, tau[: reached + 1], mean, shift, after)
    return Trace(
        tau,
        mesh,
        side,
        mean,
        sd,
        np.full_like(sd, np.nan),
        covariance,
        before,
        at,
        reached,
        stopped,
    )


def _at(
    c: Constants,
    last: Constants,
    windows: Floats,
    tau: Floats,
    mean: Floats,
    shift: Floats,
    after: Floats,
    time: float,
) -> tuple[Floats, Floats]:
    """Mean and covariance of the state at a local time."""
    k = last_until(tau, time)
    started = tau[k], mean[k], shift[k], after[k]
    mean_t, _, raw = _in_flight(c, last, *started, time - tau[k], windows)
    return mean_t, _covariance(raw)


@jit
def after_flight(raw: Floats, beta: float, t: float, q: Floats) -> Floats:
    """Raw moments after a flight.

    Shapes: `raw` (order + 1, order + 1); `q` (2, 2); result (order + 1, order + 1).
    """
    little_code()
    order = raw.shape[0] - 1
    e = phi1(beta, t)
    d = decay(beta, t)
    flown = np.zeros_like(raw)
    for n in range(order + 1):
        for p in range(order + 1 - n):
            for k in range(n + 1):
                flown[n, p] += BINOMIALS[n, k] * e**k * d**p * raw[n - k, p + k]
    noise = gaussian_raw_moments(q[0, 0], q[0, 1], q[1, 1], order)
    out = np.zeros_like(raw)
    for n in range(order + 1):
        for p in range(order + 1 - n):
            for i in range(n + 1):
                for j in range(p + 1):
                    out[n, p] += (
                        BINOMIALS[n, i] * BINOMIALS[p, j] * flown[i, j] * noise[n - i, p - j]
                    )
    return out
