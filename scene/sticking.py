"""Sticking: when chatter is complete, what keeps a mesh closed, when it opens, and how the rest of
the system moves.

Wheels whose meshes are closed move as one body: a wheel again, at the mesh of its first wheel
(`lock`).  With ``v_j = K_j v_r`` for a wheel j of the body of wheel r, and sums over all that is
locked below a mesh i, itself included,

    M = sum K_j^2 m_j,   B = sum K_j^2 m_j beta_j / M,   G = sum K_j m_j gamma_j / M,

the force in the closed mesh i is ``M (v_i' - (G - B v_i + kappa_i alpha (f'' + B f')))``.  A mesh
sticks on a side while its contact pushes.  A body that is locked to the driver moves with it.

Chatter is completed as a geometric series (`complete_chatter`).
"""

import math
from typing import Any

import numpy as np

from rattle.scene import drive as motion
from rattle.scene.compiled import internal, lean_internal, not_inlined, splice
from rattle.scene.flight import flow, wheel_speeds
from rattle.scene.impact import NONE, REST, TOUCH_STEP, approach, next_impact, safe_time
from rattle.scene.linear_algebra import put_row
from rattle.scene.types import BODY, WHEEL, Bodies, Constants, Floats, Ints, Wheels
from rattle.scene.wheel import complete_wheels, nearest_wall, with_wheels

# longest time, and largest relative change of the contact acceleration, of chatter that is summed
# up
CHATTER_LIMIT = 1e-6
MOST_CHANGES = 1000  # of the meshes that stick, until the right ones are
DRIVER = -1  # root of a body that is locked to the driver

Driver = tuple[float, float]
"""Velocity and acceleration of the driver, ``f'`` and ``f''``."""


@lean_internal
def lock(c: Constants, closed: Ints, bodies: Bodies) -> None:
    """Write the bodies that closed meshes make of the wheels.

    `closed`: Sides on which meshes are closed, +1 or -1; 0 for an open mesh.  Shapes: `closed`,
    `bodies` (wheels,).
    """
    not_inlined()
    for i, wheel in enumerate(c.wheels):
        body = bodies[i]
        body.root = i
        body.carry = 1.0
        if closed[i] != 0:
            body.root = DRIVER
            body.carry = wheel.turn
            if wheel.parent >= 0:
                body.root = bodies[wheel.parent].root
                body.carry = wheel.ratio * bodies[wheel.parent].carry
        body.mass = wheel.mass
        body.beta = wheel.mass * wheel.beta
        body.gamma = wheel.mass * (wheel.gamma + c.pressing * wheel.own)
        body.own = wheel.mass * wheel.own
        body.alone = (wheel.mass * wheel.alone) ** 2
    for i in range(c.wheels.size - 1, -1, -1):
        wheel = c.wheels[i]
        body = bodies[i]
        if closed[i] != 0 and wheel.parent >= 0:
            parent = bodies[wheel.parent]
            square = wheel.ratio * wheel.ratio
            parent.mass += square * body.mass
            parent.beta += square * body.beta
            parent.gamma += wheel.ratio * body.gamma
            parent.own += wheel.ratio * body.own
            parent.alone += square * body.alone
        body.beta /= body.mass
        body.gamma /= body.mass
        body.own /= body.mass
        body.alone = math.sqrt(body.alone) / body.mass  # of independent noises


