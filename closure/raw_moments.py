"""Raw moments ``E[xi^n zeta^p]`` of one stage, propagated through a flight in closed form (Eqs. 14, 16).

A flight maps ``(xi, zeta)`` to ``(xi + E zeta + w_1, exp(-beta t) zeta + w_2)`` with ``w`` an independent Gaussian.
The moment equations are linear and close at every order, so their solution is the binomial expansion of that map.  This
holds also for moments that are not realizable: so the published closure can be followed beyond its breakdown.
"""

from math import comb

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import jit
from rattle.scene.damping import decay, phi1
from rattle.scene.flight import NODES, PANEL, WEIGHTS
from rattle.scene.moments import gaussian_raw_moments

Floats = NDArray[np.float64]

BINOMIAL = np.array([[comb(n, k) for k in range(7)] for n in range(7)], dtype=float)


def stage_raw_moments(covariance: Floats, order: int) -> Floats:
    """Raw moments of both stages of Gaussian perturbations.

    Shapes: `covariance` (count, 4, 4); result (count, 2, order + 1, order + 1).
    """
    raw = np.empty((len(covariance), 2, order + 1, order + 1))
    for k, c in enumerate(covariance):
        for i, j in ((0, 0), (1, 2)):
            raw[k, i] = gaussian_raw_moments(c[j, j], c[j, j + 1], c[j + 1, j + 1], order)
    return raw


@jit
def after_flight(raw: Floats, beta: float, t: float, q: Floats) -> Floats:
    """Raw moments after a flight.

    Shapes: `raw` (order + 1, order + 1); `q` (2, 2); result (order + 1, order + 1).

    Examples
    --------
    >>> raw = gaussian_raw_moments(0.0, 0.0, 1.0, 2)              # zeta ~ N(0, 1), xi = 0
    >>> float(after_flight(raw, 0.0, 2.0, np.zeros((2, 2)))[2, 0])  # E[(2 zeta)^2]
    4.0
    """
    order = raw.shape[0] - 1
    e, d = phi1(beta, t), decay(beta, t)
    flown = np.zeros_like(raw)
    for n in range(order + 1):
        for p in range(order + 1 - n):
            for k in range(n + 1):
                flown[n, p] += BINOMIAL[n, k] * e**k * d**p * raw[n - k, p + k]
    noise = gaussian_raw_moments(q[0, 0], q[0, 1], q[1, 1], order)
    out = np.zeros_like(raw)
    for n in range(order + 1):
        for p in range(order + 1 - n):
            for i in range(n + 1):
                for j in range(p + 1):
                    out[n, p] += BINOMIAL[n, i] * BINOMIAL[p, j] * flown[i, j] * noise[n - i, p - j]
    return out


@jit
def unmodulated_covariance(beta: float, sigma: float, t: float) -> Floats:
    """Noise covariance of a flight if the noise on the velocity were not modulated, as in Eq. 14.

    Shapes: result (2, 2).
    """
    q = np.zeros((2, 2))
    panel = min(PANEL, 2.0 / beta) if beta > 0.0 else PANEL
    lag = 0.0
    while lag < t:
        h = min(panel, t - lag)
        for n in range(NODES.size):
            r = lag + h * NODES[n]
            e, d, w = phi1(beta, r), decay(beta, r), sigma * sigma * h * WEIGHTS[n]
            q[0, 0] += w * e * e
            q[0, 1] += w * e * d
            q[1, 1] += w * d * d
        lag += h
        panel = min(PANEL, 2.0 * panel)
    q[1, 0] = q[0, 1]
    return q
