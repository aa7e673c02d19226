"""Closed meshes within a step: sticking, completed chatter, and what noise makes of a mesh that is
pressed shut.

A mesh that sticks (its contact pushes, at zero relative velocity) stays closed to the end of the
step, or to the next impact of the other stage, which flies as a single stage meanwhile
(`rattle.scene.sticking`).  So a mesh opens at the end of a step, late by less than a step.  One
that has had `MOST_IN_A_STEP` impacts in the step stays closed to its end.

Where a run allows it (`Quiet`), a mesh is also held closed while noise lifts it by so little that
its impacts are slow: the law of that motion is known, see `rattle.montecarlo.schemes.quiet`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.schemes.crossing import MARGIN_SDS
from rattle.montecarlo.schemes.short_flight import kick
from rattle.montecarlo.schemes.step_state import Progress, Quiet, Scratch, copy_state
from rattle.scene import Constants, Floats, Ints
from rattle.scene.compiled import inline, internal, lean_internal, not_inlined
from rattle.scene.drive import most_modulation, most_velocity, velocity_acceleration
from rattle.scene.flight import flow, wheel_speeds
from rattle.scene.sticking import (
    DRIVER,
    as_bodies,
    close,
    contact_motion,
    find_sticking,
    lock,
    open_meshes,
    put_open,
    take_open,
)

# bound on the rate of fast impacts at a closed mesh, over ``exp(-tail w)``, in its units of time:
# 0.2 to 1.2 for restitutions up to 0.9 and speeds of 4 to 8 units, in 4e5 units of time each
PREFACTOR = 1.2
STEADY_PRESS = 0.1  # largest relative change of the press while a motion at a wall dies away


@inline
def put_all(to: Any, value: Any) -> None:
    """Fill a vector with a value."""
    for i in range(to.size):
        to[i] = value


@inline
def is_any(closed: Ints) -> bool:
    """Whether any mesh is closed."""
    closed_at_all = False
    for i in range(closed.size):
        closed_at_all = closed_at_all or closed[i] != 0
    return closed_at_all


@inline
def stays_open(c: Constants, at: Progress, scratch: Scratch, quiet: Quiet) -> tuple[bool, float]:
    """All meshes open: a scheme whose steps know no contact force."""
    return False, 0.0


@inline
def stay(c: Constants, at: Progress, scratch: Scratch) -> Progress:
    """The path as it is: it has been at the end of its step all the time."""
    return at


@inline
def close_only(code: int, scratch: Scratch) -> None:
    """The mesh of an impact closed on the side of that impact, all others open."""
    for i in range(scratch.sides.size):
        scratch.sides[i] = 0
        scratch.unfollowed[0, i] = 0.0
        scratch.unfollowed[1, i] = 0.0
    scratch.sides[abs(code) - 1] = 1 if code > 0 else -1


@inline
def find_closed(c: Constants, at: Progress, scratch: Scratch, quiet: Quiet) -> tuple[bool, float]:
    """The meshes that are closed for what is left of a step: those that stick, or that noise moves
    too little to be followed.

    Noise with a memory is a known force within a step, and part of the drive's.
    """
    slow = False
    for i in range(c.wheels.size):
        x = scratch.state[2 * i]
        y = scratch.state[2 * i + 1]
        if abs(y) <= quiet.speed:
            slow = True
        elif (x == scratch.walls[2 * i] and y > 0.0) or (
            x == -scratch.walls[2 * i + 1] and y < 0.0
        ):
            return False, 0.0  # an impact comes first
    if not slow:
        return False, 0.0
    above = _close_slow(c, at, scratch, quiet)
    return above >= 0.0, above


class Slow(NamedTuple):
    """The meshes of a path that may be closed; arrays by mesh."""

    sides: Ints  # of the nearest wall
    distance: Floats  # to it
    touches: Ints  # the side of a mesh that rests at its wall or bounces there slowly, else 0


@internal
def _close_slow(c: Constants, at: Progress, scratch: Scratch, quiet: Quiet) -> float:
    """Write the meshes that are closed into the scratch; the bound on the rate of fast impacts that
    are not followed there, or -1 where none is closed."""
    not_inlined()
    spread = c.sigma
    if c.memory > 0.0:
        alpha = c.alpha + c.sigma * at.noise.increment / at.left
        c = Constants(alpha, c.sigma, c.wheels, c.drive, c.memory)
        spread = 0.0
    put_all(scratch.unfollowed[0], 0.0)
    put_all(scratch.unfollowed[1], 0.0)
    s = scratch.state
    slow = _find_slow(c, at.tau, scratch, quiet.speed)
    closed = slow.touches
    if not is_any(closed):
        return -1.0
    if quiet.speed > 0.0:
        closed = _leave_shaken(c, slow.touches, find_sticking(c, at.tau, s, slow.touches))
        above = _hold_quiet(c, at, slow, closed, spread, scratch, quiet)
        if above >= 0.0:
            return above
    still = np.zeros(c.wheels.size, np.int64)
    for i in range(still.size):
        if s[2 * i + 1] == 0.0 and slow.distance[i] == 0.0:
            still[i] = slow.sides[i]
    closed = find_sticking(c, at.tau, s, still)
    leave_lifted(c, at, s, closed, spread)
    copy_state(scratch.sides, closed)
    return 0.0 if is_any(closed) else -1.0


@internal
def _find_slow(c: Constants, tau: float, scratch: Scratch, speed: float) -> Slow:
    """The meshes that rest at their wall, or bounce there below a speed, pressed by what acts on
    them while those above them touch."""
    n = c.wheels.size
    sides = np.zeros(n, np.int64)
    distance = np.empty(n)
    touches = np.zeros(n, np.int64)
    for i in range(n):
        x = scratch.state[2 * i]
        y = scratch.state[2 * i + 1]
        above = scratch.walls[2 * i] - x
        below = scratch.walls[2 * i + 1] + x
        sides[i] = 1 if above <= below else -1
        distance[i] = min(above, below)
        if abs(y) > speed:
            continue
        push = sides[i] * contact_motion(c, tau, scratch.state, touches)[i]
        bounces = push > 0.0 and y * y + 2.0 * push * distance[i] <= speed * speed
        if bounces or (y == 0.0 and distance[i] == 0.0):
            touches[i] = sides[i]
    return Slow(sides, distance, touches)


@internal
def _leave_shaken(c: Constants, touches: Ints, closed: Ints) -> Ints:
    """The closed meshes, without those of a wheel that also touches at a mesh that is not closed:
    every impact there shakes them."""
    kept = closed.copy()
    for i in range(closed.size):
        if touches[i] == 0 or closed[i] != 0:
            continue
        parent = c.wheels[i].parent
        for j in range(closed.size):
            other = c.wheels[j].parent
            if other == i or j == parent or (other == parent and parent >= 0):
                kept[j] = 0
    return kept


@internal
def leave_lifted(c: Constants, at: Progress, s: Floats, closed: Ints, spread: float) -> None:
    """Open all meshes at rest if one of them is not held by more than what noise could overcome
    over the time left (`MARGIN_SDS` sds of it).

    The force in a closed mesh i is what all that is locked below it needs beyond its own free
    motion (docs/model.md section 10).  With the excitation ``a = alpha + sigma eta``, sums M and B
    over that part, and `v_i' = 0` where it is locked to the driver, the part of it with a is

        M kappa_i a (f'' + B f')             locked to the driver,
        M kappa_i a (B - B_root) f'          in a moving body, whose f'' is common to all,

    so that is how the noise acts on it.  What is compared is this force with its own noise: both
    are those of the mass M, not of the wheel alone.  The noise of the wheel alone would be less
    by the share of the wheel in M, and hold a light wheel that carries heavy ones although noise
    lifts it in every other step.
    """
    bodies = lock(c, closed)
    lift = MARGIN_SDS * spread / math.sqrt(at.left)
    pushes = contact_motion(c, at.tau, s, closed)
    lifted = False
    for i in range(closed.size):
        if closed[i] == 0:
            continue
        wheel = c.wheels[i]
        noise = wheel.turn * most_modulation(c.drive, bodies.beta[i])
        if bodies.root[i] != DRIVER:
            apart = abs(bodies.beta[bodies.root[i]] - bodies.beta[i])
            noise = wheel.turn * apart * most_velocity(c.drive)
        # pushes are accelerations of the gap alone
        noise *= bodies.mass[i] / (wheel.mass * (1.0 - wheel.share))
        lifted = lifted or pushes[i] <= lift * noise
    if lifted:
        put_all(closed, 0)


class Bounce(NamedTuple):
    """The motion of a closed mesh at its wall, in which noise lifts what is pressed there."""

    mass: float  # that moves
    speed: float  # of it at the start of the time left
    push: (
        float  # push, later: acceleration into the wall, at the start of the time left and its end
    )
    later: float
    power: float  # power, more: what noise of unit intensity supplies, at both
    more: float


@internal
def _bounce(c: Constants, at: Progress, s: Floats, i: int, side: int, moving: bool) -> Bounce:
    """The motion at a closed mesh: that of its wheel towards the driver, or, where the body with
    its parent is `moving`, of both towards each other."""
    wheel = c.wheels[i]
    u = wheel_speeds(c, at.tau, s)
    first, second = velocity_acceleration(c.drive, at.tau)
    end_first, end_second = velocity_acceleration(c.drive, at.tau + at.left)
    pull = wheel.beta * u[i] + wheel.gamma
    if not moving:
        towards = side * wheel.sign
        m = wheel.turn * (second + wheel.beta * first)
        end_m = wheel.turn * (end_second + wheel.beta * end_first)
        speed = wheel.turn * c.alpha * first - u[i]
        push = towards * (pull + wheel.turn * c.alpha * second)
        later = towards * (wheel.gamma + c.alpha * end_m)
        half = 0.5 * wheel.mass
        return Bounce(wheel.mass, speed, push, later, half * m * m, half * end_m * end_m)
    # the common speed of both wheels hardly changes
    parent = c.wheels[wheel.parent]
    others = wheel.ratio * (parent.beta * u[wheel.parent] + parent.gamma)
    end_pull = wheel.beta * wheel.ratio * u[wheel.parent] + wheel.gamma
    mass = wheel.mass * (1.0 - wheel.share)
    m = wheel.first * first
    end_m = wheel.first * end_first
    push = side * (others - pull)
    later = side * (others - end_pull)
    half = 0.5 * mass
    return Bounce(mass, s[2 * i + 1], push, later, half * m * m, half * end_m * end_m)


@internal
def _hold_quiet(
    c: Constants,
    at: Progress,
    slow: Slow,
    closed: Ints,
    spread: float,
    scratch: Scratch,
    quiet: Quiet,
) -> float:
    """Hold meshes that noise moves too little to be followed, of those that would stick; the bound
    on the rate of fast impacts, or -1 where none is held.

    All that is locked to the driver behind one mesh of it is held together, or that mesh alone, or
    not; of moving bodies those of two wheels.
    """
    n = closed.size
    held = np.zeros(n, np.int64)
    bodies = lock(c, closed)
    top = np.empty(n, np.int64)
    total = 0.0
    for i in range(n):
        parent = c.wheels[i].parent
        top[i] = i if parent < 0 else top[parent]
    for i in range(n):
        if closed[i] == 0:
            continue
        group = np.zeros(n, np.int64)
        moving = bodies.root[i] != DRIVER
        count = 0
        for j in range(n):
            together = bodies.root[j] == bodies.root[i] and (moving or top[j] == i)
            if closed[j] != 0 and together:
                group[j] = closed[j]
                count += 1
        if (moving and count > 1) or (not moving and top[i] != i):
            continue
        above = _bound_fast(c, at, slow, group, moving, spread, scratch, quiet)
        if above < 0.0 and count > 1:
            put_all(group, 0)
            group[i] = closed[i]
            above = _bound_fast(c, at, slow, group, moving, spread, scratch, quiet)
        if above >= 0.0:
            total += above
            for j in range(n):
                held[j] += group[j]
    if not is_any(held):
        return -1.0
    copy_state(scratch.sides, held)
    for i in range(n):
        if held[i] == 0:
            scratch.unfollowed[0, i] = 0.0
            scratch.unfollowed[1, i] = 0.0
    return total


@internal
def _bound_fast(
    c: Constants,
    at: Progress,
    slow: Slow,
    group: Ints,
    moving: bool,
    spread: float,
    scratch: Scratch,
    quiet: Quiet,
) -> float:
    """A bound on the rate of impacts faster than ``quiet.slow`` at meshes that are held closed
    together; -1 where they are not pressed shut long and hard enough to be held.

    A wheel that is pressed against its wall with an acceleration a has under white noise of
    intensity s impacts of about the speed ``s^2 / a`` every ``s^2 / a^2``.  Pushes and noise are
    those at the start of the time left and at its end, whichever is worse.  An impact at a mesh
    moves one wheel alone, and the next mesh closes 1 + epsilon times faster.
    """
    push = math.inf
    later = math.inf
    square = 0.0  # of the noise that moves a mesh
    fastest = 0.0
    limit = quiet.slow
    epsilon = 0.0
    count = 0
    for i in range(group.size):
        if group[i] == 0:
            continue
        limit /= 1.0 + c.wheels[i].epsilon if count > 0 else 1.0
        count += 1
        b = _bounce(c, at, scratch.state, i, group[i], moving)
        push = min(push, b.push)
        later = min(later, b.later)
        square = max(square, 2.0 * spread * spread * max(b.power, b.more) / b.mass)
        fastest = max(fastest, abs(scratch.state[2 * i + 1]))
        epsilon = max(epsilon, c.wheels[i].epsilon)
        motion = 0.5 * b.speed * b.speed + b.push * slow.distance[i]
        scratch.unfollowed[0, i] = b.mass * motion
        scratch.unfollowed[1, i] = 0.5 * spread * spread * (b.power + b.more)
    least = min(push, later)
    if least <= 0.0:
        return -1.0
    slope = abs(later - push) / at.left
    cube = least * least * least
    lasts = quiet.relaxed * square * slope <= cube
    if not lasts or 2.0 * fastest * slope > STEADY_PRESS * (1.0 - epsilon) * least * least:
        return -1.0
    above = 0.0
    if square > 0.0:
        per_time = least * least / square
        above = PREFACTOR * per_time * math.exp(-quiet.tail * limit * least / square)
    return above if above <= quiet.most else -1.0


@lean_internal
def add_closed(closed: Floats, p: int, scratch: Scratch, time: float, above: float) -> None:
    """Add what is not followed of path p while meshes are closed for a time.

    Shapes: `closed` (wheels + 2, lanes), see `rattle.montecarlo.schemes.lanes.Room`.
    """
    n = scratch.sides.size
    for i in range(n):
        closed[i, p] += scratch.unfollowed[0, i] + scratch.unfollowed[1, i] * time
    closed[n, p] += time
    closed[n + 1, p] += above * time


@internal
def close_meshes(c: Constants, scratch: Scratch) -> None:
    """Put the closed meshes of a path on their walls, in its state."""
    not_inlined()
    sides = scratch.sides
    places = np.zeros(sides.size)
    for i in range(sides.size):
        if sides[i] != 0:
            places[i] = scratch.walls[2 * i] if sides[i] > 0 else -scratch.walls[2 * i + 1]
    copy_state(scratch.state, close(c, scratch.state, sides, places))


@lean_internal
def stop_at_wall(
    x: float, y: float, before: float, t: float, high: float, low: float
) -> tuple[float, float]:
    """A gap that went beyond a wall in a time t: put on it, with the speed that it had there, until
    the next step.

    `before`: Velocity at the start of that time.  The acceleration is taken as constant: what is
    gained beyond the wall must not go into the next impact.
    """
    side, beyond = (1.0, x - high) if x > 0.0 else (-1.0, -low - x)
    if beyond <= 0.0:
        return x, y
    gained = 2.0 * beyond * side * (y - before) / t
    return (high if side > 0.0 else -low), side * math.sqrt(max(y * y - gained, 0.0))


@internal
def stick_to_end(c: Constants, at: Progress, scratch: Scratch) -> Progress:
    """The path at the end of its step, with some meshes closed until then."""
    not_inlined()
    close_meshes(c, scratch)
    free = open_meshes(scratch.sides)
    c = as_bodies(c, scratch.sides)
    s = take_open(scratch.state, free)
    walls = take_open(scratch.walls, free)
    after = flow(c, at.tau, s, at.left)
    pushed = np.empty(s.size)
    kick(c, at.tau, at.left, at.noise.increment, at.noise.area, scratch.series, pushed)
    for i in range(free.size):
        x = after[2 * i] + pushed[2 * i]
        y = after[2 * i + 1] + pushed[2 * i + 1]
        high = walls[2 * i]
        low = walls[2 * i + 1]
        x, y = stop_at_wall(x, y, s[2 * i + 1], at.left, high, low)
        after[2 * i] = x
        after[2 * i + 1] = y
    copy_state(scratch.state, put_open(scratch.state, free, after))
    return Progress(0, at.tau + at.left, 0.0, Noise(0.0, 0.0))