@lean_internal
def contact_motion(c: Constants, driver: Driver, s: Floats, closed: Ints, bodies: Bodies) -> None:
    """Write the bodies, and by mesh the push of a closed one's contact as the acceleration that it
    alone gives the gap, positive while it pushes; the acceleration of an open one's gap.

    ``v_i' = w_i + kappa_i alpha f''``; the last term is the same for both sides of a gap.  The
    speeds are those of the state, in which a closed mesh may still have a rate: so the forces are
    linear in the contacts.  Shapes: `s` (2 wheels,); `closed`, `bodies` (wheels,).
    """
    not_inlined()
    lock(c, closed, bodies)
    speed = c.alpha * driver[0]
    acceleration = c.alpha * driver[1]
    # what all that is locked below a mesh loses by damping and drag, as an acceleration
    for i, wheel in enumerate(c.wheels):
        body = bodies[i]
        if wheel.parent < 0:
            body.speed = wheel.turn * speed - wheel.sign * s[2 * i + 1]
        else:
            body.speed = wheel.ratio * bodies[wheel.parent].speed + s[2 * i + 1]
        held = wheel.gamma + c.pressing * wheel.own - wheel.stiffness * s[2 * i]
        body.pull = wheel.mass * (wheel.beta * body.speed + held)
    for i in range(c.wheels.size - 1, -1, -1):
        wheel = c.wheels[i]
        body = bodies[i]
        if closed[i] != 0 and wheel.parent >= 0:
            bodies[wheel.parent].pull += wheel.ratio * body.pull
        body.pull /= body.mass
    for i, wheel in enumerate(c.wheels):
        body = bodies[i]
        r = body.root
        body.motion = -wheel.turn * acceleration if r == DRIVER else body.carry * bodies[r].pull
        if closed[i] != 0:
            force = body.mass * (body.pull - body.motion)
            body.push = closed[i] * wheel.sign * force / (wheel.mass * (1.0 - wheel.share))
        elif wheel.parent < 0:
            body.push = wheel.sign * (body.motion + wheel.turn * acceleration)
        else:
            body.push = wheel.ratio * bodies[wheel.parent].motion - body.motion


@lean_internal
def _bound_accelerations(c: Constants, driver: Driver, bodies: Bodies) -> float:
    """A bound of all accelerations of gaps and contacts: what their terms add up to, on the
    lightest wheel.

    `bodies`: as `contact_motion` wrote them.
    """
    acceleration = abs(c.alpha * driver[1])
    total = 0.0
    mass = 0.0
    lightest = math.inf
    for i, wheel in enumerate(c.wheels):
        steady = wheel.gamma + c.pressing * wheel.own
        total += abs(wheel.beta * bodies[i].speed + steady) + wheel.turn * acceleration
        total += wheel.stiffness * wheel.size
        mass += wheel.turn * wheel.turn * wheel.mass
        lightest = min(lightest, wheel.turn * wheel.turn * wheel.mass)
    return total * mass / lightest


@lean_internal
def find_sticking(
    c: Constants, driver: Driver, s: Floats, touching: Ints, closed: Ints, bodies: Bodies
) -> None:
    """Write which meshes stick, of those that touch a wall at zero speed, and their
    `contact_motion`.

    The answer is the one combination in which every contact pushes and every open mesh accelerates
    away.  It is unique, because the matrix of the contacts' effects on each other is positive
    definite: all of them where all of them push.  Else it is found by changing the first mesh that
    is wrong, again and again (Murty 1974).  A contact whose force is zero but for rounding stays
    closed; `opening` opens it if it must.

    `touching`: Sides on which meshes touch their wall at zero speed; 0 for a mesh that does not.
    Shapes: `s` (2 wheels,); `touching`, `closed`, `bodies` (wheels,).
    """
    not_inlined()
    put_row(closed, touching)
    contact_motion(c, driver, s, closed, bodies)
    slack = 1e-15 * _bound_accelerations(c, driver, bodies)
    least = math.inf
    for i in range(closed.size):
        if closed[i] != 0:
            least = min(least, bodies[i].push)
    if least > slack:
        return
    closed[:] = 0
    wrong = 0
    for _ in range(MOST_CHANGES):
        contact_motion(c, driver, s, closed, bodies)
        wrong = -1
        for i in range(closed.size - 1, -1, -1):
            push = bodies[i].push
            opens = closed[i] != 0 and push < -slack
            closes = closed[i] == 0 and touching[i] * push > 0.0
            if opens or closes:
                wrong = i
        if wrong < 0:
            break
        closed[wrong] = touching[wrong] if closed[wrong] == 0 else 0


@internal
def _until_driver(
    drive: Any, side: int, beta: float, gamma: float, alpha: float, tau: float
) -> float:
    """Time until ``side (gamma + alpha (beta f' + f''))`` falls to zero; infinite if it never
    does."""
    if len(drive) != 0:
        return _until_orders(drive, side, beta, gamma, alpha, tau)
    most = alpha * math.sqrt(1.0 + beta * beta)
    if side * gamma >= most:
        return math.inf
    falls = (
        math.asin(max(gamma / most, -1.0))
        if side > 0
        else math.pi - math.asin(min(gamma / most, 1.0))
    )
    return (falls + math.atan(beta) - tau) % (2.0 * math.pi)


