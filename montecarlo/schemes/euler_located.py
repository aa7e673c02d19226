"""``euler-maruyama-located``: Euler-Maruyama steps that are cut where the path meets a wall.

The displacement of an Euler step is linear in time, so the impact time is exact for the scheme.
The Brownian increment is split there by its bridge, and the scheme goes on with what is left of the
step, through all impacts of both meshes in their true order.
"""

import math
from functools import partial

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import BRIDGE, Word, normals
from rattle.montecarlo.schemes import euler
from rattle.montecarlo.schemes.euler import (
    KICK,
    PUSH,
    longest_euler_step,
    step_forcing,
    trusted_euler_step,
)
from rattle.montecarlo.schemes.lanes import Lanes, join_halves
from rattle.montecarlo.schemes.scheme import Scheme
from rattle.montecarlo.schemes.short_flight import Moved, Phase, no_phase
from rattle.montecarlo.schemes.step_state import (
    FREE,
    SPLITS,
    TOGETHER,
    Inside,
    Progress,
    Scratch,
    at_end,
    parent_deviation,
    put_on_wall,
)
from rattle.montecarlo.schemes.sticking import stays_open, stick_to_end
from rattle.montecarlo.schemes.wheel_noise import (
    add_kick,
    divide_increments,
    gather_alone,
)
from rattle.scene import Bools, Constants
from rattle.scene.compiled import inline, lean, lean_internal


@lean_internal
def step_lanes(
    c: Constants,
    tau: float,
    h: float,
    toleranced: bool,
    lanes: Lanes,
    scratch: Scratch,
    beyond: Bools,
    live: int,
) -> None:
    """One step of all lanes in place, ignoring the walls; marks those that it takes beyond one.
    Vectorises."""
    for i in range(lanes.state.shape[0]):
        for p in range(live):
            lanes.before[i, p] = lanes.state[i, p]
    euler.step_lanes(c, tau, h, True, lanes, scratch, beyond, live)


@lean_internal
def _step_partly(c: Constants, tau: float, h: float, increment: float, scratch: Scratch) -> None:
    """An Euler step of length h with a given Brownian increment, of one path; none for h <= 0."""
    if h <= 0.0:
        return
    s = scratch.state
    step_forcing(c, tau, h, scratch.forcing)
    z = increment / math.sqrt(h)
    for i in range(c.wheels.size - 1, -1, -1):
        wheel = c.wheels[i]
        y = s[2 * i + 1]
        s[2 * i] += h * y
        pulled = h * wheel.coupling * parent_deviation(c, s, i) - h * wheel.stiffness * s[2 * i]
        s[2 * i + 1] = (
            y
            + (pulled - h * wheel.beta * y)
            + scratch.forcing[i, PUSH]
            + scratch.forcing[i, KICK] * z
        )
    if scratch.shaken:
        add_kick(c, s, scratch.series)


@lean
def _reach(x: float, y: float, high: float, low: float) -> float:
    """Time in which a straight line from x at speed y meets ``high`` or ``-low``; infinite for y =
    0."""
    if y == 0.0:
        return math.inf
    gap = high - x if y > 0.0 else low + x
    return max(gap, 0.0) / abs(y)


@inline
def advance(inside: Inside, met: int, at: Progress, phase: Phase) -> Moved:
    """Go to the next wall that the path meets in this step, or to the end of the step.

    A fresh normal splits the increment at the wall (Brownian bridge); there is none for noise with
    a memory, whose integral is nearly straight.
    """
    c = inside.c
    s = inside.scratch.state
    walls = inside.scratch.walls
    normal = 0.0
    index = Word(inside.step) * SPLITS + Word(met)
    if c.memory == 0.0:
        normal = normals(inside.key, inside.path, index, Word(BRIDGE + inside.level))[0]
    whole = at.noise.increment
    reach = math.inf
    struck = 0
    for i in range(c.wheels.size):
        time = _reach(s[2 * i], s[2 * i + 1], walls[2 * i], walls[2 * i + 1])
        if time < reach - TOGETHER:
            reach = time
            struck = i
    if reach >= at.left:
        if inside.scratch.shaken:
            free = inside.scratch.choices[FREE]
            bodies = inside.scratch.bodies
            gather_alone(inside.scratch.alone, c.wheels.size, bodies, free, inside.scratch.series)
        _step_partly(c, at.tau, at.left, whole, inside.scratch)
        return at_end(at), phase
    # the increment up to there, given the whole of it: a Brownian bridge
    spread = math.sqrt(reach * (at.left - reach) / at.left)
    part = whole * reach / at.left + spread * normal
    side = 1 if s[2 * struck + 1] > 0.0 else -1
    if inside.scratch.shaken:
        divide_increments(
            inside.key,
            inside.path,
            index,
            inside.level,
            at.left,
            reach,
            inside.scratch.intensity,
            inside.scratch.alone,
            inside.scratch.series,
        )
    _step_partly(c, at.tau, reach, part, inside.scratch)
    code = side * (struck + 1)
    put_on_wall(s, code, walls)
    if side * s[2 * struck + 1] <= 0.0:
        code = 0  # the noise has reversed the velocity at the wall
    return Progress(code, at.tau + reach, at.left - reach, Noise(whole - part, 0.0)), phase


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
