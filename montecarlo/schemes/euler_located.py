"""``euler-maruyama-located``: Euler-Maruyama steps that are cut where the path meets a wall.

The displacement of an Euler step is linear in time, so the impact time is exact for the scheme.
The Brownian increment is split there by its bridge, and the scheme goes on with what is left of the
step, through all impacts of both meshes in their true order.
"""

import math
from functools import partial

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import BRIDGE, Word, normals
from rattle.montecarlo.schemes.euler import (
    euler_step,
    longest_euler_step,
    step_forcing,
    trusted_euler_step,
)
from rattle.montecarlo.schemes.lanes import Lanes, four, join_halves
from rattle.montecarlo.schemes.scheme import Scheme
from rattle.montecarlo.schemes.short_flight import Phase, no_phase
from rattle.montecarlo.schemes.step_state import (
    SPLITS,
    TOGETHER,
    Inside,
    Progress,
    State,
    Walls,
    put_on_wall,
)
from rattle.montecarlo.schemes.sticking import stays_open, stick_to_end
from rattle.scene import Bools, Constants
from rattle.scene.compiled import inline, lean, lean_internal


@inline
def leaves(h: float, x: float, y: float, high: float, low: float) -> bool:
    """Whether a stage's next Euler step, ``x + h y``, ends beyond a wall."""
    end = x + h * y
    return (end > high) | (end < -low)


@lean_internal
def step_lanes(
    c: Constants, tau: float, h: float, toleranced: bool, lanes: Lanes, beyond: Bools, live: int
) -> None:
    """One step of all lanes in place, ignoring the walls; marks those that it takes beyond one.
    Vectorises."""
    f = step_forcing(c, tau, h)
    state = lanes.state
    x1, y1, x2, y2 = four(state)
    high1, low1, high2, low2 = four(lanes.walls)
    z = lanes.w
    for i in range(2 * c.stages):
        for p in range(live):
            lanes.before[i, p] = state[i, p]
    for p in range(live):
        beyond[p] = leaves(h, x1[p], y1[p], high1[p], low1[p])
    if c.stages == 2:
        for p in range(live):
            beyond[p] |= leaves(h, x2[p], y2[p], high2[p], low2[p])
    for p in range(live):
        x1[p], y1[p], x2[p], y2[p] = euler_step(c, f, h, x1[p], y1[p], x2[p], y2[p], z[p])


@lean_internal
def _part_of_step(c: Constants, tau: float, s: float, increment: float, state: State) -> State:
    """State after an Euler step of length s with a given Brownian increment; as it is for s <=
    0."""
    if s <= 0.0:
        return state
    x1, y1, x2, y2 = state
    return euler_step(c, step_forcing(c, tau, s), s, x1, y1, x2, y2, increment / math.sqrt(s))


@lean
def _reach(x: float, y: float, high: float, low: float) -> float:
    """Time in which a straight line from x at speed y meets ``high`` or ``-low``; infinite for y =
    0."""
    if y > 0.0:
        return max(high - x, 0.0) / y
    if y < 0.0:
        return max(low + x, 0.0) / -y
    return math.inf


@inline
def advance(
    inside: Inside, met: int, at: Progress, phase: Phase, walls: Walls
) -> tuple[Progress, Phase]:
    """Go to the next wall that the path meets in this step, or to the end of the step.

    A fresh normal splits the increment at the wall (Brownian bridge); there is none for noise with
    a memory, whose integral is nearly straight.
    """
    c = inside.c
    normal = 0.0
    if c.memory == 0.0:
        index = Word(inside.step) * SPLITS + Word(met)
        normal = normals(inside.key, inside.path, index, Word(BRIDGE + inside.level))[0]
    x1, y1, x2, y2 = at.state
    whole = at.noise.increment
    s1 = _reach(x1, y1, walls.high1, walls.low1)
    s2 = _reach(x2, y2, walls.high2, walls.low2) if c.stages == 2 else math.inf
    first = s1 <= s2 + TOGETHER
    s = s1 if first else s2
    if s >= at.left:
        state = _part_of_step(c, at.tau, at.left, whole, at.state)
        return Progress(0, at.tau + at.left, 0.0, Noise(0.0, 0.0), state), phase
    # the increment up to s, given the whole of it: a Brownian bridge
    part = whole * s / at.left + math.sqrt(s * (at.left - s) / at.left) * normal
    side = 1 if (y1 if first else y2) > 0.0 else -1
    x1, y1, x2, y2 = _part_of_step(c, at.tau, s, part, at.state)
    code = side if first else 2 * side
    x1, x2 = put_on_wall(x1, x2, code, walls)
    if side * (y1 if first else y2) <= 0.0:
        code = 0  # the noise has reversed the velocity at the wall
    noise = Noise(whole - part, 0.0)
    return Progress(code, at.tau + s, at.left - s, noise, (x1, y1, x2, y2)), phase


LOCATED = Scheme(
    weak_order=1,
    normals=1,
    step=2e-3,
    step_ns=5.1,
    impact_ns=250.0,
    detects_at_end=False,
    longest_step=longest_euler_step,
    trusted_step=partial(trusted_euler_step, 0.04, 0.05),
    step_lanes=step_lanes,
    join_noise=join_halves,
    phase_at=no_phase,
    advance=advance,
    find_sticking=stays_open,
    stick_to_end=stick_to_end,
)
