"""The map from a path's own impact to its own next one, its derivatives, and the third cumulants that it produces.

The section state at the k-th impact is ``s = (tau, x1, y1, x2, y2)``, followed by the deviations of the flanks where
they vary.  ``s' = H(s, n)``: let the path fly for the orbit's flight time, add the flight's noise ``n ~ N(0, Q)``, and
continue (or go back) without noise to the path's own wall.

Besides the second derivatives of H, two effects enter the third cumulants at the same order.  First, Q depends on the
path's own tau_k.  Second, the noise between the orbit's flight time and the path's own (a time delta, of either sign)
is missing from n.  By the Fokker-Planck equation it changes the density f on the section by
``delta sigma^2 (m . grad)^2 f / 2``, m the modulation of the noise.  That adds ``sigma^2 m_i m_j cov(delta, s_l)`` and
its permutations to the third cumulants, and nothing to the mean or the covariance.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.closure.flanks import column
from rattle.scene.compiled import jit
from rattle.scene.constants import Constants
from rattle.scene.flight import field, field_rate, jacobian, noise_covariance, noise_rate, system_matrix
from rattle.scene.impact import contact_matrix
from rattle.scene.small_matrices import apply, block, congruence, put, times, times_transposed
from rattle.scene.small_vectors import dot, put_row

Floats = NDArray[np.float64]


@jit
def derivatives(
    c: Constants, mesh: int, side: int, tau: float, after: Floats, t: float, before: Floats, d: int
) -> tuple[Floats, Floats]:
    """First and second derivatives of the section map with respect to ``(s, n)``, exact.

    The flight is linear except in the phase of its start; the other nonlinearity is the time at which it ends.

    Shapes: `tau`, `after` (4,); `t`, `before` (4,); `first` (d, d + 4); `second` (5, d + 4, d + 4).
    """
    size = d + 4
    i = 0 if mesh == 1 else 2
    y = before[i + 1]
    j, a = jacobian(c, t), system_matrix(c)
    rate = field(c, tau + t, before[1], before[3])
    explicit = field_rate(c, tau + t)
    bend = apply(a, rate)  # second time derivative along the flight
    flown = np.zeros((4, size))  # derivative of the state after a flight of time t, noise added
    begun, first_rate = apply(j, field(c, tau, after[1], after[3])), np.zeros(4)
    for k in range(4):
        bend[k] += explicit[k]
        first_rate[k] = flown[k, 0] = rate[k] - begun[k]
        flown[k, d + k] = 1.0
        for m in range(4):
            flown[k, 1 + m] = j[k, m]
    flank = column(mesh, side)
    late = np.zeros(size)  # derivative of the remaining time to the wall
    for m in range(size):
        late[m] = -flown[i, m] / y
    if d > 5:
        late[flank] += side / y
    first = np.zeros((d, size))
    for m in range(size):
        first[0, m] = late[m]
        for k in range(4):
            if k != i:  # the struck displacement is on its wall: derivative 0
                first[1 + k, m] = flown[k, m] + rate[k] * late[m]
    first[0, 0] += 1.0
    for k in range(5, d):
        first[k, k] = 1.0
    if d > 5:
        first[1 + i, flank] = side
    drift = times(a, flown)
    end_term, start_term = apply(a, first_rate), apply(j, field_rate(c, tau))
    for k in range(4):
        drift[k, 0] += explicit[k]  # derivative of the rate at the end of the flight
    second = np.zeros((5, size, size))
    for m in range(size):
        for n in range(size):
            for k in range(4):
                second[1 + k, m, n] = drift[k, m] * late[n] + late[m] * drift[k, n] + bend[k] * (late[m] * late[n])
    for k in range(4):
        second[1 + k, 0, 0] += explicit[k] + end_term[k] - start_term[k]
    for m in range(size):
        for n in range(size):
            second[0, m, n] = -second[1 + i, m, n] / y
            for k in range(4):
                second[1 + k, m, n] += rate[k] * second[0, m, n]
            second[1 + i, m, n] = 0.0
    return first, second


@jit
def noise_slope(c: Constants, tau: float, t: float) -> Floats:
    """Derivative of the covariance of a flight's noise with respect to the time of its start.

    That covariance is ``A + B cos 2 tau + C sin 2 tau``, so a difference over a quarter of a period gives it exactly.

    Shapes: result (4, 4).
    """
    eighth = 0.25 * math.pi
    slope, earlier = noise_covariance(c, tau + eighth, t), noise_covariance(c, tau - eighth, t)
    for i in range(4):
        for j in range(4):
            slope[i, j] -= earlier[i, j]
    return slope


@jit
def third_cumulants(
    c: Constants, tau: float, first: Floats, hessian: Floats, p: Floats, q: Floats, slope: Floats, third: Floats
) -> Floats:
    """Third cumulants of the next section state; see the module's docstring.

    Shapes: `first`, `hessian` (d, d + 4) and (5, d + 4, d + 4); `p`, `q` (d, d) and (4, 4); `slope` (4, 4);
    `third` (d, d, d); result (d, d, d).
    """
    d = p.shape[0]
    size = d + 4
    spread = np.zeros((size, size))  # covariance of (s, n)
    put(spread[:d, :d], p)
    put(spread[d:, d:], q)
    reach = times(first, spread)  # cov(s', (s, n))
    covariance = times_transposed(reach, first)
    varied = congruence(block(first, d, d, size), slope)  # d cov(s' | s) / d tau_k
    late = np.empty(d)  # cov(delta, s'), delta = tau' - tau - t
    for i in range(d):
        late[i] = covariance[0, i] - reach[i, 0]
    m1, m2 = noise_rate(c, tau)
    kick = np.zeros(d)
    kick[2] = c.sigma * m1
    if c.stages == 2:
        kick[4] = c.sigma * m2
    bent = np.zeros((d, d, d))  # bent[l, i, j]: contribution of the quadratic part of component l
    for k in range(5):
        put(bent[k], congruence(reach, hessian[k]))
    out = np.zeros((d, d, d))
    mapped = np.zeros((d, d, d))
    linear = block(first, d, 0, d)
    for a in range(d):
        put(mapped[a], congruence(linear, third[a]))
    for i in range(d):
        for j in range(d):
            for k in range(d):
                total = bent[k, i, j] + bent[j, i, k] + bent[i, j, k]
                total += varied[i, j] * reach[k, 0] + varied[i, k] * reach[j, 0] + varied[j, k] * reach[i, 0]
                total += kick[i] * kick[j] * late[k] + kick[i] * kick[k] * late[j] + kick[j] * kick[k] * late[i]
                for a in range(d):
                    total += linear[i, a] * mapped[a, j, k]
                out[i, j, k] = total
    return out


@jit
def flight_third_cumulant(first: Floats, hessian: Floats, p: Floats, q: Floats, slope: Floats, third: Floats) -> float:
    """Third cumulant of the flight time, the difference of the next tau and the last one.

    Only the next tau is nonlinear.  The noise beyond the orbit's flight time does not enter, because it acts on
    velocities.

    Shapes: `first`, `hessian` (d, d + 4) and (5, d + 4, d + 4); `p`, `q` (d, d) and (4, 4); `slope` (4, 4);
    `third` (d, d, d).
    """
    d = p.shape[0]
    own = first[0].copy()  # derivative of the flight time with respect to (s, n)
    own[0] -= 1.0
    past, noise = own[:d], own[d:]
    reach = np.zeros(d + 4)  # its covariance with (s, n)
    put_row(reach[:d], apply(p, past))
    put_row(reach[d:], apply(q, noise))
    varied = dot(noise, apply(slope, noise))  # d var(flight | s) / d tau_k
    total = 3.0 * dot(reach, apply(hessian[0], reach)) + 3.0 * varied * reach[0]
    for a in range(d):
        total += own[a] * dot(past, apply(third[a], past))
    return float(total)


@jit
def hit_matrix(c: Constants, mesh: int, d: int) -> Floats:
    """The restitution map on the section state ``(tau, x1, y1, x2, y2, ...)``.

    Shapes: result (d, d).

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> (hit_matrix(Scene.from_gears(DAT21).constants, 1, 5) @ np.array([0.3, 0.5, 2.0, 0.1, 2.0])).round(12).tolist()
    [0.3, 0.5, -1.8, 0.1, -1.8]
    """
    contact, out = contact_matrix(c, mesh), np.zeros((d, d))
    for i in range(d):
        out[i, i] = 1.0
    for i in range(4):
        for j in range(4):
            out[1 + i, 1 + j] = contact[i, j]
    return out
