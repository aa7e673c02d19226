"""The flight of one path over a part of a step, its noise given: the trial of ``exact-flight``.

The noise of a time h is represented by its increment and area: the rate ``dB/ds = (increment + 12
area (s / h - 1/2)) / h``.  Excitation and noise then force Eq. 5 together, ``y' = -beta y + ... +
m(tau + s) (alpha + sigma dB/ds)``, and the Taylor series of the flight follow from a recursion, in
which sine and cosine of the phase are two more series.
"""

from typing import Any

from rattle.montecarlo.schemes.step_state import State
from rattle.scene import Constants
from rattle.scene.compiled import inline, lean
from rattle.scene.drive import (
    begin_derivatives,
    highest_order,
    next_derivative,
    phase_of_orders,
    sine_cosine,
)

Phase = tuple[float, ...]
"""Sine and cosine of a time; of several orders ``-f''``, ``f'``, ``-f'''`` and the time itself."""

MOST_TERMS = 60
NEGLIGIBLE = 1e-16  # size of a Taylor term, relative to the first, after which the series ends


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


@lean
def short_flight(
    c: Constants, phase: Phase, h: float, s: State, increment: float, area: float
) -> tuple[State, Phase]:
    """Fly for a time h, at most a step, with given noise.

    With u = s / h in [0, 1] the flight is ``dx/du = h y`` and ``dy1/du = -h beta1 y1 + h gamma1 +
    m1 (even + odd u)``, likewise for stage 2.  All series are summed until their terms, of relative
    size ``(h (1 + beta))^k / k!``, are below rounding: eight terms at the default step, three at
    the last trial before an impact.
    """
    return _fly(c.drive, c, phase, h, s, increment, area)


@inline
def _fly(
    drive: Any, c: Constants, phase: Phase, h: float, s: State, increment: float, area: float
) -> tuple[State, Phase]:
    """`short_flight` for the drive at hand.

    Of ``f = sin tau``, sine and cosine are carried along as two of the series; of several orders,
    Taylor coefficients of ``f'``: its derivative k - 1, and the two after it.
    """
    sine = cosine = first = second = third = 0.0
    moved1 = moved2 = m1_before = m2_before = 0.0
    first_end = second_end = third_end = 0.0
    size = power = 1.0
    if len(drive) == 0:
        sine, cosine = phase
    else:
        first, second, third = begin_derivatives(drive, phase[3])
    odd = 12.0 * c.sigma * area
    even = c.alpha * h + (c.sigma * increment - 0.5 * odd)
    drag1 = h * c.gamma1
    drag2 = h * (c.gamma1 - c.gamma2)
    apart = c.beta2 - c.beta1
    fastest = abs(h) * (highest_order(drive) + max(c.beta1, c.beta2))
    y1 = s[1]
    y2 = s[3]
    y1_end = y1
    y2_end = y2
    sine_end = sine
    cosine_end = cosine
    for k in range(1, MOST_TERMS):  # from the terms in u^(k - 1) to those in u^k
        share = 1.0 / k
        hk = h * share
        if len(drive) == 0:
            m1 = c.beta1 * cosine - sine
            m2 = -apart * cosine
            sine, cosine = hk * cosine, -hk * sine
            sine_end += sine
            cosine_end += cosine
        else:
            first_end += power * first
            second_end += power * second
            third_end += power * third
            m1 = power * (c.beta1 * first + second)
            m2 = -apart * (power * first)
        moved1 += hk * y1
        if c.stages == 2:
            moved2 += hk * y2
            y2 = (share * (drag2 + (even * m2 + odd * m2_before)) + (hk * apart) * y1) - (
                hk * c.beta2
            ) * y2
            y2_end += y2
        y1 = share * (drag1 + (even * m1 + odd * m1_before)) - (hk * c.beta1) * y1
        y1_end += y1
        m1_before = m1
        m2_before = m2
        drag1 = drag2 = 0.0
        size *= fastest * share
        if size < NEGLIGIBLE:
            break
        if len(drive) != 0:
            power *= hk
            first = second
            second = third
            third = next_derivative(drive, k)
    end = s[0] + moved1, y1_end, s[2] + moved2, y2_end
    if len(drive) == 0:
        return end, (sine_end, cosine_end)
    return end, (-second_end, first_end, -third_end, phase[3] + h)


@inline
def under(c: Constants, alpha: float, gamma1: float, gamma2: float) -> Constants:
    """The scene under another excitation and other drags."""
    return Constants(
        alpha,
        c.epsilon,
        c.beta1,
        c.beta2,
        gamma1,
        gamma2,
        c.mu,
        c.wall1,
        c.wall2,
        c.sigma,
        c.stages,
        c.drive,
        c.memory,
    )


@lean
def kick(c: Constants, tau: float, h: float, increment: float, area: float) -> State:
    """Displacement at the end of a time h by given noise alone (Eq. 5)."""
    quiet = under(c, 0.0, 0.0, 0.0)
    return short_flight(quiet, phase_at(c.drive, tau), h, (0.0, 0.0, 0.0, 0.0), increment, area)[0]
