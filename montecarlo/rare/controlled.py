"""A path under given increments, without other noise, and how far it is from another event than the orbit's."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.schemes.short_flight import Phase, State, short_flight, sine_cosine
from rattle.scene.compiled import internal, jit
from rattle.scene.constants import Constants
from rattle.scene.impact import struck

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_TRIALS = 40  # for the time of an impact within a step
LOCATED = 1e-13  # distance to the wall at which they end, in half gaps
MOST_STEPS = 100_000  # after which a path is given up


class Origin(NamedTuple):
    """Where controlled paths begin, and the step of their noise."""

    tau: float  # initial time
    state: State  # initial state, after the impact at the start if there is one
    dt: float  # step


class Question(NamedTuple):
    """Which other event is asked for."""

    impact: int  # from 0 on, the impact that is to be another than the orbit's; -1 for none
    flank: int  # ``mesh * side`` of the flank that is to be struck first; the orbit's own if it is to be missed


@internal
def _peak(x0: float, y0: float, x1: float, y1: float, h: float) -> float:
    """Largest x of a step at whose end or turning point x is largest, by the cubic through its ends."""
    if y0 > 0.0 and y1 < 0.0:
        t = y0 / (y0 - y1)
        first, last = (1.0 + 2.0 * t) * x0 + t * h * y0, (3.0 - 2.0 * t) * x1 + (t - 1.0) * h * y1
        return max(x1, (1.0 - t) ** 2 * first + t * t * last)
    return x1


@internal
def _look_at(s: State, flank: int) -> tuple[float, float]:
    """Displacement and velocity towards a flank."""
    side = 1.0 if flank > 0 else -1.0
    return (side * s[0], side * s[1]) if abs(flank) == 1 else (side * s[2], side * s[3])


@internal
def _crossing(c: Constants, phase: Phase, h: float, s: State, e: State, increment: float, flank: int) -> float:
    """Time within a step from s to e at which a flank is crossed outward; infinite for none."""
    wall = c.wall1 if abs(flank) == 1 else c.wall2
    (x0, y0), (x1, y1) = _look_at(s, flank), _look_at(e, flank)
    if (y0 <= 0.0 and y1 <= 0.0) or _peak(x0, y0, x1, y1, h) <= wall:
        return math.inf
    turn = h * y0 / (y0 - y1) if y0 * y1 < 0.0 else 0.0
    low, high = (turn if y0 < 0.0 else 0.0), (h if x1 > wall else turn)
    if x1 <= wall:
        at, _ = short_flight(c, phase, turn, s, increment * turn / h, 0.0)
        if _look_at(at, flank)[0] <= wall:
            return math.inf
    t = high
    for _ in range(MOST_TRIALS):
        at, _ = short_flight(c, phase, t, s, increment * t / h, 0.0)
        x, y = _look_at(at, flank)
        if x > wall:
            high = t
        else:
            low = t
        if abs(x - wall) < LOCATED * wall:
            break
        newton = t - (x - wall) / y if y > 0.0 else low
        t = newton if low < newton < high else 0.5 * (low + high)
    return t


@jit
def follow_controlled(
    c: Constants, origin: Origin, noise: Floats, codes: Ints, asked: Question, rows: Floats
) -> tuple[float, int]:
    """Follow a path under given increments; with a question, up to its impact.

    The limit function is negative where the other event happens: the gap that the flank asked for keeps until the
    orbit's is struck; if the orbit's own is to be missed, how far the path would pass it before it strikes another.

    Returns: The limit function; NaN if an earlier impact is another than the orbit's, and without a question.
    Shapes: `noise` (steps,); `codes` (impacts,); `rows` (impacts, 7).
    """
    n, k, last, left, s = 0, 0, origin.tau, origin.dt, origin.state
    wall = c.wall1 if abs(asked.flank) == 1 else c.wall2
    nearest, approaching = -math.inf, True
    while n < MOST_STEPS:
        tau = origin.tau + (n + 1) * origin.dt - left
        increment = (noise[n] if n < noise.size else 0.0) * left / math.sqrt(origin.dt)
        phase = sine_cosine(tau)
        e, _ = short_flight(c, phase, left, s, increment, 0.0)
        there, met, go = k == asked.impact, 0, left
        for flank in (1, -1, 2, -2):
            if abs(flank) > c.stages or (there and flank == asked.flank):
                continue
            if there and asked.flank != codes[k] and flank != codes[k]:
                continue
            t = _crossing(c, phase, left, s, e, increment, flank)
            if t < go or (t == left and met == 0):
                met, go = flank, t
        if met != 0:
            e, _ = short_flight(c, phase, go, s, increment * go / left, 0.0)
        if there:
            (x0, y0), (x1, y1) = _look_at(s, asked.flank), _look_at(e, asked.flank)
            approaching = approaching or y0 > 0.0 or y1 > 0.0
            if approaching:
                nearest = max(nearest, _peak(x0, y0, x1, y1, go))
            if met != 0:
                return (nearest - wall if asked.flank == codes[k] else wall - nearest), n + 1
        left, s = left - go, e
        if met != 0:
            if there or (asked.impact >= 0 and met != codes[k]):
                return math.nan, n + 1
            rows[k, 0], rows[k, 1], rows[k, 6] = tau + go, tau + go - last, met
            for i in range(4):
                rows[k, 2 + i] = s[i]
            last = tau + go
            y1, y2 = struck(c, abs(met), s[1], s[3])
            side = 1.0 if met > 0 else -1.0
            s = (side * c.wall1 if abs(met) == 1 else s[0], y1, side * c.wall2 if abs(met) == 2 else s[2], y2)
            k += 1
            if k == rows.shape[0]:
                return math.nan, n + 1
            approaching = asked.flank != met
        if met == 0 or left <= 0.0:
            n, left = n + 1, origin.dt
    return math.nan, n
