"""Free flight under noise with a memory: the linear flight of Eq. 8 with the noise eta as one more
state.

``d(xi, eta) = A(tau) (xi, eta) dtau + (0, dW / theta)``, where A holds the matrix of Eq. 8, sigma
times what the noise acts on beside it, the modulation of Eq. 5 or a body, and ``-1 / theta`` for
eta (docs/model.md section 4).  By
Gauss-Legendre quadrature on panels.
"""

import math

import numpy as np

from rattle.scene.compiled import internal, jit
from rattle.scene.drive import acceleration, highest_order, jerk
from rattle.scene.flight import (
    NODES,
    PANEL,
    WEIGHTS,
    fastest_rate,
    jacobian,
    noise_rate,
    system_matrix,
)
from rattle.scene.linear_algebra import congruence, put, times, times_transposed
from rattle.scene.types import Constants, Floats


@internal
def _panels(c: Constants, t: float) -> int:
    """Panels of a flight on which the quadrature is exact to rounding."""
    fastest = max(1.0 / c.memory, highest_order(c.drive), fastest_rate(c))
    return max(1, math.ceil(t * fastest / PANEL))


@internal
def _push(c: Constants, tau: float, h: float) -> tuple[Floats, Floats]:
    """What a unit eta at `tau` adds to the state in a panel of length h, and its derivative by
    `tau`; shapes (2 wheels,)."""
    size = 2 * c.wheels.size
    out = np.zeros(size)
    slope = np.zeros(size)
    for n in range(NODES.size):
        s = h * NODES[n]
        j = jacobian(c, h - s)
        left = h * WEIGHTS[n] * c.sigma * math.exp(-s / c.memory)
        second = acceleration(c.drive, tau + s)
        third = jerk(c.drive, tau + s)
        for k, wheel in enumerate(c.wheels):
            m = noise_rate(c, tau + s, k)
            rate = c.modulates * (wheel.second * third + wheel.first * second)
            for i in range(size):
                out[i] += left * (j[i, 2 * k + 1] * m)
                slope[i] += left * (j[i, 2 * k + 1] * rate)
    return out, slope


@internal
def _of_panel(c: Constants, tau: float, h: float) -> tuple[Floats, Floats]:
    """`propagator` over a panel."""
    size = 2 * c.wheels.size
    whole = np.zeros((size + 1, size + 1))
    rate = np.zeros((size + 1, size + 1))
    pushed, slope = _push(c, tau, h)
    put(whole, jacobian(c, h))
    for i in range(size):
        whole[i, size] = pushed[i]
        rate[i, size] = slope[i]
    whole[size, size] = math.exp(-h / c.memory)
    return whole, rate


@jit
def propagator(c: Constants, tau: float, t: float) -> tuple[Floats, Floats]:
    """Derivative of the end of a flight by its start ``(x1, y1, ..., eta)``, and the derivative of
    that by `tau`.

    Shapes: result (2 wheels + 1, 2 wheels + 1).
    """
    size = 2 * c.wheels.size + 1
    panels = _panels(c, t)
    whole = np.eye(size)
    rate = np.zeros((size, size))
    h = t / panels
    for k in range(panels):
        step, slope = _of_panel(c, tau + k * h, h)
        rate = times(slope, whole) + times(step, rate)
        whole = times(step, whole)
    return whole, rate


@jit
def covariance(c: Constants, tau: float, t: float) -> tuple[Floats, Floats]:
    """Covariance of ``(x1, y1, ..., eta)`` that the noise adds in a flight, and its derivative by
    `tau`.

    What eta is at the start of the flight is not part of it, see `propagator`.

    Shapes: result (2 wheels + 1, 2 wheels + 1).
    """
    size = 2 * c.wheels.size + 1
    last = size - 1
    panels = _panels(c, t)
    h = t / panels
    out = np.zeros((size, size))
    slope = np.zeros((size, size))
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
            for i in range(size):
                for j in range(size):
                    out[i, j] += w * (response[i, last] * response[j, last])
                    crossed = own[i, last] * response[j, last] + response[i, last] * own[j, last]
                    slope[i, j] += w * crossed
    return out, slope


def matrix(c: Constants, tau: float) -> Floats:
    """``A(tau)``.

    Shapes: result (2 wheels + 1, 2 wheels + 1).
    """
    size = 2 * c.wheels.size
    a = np.zeros((size + 1, size + 1))
    a[:size, :size] = system_matrix(c)
    for i in range(c.wheels.size):
        a[2 * i + 1, size] = c.sigma * noise_rate(c, tau, i)
    a[size, size] = -1.0 / c.memory
    return a
