"""``euler-maruyama``: Eq. 5 by the Euler-Maruyama scheme, with impacts detected at the end of a
step.

A path that ends a step beyond a wall and moves outward is put back on the wall, and the impact rule
is applied.
"""

import math
from functools import partial
from typing import NamedTuple

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.schemes.lanes import Lanes, fill_speeds, join_increments, vector_beside
from rattle.montecarlo.schemes.scheme import Scheme
from rattle.montecarlo.schemes.short_flight import Moved, Phase, no_phase
from rattle.montecarlo.schemes.step_state import Inside, Progress, Scratch, put_on_wall
from rattle.montecarlo.schemes.sticking import stay, stays_open
from rattle.montecarlo.schemes.time_scales import (
    MEMORY_REASON,
    SPRING_REASON,
    Limit,
    least_limit,
    memory_step,
    time_scales,
)
from rattle.montecarlo.schemes.wheel_noise import add_kicks
from rattle.scene import Bools, Constants, Floats, Scene
from rattle.scene.compiled import fma, inline, lean, splice, widest_vectors
from rattle.scene.drive import highest_order, velocity_acceleration

PUSH = 0  # columns of a step's forcing: drift by excitation and drag over the step,
KICK = 1  # and effect of a unit normal


@lean
def step_forcing(c: Constants, tau: float, h: float, forcing: Floats) -> None:
    """Forcing of an Euler-Maruyama step of length h at `tau` (Eq. 5): the part that is the same for
    every path."""
    first, second = velocity_acceleration(c.drive, tau)
    root = c.sigma * math.sqrt(h)
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        m = wheel.second * second + wheel.first * first
        forcing[i, PUSH] = h * (wheel.drag + c.alpha * m)
        forcing[i, KICK] = root * (c.modulates * m + wheel.force)


class GapStep(NamedTuple):
    """What a step makes of a gap, the same for all lanes."""

    h: float  # length
    # share of the rate that is kept; a spring pulls by the place at the end of the step, so that a
    # swing neither gains nor loses energy (symplectic Euler)
    keep: float
    # of the deviation of the parent's speed; of a wheel at the driver of its own displacement,
    # against its spring
    pull: float
    push: float  # push, kick: see the forcing
    kick: float
    wall: float
    toleranced: bool  # whether the flanks of each lane are its own
    seen: bool  # whether other gaps have marked lanes in this step


@inline
def _step_gap(
    f: GapStep,
    x: Floats,
    y: Floats,
    v: Floats,
    z: Floats,
    high: Floats,
    low: Floats,
    beyond: Bools,
) -> None:
    """One step of a gap in all lanes, in place.  Vectorises: what is written is read nowhere
    else."""
    for p in range(beyond.size):
        rate = y[p]
        at = fma(f.h, rate, x[p])
        x[p] = at
        y[p] = fma(f.keep, rate, fma(f.pull, v[p], fma(f.kick, z[p], f.push)))
        out = (at > high[p]) | (-at > low[p]) if f.toleranced else abs(at) > f.wall
        beyond[p] = out | (f.seen & beyond[p])


@inline
def plain_lanes(
    c: Constants,
    wheels: int,
    forcing: Floats,
    h: float,
    toleranced: bool,
    walls: Floats,
    state: Floats,
    speeds: Floats,
    z: Floats,
    beyond: Bools,
) -> None:
    """One Euler-Maruyama step of Eq. 5 without walls, of as many lanes as `beyond` has, in place;
    marks those that are beyond a wall at its end.

    Children before their parents, whose speeds at the start of the step they need.  `walls` is read
    only if they are toleranced.  `wheels`: Their number, which a kernel for two knows.  Shapes:
    `walls`, `state` (2 wheels, lanes or more);
    `speeds` (wheels, lanes or more); `z` (lanes or more,).
    """
    widest_vectors()
    fill_speeds(c, state, speeds, beyond.size)
    last = wheels - 1
    for i in range(last, -1, -1):
        wheel = c.wheels[i]
        parent = wheel.parent
        f = GapStep(
            h,
            1.0 - h * (wheel.beta + h * wheel.stiffness),
            h * (wheel.coupling if parent >= 0 else -wheel.stiffness),
            forcing[i, PUSH],
            forcing[i, KICK],
            wheel.wall,
            toleranced,
            i != last,
        )
        x = state[2 * i]
        y = state[2 * i + 1]
        high = walls[2 * i]
        low = walls[2 * i + 1]
        v = vector_beside(c, i, state, speeds, z)
        _step_gap(f, x, y, v, z, high, low, beyond)


