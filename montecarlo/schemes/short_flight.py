"""The flight of one path over a part of a step, its noise given: the trial of ``exact-flight``.

The noise of a time h is represented by its increment and area: the rate ``dB/ds = (increment + 12
area (s / h - 1/2)) / h``.  Excitation and noise then force Eq. 5 together, ``y' = -beta y + ... +
m(tau + s) (alpha + sigma dB/ds)``, and the Taylor series of the flight follow from a recursion, in
which sine and cosine of the phase are two more series.
"""

import math
from typing import Any

import numpy as np

from rattle.montecarlo.schemes.step_state import (
    AREA,
    INCREMENT,
    MOST_TERMS,
    TERMS_AND_NOISE,
    Progress,
)
from rattle.scene import Constants, Floats
from rattle.scene.compiled import fma, inline, lean
from rattle.scene.drive import (
    begin_derivatives,
    highest_order,
    next_derivative,
    phase_of_orders,
    sine_cosine,
)
from rattle.scene.flight import COMMON

Phase = tuple[float, ...]
"""Sine and cosine of a time; of several orders ``-f''``, ``f'``, ``-f'''`` and the time itself."""

Moved = tuple[Progress, Phase]
"""Where a path has come to within a step, and the phase there."""

NEGLIGIBLE = 1e-16  # size of a Taylor term, relative to the first, after which the series ends
# 1 / k!, of derivative k in the series
FACTORIAL_WEIGHTS = np.array([1.0 / math.factorial(k) for k in range(MOST_TERMS + 1)])
# terms that are summed or left out together: the processor mispredicts where a loop ends whose
# length differs from flight to flight, which costs more than some terms
TERMS_AT_ONCE = 4
# largest h times the fastest rate for which 4, 8, 12, ... terms are enough
LARGEST_FOR_TERMS = np.array(
    [
        (NEGLIGIBLE * math.factorial(k)) ** (1.0 / k)
        for k in range(TERMS_AT_ONCE, MOST_TERMS + 1, TERMS_AT_ONCE)
    ]
)


@inline
def phase_at(drive: Any, tau: float) -> Phase:
    """The phase of a time."""
    if len(drive) == 0:
        return sine_cosine(tau)
    return phase_of_orders(drive, tau)


@inline
def no_phase(drive: Any, tau: float) -> Phase:
    """In place of the phase of a time, for schemes that know none."""
    return (0.0, 0.0) if len(drive) == 0 else (0.0, 0.0, 0.0, 0.0)


@inline
def third_of(drive: Any, phase: Phase) -> float:
    """``-f'''`` of a phase."""
    return phase[1] if len(drive) == 0 else phase[2]


@inline
def shift_phase(drive: Any, phase: Phase, t: float) -> Phase:
    """The phase a time so short later that its square hardly counts."""
    if len(drive) == 0:
        sine, cosine = phase
        half = 0.5 * t
        return sine + t * (cosine - half * sine), cosine - t * (sine + half * cosine)
    return (
        phase[0] + t * phase[2],
        phase[1] - t * (phase[0] + 0.5 * t * phase[2]),
        phase[2],
        phase[3] + t,
    )


