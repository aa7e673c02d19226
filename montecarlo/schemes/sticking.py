"""Sticking and completed chatter within a step.

A mesh that sticks (its contact pushes, at zero relative velocity), or that has had `MOST_IN_A_STEP`
impacts in the step, stays closed to the end of the step; the other stage moves as it does beside a
closed mesh (`rattle.scene.sticking`).  So a mesh opens at the end of a step, late by less than a
step, and an impact of the other stage meanwhile is detected at the start of the next step.
"""

import math

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.schemes.crossing import MARGIN_SDS
from rattle.montecarlo.schemes.short_flight import kick, under
from rattle.montecarlo.schemes.step_state import Progress, Walls, put_on_wall
from rattle.scene import Constants
from rattle.scene.compiled import inline, lean_internal
from rattle.scene.sticking import Sides, find_sticking, open_stage, presses, stick_on, stuck_on


@inline
def stays_open(c: Constants, at: Progress, walls: Walls) -> Sides:
    """Both meshes open: a scheme whose steps know no contact force."""
    return 0, 0


@inline
def stay(c: Constants, at: Progress, sides: Sides, walls: Walls) -> Progress:
    """The path as it is: it has been at the end of its step all the time."""
    return at


@lean_internal
def sides_of(code: int) -> Sides:
    """The mesh of an impact closed on the side of that impact, the other open."""
    side = 1 if code > 0 else -1
    return (side, 0) if abs(code) == 1 else (0, side)


@lean_internal
def sticking_sides(c: Constants, at: Progress, walls: Walls) -> Sides:
    """The sides on which meshes stick for what is left of a step.

    A mesh sticks if it is at a wall with zero velocity and its contact force exceeds what noise
    over this time could overcome (`MARGIN_SDS` sds of it).  Noise with a memory is a known force
    within a step, and part of the drive's.
    """
    spread = c.sigma
    if c.memory > 0.0:
        alpha = c.alpha + c.sigma * at.noise.increment / at.left
        c = under(c, alpha, c.gamma1, c.gamma2)
        spread = 0.0
    x1, y1, x2, y2 = at.state
    flank1 = int(x1 == walls.high1) - int(x1 == -walls.low1)
    flank2 = int(x2 == walls.high2) - int(x2 == -walls.low2) if c.stages == 2 else 0
    if flank1 * y1 > 0.0 or flank2 * y2 > 0.0:
        return 0, 0  # an impact comes first
    touching = flank1 if y1 == 0.0 else 0, flank2 if y2 == 0.0 else 0
    if touching[0] == 0 and touching[1] == 0:
        return touching
    sides = find_sticking(c, at.tau, y1, y2, touching)
    press1, press2 = presses(c, at.tau, y1, y2, sides)
    lift = MARGIN_SDS * spread / math.sqrt(at.left)
    by_driver = lift * math.sqrt(1.0 + max(c.beta1, c.beta2) ** 2)
    lift2 = by_driver if sides[0] != 0 else lift * abs(c.beta1 - c.beta2)
    if (sides[0] != 0 and press1 <= by_driver) or (sides[1] != 0 and press2 <= lift2):
        return 0, 0
    return sides


@lean_internal
def stop_at_wall(
    x: float, y: float, before: float, t: float, high: float, low: float
) -> tuple[float, float]:
    """A stage that went beyond a wall in a time t: put on it, with the speed that it had there,
    until the next step.

    `before`: Velocity at the start of that time.  The acceleration is taken as constant: what is
    gained beyond the wall must not go into the next impact.
    """
    side, beyond = (1.0, x - high) if x > 0.0 else (-1.0, -low - x)
    if beyond <= 0.0:
        return x, y
    gained = 2.0 * beyond * side * (y - before) / t
    return (high if side > 0.0 else -low), side * math.sqrt(max(y * y - gained, 0.0))


@lean_internal
def stick_to_end(c: Constants, at: Progress, sides: Sides, walls: Walls) -> Progress:
    """The path at the end of its step, with some meshes closed until then."""
    first, second = sides
    x1, y1, x2, y2 = at.state
    wall1, _ = put_on_wall(x1, x2, first, walls)
    _, wall2 = put_on_wall(x1, x2, 2 * second, walls)
    if first != 0:
        x1, y1, x2, y2 = stuck_on(c, x1, y1, x2, y2, 1, wall1)
    if second != 0 and first != 0:
        x2 = wall2
        y2 = 0.0
    elif second != 0:
        x1, y1, x2, y2 = stuck_on(c, x1, y1, x2, y2, 2, wall2)
    before1 = y1
    before2 = y2
    x1, y1, x2, y2 = stick_on(c, at.tau, x1, y1, x2, y2, sides, at.left)
    if c.stages == 2 and (first == 0 or second == 0):
        moved, pushed, _, _ = kick(
            open_stage(c, sides), at.tau, at.left, at.noise.increment, at.noise.area
        )
        if first != 0:
            x2 = x2 - moved
            y2 = y2 - pushed
        else:
            x1 = x1 + moved
            y1 = y1 + pushed
    x1, y1 = stop_at_wall(x1, y1, before1, at.left, walls.high1, walls.low1)
    x2, y2 = stop_at_wall(x2, y2, before2, at.left, walls.high2, walls.low2)
    return Progress(0, at.tau + at.left, 0.0, Noise(0.0, 0.0), (x1, y1, x2, y2))
