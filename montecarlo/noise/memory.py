"""Noise with a memory: an Ornstein-Uhlenbeck process in place of white noise (docs/model.md section
4).

``d eta = -eta dtau / theta + dW / theta``, started in its stationary distribution, of variance ``1
/ (2 theta)``.  A step of length h takes the integral of eta in place of the Brownian increment, and
its area in place of that of the Brownian path: the schemes need to know nothing else.  Given eta at
both ends the integral has the mean ``theta tanh(h / 2 theta) (eta_0 + eta_1)`` and the variance ``h
- 2 theta tanh(h / 2 theta)``, and the area a mean in the proportion of ``eta_1 - eta_0``.  What
varies beyond that, of the order ``h^3 / theta^2`` of a variance, is neglected: the area's by
``exact-flight``, the integral's too by the Euler schemes.  So steps are at most a tenth of theta.
"""

import math
from typing import NamedTuple

from rattle.montecarlo.noise.philox import MEMORY, Key, Word, normals
from rattle.scene import Floats
from rattle.scene.compiled import lean, lean_internal, widest_vectors


class Memory(NamedTuple):
    """A step of the process, for compiled code; integral and area in units of the sds of a Brownian
    path."""

    # kept, fresh: share of eta that is left after the step, and sd of what comes to it
    kept: float = 0.0
    fresh: float = 0.0
    whole: float = 0.0  # mean of the integral, for each of both ends
    rest: float = 0.0  # and its sd
    tilt: float = 0.0  # mean of the area, for the difference of the ends


def memory_of(theta: float, h: float) -> Memory:
    """The step of length h of a process with correlation time theta; h is at most theta."""
    if theta == 0.0:
        return Memory()
    x = h / theta
    # h - 2 theta tanh(x / 2)
    variance = theta * x**3 * (1.0 / 12.0 - x**2 / 120.0 + 17.0 * x**4 / 20160.0)
    # theta (1 / 2 - 1 / x + 1 / (e^x - 1))
    area = theta * x * (1.0 / 12.0 - x**2 / 720.0 + x**4 / 30240.0)
    fresh = math.sqrt(-math.expm1(-2.0 * x) / (2.0 * theta))
    whole = theta * math.tanh(0.5 * x) / math.sqrt(h)
    return Memory(math.exp(-x), fresh, whole, math.sqrt(variance / h), area / math.sqrt(h / 12.0))


@lean
def begin_memory(theta: float, key: Key, first: int, eta: Floats) -> None:
    """The process at the start of all paths, from number `first` on."""
    sd = math.sqrt(0.5 / theta)
    for p in range(eta.size):
        eta[p] = sd * normals(key, Word(first + p), Word(0), Word(MEMORY))[0]


@lean_internal
def color_noise(
    m: Memory, eta: Floats, w: Floats, area: Floats, has_area: bool, lanes: int
) -> None:
    """Turn the normals of a step, one or two, into integral and area of the process, in place.
    Vectorises."""
    widest_vectors()
    for p in range(lanes):
        before = eta[p]
        after = m.kept * before + m.fresh * w[p]
        w[p] = m.whole * (before + after)
        if has_area:
            w[p] += m.rest * area[p]
            area[p] = m.tilt * (after - before)
        eta[p] = after
