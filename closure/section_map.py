"""The flight as a map from a path's own impact to its own next one, its derivatives, and the third cumulants it makes.

The state at the k-th impact is ``s = (tau, x1, y1, x2, y2)``, with the deviations of the flanks as further columns
where they vary.  ``s' = H(s, n)``: let the path fly for the orbit's flight time, add the flight's noise
``n ~ N(0, Q)``, and go on (or back) without noise to the path's own wall.

Besides the second derivatives of H, two things enter the third cumulants at the same order.  Q depends on the path's
own tau_k.  And the noise between the orbit's flight time and the path's own (a time delta, of either sign) is missing
from n: by the Fokker-Planck equation it changes the density on the section by ``delta sigma^2 (m d)^2 / 2`` of itself,
m the noise's modulation.  That adds ``sigma^2 m_i m_j cov(delta, s_l)`` and its permutations to the third cumulants,
and nothing to the mean or the covariance.
"""

import numpy as np
from numpy.typing import NDArray

from scene.compiled import jit
from scene.flight import flow, noise_covariance, noise_rate, wheel_speeds
from scene.scene import Constants

__all__ = ["derivatives", "field", "section_map", "third_cumulants"]

Floats = NDArray[np.float64]

STEP = 1e-4  # of the central differences: truncation and rounding of a second derivative both stay near 1e-8


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
def derivatives(c: Constants, mesh: int, side: int, t: float, s: Floats, second: bool) -> tuple[Floats, Floats]:
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
def third_cumulants(
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
