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

from rattle.montecarlo.schemes.crossing import MARGIN_SDS
from rattle.montecarlo.schemes.short_flight import kick
from rattle.montecarlo.schemes.step_state import (
    FREE,
    GROUP,
    HELD,
    LEFT,
    STICKING,
    TOP,
    TOUCHING,
    UNSHAKEN,
    Progress,
    Quiet,
    Scratch,
    at_end,
    copy_state,
    due_side,
)
from rattle.montecarlo.schemes.wheel_noise import gather_alone
from rattle.scene import Constants, Floats, Ints
from rattle.scene.compiled import inline, internal, lean_internal, not_inlined, splice
from rattle.scene.drive import most_modulation, most_velocity, velocity_acceleration
from rattle.scene.flight import flow
from rattle.scene.sticking import (
    DRIVER,
    Driver,
    close,
    contact_motion,
    find_sticking,
    list_open,
    lock,
    put_open,
    take_open,
    write_bodies,
)
from rattle.scene.types import Bodies
from rattle.scene.wheel import with_known_noise, with_wheels

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
def stays_open(c: Constants, at: Progress, scratch: Scratch, quiet: Quiet) -> float:
    """All meshes open: a scheme whose steps know no contact force."""
    return -1.0


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
    scratch.sides[abs(code) - 1] = due_side(code)