@internal
def _until_orders(
    drive: Any, side: int, beta: float, gamma: float, alpha: float, tau: float
) -> float:
    """The same for several orders, by steps within which there is no zero: near one they are Newton
    steps."""
    # bound of the second derivative
    bend = alpha * drive.highest * motion.most_modulation_rate(drive, beta)
    rounding = 1e-15 * (abs(gamma) + alpha * motion.most_modulation(drive, beta))
    t = 0.0
    while t < 2.0 * math.pi:
        first, second = motion.velocity_acceleration(drive, tau + t)
        force = side * (gamma + alpha * (second + beta * first))
        if force <= rounding:
            return t
        slope = side * alpha * (motion.jerk(drive, tau + t) + beta * second)
        if bend == 0.0:
            break
        root = math.sqrt(slope * slope + 2.0 * bend * force)
        t += 2.0 * force / (root - slope) if slope < 0.0 else (slope + root) / bend
    return math.inf


@internal
def _until_apart(i: int, speed: float, bodies: Bodies) -> float:
    """Time until a closed mesh of a moving body opens: the speed of the body's first wheel at which
    both sides of the mesh decelerate alike; infinite if it never comes."""
    body = bodies[i]
    first = bodies[body.root]
    beta = first.beta
    slope = body.carry * (beta - body.beta)
    if slope == 0.0:
        return math.inf
    # what is left to lose of the speed
    left = speed + (body.carry * first.gamma - body.gamma) / slope
    rate = beta * speed + first.gamma
    e = left / rate if rate != 0.0 else math.inf  # E = (1 - exp(-beta t)) / beta at the opening
    if not e > 0.0 or beta * e >= 1.0:
        return math.inf
    return e if beta == 0.0 else -math.log1p(-beta * e) / beta


@internal
def opening(c: Constants, tau: float, s: Floats, closed: Ints) -> tuple[float, int]:
    """Time until the first of the sticking meshes opens, because its contact force has fallen to
    zero, and its index."""
    bodies = np.empty(c.wheels.size, BODY)
    contact_motion(c, motion.velocity_acceleration(c.drive, tau), s, closed, bodies)
    first = math.inf
    which = 0
    for i, wheel in enumerate(c.wheels):
        if closed[i] == 0:
            continue
        body = bodies[i]
        if body.push <= 0.0:
            t = 0.0
        elif body.root == DRIVER:
            side = closed[i] * int(wheel.sign)
            held = body.gamma - wheel.stiffness * s[2 * i]
            t = _until_driver(c.drive, side, body.beta, held, wheel.turn * c.alpha, tau)
        else:
            t = _until_apart(i, bodies[body.root].speed, bodies)
        if t < first:
            first = t
            which = i
    return first, which


@lean_internal
def list_open(closed: Ints, free: Ints) -> int:
    """List the meshes that are open; returns how many there are.

    Shapes: `closed`, `free` (wheels,).
    """
    not_inlined()
    count = 0
    for i in range(closed.size):
        if closed[i] == 0:
            free[count] = i
            count += 1
    return count


@internal
def open_meshes(closed: Ints) -> Ints:
    """Indices of the meshes that are open."""
    free = np.empty(closed.size, np.int64)
    count = list_open(closed, free)
    return free[:count]


@lean_internal
def write_bodies(c: Constants, closed: Ints, free: Ints, bodies: Bodies, wheels: Wheels) -> None:
    """Write the bodies that closed meshes leave as the wheels of a scene: those of the open meshes.

    A mesh with a wheel that is locked to the driver is one at the driver, with the sign that it
    has.  Shapes: `free`, `wheels` (open meshes,).
    """
    not_inlined()
    lock(c, closed, bodies)
    for j in range(free.size):
        i = free[j]
        wheel = c.wheels[i]
        body = wheels[j]
        body.parent = DRIVER
        body.sign = wheel.sign
        body.ratio = wheel.ratio
        if wheel.parent >= 0:
            root = bodies[wheel.parent].root
            body.ratio = wheel.ratio * bodies[wheel.parent].carry
            for k in range(j):
                if free[k] == root:
                    body.parent = k
        body.turn = wheel.turn
        locked = bodies[i]
        body.beta = locked.beta
        body.gamma = locked.gamma
        body.own = locked.own
        body.alone = locked.alone
        body.mass = locked.mass
        body.stiffness = wheel.stiffness
        body.size = wheel.size
        body.wall = wheel.wall
        body.low = wheel.low
        body.epsilon = wheel.epsilon
        body.variance = wheel.variance
        body.slowing = wheel.slowing
        body.rows = wheel.rows
        if wheel.rows > 0:
            body.pieces = wheel.pieces
    complete_wheels(wheels, c.drive)


