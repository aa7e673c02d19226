"""What the noise does to the wheels between impacts: sums of mean zero, the control variates of a
long run.

Over a piece of flight, from a point that is known when it begins to a stopping time, ``W = e^(beta
t) u_end + gamma (e^(beta t) - 1) / beta`` is a martingale of the length of the piece, and so is
``W^2`` less its variance, u a wheel's speed (docs/model.md section 10).  Their sums over the pieces
of a path have the exact mean zero, however it moves.
"""

import math

from rattle.montecarlo.schemes.short_flight import Phase
from rattle.scene import Constants, Floats, Ints
from rattle.scene.compiled import inline, internal
from rattle.scene.drive import sine_cosine
from rattle.scene.impact import struck

CONTROLS = 4
"""Work of the noise on both wheels as seen from the driver; its impulse on wheel 1, times 1, cosine
and sine."""
PIECE_SAMPLES = 16  # samples of the state in a piece
# damping from which a piece would have to be shorter than the distance of two samples
STRONGEST_NOISE = 2.5


def has_controls(c: Constants) -> bool:
    """Whether a scene has these control variates: white noise, one order, and a speed known over a
    piece."""
    return (
        c.sigma > 0.0
        and c.memory == 0.0
        and not c.drive
        and max(c.beta1, c.beta2) <= STRONGEST_NOISE
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


@internal
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
    Shapes: `before` (paths, 4); `out` (paths, CONTROLS).
    """
    mass = c.mu / (1.0 - c.mu) if c.stages == 2 else 0.0
    variance = c.sigma * c.sigma
    last = states.shape[1] - 1
    for p in range(len(rows)):
        at = tau - apart
        here = sine_cosine(at)
        u1 = c.alpha * here[1] - before[p, 1]
        u2 = u1 + before[p, 3]
        k = 0
        j = min(PIECE_SAMPLES - 1, last)
        sum0 = sum1 = sum2 = sum3 = 0.0
        while j <= last:
            cut = tau + j * apart
            impact = k < impacts[p] and rows[p, k, 0] <= cut
            now = cut
            y1 = states[p, j, 1]
            y2 = states[p, j, 3]
            if impact:
                now = rows[p, k, 0]
                y1 = rows[p, k, 3]
                y2 = rows[p, k, 5]
            there = sine_cosine(now)
            moved = c.alpha * there[1]
            end = moved - y1
            growth = _growth(c.beta1, now - at, here, there)
            impulse, work = _piece(c.gamma1, variance, growth, u1, end)
            work -= c.alpha * here[1] * impulse
            if c.stages == 2:
                if c.beta2 != c.beta1:
                    growth = _growth(c.beta2, now - at, here, there)
                other, more = _piece(c.gamma2, variance, growth, u2, end + y2)
                work += mass * (more - c.alpha * here[1] * other)
            sum0 += work
            sum1 += impulse
            sum2 += here[1] * impulse
            sum3 += here[0] * impulse
            if impact:
                # both: the mesh is unpredictable
                first = struck(c, 1, y1, y2)
                second = struck(c, 2, y1, y2)
                y1, y2 = first if abs(rows[p, k, 6]) == 1.0 else second
                k += 1
            elif j == last:
                break
            else:
                j = min(j + PIECE_SAMPLES, last)
            at = now
            here = there
            u1 = moved - y1
            u2 = u1 + y2
        out[p, 0] += sum0
        out[p, 1] += sum1
        out[p, 2] += sum2
        out[p, 3] += sum3
