"""The closure that is right to first order, and its second order: a Markov step from section to section.

A perturbed path meets the wall at another instant than the orbit.  So the state that is followed is the one that each
path has at its own k-th impact, ``s = (tau, x1, y1, x2, y2)``, with the half gaps of the flanks as further columns where
they vary.  One flight maps it to ``s' = H(s, n)``: let the path fly for the orbit's flight time, add the flight's noise
``n ~ N(0, Q)``, and go on (or back) without noise to the path's own wall.  The covariance is carried by the
derivative of H; in clock coordinates that is the saltation matrix ``Xi = R + (F+ - R F-) g' / (g' F-)`` (MODEL section 6).

Second order (moments of order 3 and above): the second derivatives of H give the mean shift, an O(sigma^2)
effect, and the third cumulants.  Two terms more belong to the same order.  Q depends on the path's own tau_k.  And the
noise between the orbit's flight time and the path's own (a time delta, of either sign) is missing from n: by the
Fokker-Planck equation it changes the section's density by ``delta sigma^2 (m d)^2 / 2`` of itself, m the noise's
modulation, which adds ``sigma^2 m_i m_j cov(delta, s_l)`` and its permutations to the third cumulants and nothing to the
mean or the covariance.
"""

import numpy as np

from closure.orbit import Floats, Ints, follow
from closure.raw_moments import stage_raw_moments
from closure.trace import Trace
from scene.compiled import jit
from scene.flight import flow, jacobian, noise_covariance, noise_rate, wheel_speeds
from scene.impact import contact_matrix
from scene.scene import Constants, Scene

__all__ = ["field", "section_map", "trace"]

STEP = 1e-4  # of the central differences: truncation and rounding of a second derivative both stay near 1e-8
SLOWEST = 1e-6  # impact speed below which the orbit grazes: derivatives of the section map do not exist there


@jit
def field(c: Constants, tau: float, y1: float, y2: float) -> Floats:
    """Time derivative of ``(x1, y1, x2, y2)`` in flight (Eq. 3), shape (4,)."""
    u1, u2 = wheel_speeds(c, tau, y1, y2)
    drag1 = c.beta1 * u1 + c.gamma1
    f = np.array([y1, -c.alpha * np.sin(tau) + drag1, y2, drag1 - c.beta2 * u2 - c.gamma2])
    if c.stages == 1:
        f[2:] = 0.0
    return f


@jit
def section_map(c: Constants, mesh: int, side: int, t: float, s: Floats, n: Floats, out: Floats) -> None:
    """``H``: from a state after an impact to the state before the next, through a flight of about `t`.

    Parameters
    ----------
    mesh, side : int
        The wall that is struck.
    t : float
        Flight time of the orbit.
    s : ndarray, shape (5,) or (9,)
        ``tau, x1, y1, x2, y2`` after the impact, and the deviations of the flanks +1, -1, +2, -2 from their gaps.
    n : ndarray, shape (4,)
        Noise of the flight.
    out : ndarray, shape of `s`
        Output: the same before the next impact; the deviations stay.
    """
    x1, y1, x2, y2 = flow(c, s[0], s[1], s[2], s[3], s[4], t)
    x1, y1, x2, y2 = x1 + n[0], y1 + n[1], x2 + n[2], y2 + n[3]
    wall = c.wall1 if mesh == 1 else c.wall2
    if s.size > 5:
        wall += s[5 + 2 * (mesh - 1) + (0 if side > 0 else 1)]
    begin, delta = s[0] + t, 0.0
    a1, b1, a2, b2 = x1, y1, x2, y2
    for _ in range(8):  # Newton; the start is within a step of the differences
        x, y = (a1, b1) if mesh == 1 else (a2, b2)
        change = (side * wall - x) / y
        delta += change
        a1, b1, a2, b2 = flow(c, begin, x1, y1, x2, y2, delta)
        if abs(change) < 1e-15:
            break
    if mesh == 1:
        a1 = side * wall
    else:
        a2 = side * wall
    out[:] = s
    out[0], out[1], out[2], out[3], out[4] = begin + delta, a1, b1, a2, b2


