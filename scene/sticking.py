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
from typing import Any, NamedTuple

import numpy as np

from rattle.scene import drive as motion
from rattle.scene.compiled import internal, not_inlined
from rattle.scene.flight import deviations, flow, wheel_speeds
from rattle.scene.impact import NONE, REST, TOUCH_STEP, approach, next_impact, safe_time
from rattle.scene.types import Constants, Floats, Ints
from rattle.scene.wheel import complete_wheels

# longest time, and largest relative change of the contact acceleration, of chatter that is summed
# up
CHATTER_LIMIT = 1e-6
MOST_CHANGES = 1000  # of the meshes that stick, until the right ones are
DRIVER = -1  # root of a body that is locked to the driver


class Bodies(NamedTuple):
    """What the wheels make where some meshes are closed; arrays by wheel."""

    root: Ints  # first wheel of its body, or `DRIVER`
    carry: Floats  # its speed over that of the root
    # mass, beta, gamma: of all that is locked below its mesh, as one wheel there
    mass: Floats
    beta: Floats
    gamma: Floats


@internal
def lock(c: Constants, closed: Ints) -> Bodies:
    """The bodies that closed meshes make of the wheels.

    `closed`: Sides on which meshes are closed, +1 or -1; 0 for an open mesh.  Shapes: `closed`
    (wheels,).
    """
    not_inlined()
    n = c.wheels.size
    root = np.empty(n, np.int64)
    carry = np.ones(n)
    mass = np.empty(n)
    beta = np.empty(n)
    gamma = np.empty(n)
    for i in range(n):
        wheel = c.wheels[i]
        root[i] = i
        if closed[i] != 0:
            root[i] = DRIVER
            carry[i] = wheel.turn
            if wheel.parent >= 0:
                root[i] = root[wheel.parent]
                carry[i] = wheel.ratio * carry[wheel.parent]
        mass[i] = wheel.mass
        beta[i] = wheel.mass * wheel.beta
        gamma[i] = wheel.mass * wheel.gamma
    for i in range(n - 1, -1, -1):
        wheel = c.wheels[i]
        if closed[i] != 0 and wheel.parent >= 0:
            mass[wheel.parent] += wheel.ratio * wheel.ratio * mass[i]
            beta[wheel.parent] += wheel.ratio * wheel.ratio * beta[i]
            gamma[wheel.parent] += wheel.ratio * gamma[i]
        beta[i] /= mass[i]
        gamma[i] /= mass[i]
    return Bodies(root, carry, mass, beta, gamma)


@internal
def contact_motion(c: Constants, tau: float, s: Floats, closed: Ints) -> Floats:
    """By mesh: the push of a closed one's contact as the acceleration that it alone gives the gap,
    positive while it pushes; the acceleration of an open one's gap.

    ``v_i' = w_i + kappa_i alpha f''``; the last term is the same for both sides of a gap.  The
    speeds are those of the state, in which a closed mesh may still have a rate: so the forces are
    linear in the contacts.  Shapes: `s` (2 wheels,); `closed`, result (wheels,).
    """
    not_inlined()
    n = c.wheels.size
    bodies = lock(c, closed)
    u = wheel_speeds(c, tau, s)
    driver = c.alpha * motion.acceleration(c.drive, tau)
    # what all that is locked below a mesh loses by damping and drag, as an acceleration
    pull = np.empty(n)
    for i in range(n):
        wheel = c.wheels[i]
        pull[i] = wheel.mass * (wheel.beta * u[i] + wheel.gamma)
    for i in range(n - 1, -1, -1):
        wheel = c.wheels[i]
        if closed[i] != 0 and wheel.parent >= 0:
            pull[wheel.parent] += wheel.ratio * pull[i]
        pull[i] /= bodies.mass[i]
    w = np.empty(n)
    out = np.empty(n)
    for i in range(n):
        wheel = c.wheels[i]
        r = bodies.root[i]
        w[i] = -wheel.turn * driver if r == DRIVER else bodies.carry[i] * pull[r]
        if closed[i] != 0:
            force = bodies.mass[i] * (pull[i] - w[i])
            out[i] = closed[i] * wheel.sign * force / (wheel.mass * (1.0 - wheel.share))
        elif wheel.parent < 0:
            out[i] = wheel.sign * (w[i] + wheel.turn * driver)
        else:
            out[i] = wheel.ratio * w[wheel.parent] - w[i]
    return out


