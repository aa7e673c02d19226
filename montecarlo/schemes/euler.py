"""``euler-maruyama``: Eq. 5 by the Euler-Maruyama scheme, with impacts detected at the end of a
step.

A path that ends a step beyond a wall and moves outward is put back on the wall, and the impact rule
is applied.
"""

import math
from functools import partial
from typing import NamedTuple

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.schemes.lanes import Lanes, four, join_increments
from rattle.montecarlo.schemes.scheme import Scheme
from rattle.montecarlo.schemes.short_flight import Phase, no_phase
from rattle.montecarlo.schemes.step_state import Inside, Progress, Walls, put_on_wall
from rattle.montecarlo.schemes.sticking import stay, stays_open
from rattle.montecarlo.schemes.time_scales import (
    MEMORY_REASON,
    Limit,
    least_limit,
    memory_step,
    time_scales,
)
from rattle.scene import Bools, Constants, Floats, Scene
from rattle.scene.compiled import fma, inline, lean, lean_internal, splice, widest_vectors
from rattle.scene.drive import highest_order
from rattle.scene.flight import noise_rate


class StepForcing(NamedTuple):
    """The part of a step that is the same for every path: ``y_i += push_i + kick_i z``, z standard
    normal."""

    push1: float  # push1, push2: drift by excitation and drag, over the step
    kick1: float  # kick1, kick2: effect of a unit normal
    push2: float
    kick2: float


@lean
def step_forcing(c: Constants, tau: float, h: float) -> StepForcing:
    """Forcing of an Euler-Maruyama step of length h at `tau` (Eq. 5)."""
    m1, m2 = noise_rate(c, tau)
    root = c.sigma * math.sqrt(h)
    return StepForcing(
        h * (c.gamma1 + c.alpha * m1),
        root * m1,
        h * (c.gamma1 - c.gamma2 + c.alpha * m2),
        root * m2,
    )


@inline
def euler_step(
    c: Constants, f: StepForcing, h: float, x1: float, y1: float, x2: float, y2: float, z: float
) -> tuple[float, float, float, float]:
    """One Euler-Maruyama step of Eq. 5 without walls."""
    keep1 = 1.0 - h * c.beta1
    keep2 = 1.0 - h * c.beta2
    pull = h * (c.beta2 - c.beta1)
    return (
        fma(h, y1, x1),
        fma(keep1, y1, fma(f.kick1, z, f.push1)),
        fma(h, y2, x2),
        fma(keep2, y2, fma(pull, y1, fma(f.kick2, z, f.push2))),
    )


@lean_internal
def plain_lanes(
    c: Constants,
    f: StepForcing,
    h: float,
    toleranced: bool,
    walls: Floats,
    state: Floats,
    z: Floats,
    beyond: Bools,
) -> None:
    """One step of as many lanes as `beyond` has, in place; marks those that are beyond a wall at
    its end.  Vectorises.

    `walls` is read only if they are toleranced. Shapes: `walls`, `state` (4, lanes or more); `z`
    (lanes or more,).
    """
    widest_vectors()
    x1, y1, x2, y2 = four(state)
    high1, low1, high2, low2 = four(walls)
    if c.stages == 1:
        for p in range(beyond.size):
            x1[p], y1[p], _, _ = euler_step(c, f, h, x1[p], y1[p], 0.0, 0.0, z[p])
            high, low = (high1[p], low1[p]) if toleranced else (c.wall1, c.wall1)
            beyond[p] = (x1[p] > high) | (-x1[p] > low)
        return
    for p in range(beyond.size):
        new = euler_step(c, f, h, x1[p], y1[p], x2[p], y2[p], z[p])
        x1[p], y1[p], x2[p], y2[p] = new
        high, low = (high1[p], low1[p]) if toleranced else (c.wall1, c.wall1)
        other, under = (high2[p], low2[p]) if toleranced else (c.wall2, c.wall2)
        beyond[p] = (new[0] > high) | (-new[0] > low) | (new[2] > other) | (-new[2] > under)


@splice
def step_lanes(
    c: Constants, tau: float, h: float, toleranced: bool, lanes: Lanes, marks: Bools, live: int
) -> None:
    """One step of all lanes; marks those that are beyond a wall at its end."""
    forcing = step_forcing(c, tau, h)
    plain_lanes(c, forcing, h, toleranced, lanes.walls, lanes.state, lanes.w, marks[:live])


@splice
def advance(
    inside: Inside, met: int, at: Progress, phase: Phase, walls: Walls
) -> tuple[Progress, Phase]:
    """Go to the impact that is due at the end of the step: the path is put back on the wall that it
    is beyond, outward.

    Mesh 1 before mesh 2.  Branch-free.
    """
    x1, y1, x2, y2 = at.state
    first = int((x1 > walls.high1) & (y1 > 0.0)) - int((x1 < -walls.low1) & (y1 < 0.0))
    second = int((x2 > walls.high2) & (y2 > 0.0)) - int((x2 < -walls.low2) & (y2 < 0.0))
    code = first if first != 0 else (2 * second if inside.c.stages == 2 else 0)
    x1, x2 = put_on_wall(x1, x2, code, walls)
    left = at.left if code != 0 else 0.0  # another impact may be due after this one
    return Progress(code, at.tau, left, Noise(0.0, 0.0), (x1, y1, x2, y2)), phase


def longest_euler_step(scene: Scene) -> Limit:
    """The longest Euler-Maruyama step that is stable, follows the drive and misses no gap."""
    t = time_scales(scene)
    limits = {
        "a longer step makes the damping unstable": t.damping,
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