@jit
def _derivatives(c: Constants, mesh: int, side: int, t: float, s: Floats, second: bool) -> tuple[Floats, Floats]:
    """First and second derivatives of the section map with respect to ``(s, n)`` by central differences.

    Shapes (d, d + 4) and (5, d + 4, d + 4), d the size of s; the second is zero unless asked for.
    """
    d = s.size
    size = d + 4
    u = np.zeros(size)
    first, hessian = np.zeros((d, size)), np.zeros((5, size, size))
    plus, minus, base, mixed = np.empty(d), np.empty(d), np.empty(d), np.empty((4, d))
    section_map(c, mesh, side, t, s, u[d:], base)
    for a in range(size):
        u[:] = 0.0
        u[a] = STEP
        section_map(c, mesh, side, t, s + u[:d], u[d:], plus)
        u[a] = -STEP
        section_map(c, mesh, side, t, s + u[:d], u[d:], minus)
        for i in range(d):
            first[i, a] = (plus[i] - minus[i]) / (2.0 * STEP)
        if not second:
            continue
        for i in range(5):
            hessian[i, a, a] = (plus[i] - 2.0 * base[i] + minus[i]) / STEP**2
        for b in range(a):
            for k in range(4):
                u[:] = 0.0
                u[a] = STEP if k < 2 else -STEP
                u[b] = STEP if k % 2 == 0 else -STEP
                section_map(c, mesh, side, t, s + u[:d], u[d:], mixed[k])
            for i in range(5):
                value = (mixed[0, i] - mixed[1, i] - mixed[2, i] + mixed[3, i]) / (4.0 * STEP**2)
                hessian[i, a, b] = hessian[i, b, a] = value
    return first, hessian


@jit
def _third_cumulants(
    c: Constants, tau: float, t: float, y1: float, y2: float, first: Floats, hessian: Floats,
    p: Floats, q: Floats, third: Floats,
) -> Floats:  # fmt: skip
    """Third cumulants of the next section state, shape (d, d, d); see the module's docstring."""
    d = p.shape[0]
    size = d + 4
    spread = np.zeros((size, size))  # covariance of (s, n)
    spread[:d, :d], spread[d:, d:] = p, q
    reach = first @ spread  # cov(s', (s, n))
    covariance = reach @ first.T
    noise_slope = (noise_covariance(c, tau + STEP, t) - noise_covariance(c, tau - STEP, t)) / (2.0 * STEP)
    through = np.ascontiguousarray(first[:, d:])
    varied = through @ noise_slope @ through.T  # d cov(s' | s) / d tau_k
    late = covariance[0] - reach[:, 0]  # cov(delta, s'), delta = tau' - tau - t
    m1, m2 = noise_rate(c, tau + t)
    kick = np.zeros(d)
    kick[2] = c.sigma * m1
    if c.stages == 2:
        kick[4] = c.sigma * m2
    bent = np.zeros((d, d, d))  # bent[l, i, j]: the quadratic part is in component l
    for k in range(5):
        bent[k] = reach @ hessian[k] @ reach.T
    out = np.zeros((d, d, d))
    carried = np.zeros((d, d, d))
    linear = np.ascontiguousarray(first[:, :d])
    for a in range(d):
        carried[a] = linear @ third[a] @ linear.T
    for i in range(d):
        for j in range(d):
            for k in range(d):
                total = bent[k, i, j] + bent[j, i, k] + bent[i, j, k]
                total += varied[i, j] * reach[k, 0] + varied[i, k] * reach[j, 0] + varied[j, k] * reach[i, 0]
                total += kick[i] * kick[j] * late[k] + kick[i] * kick[k] * late[j] + kick[j] * kick[k] * late[i]
                for a in range(d):
                    total += linear[i, a] * carried[a, j, k]
                out[i, j, k] = total
    return out


@jit
def _carry(
    c: Constants, tau: Floats, mesh: Ints, side: Ints, before: Floats, after: Floats, found: int,
    start: Floats, variance: Floats, redraw: bool, second: bool,
) -> tuple[int, Floats, Floats, Floats, Floats]:  # fmt: skip
    """Section moments before each impact, and the covariance after it.

    `start` is the covariance after the start's impact; its size says whether flanks vary.  `variance` is that of the flanks.
    """
    count, d = tau.size, start.shape[0]
    shift = np.full((count, 6), np.nan)
    sd = np.full((count, 6), np.nan)
    skew = np.full((count, 6), np.nan)
    covariance = np.full((count, d, d), np.nan)  # after the impact
    section = np.full((count, d, d), np.nan)  # before it
    covariance[0], section[0] = start, start
    moved, third = np.zeros(d), np.zeros((d, d, d))
    s = np.zeros(d)
    for k in range(1, found + 1):
        speed = before[k, 1] if mesh[k] == 1 else before[k, 3]
        if abs(speed) < SLOWEST:
            return k - 1, shift, sd, skew, section, covariance
        t = tau[k] - tau[k - 1]
        s[0], s[1:5] = tau[k - 1], after[k - 1]
        first, hessian = _derivatives(c, mesh[k], side[k], t, s, second)
        q = noise_covariance(c, tau[k - 1], t)
        p = covariance[k - 1]
        linear, through = np.ascontiguousarray(first[:, :d]), np.ascontiguousarray(first[:, d:])
        section[k] = linear @ p @ linear.T + through @ q @ through.T
        together = (linear @ p)[0, 0]  # cov(tau_k, tau_k-1)
        spread = section[k, 0, 0] + p[0, 0] - 2.0 * together
        for i in range(5):
            sd[k, i if i == 0 else i + 1] = np.sqrt(max(section[k, i, i], 0.0))
        sd[k, 1] = np.sqrt(max(spread, 0.0))
        last = moved[0]
        moved = linear @ moved
        if second:
            third = _third_cumulants(
                c, tau[k - 1], t, before[k, 1], before[k, 3], first, hessian, p, q, third
            )  # fmt: skip
            for i in range(5):
                moved[i] += 0.5 * ((hessian[i, :d, :d] * p).sum() + (hessian[i, d:, d:] * q).sum())
                place = 0 if i == 0 else i + 1
                shift[k, place] = moved[i]
                if sd[k, place] > 0.0:
                    skew[k, place] = third[i, i, i] / sd[k, place] ** 3
            shift[k, 1] = moved[0] - last
        hit = np.eye(d)
        hit[1:5, 1:5] = contact_matrix(c, mesh[k])
        covariance[k] = hit @ section[k] @ hit.T
        moved = hit @ moved
        turned_third = np.zeros((d, d, d))
        for i in range(d):
            for a in range(d):
                if hit[i, a] != 0.0:
                    turned_third[i] += hit[i, a] * (hit @ third[a] @ hit.T)
        third = turned_third
        if redraw:
            flank = 5 + 2 * (mesh[k] - 1) + (1 if side[k] > 0 else 0)  # the opposite one
            covariance[k, flank, :] = 0.0
            covariance[k, :, flank] = 0.0
            covariance[k, flank, flank] = variance[flank - 5]
            third[flank], third[:, flank], third[:, :, flank], moved[flank] = 0.0, 0.0, 0.0, 0.0
    return found, shift, sd, skew, section, covariance