@internal
def _most_acceleration(c: Constants, tau: float, s: Floats) -> float:
    """A bound of all accelerations of gaps and contacts: what their terms add up to, on the
    lightest wheel."""
    u = wheel_speeds(c, tau, s)
    driver = abs(c.alpha * motion.acceleration(c.drive, tau))
    total = 0.0
    mass = 0.0
    lightest = math.inf
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        total += abs(wheel.beta * u[i] + wheel.gamma) + wheel.turn * driver
        mass += wheel.turn * wheel.turn * wheel.mass
        lightest = min(lightest, wheel.turn * wheel.turn * wheel.mass)
    return total * mass / lightest


@internal
def find_sticking(c: Constants, tau: float, s: Floats, touching: Ints) -> Ints:
    """Which meshes stick, of those that touch a wall at zero speed.

    The answer is the one combination in which every contact pushes and every open mesh accelerates
    away.  It is unique, because the matrix of the contacts' effects on each other is positive
    definite, and is found by changing the first mesh that is wrong, again and again (Murty 1974).
    A contact whose force is zero but for rounding stays closed; `opening` opens it if it must.

    `touching`: Sides on which meshes touch their wall at zero speed; 0 for a mesh that does not.
    Shapes: `s` (2 wheels,); `touching`, result (wheels,).
    """
    not_inlined()
    closed = np.zeros(touching.size, np.int64)
    slack = 1e-15 * _most_acceleration(c, tau, s)
    wrong = 0
    for _ in range(MOST_CHANGES):
        motions = contact_motion(c, tau, s, closed)
        wrong = -1
        for i in range(touching.size - 1, -1, -1):
            opens = closed[i] != 0 and motions[i] < -slack
            closes = closed[i] == 0 and touching[i] * motions[i] > 0.0
            if opens or closes:
                wrong = i
        if wrong < 0:
            break
        closed[wrong] = touching[wrong] if closed[wrong] == 0 else 0
    return closed


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
    r = bodies.root[i]
    beta = bodies.beta[r]
    slope = bodies.carry[i] * (beta - bodies.beta[i])
    if slope == 0.0:
        return math.inf
    # what is left to lose of the speed
    left = speed + (bodies.carry[i] * bodies.gamma[r] - bodies.gamma[i]) / slope
    rate = beta * speed + bodies.gamma[r]
    e = left / rate if rate != 0.0 else math.inf  # E = (1 - exp(-beta t)) / beta at the opening
    if not e > 0.0 or beta * e >= 1.0:
        return math.inf
    return e if beta == 0.0 else -math.log1p(-beta * e) / beta


@internal
def opening(c: Constants, tau: float, s: Floats, closed: Ints) -> tuple[float, int]:
    """Time until the first of the sticking meshes opens, because its contact force has fallen to
    zero, and its index."""
    bodies = lock(c, closed)
    u = wheel_speeds(c, tau, s)
    pushes = contact_motion(c, tau, s, closed)
    first = math.inf
    which = 0
    for i in range(c.wheels.size):
        if closed[i] == 0:
            continue
        wheel = c.wheels[i]
        if pushes[i] <= 0.0:
            t = 0.0
        elif bodies.root[i] == DRIVER:
            side = closed[i] * int(wheel.sign)
            alpha = wheel.turn * c.alpha
            t = _until_driver(c.drive, side, bodies.beta[i], bodies.gamma[i], alpha, tau)
        else:
            t = _until_apart(i, u[bodies.root[i]], bodies)
        if t < first:
            first = t
            which = i
    return first, which


@internal
def open_meshes(closed: Ints) -> Ints:
    """Indices of the meshes that are open."""
    not_inlined()
    count = 0
    for i in range(closed.size):
        count += closed[i] == 0
    out = np.empty(count, np.int64)
    count = 0
    for i in range(closed.size):
        if closed[i] == 0:
            out[count] = i
            count += 1
    return out


