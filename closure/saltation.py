"""The saltation closure: first order in the noise, exactly, and its second-order corrections.

A perturbed path meets the wall at another time than the orbit.  So the state that is propagated is the one that each
path has at its own k-th impact (the section state).  Its covariance is propagated by the derivative of the map from
section to section; at fixed times that is the saltation matrix ``Xi = R + (F+ - R F-) g' / (g' F-)`` (docs/model.md
section 6).  From order 3 on, the second derivatives add the shift of the mean, an O(sigma^2) effect, and the third
cumulants.
"""

import math
from functools import partial

import numpy as np

from rattle.closure.flanks import column, random_tolerance, start_covariance
from rattle.closure.moments import Trace
from rattle.closure.orbit import Floats, Ints, Orbit, follow
from rattle.closure.raw_moments import stage_raw_moments
from rattle.closure.section_map import derivatives, hit_matrix
from rattle.closure.third_cumulants import after_impact, flight_third_cumulant, noise_slope, third_cumulants
from rattle.scene.constants import Constants
from rattle.scene.flight import field, jacobian, noise_covariance
from rattle.scene.moments import SMALLEST, semidefinite
from rattle.scene.products import image, product, total, totals, transform
from rattle.scene.scene import Scene

SLOWEST = 1e-6
"""Impact speed, relative to excitation, drag and initial speeds, below which the orbit grazes: no derivatives there."""


def propagate(
    c: Constants,
    tau: Floats,
    mesh: Ints,
    side: Ints,
    before: Floats,
    after: Floats,
    found: int,
    start: Floats,
    variance: Floats,
    redraw: bool,
    second: bool,
) -> tuple[int, Floats, Floats, Floats, Floats, Floats]:
    """Mean shift, sd and skewness of the section quantities, and covariance of the section state before and after.

    `start`: Covariance of the section state after the start; its size tells whether flanks vary. Shapes: `start`
    (d, d); `variance` (4,); result (impacts + 1, 6); result (impacts + 1, d, d).
    """
    count, d = tau.size, start.shape[0]
    shift, sd, skew = np.full((3, count, 6), np.nan)
    section, covariance = np.full((2, count, d, d), np.nan)  # before the impact, and after it
    section[0] = covariance[0] = start
    moved, third = np.zeros(d), np.zeros((d, d, d))
    states = np.arange(5)
    places = np.array([0, 2, 3, 4, 5])  # of tau and of the state among the section quantities
    fastest = max(c.alpha, c.gamma1, abs(before[0, 1]), abs(before[0, 3]))
    for k in range(1, found + 1):
        speed = before[k, 1] if mesh[k] == 1 else before[k, 3]
        if abs(speed) < SLOWEST * fastest:
            return k - 1, shift, sd, skew, section, covariance
        t = tau[k] - tau[k - 1]
        first, hessian = derivatives(c, mesh[k], side[k], tau[k - 1], after[k - 1], t, before[k], d)
        q = noise_covariance(c, tau[k - 1], t)
        p = covariance[k - 1]
        linear = first[:, :d]
        section[k] = transform(linear, p) + transform(first[:, d:], q)
        cross = total(linear[0] * p[0])  # cov(tau_k, tau_k-1)
        spread = section[k, 0, 0] + p[0, 0] - 2.0 * cross  # variance of the flight time
        sd[k, places] = np.sqrt(np.maximum(np.diagonal(section[k])[:5], 0.0))
        sd[k, 1] = math.sqrt(max(spread, 0.0))
        last = moved[0]
        moved = image(linear, moved)
        if second:
            slope = noise_slope(c, tau[k - 1], t)
            cube = sd[k] * sd[k] * sd[k]
            if cube[1] > SMALLEST:
                skew[k, 1] = flight_third_cumulant(first, hessian, p, q, slope, third) / cube[1]
            third = third_cumulants(c, tau[k - 1] + t, first, hessian, p, q, slope, third)
            moved[:5] += 0.5 * (totals(hessian[:, :d, :d] * p) + totals(hessian[:, d:, d:] * q))
            shift[k, places], shift[k, 1] = moved[:5], moved[0] - last
            clear = cube[places] > SMALLEST
            skew[k, places[clear]] = third[states, states, states][clear] / cube[places[clear]]
        hit = hit_matrix(c, mesh[k], d)
        covariance[k] = transform(hit, section[k])
        moved = image(hit, moved)
        if second:
            third = after_impact(hit, third)
        if redraw:
            flank = column(mesh[k], -side[k])
            moved[flank] = covariance[k, flank] = covariance[k, :, flank] = 0.0
            covariance[k, flank, flank] = variance[flank - 5]
            third[flank] = third[:, flank] = third[:, :, flank] = 0.0
    return found, shift, sd, skew, section, covariance


def trace(scene: Scene, impacts: int, order: int) -> Trace:
    """Follow the saltation closure; to second order from `order` 3 on."""
    c, orbit = scene.constants, follow(scene, impacts).until_sticking
    tolerance = random_tolerance(scene)
    variance = np.zeros(4) if tolerance is None else np.repeat(tolerance.variances, 2)
    redraw = tolerance is not None and tolerance.draw == "contact"
    found, shift, sd, skew, section, after = propagate(
        c,
        orbit.tau,
        orbit.mesh,
        orbit.side,
        orbit.before,
        orbit.after,
        orbit.found,
        start_covariance(scene),
        variance,
        redraw,
        order >= 3,
    )
    stopped = orbit.stopped if found == orbit.found else f"impact {found + 1} grazes its wall"
    mean = orbit.before + np.nan_to_num(shift[:, 2:])
    tau = orbit.tau + np.nan_to_num(shift[:, 0])
    mean[found + 1 :], tau[found + 1 :] = np.nan, np.nan
    covariance = np.full((impacts + 1, 4, 4), np.nan)
    for k in range(found + 1):
        rate = field(c, orbit.tau[k], orbit.before[k, 1], orbit.before[k, 3]) if k else np.zeros(4)
        covariance[k] = _at_one_time(rate, section[k, :5, :5], np.eye(4))
    raw = stage_raw_moments(covariance, order)

    at = partial(_in_flight, c, orbit, found, after)
    mesh, side = orbit.mesh.copy(), orbit.side.copy()
    mesh[found + 1 :], side[found + 1 :] = 0, 0
    return Trace(tau, mesh, side, mean, sd, skew, covariance, raw, at, found, stopped, until=float(orbit.tau[found]))


def _in_flight(c: Constants, orbit: Orbit, found: int, after: Floats, time: float) -> tuple[Floats, Floats]:
    """Mean and covariance of the state at a local time, from the covariance of the section state after each impact."""
    k = int(np.searchsorted(orbit.tau[: found + 1], time, side="right")) - 1
    rate = field(c, orbit.tau[k], orbit.after[k, 1], orbit.after[k, 3])
    t = time - orbit.tau[k]
    flown = _at_one_time(rate, after[k, :5, :5], jacobian(c, t))
    return orbit.state(time), flown + noise_covariance(c, orbit.tau[k], t)


def _at_one_time(rate: Floats, section: Floats, flown: Floats) -> Floats:
    """Covariance of the state at one time: ``xi = delta s - F delta tau`` propagated by a flight, shape (4, 4)."""
    fixed = product(flown, np.concatenate([-rate[:, None], np.eye(4)], axis=1))
    sd = np.sqrt(np.maximum(np.diagonal(section), 0.0))
    return semidefinite(transform(fixed, section), image(np.abs(flown), sd[1:] + np.abs(rate) * sd[0]))