def _start_covariance(scene: Scene) -> tuple[Floats, Floats, bool]:
    """Covariance of ``(tau, x1, y1, x2, y2, flanks)`` after the start, variances of the flanks, and whether they are redrawn."""
    tolerance = scene.tolerance
    if tolerance is None or tolerance.law == "fixed":
        return np.zeros((5, 5)), np.zeros(4), False
    variance = np.repeat(tolerance.variances, 2)
    per_path = tolerance.draw == "path"
    flanks = np.diag(variance)
    if per_path:  # both flanks of a mesh have one deviation
        flanks[[0, 1], [1, 0]], flanks[[2, 3], [3, 2]] = variance[0], variance[2]
    placed = np.zeros((9, 4))
    placed[5:] = np.eye(4)
    for row, x, gap, flank in ((1, scene.start.x1, scene.gap1, 0), (3, scene.start.x2, scene.gap2, 2)):
        if abs(x) == gap:  # the start lies on each path's own flank
            placed[row, flank + (0 if x > 0.0 else 1)] = np.sign(x)
    return placed @ flanks @ placed.T, variance, not per_path


def trace(scene: Scene, impacts: int, order: int) -> Trace:
    """Follow the saltation closure through `impacts` impacts; second order from `order` 3 on."""
    c, orbit = scene.constants, follow(scene, impacts)
    start, variance, redraw = _start_covariance(scene)
    found, shift, sd, skew, section, after = _carry(
        c, orbit.tau, orbit.mesh, orbit.side, orbit.before, orbit.after, orbit.found, start, variance, redraw, order >= 3
    )  # fmt: skip
    stopped = orbit.stopped if found == orbit.found else f"impact {found + 1} grazes its wall"
    mean = orbit.before + np.nan_to_num(shift[:, 2:])
    tau = orbit.tau + np.nan_to_num(shift[:, 0])
    mean[found + 1 :], tau[found + 1 :] = np.nan, np.nan
    covariance = np.full((impacts + 1, 4, 4), np.nan)
    for k in range(found + 1):
        clock = _clock(field(c, orbit.tau[k], orbit.before[k, 1], orbit.before[k, 3]) if k else np.zeros(4))
        covariance[k] = clock @ section[k, :5, :5] @ clock.T
    raw = stage_raw_moments(covariance, order)

    def at(time: float) -> tuple[Floats, Floats]:
        k = int(np.searchsorted(orbit.tau[: found + 1], time, side="right")) - 1
        clock = _clock(field(c, orbit.tau[k], orbit.after[k, 1], orbit.after[k, 3]))
        t = time - orbit.tau[k]
        j = jacobian(c, t) @ clock
        return orbit.state(c, time), j @ after[k, :5, :5] @ j.T + noise_covariance(c, orbit.tau[k], t)

    return Trace(tau, orbit.mesh, orbit.side, mean, sd, skew, covariance, raw, at, found, stopped)


def _clock(rate: Floats) -> Floats:
    """From a path's own instant to the orbit's: ``xi = delta s - F delta tau``, shape (4, 5)."""
    return np.concatenate([-rate[:, None], np.eye(4)], axis=1)