@internal
def as_bodies(c: Constants, closed: Ints) -> Constants:
    """The scene whose wheels are the bodies that closed meshes leave."""
    free = open_meshes(closed)
    wheels = np.empty(free.size, WHEEL)
    write_bodies(c, closed, free, np.empty(closed.size, BODY), wheels)
    return with_wheels(c, wheels)


@lean_internal
def take_open(s: Floats, free: Ints, part: Floats) -> None:
    """Write the part of a state that belongs to some meshes.

    Shapes: `s` (2 wheels,); `part` (2 free,).
    """
    not_inlined()
    for j in range(free.size):
        part[2 * j] = s[2 * free[j]]
        part[2 * j + 1] = s[2 * free[j] + 1]


@lean_internal
def put_open(s: Floats, free: Ints, part: Floats) -> None:
    """Give a state another part for some meshes, in place: see `take_open`."""
    not_inlined()
    for j in range(free.size):
        s[2 * free[j]] = part[2 * j]
        s[2 * free[j] + 1] = part[2 * j + 1]


@internal
def stick_on(c: Constants, tau: float, s: Floats, closed: Ints, t: float) -> Floats:
    """State after a time in which the same meshes stick and no wall is struck."""
    free = open_meshes(closed)
    part = np.empty(2 * free.size)
    take_open(s, free, part)
    out = s.copy()
    put_open(out, free, flow(as_bodies(c, closed), tau, part, t))
    return out


@internal
def next_contact(
    c: Constants, tau: float, s: Floats, closed: Ints, horizon: float
) -> tuple[float, int, int, Floats, Ints]:
    """The next event of a sticking phase: an impact of an open mesh, or the opening of a sticking
    one.

    Returns: As of `rattle.scene.impact.next_impact`, and the meshes that stick then; `REST` means
    that a mesh has opened, or that an open one has come to its wall at zero speed.
    """
    opens, which = opening(c, tau, s, closed)
    free = open_meshes(closed)
    part = np.empty(2 * free.size)
    take_open(s, free, part)
    until = min(opens, horizon)
    t, mesh, side, part = next_impact(as_bodies(c, closed), tau, part, until)
    out = s.copy()
    put_open(out, free, part)
    still = closed.copy()
    if mesh > 0:
        mesh = free[mesh - 1] + 1
    elif mesh == REST:
        still[:] = 0
    elif mesh == NONE and opens <= horizon:
        # step over the opening: TOUCH_STEP later the mesh moves inward, if by less than the
        # rounding of its displacement
        mesh = REST
        side = closed[which]
        still[which] = 0
        out = stick_on(c, tau + t, out, still, TOUCH_STEP)
        out[2 * which] = side * c.wheels[which].wall
        out[2 * which + 1] = -side * max(-side * out[2 * which + 1], 1e-300)
        t += TOUCH_STEP
    return t, mesh, side, out, still