@internal
def as_bodies(c: Constants, closed: Ints) -> Constants:
    """The scene whose wheels are the bodies that closed meshes leave: those of the open meshes.

    A mesh with a wheel that is locked to the driver is one at the driver, with the sign that it
    has.
    """
    not_inlined()
    bodies = lock(c, closed)
    free = open_meshes(closed)
    wheels = c.wheels[: free.size].copy()
    for j in range(free.size):
        i = free[j]
        wheel = c.wheels[i]
        body = wheels[j]
        body.parent = DRIVER
        body.sign = wheel.sign
        body.ratio = wheel.ratio
        if wheel.parent >= 0:
            root = bodies.root[wheel.parent]
            body.ratio = wheel.ratio * bodies.carry[wheel.parent]
            for k in range(j):
                if free[k] == root:
                    body.parent = k
        body.turn = wheel.turn
        body.beta = bodies.beta[i]
        body.gamma = bodies.gamma[i]
        body.mass = bodies.mass[i]
        body.wall = wheel.wall
        body.epsilon = wheel.epsilon
    complete_wheels(wheels, c.drive)
    return Constants(c.alpha, c.sigma, wheels, c.drive, c.memory)


@internal
def take_open(s: Floats, free: Ints) -> Floats:
    """The part of a state that belongs to some meshes.

    Shapes: `s` (2 wheels,); result (2 free,).
    """
    not_inlined()
    out = np.empty(2 * free.size)
    for j in range(free.size):
        out[2 * j] = s[2 * free[j]]
        out[2 * j + 1] = s[2 * free[j] + 1]
    return out


@internal
def put_open(s: Floats, free: Ints, part: Floats) -> Floats:
    """A state with another part for some meshes: see `take_open`."""
    not_inlined()
    out = s.copy()
    for j in range(free.size):
        out[2 * free[j]] = part[2 * j]
        out[2 * free[j] + 1] = part[2 * j + 1]
    return out


@internal
def stick_on(c: Constants, tau: float, s: Floats, closed: Ints, t: float) -> Floats:
    """State after a time in which the same meshes stick and no wall is struck."""
    free = open_meshes(closed)
    return put_open(s, free, flow(as_bodies(c, closed), tau, take_open(s, free), t))


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
    body_state = take_open(s, free)
    until = min(opens, horizon)
    t, mesh, side, body_state = next_impact(as_bodies(c, closed), tau, body_state, until)
    out = put_open(s, free, body_state)
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


@internal
def close(c: Constants, s: Floats, closed: Ints, places: Floats) -> Floats:
    """The state with sticking meshes put on their walls, at `places`, at zero speed.

    Each body keeps its momentum and its centre of mass; one that is locked to the driver moves with
    it.  All other wheels stay as they are.  Shapes: `s` (2 wheels,); `closed`, `places` (wheels,).
    """
    not_inlined()
    n = c.wheels.size
    bodies = lock(c, closed)
    v = deviations(c)
    # of each wheel: position and speed, and its place in its body
    place = np.zeros(n)
    now = np.zeros((2, n))
    kept = np.zeros((2, n))
    for i in range(n):
        wheel = c.wheels[i]
        for j in range(i + 1):
            now[0, i] += v[i, j] * s[2 * j]
            now[1, i] += v[i, j] * s[2 * j + 1]
        if closed[i] != 0:
            carried = wheel.ratio * place[wheel.parent] if wheel.parent >= 0 else 0.0
            place[i] = carried + wheel.sign * places[i]
        r = bodies.root[i]
        if r != DRIVER:
            share = bodies.carry[i] * wheel.mass / bodies.mass[r]
            kept[0, r] += share * (now[0, i] - place[i])
            kept[1, r] += share * now[1, i]
    moved = np.zeros((2, n))
    for i in range(n):
        r = bodies.root[i]
        alone = r == i and bodies.mass[i] == c.wheels[i].mass
        if not alone:
            at = bodies.carry[i] * kept[0, r] if r != DRIVER else 0.0
            speed = bodies.carry[i] * kept[1, r] if r != DRIVER else 0.0
            moved[0, i] = at + place[i] - now[0, i]
            moved[1, i] = speed - now[1, i]
    out = s.copy()
    for i in range(n):
        wheel = c.wheels[i]
        for part in range(2):
            carried = wheel.ratio * moved[part, wheel.parent] if wheel.parent >= 0 else 0.0
            out[2 * i + part] += carried + wheel.sign * moved[part, i]
        if closed[i] != 0:
            out[2 * i] = places[i]
            out[2 * i + 1] = 0.0
    return out


