"""Closed meshes within a step: a path that rests on a wall, or has more impacts in a step than are followed.

The rule: a mesh that is pressed shut, or has had `MOST_IN_A_STEP` impacts, stays closed to the end of the step; the
other stage moves as it does beside a closed mesh (`rattle.scene.sticking`).  So a mesh opens at the end of a step, late
by less than a step, and an impact of the other stage meanwhile is met at the start of the next one.
"""

import math

from rattle.montecarlo.schemes.exact_flight import STRAY, kick
from rattle.montecarlo.schemes.step_state import Noise, Progress, Walls
from rattle.scene.compiled import lean
from rattle.scene.scene import Constants
from rattle.scene.sticking import Sides, carried, closed_sides, open_stage, presses, settled_on

__all__ = ["OPEN", "sides_of", "stick_to_end", "sticking_sides"]

OPEN: Sides = (0, 0)


@lean
def sides_of(code: int) -> Sides:
    """Closed at the wall of an impact, ``mesh * side``, and nowhere else."""
    side = 1 if code > 0 else -1
    return (side, 0) if abs(code) == 1 else (0, side)


@lean
def sticking_sides(c: Constants, at: Progress, walls: Walls) -> Sides:
    """The sides on which a path rests through what is left of a step; 0 for an open mesh.

    At no speed on its wall, and pressed so that no noise of this time (`STRAY` sds of it) lifts it off.
    """
    flank1 = int(at.x1 == walls.high1) - int(at.x1 == -walls.low1)
    flank2 = int(at.x2 == walls.high2) - int(at.x2 == -walls.low2) if c.stages == 2 else 0
    if flank1 * at.y1 > 0.0 or flank2 * at.y2 > 0.0:
        return 0, 0  # an impact comes first
    touching = flank1 if at.y1 == 0.0 else 0, flank2 if at.y2 == 0.0 else 0
    if touching[0] == 0 and touching[1] == 0:
        return touching
    sides = closed_sides(c, at.tau, at.y1, at.y2, touching)
    press1, press2 = presses(c, at.tau, at.y1, at.y2, sides)
    lift = STRAY * c.sigma / math.sqrt(at.left)
    by_driver = lift * math.sqrt(1.0 + max(c.beta1, c.beta2) ** 2)
    lift2 = by_driver if sides[0] != 0 else lift * abs(c.beta1 - c.beta2)
    if (sides[0] != 0 and press1 <= by_driver) or (sides[1] != 0 and press2 <= lift2):
        return 0, 0
    return sides


@lean
def stick_to_end(c: Constants, at: Progress, sides: Sides, walls: Walls) -> Progress:
    """The path at the end of its step, with these meshes closed until then."""
    first, second = sides
    x1, y1, x2, y2 = at.x1, at.y1, at.x2, at.y2
    if first != 0:
        x1, y1, x2, y2 = settled_on(c, x1, y1, x2, y2, 1, walls.high1 if first > 0 else -walls.low1)
    if second != 0 and first != 0:
        x2, y2 = walls.high2 if second > 0 else -walls.low2, 0.0
    elif second != 0:
        x1, y1, x2, y2 = settled_on(c, x1, y1, x2, y2, 2, walls.high2 if second > 0 else -walls.low2)
    x1, y1, x2, y2 = carried(c, at.tau, x1, y1, x2, y2, sides, at.left)
    if c.stages == 2 and (first == 0 or second == 0):
        moved, pushed, _, _ = kick(open_stage(c, sides), at.tau, at.left, at.noise.increment, 12.0 * at.noise.area)
        if first != 0:
            x2, y2 = x2 - moved, y2 - pushed
        else:
            x1, y1 = x1 + moved, y1 + pushed
    # a stage that has come to its wall is struck in the next step
    x1, x2 = min(max(x1, -walls.low1), walls.high1), min(max(x2, -walls.low2), walls.high2)
    return Progress(0, at.tau + at.left, 0.0, Noise(0.0, 0.0), x1, y1, x2, y2)
