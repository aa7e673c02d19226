"""Euler-Maruyama on Eqs. 5-6, and two ways of meeting a wall; scalar, for one path.

``euler-maruyama`` looks at the end of the step: a path beyond a wall and moving outward is put back on the wall
and thrown back.  ``euler-maruyama-located`` finds the impact inside the step: the displacement of an Euler step is
a straight line, so the instant is exact for the scheme; the Brownian increment is split there by its bridge,
and the rest of the step is carried on, through as many impacts at either mesh as come, in their true order.
"""

import math
from typing import NamedTuple

from scene.compiled import jit
from scene.flight import noise_rate
from scene.scene import Constants

__all__ = [
    "MOST_IN_A_STEP",
    "SCHEMES",
    "Progress",
    "StepForcing",
    "advance_at_end",
    "advance_inside",
    "euler_step",
    "step_forcing",
]

SCHEMES = {"euler-maruyama": False, "euler-maruyama-located": True}
"""Name of a scheme: whether it locates impacts inside the step."""

MOST_IN_A_STEP = 64
"""Impacts of one path within one step; beyond, the path rests where it is to the end of the step, and is counted."""


class StepForcing(NamedTuple):
    """What a step does to every path alike: ``y_i += push_i + kick_i z``, z standard normal."""

    push1: float
    kick1: float
    push2: float
    kick2: float


class Progress(NamedTuple):
    """A path within a step: how far it has come, and what it meets there.

    ``code`` is ``mesh * side`` of an impact that is due at this very state, or 0.  ``left`` is the time to the end of
    the step, ``increment`` the Brownian increment over that time.
    """

    code: int
    tau: float
    left: float
    increment: float
    x1: float
    y1: float
    x2: float
    y2: float


@jit
def step_forcing(c: Constants, tau: float, h: float) -> StepForcing:
    """Forcing of an Euler-Maruyama step of length h at `tau` (Eq. 5)."""
    m1, m2 = noise_rate(c, tau)
    root = c.sigma * math.sqrt(h)
    return StepForcing(
        h * (c.gamma1 + c.alpha * m1), root * m1, h * (c.gamma1 - c.gamma2 + c.alpha * m2), root * m2
    )  # fmt: skip


@jit
def euler_step(
    c: Constants, f: StepForcing, h: float, x1: float, y1: float, x2: float, y2: float, z: float
) -> tuple[float, float, float, float]:
    """One Euler-Maruyama step of Eq. 5 without walls; `z` is the one standard normal that both stages share."""
    return (
        x1 + h * y1,
        y1 - h * c.beta1 * y1 + f.push1 + f.kick1 * z,
        x2 + h * y2,
        y2 - h * c.beta2 * y2 + h * (c.beta2 - c.beta1) * y1 + f.push2 + f.kick2 * z,
    )


@jit
def _part_of_step(
    c: Constants, tau: float, s: float, increment: float, x1: float, y1: float, x2: float, y2: float
) -> tuple[float, float, float, float]:
    if s <= 0.0:
        return x1, y1, x2, y2
    return euler_step(c, step_forcing(c, tau, s), s, x1, y1, x2, y2, increment / math.sqrt(s))


@jit
def advance_at_end(
    c: Constants, at: Progress, normal: float, high1: float, low1: float, high2: float, low2: float
) -> Progress:
    """Go to the end of the step; the impact due there, mesh 1 before mesh 2 (`normal` is not used)."""
    x1, y1, x2, y2 = _part_of_step(c, at.tau, at.left, at.increment, at.x1, at.y1, at.x2, at.y2)
    tau = at.tau + at.left
    if x1 > high1 and y1 > 0.0:
        return Progress(1, tau, 0.0, 0.0, high1, y1, x2, y2)
    if x1 < -low1 and y1 < 0.0:
        return Progress(-1, tau, 0.0, 0.0, -low1, y1, x2, y2)
    if c.stages == 2 and x2 > high2 and y2 > 0.0:
        return Progress(2, tau, 0.0, 0.0, x1, y1, high2, y2)
    if c.stages == 2 and x2 < -low2 and y2 < 0.0:
        return Progress(-2, tau, 0.0, 0.0, x1, y1, -low2, y2)
    return Progress(0, tau, 0.0, 0.0, x1, y1, x2, y2)


@jit
def _reach(x: float, y: float, high: float, low: float) -> float:
    """Time in which a straight line from x at speed y meets ``high`` or ``-low``; infinite for y = 0."""
    if y > 0.0:
        return max(high - x, 0.0) / y
    if y < 0.0:
        return max(low + x, 0.0) / -y
    return math.inf


@jit
def advance_inside(
    c: Constants, at: Progress, normal: float, high1: float, low1: float, high2: float, low2: float
) -> Progress:
    """Go to the next wall that the path meets in this step, or to the step's end.

    `normal` is a standard normal of its own for every call: it splits the increment at the wall.
    """
    x1, y1, x2, y2 = at.x1, at.y1, at.x2, at.y2
    s1 = _reach(x1, y1, high1, low1)
    s2 = _reach(x2, y2, high2, low2) if c.stages == 2 else math.inf
    s = min(s1, s2)
    if s >= at.left:
        x1, y1, x2, y2 = _part_of_step(c, at.tau, at.left, at.increment, x1, y1, x2, y2)
        return Progress(0, at.tau + at.left, 0.0, 0.0, x1, y1, x2, y2)
    # the increment up to s, given the whole of it: a Brownian bridge
    part = at.increment * s / at.left + math.sqrt(s * (at.left - s) / at.left) * normal
    first = s1 <= s2
    side = 1 if (y1 if first else y2) > 0.0 else -1
    x1, y1, x2, y2 = _part_of_step(c, at.tau, s, part, x1, y1, x2, y2)
    tau, left, increment = at.tau + s, at.left - s, at.increment - part
    if first:
        x1 = high1 if side > 0 else -low1
        code = side if side * y1 > 0.0 else 0  # 0: the noise has turned the path at the wall
    else:
        x2 = high2 if side > 0 else -low2
        code = 2 * side if side * y2 > 0.0 else 0
    return Progress(code, tau, left, increment, x1, y1, x2, y2)
