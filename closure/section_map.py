"""The map from a path's own impact to its own next one, and its derivatives.

The section state at the k-th impact is ``s = (tau, x1, y1, x2, y2)``, followed by the deviations of the flanks where
they vary.  ``s' = H(s, n)``: let the path fly for the orbit's flight time, add the flight's noise ``n ~ N(0, Q)``, and
continue (or go back) without noise to the path's own wall.
"""

import numpy as np
from numpy.typing import NDArray

from rattle.closure.flanks import column
from rattle.scene.compiled import jit
from rattle.scene.constants import Constants
from rattle.scene.flight import field, field_rate, jacobian, system_matrix
from rattle.scene.impact import contact_matrix
from rattle.scene.small_matrices import apply, times

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
