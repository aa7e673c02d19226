"""A whole step of ``exact-flight`` for all paths side by side, and which of them may have an impact.

Between impacts Eq. 5 is linear: the state after a step is the flight of Eq. 3 plus a Gaussian displacement, the noise's
increment and area times vectors that are the same for all paths.
"""

import math
from typing import NamedTuple

from rattle.montecarlo.schemes.crossing import margins, near_wall
from rattle.montecarlo.schemes.short_flight import State, kick, phase_at, short_flight
from rattle.scene.compiled import inline, lean
from rattle.scene.constants import Constants
from rattle.scene.damping import pair
from rattle.scene.types import Bools, Floats


class FlightForcing(NamedTuple):
    """A step of all lanes: ``s' = J s + drift + z_w along + z_a across``, and the margins of the walls."""

    # entries of the flight's Jacobian J that are neither 0 nor 1: of x1 and y1 by y1, x2 by y1 and y2, y2 by y1 and y2
    carry: tuple[float, float, float, float, float, float]
    drift: State  # effect of excitation and drag on ``(x1, y1, x2, y2)``
    along: State  # along, across: effect of a unit normal for the increment, and for the area
    across: State
    margin1: float  # margin1, margin2: of both stages, see `rattle.montecarlo.schemes.crossing.margins`
    margin2: float


@lean
def flight_forcing(c: Constants, tau: float, h: float) -> FlightForcing:
    """Everything in a step that is the same for all paths."""
    p = pair(c.beta1, c.beta2, h)
    phase = phase_at(c.drive, tau)
    margin1, margin2 = margins(c, phase[0], phase[1], h)
    drift, _ = short_flight(c, phase, h, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0)
    along, across = kick(c, tau, h, math.sqrt(h), 0.0), kick(c, tau, h, 0.0, math.sqrt(h / 12.0))
    return FlightForcing((p.e1, p.d1, p.e12, p.e2, p.d12, p.d2), drift, along, across, margin1, margin2)


@inline
def first_stage(f: FlightForcing, x1: float, y1: float, z: float, area: float) -> tuple[float, float]:
    """Stage 1 after a step, ignoring the walls."""
    return (
        x1 + f.carry[0] * y1 + (f.drift[0] + f.along[0] * z + f.across[0] * area),
        f.carry[1] * y1 + (f.drift[1] + f.along[1] * z + f.across[1] * area),
    )


@inline
def second_stage(f: FlightForcing, x2: float, y1: float, y2: float, z: float, area: float) -> tuple[float, float]:
    """Stage 2 after a step, ignoring the walls."""
    return (
        x2 + (f.carry[2] * y1 + f.carry[3] * y2 + (f.drift[2] + f.along[2] * z + f.across[2] * area)),
        f.carry[4] * y1 + f.carry[5] * y2 + (f.drift[3] + f.along[3] * z + f.across[3] * area),
    )


@lean
def flight_lanes(
    c: Constants,
    f: FlightForcing,
    h: float,
    toleranced: bool,
    walls: Floats,
    state: Floats,
    before: Floats,
    z: Floats,
    area: Floats,
    near: Bools,
    lanes: int,
) -> None:
    """One step of all lanes in place, ignoring the walls; marks those that may have an impact.  Vectorises.

    `walls`, `state`: Flanks and states of the paths; `walls` is read only if they are toleranced. Shapes:
    `walls`, `state` (4, lanes or more); `before` (4, lanes or more).
    """
    x1, y1, x2, y2 = state[0], state[1], state[2], state[3]
    x1_before, y1_before, x2_before, y2_before = before[0], before[1], before[2], before[3]
    high1, low1, high2, low2 = walls[0], walls[1], walls[2], walls[3]
    third = h / 3.0
    for p in range(lanes):
        x, y = x1[p], y1[p]
        end, speed = first_stage(f, x, y, z[p], area[p])
        high, low = (high1[p], low1[p]) if toleranced else (c.wall1, c.wall1)
        meets = near_wall(third, x, y, end, speed, high, low, f.margin1)
        x1_before[p], y1_before[p], x1[p], y1[p] = x, y, end, speed
        if c.stages == 2:
            u, v = x2[p], y2[p]
            end, speed = second_stage(f, u, y, v, z[p], area[p])
            high, low = (high2[p], low2[p]) if toleranced else (c.wall2, c.wall2)
            meets |= near_wall(third, u, v, end, speed, high, low, f.margin2)
            x2_before[p], y2_before[p], x2[p], y2[p] = u, v, end, speed
        near[p] = meets
