"""The flight of one path over a part of a step, its noise given: the trial of ``exact-flight``.

The noise of a time h is represented by its increment and area (`rattle.montecarlo.noise.brownian`): the rate
``dB/ds = (increment + 12 area (s / h - 1/2)) / h``.  Excitation and noise then force Eq. 5 together, ``y' = -beta y +
... + m(tau + s) (alpha + sigma dB/ds)`` with a modulation m that is a sine and a polynomial beside it, so that the
Taylor series of the flight follow from a recursion.  Sine and cosine of the phase are two of these series: one that
carries them along calls no other function.
"""

import math

from rattle.scene.compiled import lean
from rattle.scene.constants import Constants

State = tuple[float, float, float, float]
"""``x1, y1, x2, y2``."""

Phase = tuple[float, float]
"""Sine and cosine of a time."""

MOST_TERMS = 60
NEGLIGIBLE = 1e-16  # size of a Taylor term, relative to the first, after which the series ends

# pi / 2 in three parts; multiples of the first two below 2^20 are exact
QUARTER_HIGH, QUARTER_MIDDLE = 1.57079632673412561417, 6.07710050630396597660e-11
QUARTER_LOW = 2.02226624879595063154e-21
QUARTERS = 0.63661977236758134308  # 2 / pi


@lean
def sine_cosine(tau: float) -> Phase:
    """Sine and cosine to rounding, by the same operations on every processor.

    Reduction to a quarter turn and the polynomials of FDLIBM (k_sin.c, k_cos.c).

    Examples
    --------
    >>> [round(v, 15) for v in sine_cosine(0.5)]
    [0.479425538604203, 0.877582561890373]
    """
    turns = math.floor(QUARTERS * tau + 0.5)
    x = tau - turns * QUARTER_HIGH - turns * QUARTER_MIDDLE - turns * QUARTER_LOW
    z = x * x
    sine = x + x * z * (
        -1.66666666666666324348e-1
        + z
        * (
            8.33333333332248946124e-3
            + z
            * (
                -1.98412698298579493134e-4
                + z * (2.75573137070700676789e-6 + z * (-2.50507602534068634195e-8 + z * 1.58969099521155010221e-10))
            )
        )
    )
    cosine = 1.0 - (
        0.5 * z
        - z
        * z
        * (
            4.16666666666666019037e-2
            + z
            * (
                -1.38888888888741095749e-3
                + z
                * (
                    2.48015872894767294178e-5
                    + z
                    * (-2.75573143513906633035e-7 + z * (2.08757232129817482790e-9 - z * 1.13596475577881948265e-11))
                )
            )
        )
    )
    quadrant = turns & 3
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


@lean
def short_flight(c: Constants, phase: Phase, h: float, s: State, increment: float, area: float) -> tuple[State, Phase]:
    """Fly for a time h, at most a step, with given noise.

    With u = s / h in [0, 1] the flight is ``dx/du = h y`` and ``dy1/du = -h beta1 y1 + h gamma1 + m1 (even + odd u)``,
    likewise for stage 2.  All series are summed until their terms, of relative size ``(h (1 + beta))^k / k!``, are
    below rounding: eight terms at the default step, three at the last trial before an impact.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> c = Scene.from_gears(DAT21, sigma=0.1).constants
    >>> state, _ = short_flight(c, (0.0, 1.0), 0.01, (0.5, -1.0, 0.1, 0.2), 0.0, 0.0)
    >>> round(state[0], 5)
    0.49001
    """
    odd = 12.0 * c.sigma * area
    even = c.alpha * h + (c.sigma * increment - 0.5 * odd)
    drag1, drag2 = h * c.gamma1, h * (c.gamma1 - c.gamma2)
    apart, fastest = c.beta2 - c.beta1, abs(h) * (1.0 + max(c.beta1, c.beta2))
    sine, cosine = phase
    y1, y2 = s[1], s[3]
    sine_end, cosine_end, y1_end, y2_end, moved1, moved2 = sine, cosine, y1, y2, 0.0, 0.0
    m1_before, m2_before, size = 0.0, 0.0, 1.0
    for k in range(1, MOST_TERMS):  # from the terms in u^(k - 1) to those in u^k
        share = 1.0 / k
        hk = h * share
        m1, m2 = c.beta1 * cosine - sine, -apart * cosine
        moved1 += hk * y1
        if c.stages == 2:
            moved2 += hk * y2
            y2 = (share * (drag2 + (even * m2 + odd * m2_before)) + (hk * apart) * y1) - (hk * c.beta2) * y2
            y2_end += y2
        y1 = share * (drag1 + (even * m1 + odd * m1_before)) - (hk * c.beta1) * y1
        y1_end += y1
        sine, cosine = hk * cosine, -hk * sine
        sine_end += sine
        cosine_end += cosine
        m1_before, m2_before, drag1, drag2 = m1, m2, 0.0, 0.0
        size *= fastest * share
        if size < NEGLIGIBLE:
            break
    return (s[0] + moved1, y1_end, s[2] + moved2, y2_end), (sine_end, cosine_end)


@lean
def kick(c: Constants, tau: float, h: float, increment: float, area: float) -> State:
    """Displacement at the end of a time h by given noise alone (Eq. 5)."""
    quiet = Constants(0.0, c.epsilon, c.beta1, c.beta2, 0.0, 0.0, c.mu, c.wall1, c.wall2, c.sigma, c.stages)
    return short_flight(quiet, sine_cosine(tau), h, (0.0, 0.0, 0.0, 0.0), increment, area)[0]