@internal
def _is_slow(c: Constants, i: int, s: Floats, most: float) -> bool:
    """Whether a mesh is as slow and as close to a wall as one that sticks together with others."""
    wheel = c.wheels[i]
    gap = max(wheel.wall - abs(s[2 * i]), 0.0)
    limit = (1.0 - wheel.epsilon) * CHATTER_LIMIT
    rate = abs(s[2 * i + 1])
    return bool(2.0 * rate <= limit * most and 8.0 * gap <= limit * limit * most)


@internal
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
    towards = approach(c, at, wheel_speeds(c, tau, s), driver, 0.0, 0.0)[0]
    return bool(2.0 * rate <= limit * abs(towards))


@internal
def _stick_together(
    c: Constants, tau: float, s: Floats, together: Ints, at_rest: Ints, mesh: int, change: float
) -> bool:
    """Whether chatter at a mesh ends at once, since it and others that are not at rest throw each
    other back.

    `change`: Bound of the rate of change of all accelerations.
    """
    pushes = contact_motion(c, tau, s, together)
    others = False
    weakest = math.inf
    strongest = 0.0
    longest = 0.0
    fastest = 0.0
    furthest = 0.0
    for i in range(together.size):
        if together[i] == 0:
            continue
        wheel = c.wheels[i]
        weakest = min(weakest, pushes[i])
        strongest = max(strongest, pushes[i])
        if at_rest[i] == 0:
            others = others or i != mesh - 1
            longest = max(longest, 2.0 / (1.0 - wheel.epsilon))
            fastest = max(fastest, abs(s[2 * i + 1]))
            furthest = max(furthest, wheel.wall - abs(s[2 * i]))
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
    driver = c.alpha * motion.acceleration(c.drive, tau)
    force = c.alpha * motion.most_acceleration(c.drive)
    jolt = c.alpha * motion.most_jerk(c.drive)
    most = _most_acceleration(c, tau, s)
    near = np.zeros(n, np.int64)
    at_rest = np.zeros(n, np.int64)
    reach = np.zeros(n)
    change = 0.0
    for i in range(n):
        wheel = c.wheels[i]
        nearest = 1 if s[2 * i] > 0.0 else -1
        gap = max(wheel.wall - abs(s[2 * i]), 0.0)
        slow = _is_slow(c, i, s, most)
        change += approach(c, i, u, driver, force, jolt)[3]
        near[i] = nearest if slow or i == mesh - 1 else 0
        # speed that it has at its wall at most
        fastest = abs(s[2 * i + 1]) + math.sqrt(2.0 * most * gap)
        if i != mesh - 1:
            at_rest[i] = nearest if fastest == 0.0 else 0
            reach[i] = fastest if slow else 0.0
    # without the fastest of them, again and again: it may be in flight beside the chatter of others
    while reach.max() > 0.0:
        together = find_sticking(c, tau, s, near)
        if together[mesh - 1] != 0 and _stick_together(c, tau, s, together, at_rest, mesh, change):
            return 0.0, together
        i = int(np.argmax(reach))
        near[i] = 0
        reach[i] = 0.0
    closed = find_sticking(c, tau, s, at_rest)
    press = side * contact_motion(c, tau, s, closed)[mesh - 1]
    speed = -side * s[2 * mesh - 1]
    if not (press > 0.0 and speed >= 0.0):
        return math.inf, never
    t = 2.0 / (1.0 - c.wheels[mesh - 1].epsilon) * speed / press
    change = approach(c, mesh - 1, u, driver, force, jolt)[3]
    if t > CHATTER_LIMIT or t * change > CHATTER_LIMIT * press:
        return math.inf, never
    closed[mesh - 1] = side
    motions = contact_motion(c, tau, s, closed)
    for i in range(n):
        if closed[i] != 0:
            continue
        wheel = c.wheels[i]
        x = s[2 * i]
        y = s[2 * i + 1]
        up = safe_time(wheel.wall - x, y, motions[i], most, 0.0)
        down = safe_time(wheel.wall + x, -y, -motions[i], most, 0.0)
        if min(up, down) < t:
            return math.inf, never
    return t, closed
