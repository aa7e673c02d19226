"""Free flight under noise with a memory: the linear flight of Eq. 8 with the noise eta as a fifth
state.

``d(xi, eta) = A(tau) (xi, eta) dtau + (0, dW / theta)``, where A holds the matrix of Eq. 8, sigma
times the modulation of Eq. 5 beside it, and ``-1 / theta`` for eta (docs/model.md section 4).  By
Gauss-Legendre quadrature on panels.
"""

import math

import numpy as np

from rattle.scene.compiled import internal, jit
from rattle.scene.drive import acceleration, highest_order, jerk
from rattle.scene.flight import NODES, PANEL, WEIGHTS, jacobian, noise_rate, system_matrix
from rattle.scene.linear_algebra import congruence, times, times_transposed
from rattle.scene.types import Constants, Floats


@internal
def _panels(c: Constants, t: float) -> int:
    """Panels of a flight on which the quadrature is exact to rounding."""
    fastest = max(c.beta1, c.beta2, 1.0 / c.memory, highest_order(c.drive))
    return max(1, math.ceil(t * fastest / PANEL))


@internal
def _push(c: Constants, tau: float, h: float) -> tuple[Floats, Floats]:
    """What a unit eta at `tau` adds to the state in a panel of length h, and its derivative by
    `tau`; shapes (4,)."""
    out = np.zeros(4)
    slope = np.zeros(4)
    for n in range(NODES.size):
        s = h * NODES[n]
        j = jacobian(c, h - s)
        left = h * WEIGHTS[n] * c.sigma * math.exp(-s / c.memory)
        m1, m2 = noise_rate(c, tau + s)
        second = acceleration(c.drive, tau + s)
        r1 = jerk(c.drive, tau + s) + c.beta1 * second
        r2 = (c.beta1 - c.beta2) * second
        if c.stages == 1:
            m2 = 0.0
            r2 = 0.0
        for i in range(4):
            out[i] += left * (j[i, 1] * m1 + j[i, 3] * m2)
            slope[i] += left * (j[i, 1] * r1 + j[i, 3] * r2)
    return out, slope


@internal
def _of_panel(c: Constants, tau: float, h: float) -> tuple[Floats, Floats]:
    """`propagator` over a panel."""
    whole = np.zeros((5, 5))
    rate = np.zeros((5, 5))
    j = jacobian(c, h)
    pushed, slope = _push(c, tau, h)
    for i in range(4):
        for k in range(4):
            whole[i, k] = j[i, k]
        whole[i, 4], rate[i, 4] = pushed[i], slope[i]
    whole[4, 4] = math.exp(-h / c.memory)
    return whole, rate


@jit
def propagator(c: Constants, tau: float, t: float) -> tuple[Floats, Floats]:
    """Derivative of the end of a flight by its start ``(x1, y1, x2, y2, eta)``, and the derivative
    of that by `tau`.

    Shapes: result (5, 5).
    """
    panels = _panels(c, t)
    whole = np.eye(5)
    rate = np.zeros((5, 5))
    h = t / panels
    for k in range(panels):
        step, slope = _of_panel(c, tau + k * h, h)
        rate = times(slope, whole) + times(step, rate)
        whole = times(step, whole)
    return whole, rate


@jit
def covariance(c: Constants, tau: float, t: float) -> tuple[Floats, Floats]:
    """Covariance of ``(x1, y1, x2, y2, eta)`` that the noise adds in a flight, and its derivative
    by `tau`.

    What eta is at the start of the flight is not part of it, see `propagator`.

    Shapes: result (5, 5).
    """
    panels = _panels(c, t)
    h = t / panels
    out = np.zeros((5, 5))
    slope = np.zeros((5, 5))
    for k in range(panels):
        begin = tau + k * h
        step, rate = _of_panel(c, begin, h)
        mixed = times_transposed(times(rate, out), step)
        slope = congruence(step, slope) + mixed + mixed.T
        out = congruence(step, out)
        for n in range(NODES.size):
            s = h * NODES[n]
            response, own = _of_panel(c, begin + s, h - s)
            w = h * WEIGHTS[n] / (c.memory * c.memory)
            for i in range(5):
                for j in range(5):
                    out[i, j] += w * (response[i, 4] * response[j, 4])
                    slope[i, j] += w * (own[i, 4] * response[j, 4] + response[i, 4] * own[j, 4])
    return out, slope


def matrix(c: Constants, tau: float) -> Floats:
    """``A(tau)``.

    Shapes: result (5, 5).
    """
    a = np.zeros((5, 5))
    a[:4, :4] = system_matrix(c)
    m1, m2 = noise_rate(c, tau)
    a[1, 4] = c.sigma * m1
    a[3, 4] = c.sigma * m2 if c.stages == 2 else 0.0
    a[4, 4] = -1.0 / c.memory
    return a
