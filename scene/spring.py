"""The response of a body that a spring holds, ``x'' + beta x' + stiffness x = ...``: what the
phi-functions of `rattle.scene.damping` are without a spring.

With ``a = beta / 2`` the two rates are ``a -+ sqrt(a^2 - stiffness)``.  Where they are real the
response is a divided difference of the phi-functions of both; else it swings.  Over short times it
is a Taylor series, whose terms follow from the equation.
"""

import math

from rattle.scene.compiled import internal, not_inlined
from rattle.scene.damping import Damped, pair

SHORT = 1.0  # time, in units of the fastest rate, up to which the series is summed
SERIES_TERMS = 24  # to rounding there
APART = 1e-8  # least distance of the two rates, relative to their mean: its square does not count


@internal
def sprung(beta: float, stiffness: float, t: float) -> Damped:
    """Response to a unit speed, its rate, and its integral: the response to a unit acceleration.

    A unit displacement becomes ``1 - stiffness g`` and makes the speed ``-stiffness e``.
    """
    not_inlined()
    if (beta + math.sqrt(stiffness)) * abs(t) < SHORT:
        return _sum_series(beta, stiffness, t)
    mean = 0.5 * beta
    square = mean * mean - stiffness
    if square > 0.0:
        apart = max(math.sqrt(square), APART * mean)
        fast = mean + apart
        slow = stiffness / fast
        q = pair(slow, fast, t)
        e = q.d12 / (fast - slow)
        g = q.e12 / (fast - slow)
        return Damped(e, q.d1 - fast * e, g)
    turn = max(math.sqrt(-square), APART * math.sqrt(stiffness))
    left = math.exp(-mean * t)
    e = left * math.sin(turn * t) / turn
    d = left * math.cos(turn * t) - mean * e
    return Damped(e, d, (1.0 - d - beta * e) / stiffness)


@internal
def _sum_series(beta: float, stiffness: float, t: float) -> Damped:
    """The response over a short time: ``g'' + beta g' + stiffness g = 1`` by powers of the time."""
    before = 0.0
    term = 0.5 * t * t
    g = 0.0
    e = 0.0
    for n in range(2, SERIES_TERMS):
        g += term
        e += n * term
        damping = beta * t * term / (n + 1)
        spring = stiffness * t * t * before / (n * (n + 1))
        before = term
        term = -(damping + spring)
    e = e / t if t != 0.0 else 0.0
    return Damped(e, 1.0 - beta * e - stiffness * g, g)