@lean_internal
def close(c: Constants, s: Floats, closed: Ints, walls: Floats, bodies: Bodies) -> None:
    """Put sticking meshes on their walls at zero speed, in place.

    Each body keeps its momentum and its centre of mass; one that is locked to the driver moves with
    it.  All other wheels stay as they are.

    `walls`: Distances of the flanks +1, -1, +2, -2, ... from their middle.  Shapes: `s`, `walls` (2
    wheels,); `closed`, `bodies` (wheels,).
    """
    not_inlined()
    lock(c, closed, bodies)
    for i, wheel in enumerate(c.wheels):
        body = bodies[i]
        x = 2 * i
        y = x + 1
        body.place = wheel.sign * s[x]
        body.rate = wheel.sign * s[y]
        body.offset = 0.0
        body.kept_place = 0.0
        body.kept_rate = 0.0
        if wheel.parent >= 0:
            body.place += wheel.ratio * bodies[wheel.parent].place
            body.rate += wheel.ratio * bodies[wheel.parent].rate
        if closed[i] != 0:
            s[x] = walls[x] if closed[i] > 0 else -walls[y]
            s[y] = 0.0
            carried = wheel.ratio * bodies[wheel.parent].offset if wheel.parent >= 0 else 0.0
            body.offset = carried + wheel.sign * s[x]
        body.share = 0.0
        if body.root != DRIVER:
            first = bodies[body.root]
            share = body.carry * wheel.mass / first.mass
            body.share = share
            first.kept_place += share * (body.place - body.offset)
            first.kept_rate += share * body.rate
    # place, rate: from here on by how much a wheel is moved
    for i, wheel in enumerate(c.wheels):
        body = bodies[i]
        x = 2 * i
        y = x + 1
        r = body.root
        if r == i and body.mass == wheel.mass:  # alone
            body.place = 0.0
            body.rate = 0.0
        else:
            place = body.carry * bodies[r].kept_place if r != DRIVER else 0.0
            rate = body.carry * bodies[r].kept_rate if r != DRIVER else 0.0
            body.place = place + body.offset - body.place
            body.rate = rate - body.rate
        if closed[i] == 0:
            s[x] += wheel.sign * body.place
            s[y] += wheel.sign * body.rate
            if wheel.parent >= 0:
                s[x] += wheel.ratio * bodies[wheel.parent].place
                s[y] += wheel.ratio * bodies[wheel.parent].rate


@internal
def _is_slow(c: Constants, i: int, s: Floats, most: float) -> bool:
    """Whether a mesh is as slow and as close to a wall as one that sticks together with others."""
    wheel = c.wheels[i]
    gap = max(nearest_wall(c, i, s[2 * i])[1], 0.0)
    limit = (1.0 - wheel.epsilon) * CHATTER_LIMIT
    rate = abs(s[2 * i + 1])
    return bool(2.0 * rate <= limit * most and 8.0 * gap <= limit * limit * most)


@internal
def _most_acceleration(c: Constants, tau: float, s: Floats) -> float:
    """A bound of all accelerations of gaps and contacts in a state."""
    bodies = np.empty(c.wheels.size, BODY)
    driver = motion.velocity_acceleration(c.drive, tau)
    contact_motion(c, driver, s, np.zeros(c.wheels.size, np.int64), bodies)
    return _bound_accelerations(c, driver, bodies)


@splice
def may_chatter(c: Constants, tau: float, s: Floats, mesh: int) -> bool:
    """Whether `complete_chatter` may sum up the impacts at a mesh that has just been struck, where
    no mesh is at rest: alone, or together with others that are as slow."""
    at = mesh - 1
    wheel = c.wheels[at]
    limit = (1.0 - wheel.epsilon) * CHATTER_LIMIT
    rate = abs(s[2 * at + 1])
    most = _most_acceleration(c, tau, s)
    if rate > limit * most:
        return False
    for i in range(c.wheels.size):
        if i != at and _is_slow(c, i, s, most):
            return True
    driver = c.alpha * motion.acceleration(c.drive, tau)
    u = wheel_speeds(c, tau, s)
    towards = approach(c, at, s[2 * at], s[2 * at + 1], u, driver, 0.0, 0.0)[0]
    return bool(2.0 * rate <= limit * abs(towards))


@internal
def _stick_together(
    c: Constants,
    s: Floats,
    together: Ints,
    bodies: Bodies,
    at_rest: Ints,
    mesh: int,
    change: float,
) -> bool:
    """Whether chatter at a mesh ends at once, since it and others that are not at rest throw each
    other back.

    `change`: Bound of the rate of change of all accelerations.
    """
    others = False
    weakest = math.inf
    strongest = 0.0
    longest = 0.0
    fastest = 0.0
    furthest = 0.0
    for i, wheel in enumerate(c.wheels):
        if together[i] == 0:
            continue
        weakest = min(weakest, bodies[i].push)
        strongest = max(strongest, bodies[i].push)
        if at_rest[i] == 0:
            others = others or i != mesh - 1
            longest = max(longest, 2.0 / (1.0 - wheel.epsilon))
            fastest = max(fastest, abs(s[2 * i + 1]))
            furthest = max(furthest, nearest_wall(c, i, s[2 * i])[1])
    if not (others and weakest > 0.0):
        return False
    t = longest * (fastest + math.sqrt(2.0 * strongest * furthest)) / weakest
    return t <= CHATTER_LIMIT and t * change <= CHATTER_LIMIT * weakest


