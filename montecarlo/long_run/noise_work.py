"""What the noise does to the wheels between impacts: sums of mean zero, the control variates of a long run.

Between impacts each wheel flies freely: its speed obeys ``u' = -beta u - gamma - sigma m eta``, the same noise at both
(docs/model.md sections 4 and 10).  Over a piece of flight, from a point that is known when it begins (an impact or a
fixed time) to a stopping time, ``W = e^(beta t) u_end + gamma (e^(beta t) - 1) / beta`` is a martingale of the length
of the piece, and so is ``W^2`` less its variance.  Their sums over the pieces of a path have the exact mean zero,
however the path moves: what chance has put into a path, known from what was recorded anyway.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import inlined, jit
from rattle.scene.constants import Constants
from rattle.scene.impact import struck

__all__ = ["CONTROLS", "LONGEST", "add_noise_work", "has_controls"]

Floats = NDArray[np.float64]

CONTROLS = 4
"""Work of the noise on both wheels as seen from the driver; its impulse on wheel 1, times 1, cosine and sine."""
LONGEST = 16  # samples of the state in a piece
STRONGEST = 2.5  # damping from which a piece would have to be shorter than the distance of two samples


def has_controls(c: Constants) -> bool:
    """Whether a scene has these control variates: there is noise, and damping leaves a speed known over a piece.

    Parameters
    ----------
    c : Constants
        Of the scene.

    Returns
    -------
    bool
    """
    return c.sigma > 0.0 and max(c.beta1, c.beta2) <= STRONGEST


@inlined
def _grown(x: float) -> float:
    """``e^x - 1``; the series, which is faster, where it is exact to 1e-13."""
    if x > 0.1:
        return math.expm1(x)
    return x * (1 + x / 2 * (1 + x / 3 * (1 + x / 4 * (1 + x / 5 * (1 + x / 6 * (1 + x / 7 * (1 + x / 8)))))))


@inlined
def _piece(
    beta: float, gamma: float, variance: float, t: float, from_: tuple[float, float], to: tuple[float, float],
    start: float, end: float,
) -> tuple[float, float]:  # fmt: skip
    """Impulse and work of the noise in a piece of flight; `from_` and `to` are cosine and sine of its ends."""
    grown = _grown(beta * t)
    twice = grown * (2.0 + grown)  # e^(2 beta t) - 1
    length, longer = (grown / beta, 0.5 * twice / beta) if beta > 0.0 else (t, t)
    pulled = (1.0 + grown) * end + gamma * length
    cos0, sin0 = from_[0] * from_[0] - from_[1] * from_[1], 2.0 * from_[0] * from_[1]
    cos1, sin1 = to[0] * to[0] - to[1] * to[1], 2.0 * to[0] * to[1]
    below = 4.0 * (1.0 + beta * beta)
    even = ((1.0 + twice) * 2.0 * (beta * cos1 + sin1) - 2.0 * (beta * cos0 + sin0)) / below
    odd = ((1.0 + twice) * 2.0 * (beta * sin1 - cos1) - 2.0 * (beta * sin0 - cos0)) / below
    square = 0.5 * (1.0 + beta * beta) * longer + 0.5 * (beta * beta - 1.0) * even - beta * odd  # of the modulation
    return pulled - start, 0.5 * (pulled * pulled - start * start - variance * square)


@jit
def add_noise_work(
    c: Constants, rows: Floats, impacts: NDArray[np.int64], before: Floats, states: Floats, tau: float, apart: float,
    out: Floats,
) -> None:  # fmt: skip
    """Add the control variates of a stretch to the sums of each path.

    Parameters
    ----------
    c : Constants
        Of the scene.
    rows, impacts, states, tau, apart
        As of `rattle.montecarlo.long_run.sums.add_stretch`; the last state is that at the end of the stretch.
    before : ndarray, shape (paths, 4)
        States at its begin, ``tau - apart``.
    out : ndarray, shape (paths, CONTROLS)
        Added to.
    """
    mass = c.mu / (1.0 - c.mu) if c.stages == 2 else 0.0
    variance, begin, last = c.sigma * c.sigma, tau - apart, states.shape[1] - 1
    for p in range(len(rows)):
        at, here = begin, (math.cos(begin), math.sin(begin))
        u1 = c.alpha * here[0] - before[p, 1]
        u2, k, j = u1 + before[p, 3], 0, min(LONGEST - 1, last)
        while j <= last:
            cut = tau + j * apart
            impact = k < impacts[p] and rows[p, k, 0] <= cut
            now, y1, y2 = cut, states[p, j, 1], states[p, j, 3]
            if impact:
                now, y1, y2 = rows[p, k, 0], rows[p, k, 3], rows[p, k, 5]
            there = (math.cos(now), math.sin(now))
            end = c.alpha * there[0] - y1
            impulse, work = _piece(c.beta1, c.gamma1, variance, now - at, here, there, u1, end)
            work -= c.alpha * here[0] * impulse
            if c.stages == 2:
                other, more = _piece(c.beta2, c.gamma2, variance, now - at, here, there, u2, end + y2)
                work += mass * (more - c.alpha * here[0] * other)
            out[p, 0] += work
            out[p, 1] += impulse
            out[p, 2] += here[0] * impulse
            out[p, 3] += here[1] * impulse
            if impact:
                y1, y2 = struck(c, abs(int(rows[p, k, 6])), y1, y2)
                k += 1
            elif j == last:
                break
            else:
                j = min(j + LONGEST, last)
            at, here = now, there
            u1 = c.alpha * there[0] - y1
            u2 = u1 + y2