@splice
def find_closed(c: Constants, at: Progress, scratch: Scratch, quiet: Quiet) -> float:
    """Write the meshes that are closed for what is left of a step: those that stick, or that noise
    moves too little to be followed; the bound on the rate of fast impacts that are not followed
    there, or -1 where none is closed.

    Noise with a memory is a known force within a step.
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
            return -1.0  # an impact comes first
    return _close_slow(c, at, scratch, quiet) if slow else -1.0


@splice
def _close_slow(c: Constants, at: Progress, scratch: Scratch, quiet: Quiet) -> float:
    """`find_closed` where a gap is slow enough, and none is due for an impact."""
    spread = c.sigma
    if c.memory > 0.0:
        c = with_known_noise(c, c.sigma * at.noise.increment / at.left)
        spread = 0.0
    put_all(scratch.unfollowed[0], 0.0)
    put_all(scratch.unfollowed[1], 0.0)
    s = scratch.state
    bodies = scratch.bodies
    touching = scratch.choices[TOUCHING]
    sticking = scratch.choices[STICKING]
    driver = velocity_acceleration(c.drive, at.tau)
    _find_touching(c, driver, scratch, quiet.speed)
    if not is_any(touching):
        return -1.0
    if quiet.speed > 0.0:
        find_sticking(c, driver, s, touching, sticking, bodies)
        _leave_shaken(c, scratch)
        ahead = velocity_acceleration(c.drive, at.tau + at.left)
        above = _hold_quiet(c, at.left, driver, ahead, spread, scratch, quiet)
        if above >= 0.0:
            return above
    for i in range(c.wheels.size):
        side, distance = _nearest_wall(scratch, i)
        rests = s[2 * i + 1] == 0.0 and distance == 0.0
        touching[i] = side if rests else 0
    if not is_any(touching):
        return -1.0
    find_sticking(c, driver, s, touching, sticking, bodies)
    leave_lifted(c, at.left, sticking, spread, bodies)
    copy_state(scratch.sides, sticking)
    return 0.0 if is_any(sticking) else -1.0


@inline
def _nearest_wall(scratch: Scratch, i: int) -> tuple[int, float]:
    """The side of the wall of a path that is nearest in a gap, and the distance to it."""
    x = scratch.state[2 * i]
    above = scratch.walls[2 * i] - x
    below = scratch.walls[2 * i + 1] + x
    return (1, above) if above <= below else (-1, below)


@splice
def _find_touching(c: Constants, driver: Driver, scratch: Scratch, speed: float) -> None:
    """Write the meshes that rest at their wall, or bounce there below a speed, pressed by what acts
    on them while those above them touch."""
    touching = scratch.choices[TOUCHING]
    put_all(touching, 0)
    changed = True
    for i in range(c.wheels.size):
        y = scratch.state[2 * i + 1]
        if abs(y) > speed:
            continue
        if changed:
            contact_motion(c, driver, scratch.state, touching, scratch.bodies)
            changed = False
        side, distance = _nearest_wall(scratch, i)
        push = side * scratch.bodies[i].push
        bounces = push > 0.0 and y * y + 2.0 * push * distance <= speed * speed
        if bounces or (y == 0.0 and distance == 0.0):
            touching[i] = side
            changed = True


@splice
def _leave_shaken(c: Constants, scratch: Scratch) -> None:
    """Write the meshes that stick, without those of a wheel that also touches at a mesh that does
    not, which every impact there shakes; and the bodies that they make."""
    touching = scratch.choices[TOUCHING]
    sticking = scratch.choices[STICKING]
    kept = scratch.choices[UNSHAKEN]
    copy_state(kept, sticking)
    shaken = False
    for i in range(kept.size):
        if touching[i] == 0 or sticking[i] != 0:
            continue
        shaken = True
        parent = c.wheels[i].parent
        for j in range(kept.size):
            other = c.wheels[j].parent
            if other == i or j == parent or (other == parent and parent >= 0):
                kept[j] = 0
    if shaken:
        lock(c, kept, scratch.bodies)


@lean_internal
def leave_lifted(c: Constants, left: float, closed: Ints, spread: float, bodies: Bodies) -> None:
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
    lift = MARGIN_SDS * spread / math.sqrt(left)
    lifted = False
    for i in range(closed.size):
        if closed[i] == 0:
            continue
        wheel = c.wheels[i]
        body = bodies[i]
        noise = c.modulates * wheel.turn * most_modulation(c.drive, body.beta) + body.own
        noise += body.alone
        if body.root != DRIVER:
            root = bodies[body.root]
            apart = abs(root.beta - body.beta)
            noise = c.modulates * wheel.turn * apart * most_velocity(c.drive)
            noise += abs(body.own - body.carry * root.own)
            noise += body.alone + body.carry * root.alone
        # pushes are accelerations of the gap alone
        noise *= body.mass / (wheel.mass * (1.0 - wheel.share))
        lifted = lifted or body.push <= lift * noise
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


@inline
def _bounce(
    c: Constants,
    driver: Driver,
    ahead: Driver,
    scratch: Scratch,
    i: int,
    side: int,
    moving: bool,
) -> Bounce:
    """The motion at a closed mesh: that of its wheel towards the driver, or, where the body with
    its parent is `moving`, of both towards each other."""
    wheel = c.wheels[i]
    u = scratch.bodies[i].speed
    steady = wheel.gamma + c.pressing * wheel.own
    pull = wheel.beta * u + steady
    if moving:
        # the common speed of both wheels hardly changes
        parent = c.wheels[wheel.parent]
        by_parent = scratch.bodies[wheel.parent].speed
        others = wheel.ratio * (parent.beta * by_parent + parent.gamma + c.pressing * parent.own)
        end_pull = wheel.beta * wheel.ratio * by_parent + steady
        mass = wheel.mass * (1.0 - wheel.share)
        noise = c.modulates * wheel.first * driver[0] + wheel.force
        end_noise = c.modulates * wheel.first * ahead[0] + wheel.force
        intensity = wheel.shaking
        speed = scratch.state[2 * i + 1]
        push = side * (others - pull)
        later = side * (others - end_pull)
    else:
        towards = side * wheel.sign
        mass = wheel.mass
        end_m = wheel.turn * (ahead[1] + wheel.beta * ahead[0])
        noise = c.modulates * (wheel.turn * (driver[1] + wheel.beta * driver[0])) + wheel.own
        end_noise = c.modulates * end_m + wheel.own
        intensity = wheel.alone
        speed = wheel.turn * c.alpha * driver[0] - u
        push = towards * (pull + wheel.turn * c.alpha * driver[1])
        later = towards * (steady + c.alpha * end_m)
    half = 0.5 * mass
    alone = half * intensity * intensity
    power = half * noise * noise + alone
    more = half * end_noise * end_noise + alone
    return Bounce(mass, speed, push, later, power, more)


@splice
def _hold_quiet(
    c: Constants,
    left: float,
    driver: Driver,
    ahead: Driver,
    spread: float,
    scratch: Scratch,
    quiet: Quiet,
) -> float:
    """Hold meshes that noise moves too little to be followed, of those that would stick; the bound
    on the rate of fast impacts, or -1 where none is held.

    All that is locked to the driver behind one mesh of it is held together, or that mesh alone, or
    not; of moving bodies those of two wheels.
    """
    closed = scratch.choices[UNSHAKEN]
    held = scratch.choices[HELD]
    group = scratch.choices[GROUP]
    top = scratch.choices[TOP]
    bodies = scratch.bodies
    n = closed.size
    put_all(held, 0)
    if not is_any(closed):
        return -1.0
    total = 0.0
    for i in range(n):
        parent = c.wheels[i].parent
        top[i] = i if parent < 0 else top[parent]
    for i in range(n):
        if closed[i] == 0:
            continue
        put_all(group, 0)
        root = bodies[i].root
        moving = root != DRIVER
        count = 0
        for j in range(n):
            together = bodies[j].root == root and (moving or top[j] == i)
            if closed[j] != 0 and together:
                group[j] = closed[j]
                count += 1
        if (moving and count > 1) or (not moving and top[i] != i):
            continue
        above = -1.0
        while above < 0.0 and count > 0:
            above = _bound_fast(c, left, driver, ahead, moving, spread, scratch, quiet)
            if above < 0.0:
                put_all(group, 0)
                group[i] = closed[i]
                count = 1 if count > 1 else 0
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


@splice
def _bound_fast(
    c: Constants,
    left: float,
    driver: Driver,
    ahead: Driver,
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
    group = scratch.choices[GROUP]
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
        b = _bounce(c, driver, ahead, scratch, i, group[i], moving)
        push = min(push, b.push)
        later = min(later, b.later)
        square = max(square, 2.0 * spread * spread * max(b.power, b.more) / b.mass)
        fastest = max(fastest, abs(scratch.state[2 * i + 1]))
        epsilon = max(epsilon, c.wheels[i].epsilon)
        motion = 0.5 * b.speed * b.speed + b.push * _nearest_wall(scratch, i)[1]
        scratch.unfollowed[0, i] = b.mass * motion
        scratch.unfollowed[1, i] = 0.5 * spread * spread * (b.power + b.more)
    least = min(push, later)
    if least <= 0.0:
        return -1.0
    slope = abs(later - push) / left
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


@inline
def close_meshes(c: Constants, scratch: Scratch) -> None:
    """Put the closed meshes of a path on their walls, in its state."""
    close(c, scratch.state, scratch.sides, scratch.walls, scratch.bodies)


@inline
def leave_bodies(c: Constants, scratch: Scratch) -> int:
    """Write the bodies that the closed meshes of a path leave, and the open meshes; returns how
    many there are.

    Paths come with the same closed meshes step by step: the bodies are kept until others close.
    """
    sides = scratch.sides
    count = list_open(sides, scratch.choices[FREE])
    left = scratch.choices[LEFT]
    same = True
    for i in range(sides.size):
        same = same and sides[i] == left[i]
    if not same:
        free = scratch.choices[FREE, :count]
        write_bodies(c, sides, free, scratch.bodies, scratch.wheels_beside[:count])
        copy_state(left, sides)
    return count


@splice
def part_beside(whole: Scratch, count: int) -> Scratch:
    """A path of the bodies that closed meshes leave, so many, with their state and their walls."""
    free = whole.choices[FREE, :count]
    numbers = 2 * count
    part = Scratch(
        count,
        whole.shaken,
        whole.beside[0, :numbers],
        whole.beside[1, :numbers],
        whole.beside[2, :numbers],
        *whole[5:],
    )
    take_open(whole.state, free, part.state)
    take_open(whole.walls, free, part.walls)
    return part


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
    count = leave_bodies(c, scratch)
    part = part_beside(scratch, count)
    c = with_wheels(c, scratch.wheels_beside[:count])
    after = flow(c, at.tau, part.state, at.left)
    if scratch.shaken:
        gather_alone(scratch.alone, count, scratch.bodies, scratch.choices[FREE], scratch.series)
    kick(c, at.tau, at.left, at.noise.increment, at.noise.area, scratch.series, part.end)
    for i in range(0, after.size, 2):
        x = after[i] + part.end[i]
        y = after[i + 1] + part.end[i + 1]
        high = part.walls[i]
        low = part.walls[i + 1]
        after[i], after[i + 1] = stop_at_wall(x, y, part.state[i + 1], at.left, high, low)
    put_open(scratch.state, scratch.choices[FREE, :count], after)
    return at_end(at)
