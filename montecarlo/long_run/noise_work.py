"""What the noise does to the wheels between impacts: sums of mean zero, the control variates of a
long run.

Over a piece of flight, from a point that is known when it begins to a stopping time, ``W = e^(beta
t) u_end + gamma (e^(beta t) - 1) / beta`` is a martingale of the length of the piece, and so is
``W^2`` less its variance, u a wheel's speed (docs/model.md section 10).  Their sums over the pieces
of a path have the exact mean zero, however it moves.
"""

import math

import numpy as np

from rattle.montecarlo.schemes.short_flight import Phase
from rattle.scene import Constants, Floats, Ints
from rattle.scene.compiled import inline, splice
from rattle.scene.drive import sine_cosine
from rattle.scene.flight import put_speeds
from rattle.scene.impact import strike

CONTROLS = 4
"""Work of the noise on all wheels as seen from the driver; its impulse on wheel 1, times 1, cosine
and sine."""
PIECE_SAMPLES = 16  # samples of the state in a piece
# damping from which a piece would have to be shorter than the distance of two samples
STRONGEST_NOISE = 2.5


def has_controls(c: Constants) -> bool:
    """Whether a scene has these control variates: white noise of the drive alone, one order, no
    spring, a restitution that is not random, since a piece begins with the speed after an impact,
    and a speed known over a piece."""
    return (
        c.sigma > 0.0
        and c.memory == 0.0
        and not c.drive
        and c.modulates > 0.0
        and not c.wheels["alone"].any()
        and not c.wheels["variance"].any()
        and float(c.wheels["stiffness"].max()) == 0.0
        and float(c.wheels["beta"].max()) <= STRONGEST_NOISE
    )


@inline
def _expm1(x: float) -> float:
    """``e^x - 1``; the series, which is faster, where it is exact to 1e-13."""
    if x > 0.1:
        return math.expm1(x)
    return x * (
        1.0
        + x
        * (
            1 / 2
            + x
            * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x * (1 / 5040 + x / 40320)))))
        )
    )


@inline
def _growth(beta: float, t: float, from_: Phase, to: Phase) -> tuple[float, float, float]:
    """``e^(beta t)`` over a piece of flight, its integral, and that of the squared modulation with
    ``e^(2 beta t)``."""
    grown = _expm1(beta * t)
    twice = grown * (2.0 + grown)  # e^(2 beta t) - 1
    length = t
    longer = t
    if beta > 0.0:
        per = 1.0 / beta
        length = grown * per
        longer = 0.5 * twice * per
    sin_from, cos_from = from_
    sin_to, cos_to = to
    cos0 = cos_from * cos_from - sin_from * sin_from
    sin0 = 2.0 * cos_from * sin_from
    cos1 = cos_to * cos_to - sin_to * sin_to
    sin1 = 2.0 * cos_to * sin_to
    below = 0.5 / (1.0 + beta * beta)
    even = ((1.0 + twice) * (beta * cos1 + sin1) - (beta * cos0 + sin0)) * below
    odd = ((1.0 + twice) * (beta * sin1 - cos1) - (beta * sin0 - cos0)) * below
    square = 0.5 * (1.0 + beta * beta) * longer + 0.5 * (beta * beta - 1.0) * even - beta * odd
    return 1.0 + grown, length, square


@inline
def _piece(
    gamma: float, variance: float, growth: tuple[float, float, float], start: float, end: float
) -> tuple[float, float]:
    """Impulse and work of the noise in a piece of flight."""
    grown, length, square = growth
    pulled = grown * end + gamma * length
    return pulled - start, 0.5 * (pulled * pulled - start * start - variance * square)


@splice
def add_noise_work(
    c: Constants,
    rows: Floats,
    impacts: Ints,
    before: Floats,
    states: Floats,
    tau: float,
    apart: float,
    out: Floats,
) -> None:
    """Add the control variates of a stretch to the sums of each path.

    `rows`, `impacts`, `states`, `tau`, `apart`: As of
    `rattle.montecarlo.long_run.sums.add_stretch`; the last state is that at the end of the stretch.
    Shapes: `before` (paths, 2 wheels); `out` (paths, CONTROLS).
    """
    wheels = c.wheels.size
    variance = c.sigma * c.sigma
    last = states.shape[1] - 1
    u = np.empty(wheels)
    ends = np.empty(wheels)
    rates = np.empty(2 * wheels)
    code = 2 + 2 * wheels
    for p in range(len(rows)):
        at = tau - apart
        here = sine_cosine(at)
        put_speeds(c, c.alpha * here[1], before[p], u)
        k = 0
        j = min(PIECE_SAMPLES - 1, last)
        sum0 = sum1 = sum2 = sum3 = 0.0
        while j <= last:
            cut = tau + j * apart
            impact = k < impacts[p] and rows[p, k, 0] <= cut
            now = cut
            for i in range(rates.size):
                rates[i] = rows[p, k, 2 + i] if impact else states[p, j, i]
            if impact:
                now = rows[p, k, 0]
            there = sine_cosine(now)
            put_speeds(c, c.alpha * there[1], rates, ends)
            beta = -1.0
            growth = (0.0, 0.0, 0.0)
            first = 0.0
            for i in range(wheels):
                wheel = c.wheels[i]
                if wheel.beta != beta:
                    beta = wheel.beta
                    growth = _growth(beta, now - at, here, there)
                square = variance * wheel.turn * wheel.turn
                impulse, work = _piece(wheel.gamma, square, growth, u[i], ends[i])
                sum0 += wheel.mass * (work - c.alpha * wheel.turn * here[1] * impulse)
                first = impulse if i == 0 else first
            sum1 += first
            sum2 += here[1] * first
            sum3 += here[0] * first
            if impact:
                strike(c, abs(int(rows[p, k, code])), rates)
                k += 1
            elif j == last:
                break
            else:
                j = min(j + PIECE_SAMPLES, last)
            at = now
            here = there
            put_speeds(c, c.alpha * there[1], rates, u)
        out[p, 0] += sum0
        out[p, 1] += sum1
        out[p, 2] += sum2
        out[p, 3] += sum3
