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

import math

import numpy as np
from numpy.typing import NDArray

from rattle.closure.flanks import column
from rattle.closure.small_matrices import block, congruence, put, put_row
from rattle.scene.compiled import jit, spliced
from rattle.scene.flight import field, field_rate, jacobian, noise_covariance, noise_rate, system_matrix
from rattle.scene.scene import Constants

__all__ = ["derivatives", "flight_third_cumulant", "noise_slope", "third_cumulants"]

Floats = NDArray[np.float64]


@spliced
def derivatives(
    c: Constants, mesh: int, side: int, tau: float, after: Floats, t: float, before: Floats, d: int
) -> tuple[Floats, Floats]:
    """First and second derivatives of the section map with respect to ``(s, n)``, exact.

    The flight is linear but for the phase of its start; only where it ends is bent.

    Parameters
    ----------
    mesh, side : int
        The wall that is struck.
    tau, after : float, ndarray of shape (4,)
        Time of the last impact and the orbit's state after it.
    t, before : float, ndarray of shape (4,)
        Flight time of the orbit and its state before the next impact.
    d : int
        Size of s: 5, or 9 with the flanks.

    Returns
    -------
    first : ndarray, shape (d, d + 4)
    second : ndarray, shape (5, d + 4, d + 4)
    """
    size = d + 4
    i = 0 if mesh == 1 else 2
    y = before[i + 1]
    j, a = jacobian(c, t), system_matrix(c)
    rate = field(c, tau + t, before[1], before[3])
    explicit = field_rate(c, tau + t)
    bend = a @ rate + explicit  # second time derivative along the flight
    flown = np.zeros((4, size))  # derivative of the state after a flight of t, noise added
    begun, first_rate = j @ field(c, tau, after[1], after[3]), np.zeros(4)
    for k in range(4):
        first_rate[k] = flown[k, 0] = rate[k] - begun[k]
        flown[k, d + k] = 1.0
        for m in range(4):
            flown[k, 1 + m] = j[k, m]
    flank = column(mesh, side)
    late = np.zeros(size)  # derivative of the time that is left to the wall
    for m in range(size):
        late[m] = -flown[i, m] / y
    if d > 5:
        late[flank] += side / y
    first = np.zeros((d, size))
    for m in range(size):
        first[0, m] = late[m]
        for k in range(4):
            if k != i:  # on its wall, exactly
                first[1 + k, m] = flown[k, m] + rate[k] * late[m]
    first[0, 0] += 1.0
    for k in range(5, d):
        first[k, k] = 1.0
    if d > 5:
        first[1 + i, flank] = side
    drift = a @ flown
    turn, twist = a @ first_rate, j @ field_rate(c, tau)
    for k in range(4):
        drift[k, 0] += explicit[k]  # derivative of the rate at the end of the flight
    second = np.zeros((5, size, size))
    for m in range(size):
        for n in range(size):
            for k in range(4):
                second[1 + k, m, n] = drift[k, m] * late[n] + late[m] * drift[k, n] + bend[k] * (late[m] * late[n])
    for k in range(4):
        second[1 + k, 0, 0] += explicit[k] + turn[k] - twist[k]
    for m in range(size):
        for n in range(size):
            second[0, m, n] = -second[1 + i, m, n] / y
            for k in range(4):
                second[1 + k, m, n] += rate[k] * second[0, m, n]
            second[1 + i, m, n] = 0.0
    return first, second


@jit
def noise_slope(c: Constants, tau: float, t: float) -> Floats:
    """Derivative of the covariance of a flight's noise with respect to the time of its start, shape (4, 4).

    That covariance is ``A + B cos 2 tau + C sin 2 tau``, so an eighth of a period to either side gives it exactly.
    """
    eighth = 0.25 * math.pi
    return noise_covariance(c, tau + eighth, t) - noise_covariance(c, tau - eighth, t)


@spliced
def third_cumulants(
    c: Constants, tau: float, first: Floats, hessian: Floats, p: Floats, q: Floats, slope: Floats, third: Floats
) -> Floats:
    """Third cumulants of the next section state, shape (d, d, d); see the module's docstring.

    `tau` is the time of the next impact, `slope` that of the noise's covariance (`noise_slope`).
    """
    d = p.shape[0]
    size = d + 4
    spread = np.zeros((size, size))  # covariance of (s, n)
    put(spread[:d, :d], p)
    put(spread[d:, d:], q)
    reach = first @ spread  # cov(s', (s, n))
    covariance = reach @ first.T
    varied = congruence(block(first, d, d, size), slope)  # d cov(s' | s) / d tau_k
    late = np.empty(d)  # cov(delta, s'), delta = tau' - tau - t
    for i in range(d):
        late[i] = covariance[0, i] - reach[i, 0]
    m1, m2 = noise_rate(c, tau)
    kick = np.zeros(d)
    kick[2] = c.sigma * m1
    if c.stages == 2:
        kick[4] = c.sigma * m2
    bent = np.zeros((d, d, d))  # bent[l, i, j]: the quadratic part is in component l
    for k in range(5):
        put(bent[k], congruence(reach, hessian[k]))
    out = np.zeros((d, d, d))
    carried = np.zeros((d, d, d))
    linear = block(first, d, 0, d)
    for a in range(d):
        put(carried[a], congruence(linear, third[a]))
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


@spliced
def flight_third_cumulant(first: Floats, hessian: Floats, p: Floats, q: Floats, slope: Floats, third: Floats) -> float:
    """Third cumulant of the flight time, which is the next tau less the last one: what is bent is the next tau alone.

    The noise beyond the orbit's flight time is no part of it, for that kicks velocities.
    """
    d = p.shape[0]
    own = first[0].copy()  # derivative of the flight time with respect to (s, n)
    own[0] -= 1.0
    reach = np.zeros(d + 4)  # its covariance with (s, n)
    put_row(reach[:d], own[:d] @ p)
    put_row(reach[d:], own[d:] @ q)
    varied = own[d:] @ slope @ own[d:]  # d var(flight | s) / d tau_k
    total = 3.0 * (reach @ hessian[0] @ reach) + 3.0 * varied * reach[0]
    for a in range(d):
        total += own[a] * (own[:d] @ third[a] @ own[:d])
    return float(total)