@splice
def step_lanes(
    c: Constants,
    tau: float,
    h: float,
    toleranced: bool,
    lanes: Lanes,
    scratch: Scratch,
    marks: Bools,
    live: int,
) -> None:
    """One step of all lanes; marks those that are beyond a wall at its end."""
    step_forcing(c, tau, h, scratch.forcing)
    plain_lanes(
        c,
        scratch.wheels,
        scratch.forcing,
        h,
        toleranced,
        lanes.walls,
        lanes.state,
        scratch.speeds,
        lanes.w,
        marks[:live],
    )
    if scratch.shaken:
        add_kicks(c, h, lanes, live)


@splice
def advance(inside: Inside, met: int, at: Progress, phase: Phase) -> Moved:
    """Go to the impact that is due at the end of the step: the path is put back on the wall that it
    is beyond, outward.

    The first mesh first; another impact may be due after it.
    """
    s = inside.scratch.state
    walls = inside.scratch.walls
    code = 0
    for i in range(inside.scratch.wheels - 1, -1, -1):
        x = s[2 * i]
        y = s[2 * i + 1]
        above = int((x > walls[2 * i]) & (y > 0.0))
        side = above - int((x < -walls[2 * i + 1]) & (y < 0.0))
        code = side * (i + 1) if side != 0 else code
    if code != 0:
        put_on_wall(s, code, walls)
    left = at.left if code != 0 else 0.0
    return Progress(code, at.tau, left, Noise(0.0, 0.0)), phase


def longest_euler_step(scene: Scene) -> Limit:
    """The longest Euler-Maruyama step that is stable, follows the drive and misses no gap."""
    t = time_scales(scene)
    limits = {
        "a longer step makes the damping unstable": t.damping,
        # its energy swings by this share about the true one
        SPRING_REASON: 0.1 * t.swing,
        MEMORY_REASON: memory_step(scene),
        "a longer step cannot follow the excitation": (
            2.0 * math.pi / 20.0 / highest_order(scene.constants.drive)
        ),
        "a longer step may jump across the gap": 0.5 * t.crossing,
        "a longer step lets the noise throw a path through the gap": 0.25 * t.shaking,
    }
    return least_limit(limits)


def trusted_euler_step(late: float, reversal: float, scene: Scene) -> Limit:
    """The longest Euler-Maruyama step whose bias by noise is small.

    `late`, `reversal`: Shares of the times in which noise takes a path across a gap, and reverses
    its velocity at a wall.
    """
    t = time_scales(scene)
    limits = {
        "a longer step changes the spread of the damped speeds": 0.3 * t.damping,
        SPRING_REASON: 0.01 * t.swing,
        "a longer step detects the impacts of a noisy path late": late * t.shaking,
        "a longer step misses paths that the noise returns to the wall they leave": (
            reversal * t.turning
        ),
    }
    return least_limit(limits)


EULER = Scheme(
    weak_order=1,
    normals=1,
    step=2e-3,
    step_ns=3.9,
    impact_ns=130.0,
    detects_at_end=True,
    longest_step=longest_euler_step,
    trusted_step=partial(trusted_euler_step, 0.01, 0.03),  # at-end detection is half a step late
    step_lanes=step_lanes,
    join_noise=join_increments,
    phase_at=no_phase,
    advance=advance,
    find_sticking=stays_open,
    stick_to_end=stay,
)
