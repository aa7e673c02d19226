"""``euler-maruyama``: Eq. 5 by the Euler-Maruyama scheme, with impacts detected at the end of a step.

A path that ends a step beyond a wall and moves outward is put back on the wall, and the impact rule is applied.
"""

import math
from typing import NamedTuple

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.schemes.step_state import Progress, Walls
from rattle.scene.compiled import fma, inline, lean, splice, widest_vectors
from rattle.scene.constants import Constants
from rattle.scene.flight import noise_rate
from rattle.scene.types import Bools, Floats

QUAD = 4  # steps that are taken in registers, between one reading and one writing of the states
FORCING = 4  # numbers of a `StepForcing`


class StepForcing(NamedTuple):
    """The part of a step that is the same for every path: ``y_i += push_i + kick_i z``, z standard normal."""

    push1: float  # push1, push2: drift by excitation and drag, over the step
    kick1: float  # kick1, kick2: effect of a unit normal
    push2: float
    kick2: float


@lean
def step_forcing(c: Constants, tau: float, h: float) -> StepForcing:
    """Forcing of an Euler-Maruyama step of length h at `tau` (Eq. 5)."""
    m1, m2 = noise_rate(c, tau)
    root = c.sigma * math.sqrt(h)
    return StepForcing(h * (c.gamma1 + c.alpha * m1), root * m1, h * (c.gamma1 - c.gamma2 + c.alpha * m2), root * m2)


@inline
def euler_step(
    c: Constants, f: StepForcing, h: float, x1: float, y1: float, x2: float, y2: float, z: float
) -> tuple[float, float, float, float]:
    """One Euler-Maruyama step of Eq. 5 without walls."""
    keep1, keep2, pull = 1.0 - h * c.beta1, 1.0 - h * c.beta2, h * (c.beta2 - c.beta1)
    return (
        fma(h, y1, x1),
        fma(keep1, y1, fma(f.kick1, z, f.push1)),
        fma(h, y2, x2),
        fma(keep2, y2, fma(pull, y1, fma(f.kick2, z, f.push2))),
    )


@inline
def _forcing_of(row: Floats) -> StepForcing:
    return StepForcing(row[0], row[1], row[2], row[3])


@inline
def _farther(far: float, x: float) -> float:
    """The larger of two numbers; a single instruction."""
    return x if x > far else far


@inline
def _quad(
    c: Constants,
    f: tuple[StepForcing, StepForcing, StepForcing, StepForcing],
    h: float,
    s: tuple[float, float, float, float],
    z: tuple[float, float, float, float],
) -> tuple[tuple[float, float, float, float], float, float, float, float]:
    """State after four steps without walls, and how far x1 and x2 went upward and downward at their ends."""
    s = euler_step(c, f[0], h, s[0], s[1], s[2], s[3], z[0])
    up1, down1, up2, down2 = s[0], -s[0], s[2], -s[2]
    s = euler_step(c, f[1], h, s[0], s[1], s[2], s[3], z[1])
    up1, down1, up2, down2 = _farther(up1, s[0]), _farther(down1, -s[0]), _farther(up2, s[2]), _farther(down2, -s[2])
    s = euler_step(c, f[2], h, s[0], s[1], s[2], s[3], z[2])
    up1, down1, up2, down2 = _farther(up1, s[0]), _farther(down1, -s[0]), _farther(up2, s[2]), _farther(down2, -s[2])
    s = euler_step(c, f[3], h, s[0], s[1], s[2], s[3], z[3])
    up1, down1, up2, down2 = _farther(up1, s[0]), _farther(down1, -s[0]), _farther(up2, s[2]), _farther(down2, -s[2])
    return s, up1, down1, up2, down2