@inline
def short_flight(
    c: Constants,
    alpha: float,
    dragged: float,
    phase: Phase,
    h: float,
    s: Floats,
    increment: float,
    area: float,
    series: Floats,
    end: Floats,
) -> Phase:
    """Fly for a time h, at most a step, with given noise; writes the end and returns its phase.

    With u = t / h in [0, 1] the flight is ``dx/du = h y`` and ``dy/du = h (drag - beta y -
    stiffness x + coupling v_p) + m (even + odd u)``, v_p the deviation of the parent's speed; noise
    on a wheel is a drag that grows.  The derivatives of y in u follow from each other, and all
    series are summed until their terms, of relative size ``(h (1 + beta))^k / k!``, are below
    rounding: eight terms at the default step, four at the last trial before an impact.

    `alpha`, `dragged`: the excitation, and 1 with drag or 0 without.  Shapes: `s`, `end` (2
    wheels,); `series` as in `Scratch`, with the noises of single wheels alone.
    """
    fastest = 0.0
    for i in range(c.wheels.size):
        fastest = max(fastest, c.wheels[i].fastest)
    fastest = abs(h) * (highest_order(c.drive) + fastest)
    odd_noise = 12.0 * c.sigma * area
    even_noise = c.sigma * increment - 0.5 * odd_noise
    even = alpha * h + c.modulates * even_noise
    odd = c.modulates * odd_noise
    terms, after = _expand_drive(c.drive, phase, h, fastest, even, odd, series)
    nothing = series.shape[0] - 1  # a row of zeros: the driver does not deviate
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        # read once: what is written below might be what is read, as far as the compiler knows
        by_acceleration = wheel.second
        by_velocity = wheel.first
        sign = wheel.sign
        ratio = wheel.ratio
        drives = wheel.drives != 0
        damped = h * wheel.beta
        coupled = h * wheel.coupling
        pulled = h * h * wheel.stiffness
        speed = series[2 + i]
        carried = series[2 + wheel.parent if wheel.parent >= 0 else nothing]
        x = s[2 * i]
        y = s[2 * i + 1]
        # what does not follow the drive, at the start, and the rate at which that grows
        steady = h * (dragged * wheel.drag - wheel.stiffness * x) + even_noise * wheel.force
        growing = odd_noise * wheel.force
        if wheel.shaking > 0.0:
            odd_alone = 12.0 * c.sigma * (sign * speed[AREA] + ratio * carried[AREA])
            steady += c.sigma * (sign * speed[INCREMENT] + ratio * carried[INCREMENT])
            steady -= 0.5 * odd_alone
            growing += odd_alone
        y_end = y
        moved = 0.0
        before = 0.0
        speed[0] = sign * y + ratio * carried[0]
        for k in range(terms):  # from derivative k in u to the next one
            weight = FACTORIAL_WEIGHTS[k + 1]
            forced = fma(by_acceleration, series[1, k], fma(by_velocity, series[0, k], steady))
            others = fma(coupled, carried[k], forced) - pulled * before
            moved = fma(weight, y, moved)
            before = y
            y = fma(-damped, y, others)
            y_end = fma(weight, y, y_end)
            steady = growing
            growing = 0.0
            if drives:
                speed[k + 1] = fma(sign, y, ratio * carried[k + 1])
        end[2 * i] = x + h * moved
        end[2 * i + 1] = y_end
    return after


@inline
def _expand_drive(
    drive: Any, phase: Phase, h: float, fastest: float, even: float, odd: float, series: Floats
) -> tuple[int, Phase]:
    """Derivatives in u of ``f' (even + odd u)`` and ``f'' (even + odd u)``, as many as are needed,
    and the phase a time h later.

    Of ``f = sin tau`` the derivatives of f' and f'' follow from each other; of several orders
    derivative k and the two after it go along.
    """
    power = 1.0
    first_end = second_end = third_end = 0.0
    first = second = third = 0.0
    if len(drive) == 0:
        second = -phase[0]
        first = phase[1]
    else:
        first, second, third = begin_derivatives(drive, phase[3])
    terms = TERMS_AT_ONCE
    while terms < MOST_TERMS and fastest > LARGEST_FOR_TERMS[terms // TERMS_AT_ONCE - 1]:
        terms += TERMS_AT_ONCE
    velocity_before = 0.0
    acceleration_before = 0.0
    rising = 0.0  # k times `odd`
    for k in range(terms + 1):
        velocity = power * first
        acceleration = power * second
        first_end += FACTORIAL_WEIGHTS[k] * velocity
        second_end += FACTORIAL_WEIGHTS[k] * acceleration
        third_end += FACTORIAL_WEIGHTS[k] * power * third
        series[0, k] = fma(even, velocity, rising * velocity_before)
        series[1, k] = fma(even, acceleration, rising * acceleration_before)
        rising += odd
        velocity_before = velocity
        acceleration_before = acceleration
        if len(drive) == 0:
            first, second = h * second, -h * first
        else:
            power *= h
            first = second
            second = third
            third = next_derivative(drive, k + 1)
    if len(drive) == 0:
        return terms, (-second_end, first_end)
    return terms, (-second_end, first_end, -third_end, phase[3] + h)


@lean
def kick(
    c: Constants,
    tau: float,
    h: float,
    increment: float,
    area: float,
    series: Floats,
    out: Floats,
) -> None:
    """Write the displacement at the end of a time h by given noise, and nothing else (Eq. 5).

    Shapes: `series` as of `short_flight`; `out` (2 wheels,).
    """
    for i in range(out.size):
        out[i] = 0.0
    short_flight(c, 0.0, 0.0, phase_at(c.drive, tau), h, out, increment, area, series, out)


def pushed_by(
    c: Constants, tau: float, h: float, increment: float, area: float, source: int = COMMON
) -> Floats:
    """`kick` as a new array, by the common noise or by that of one wheel alone."""
    out = np.empty(2 * c.wheels.size)
    series = np.zeros((3 + c.wheels.size, TERMS_AND_NOISE))
    if source != COMMON:
        size = c.wheels[source].alone
        series[2 + source, INCREMENT] = size * increment
        series[2 + source, AREA] = size * area
        increment = area = 0.0
    kick(c, tau, h, increment, area, series, out)
    return out