@internal
def complete_chatter(
    c: Constants, tau: float, s: Floats, mesh: int, side: int
) -> tuple[float, Ints]:
    """Whether impacts at a mesh accumulate (chatter), the time until they have, and the meshes that
    then stick.

    The speed shrinks by epsilon from bounce to bounce, and the flight times ``2 w / a`` with it.
    Their sum is ``2 w / (a (1 - epsilon))``, w the speed after the impact and a the acceleration
    towards the wall.  The sum is used where it is short, a changes by less than the share
    `CHATTER_LIMIT` in it, and no other mesh meets a wall; its relative error is about
    `CHATTER_LIMIT`.  Meshes that throw each other back stick together, at once, when all are that
    slow and that close to their walls: they are hardly ever on them at the same instant.

    Returns: Time until the chatter is complete; infinite where impacts do not accumulate, or cannot
    be summed up yet.
    """
    n = c.wheels.size
    never = np.zeros(n, np.int64)
    if c.wheels[mesh - 1].epsilon == 1.0:
        return math.inf, never
    u = wheel_speeds(c, tau, s)
    moves = motion.velocity_acceleration(c.drive, tau)
    driver = c.alpha * moves[1]
    force = c.alpha * motion.most_acceleration(c.drive)
    jolt = c.alpha * motion.most_jerk(c.drive)
    most = _most_acceleration(c, tau, s)
    near = np.zeros(n, np.int64)
    at_rest = np.zeros(n, np.int64)
    reach = np.zeros(n)
    # bounds of the rate of change of all accelerations, and of that of the mesh
    change = own = 0.0
    for i in range(n):
        nearest, distance = nearest_wall(c, i, s[2 * i])
        gap = max(distance, 0.0)
        slow = _is_slow(c, i, s, most)
        rate = approach(c, i, s[2 * i], s[2 * i + 1], u, driver, force, jolt)[3]
        change += rate
        near[i] = nearest if slow or i == mesh - 1 else 0
        # speed that it has at its wall at most
        fastest = abs(s[2 * i + 1]) + math.sqrt(2.0 * most * gap)
        if i == mesh - 1:
            own = rate
        else:
            at_rest[i] = nearest if fastest == 0.0 else 0
            reach[i] = fastest if slow else 0.0
    bodies = np.empty(n, BODY)
    together = np.zeros(n, np.int64)
    # without the fastest of them, again and again: it may be in flight beside the chatter of others
    while reach.max() > 0.0:
        find_sticking(c, moves, s, near, together, bodies)
        throws = together[mesh - 1] != 0
        if throws and _stick_together(c, s, together, bodies, at_rest, mesh, change):
            return 0.0, together
        i = int(np.argmax(reach))
        near[i] = 0
        reach[i] = 0.0
    closed = np.zeros(n, np.int64)
    find_sticking(c, moves, s, at_rest, closed, bodies)
    press = side * bodies[mesh - 1].push
    speed = -side * s[2 * mesh - 1]
    if not (press > 0.0 and speed >= 0.0):
        return math.inf, never
    t = 2.0 / (1.0 - c.wheels[mesh - 1].epsilon) * speed / press
    if t > CHATTER_LIMIT or t * own > CHATTER_LIMIT * press:
        return math.inf, never
    closed[mesh - 1] = side
    contact_motion(c, moves, s, closed, bodies)
    for i, wheel in enumerate(c.wheels):
        if closed[i] != 0:
            continue
        x = s[2 * i]
        y = s[2 * i + 1]
        up = safe_time(wheel.wall - x, y, bodies[i].push, most, 0.0)
        down = safe_time(wheel.low + x, -y, -bodies[i].push, most, 0.0)
        if min(up, down) < t:
            return math.inf, never
    return t, closed