@lean
def four_euler_steps(
    c: Constants,
    forcing: Floats,
    h: float,
    toleranced: bool,
    walls: Floats,
    begin: int,
    state: Floats,
    before: Floats,
    z: Floats,
    beyond: Bools,
    lanes: int,
) -> None:
    """Four steps of some lanes, in registers; marks those that are beyond a wall at the end of any step.  Vectorises.

    `walls`, `state`, `before`: Flanks and states of the paths, and the states before these steps (output);
    `walls` is read only if they are toleranced. Shapes: `forcing` (4, FORCING); `walls`, `state`, `before` (4,
    begin + lanes or more); `z` (4 or more, lanes or more); `beyond` (lanes or more,).
    """
    widest_vectors()
    end = begin + lanes
    x1, y1, x2, y2 = state[0][begin:end], state[1][begin:end], state[2][begin:end], state[3][begin:end]
    a1, b1, a2, b2 = before[0][begin:end], before[1][begin:end], before[2][begin:end], before[3][begin:end]
    high1, low1, high2, low2 = walls[0][begin:end], walls[1][begin:end], walls[2][begin:end], walls[3][begin:end]
    z0, z1, z2, z3 = z[0], z[1], z[2], z[3]
    f = _forcing_of(forcing[0]), _forcing_of(forcing[1]), _forcing_of(forcing[2]), _forcing_of(forcing[3])
    if c.stages == 2 and toleranced:
        for p in range(lanes):
            old = x1[p], y1[p], x2[p], y2[p]
            new, up1, down1, up2, down2 = _quad(c, f, h, old, (z0[p], z1[p], z2[p], z3[p]))
            beyond[p] = (up1 > high1[p]) | (down1 > low1[p]) | (up2 > high2[p]) | (down2 > low2[p])
            a1[p], b1[p], a2[p], b2[p] = old
            x1[p], y1[p], x2[p], y2[p] = new
    elif c.stages == 2:
        for p in range(lanes):
            old = x1[p], y1[p], x2[p], y2[p]
            new, up1, down1, up2, down2 = _quad(c, f, h, old, (z0[p], z1[p], z2[p], z3[p]))
            beyond[p] = (up1 > c.wall1) | (down1 > c.wall1) | (up2 > c.wall2) | (down2 > c.wall2)
            a1[p], b1[p], a2[p], b2[p] = old
            x1[p], y1[p], x2[p], y2[p] = new
    elif toleranced:
        for p in range(lanes):
            old = x1[p], y1[p], 0.0, 0.0
            new, up1, down1, _, _ = _quad(c, f, h, old, (z0[p], z1[p], z2[p], z3[p]))
            beyond[p] = (up1 > high1[p]) | (down1 > low1[p])
            a1[p], b1[p], _, _ = old
            x1[p], y1[p], _, _ = new
    else:
        for p in range(lanes):
            old = x1[p], y1[p], 0.0, 0.0
            new, up1, down1, _, _ = _quad(c, f, h, old, (z0[p], z1[p], z2[p], z3[p]))
            beyond[p] = (up1 > c.wall1) | (down1 > c.wall1)
            a1[p], b1[p], _, _ = old
            x1[p], y1[p], _, _ = new


@splice
def due(c: Constants, x1: float, y1: float, x2: float, y2: float, walls: Walls) -> int:
    """The impact due at the end of a step: beyond a wall and moving outward, mesh 1 before mesh 2.  Branch-free."""
    first = int((x1 > walls.high1) & (y1 > 0.0)) - int((x1 < -walls.low1) & (y1 < 0.0))
    second = int((x2 > walls.high2) & (y2 > 0.0)) - int((x2 < -walls.low2) & (y2 < 0.0))
    return first if first != 0 else (2 * second if c.stages == 2 else 0)


@splice
def put_on_wall(code: int, x1: float, x2: float, walls: Walls) -> tuple[float, float]:
    """Displacements with that of the struck mesh put back on its wall."""
    x1 = walls.high1 if code == 1 else (-walls.low1 if code == -1 else x1)
    x2 = walls.high2 if code == 2 else (-walls.low2 if code == -2 else x2)
    return x1, x2


@splice
def at_end(c: Constants, at: Progress, walls: Walls) -> Progress:
    """The path with the impact that is due at the end of its step."""
    code = due(c, at.x1, at.y1, at.x2, at.y2, walls)
    x1, x2 = put_on_wall(code, at.x1, at.x2, walls)
    return Progress(code, at.tau, 0.0, Noise(0.0, 0.0), x1, at.y1, x2, at.y2)
