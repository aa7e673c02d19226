"""Sticking: when chatter is complete, what keeps a mesh closed, when it opens, and how the rest of
the system moves.

A mesh sticks on a side while its contact force pushes.  The contact at mesh 1 changes the
accelerations of ``(y1, y2)`` in the proportion (1, 1), that at mesh 2 in the proportion (mu, 1), as
their impulses do (docs/model.md section 3). With ``p_i = beta_i u_i + gamma_i`` and the free
accelerations ``f1 = p1 + alpha f''``, ``f2 = p1 - p2``:

- mesh 1 sticks: wheel 1 moves with the driver, and ``-x2`` is a single stage with the damping and
  drag of wheel 2;
- mesh 2 sticks: both wheels move as one, and x1 is a single stage with damping ``(1 - mu) beta1 +
  mu beta2`` and the drag averaged likewise;
- both stick: everything moves with the driver.

Chatter is completed as a geometric series (`complete_chatter`).
"""

import math
from typing import Any

from rattle.scene import drive as motion
from rattle.scene.compiled import internal
from rattle.scene.flight import State, flow, wheel_speeds
from rattle.scene.impact import NONE, REST, TOUCH_STEP, next_impact, safe_time
from rattle.scene.types import Constants

Sides = tuple[int, int]
"""Sides on which mesh 1 and mesh 2 stick, +1 or -1; 0 for an open mesh."""

# longest time, and largest relative change of the contact acceleration, of chatter that is summed
# up
CHATTER_LIMIT = 1e-6


@internal
def _pulls(c: Constants, tau: float, y1: float, y2: float) -> tuple[float, float, float]:
    """``(p1, p2)`` and the acceleration of the driver, ``alpha f''``."""
    u1, u2 = wheel_speeds(c, tau, y1, y2)
    return (
        c.beta1 * u1 + c.gamma1,
        c.beta2 * u2 + c.gamma2,
        c.alpha * motion.acceleration(c.drive, tau),
    )


@internal
def presses(c: Constants, tau: float, y1: float, y2: float, sides: Sides) -> tuple[float, float]:
    """Contact forces of the sticking meshes, as accelerations: positive while a contact pushes, 0
    for an open mesh."""
    p1, p2, driver = _pulls(c, tau, y1, y2)
    f1 = p1 + driver
    f2 = p1 - p2
    first, second = sides
    if first != 0 and second != 0:
        return first * (f1 - c.mu * f2) / (1.0 - c.mu), -second * (f1 - f2) / (1.0 - c.mu)
    return first * f1, second * f2


@internal
def find_sticking(c: Constants, tau: float, y1: float, y2: float, touching: Sides) -> Sides:
    """Which meshes stick, of those that touch a wall at zero speed.

    If both touch, the answer is the one combination in which every contact pushes and every open
    mesh accelerates away. It is unique, because the matrix of the contacts' effects on each other
    has a positive determinant, ``1 - mu``.

    `touching`: Sides on which meshes touch their wall at zero speed; 0 for a mesh that does not.
    """
    first, second = touching
    press1, press2 = presses(c, tau, y1, y2, touching)
    if first != 0 and second != 0:
        if press1 > 0.0 and press2 > 0.0:
            return first, second
        p1, p2, driver = _pulls(c, tau, y1, y2)
        if (
            first * (p1 + driver) > 0.0 and second * (p2 + driver) >= 0.0
        ):  # y2' = -(p2 + driver) opens mesh 2
            return first, 0
        if second * (p1 - p2) > 0.0:
            return 0, second
        return 0, 0
    return (first if press1 > 0.0 else 0), (second if press2 > 0.0 else 0)


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
def opening(c: Constants, tau: float, y1: float, y2: float, sides: Sides) -> tuple[float, int]:
    """Time until the first of the sticking meshes opens, because its contact force has fallen to
    zero."""
    first, second = sides
    if first != 0 and second != 0:
        beta, gamma = _as_one(c)
        t1 = _until_driver(c.drive, first, beta, gamma, c.alpha, tau)
        t2 = _until_driver(c.drive, -second, c.beta2, c.gamma2, c.alpha, tau)
        return (t1, 1) if t1 <= t2 else (t2, 2)
    if first != 0:
        return _until_driver(c.drive, first, c.beta1, c.gamma1, c.alpha, tau), 1
    # mesh 2 sticks: it opens at the common speed at which both wheels decelerate alike
    beta, gamma = _as_one(c)
    u, _ = wheel_speeds(c, tau, y1, y2)
    if c.beta1 == c.beta2:
        return math.inf, 2
    left = u + (c.gamma1 - c.gamma2) / (c.beta1 - c.beta2)  # what is left to lose of the speed u
    rate = beta * u + gamma
    e = left / rate if rate != 0.0 else math.inf  # E = (1 - exp(-beta t)) / beta at the opening
    if not e > 0.0 or beta * e >= 1.0:
        return math.inf, 2
    return (e if beta == 0.0 else -math.log1p(-beta * e) / beta), 2


@internal
def _as_one(c: Constants) -> tuple[float, float]:
    """Damping and drag of both wheels moving together."""
    return (1.0 - c.mu) * c.beta1 + c.mu * c.beta2, (1.0 - c.mu) * c.gamma1 + c.mu * c.gamma2


@internal
def open_stage(c: Constants, sides: Sides) -> Constants:
    """The single stage that remains while one mesh sticks.

    Returns: A single stage for ``-x2`` if mesh 1 sticks, for ``x1`` if mesh 2 does.
    """
    beta, gamma = _as_one(c)
    wall = c.wall1
    if sides[0] != 0:
        beta = c.beta2
        gamma = c.gamma2
        wall = c.wall2
    return Constants(
        c.alpha, c.epsilon, beta, 0.0, gamma, 0.0, 0.0, wall, wall, c.sigma, 1, c.drive, c.memory
    )


@internal
def stick_on(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, sides: Sides, t: float
) -> State:
    """State after a time in which the same meshes stick and no wall is struck."""
    first, second = sides
    if first == 0 and second == 0:
        return flow(c, tau, x1, y1, x2, y2, t)
    if first == 0:
        x1, y1, _, _ = flow(open_stage(c, sides), tau, x1, y1, 0.0, 0.0, t)
        return x1, y1, x2, y2
    if second == 0 and c.stages == 2:
        x2, y2, _, _ = flow(open_stage(c, sides), tau, -x2, -y2, 0.0, 0.0, t)
        return x1, y1, -x2, -y2
    return x1, y1, x2, y2


@internal
def next_contact(
    c: Constants,
    tau: float,
    x1: float,
    y1: float,
    x2: float,
    y2: float,
    sides: Sides,
    horizon: float,
) -> tuple[float, int, int, float, float, float, float, Sides]:
    """The next event of a sticking phase: an impact of the open mesh, or the opening of a sticking
    one.

    Returns: As of `rattle.scene.impact.next_impact`; `REST` means that a mesh has opened, or that
    the open one has come to its wall at zero speed.
    """
    first, second = sides
    opens, which = opening(c, tau, y1, y2, sides)
    until = min(opens, horizon)
    t = until
    mesh = NONE
    side = 0
    if first == 0:
        t, mesh, side, x1, y1, _, _ = next_impact(
            open_stage(c, sides), tau, x1, y1, 0.0, 0.0, until
        )
    elif second == 0 and c.stages == 2:
        t, mesh, side, x2, y2, _, _ = next_impact(
            open_stage(c, sides), tau, -x2, -y2, 0.0, 0.0, until
        )
        x2 = -x2
        y2 = -y2
        mesh = 2 if mesh == 1 else mesh
        side = -side
    if mesh == REST:
        return t, mesh, side, x1, y1, x2, y2, (0, 0)
    if mesh == NONE and opens <= horizon:
        # step over the opening: TOUCH_STEP later the mesh moves inward, if by less than the
        # rounding of its displacement
        mesh = REST
        side = first if which == 1 else second
        first, second = (0, second) if which == 1 else (first, 0)
        x1, y1, x2, y2 = flow(c, tau + t, x1, y1, x2, y2, TOUCH_STEP)
        x1, y1, x2, y2 = stuck(c, x1, y1, x2, y2, (first, second))
        if which == 1:
            x1 = side * c.wall1
            y1 = -side * max(-side * y1, 1e-300)
        else:
            x2 = side * c.wall2
            y2 = -side * max(-side * y2, 1e-300)
        t += TOUCH_STEP
    return t, mesh, side, x1, y1, x2, y2, (first, second)


@internal
def stuck_on(
    c: Constants, x1: float, y1: float, x2: float, y2: float, mesh: int, place: float
) -> State:
    """The state with a mesh put on its wall at zero speed, everything that its contact does not act
    on kept.

    At mesh 1 position and speed of wheel 2 are kept, at mesh 2 the momentum and centre of mass of
    both wheels.
    """
    if mesh == 1:
        return place, 0.0, x2 + (place - x1), y2 - y1
    return x1 + c.mu * (place - x2), y1 - c.mu * y2, place, 0.0


@internal
def stuck(c: Constants, x1: float, y1: float, x2: float, y2: float, sides: Sides) -> State:
    """The state with all sticking meshes put on their walls at zero speed, see `stuck_on`."""
    first, second = sides
    if first != 0 and second != 0:
        return first * c.wall1, 0.0, second * c.wall2, 0.0
    if first != 0:
        return stuck_on(c, x1, y1, x2, y2, 1, first * c.wall1)
    if second != 0:
        return stuck_on(c, x1, y1, x2, y2, 2, second * c.wall2)
    return x1, y1, x2, y2


@internal
def may_chatter(c: Constants, tau: float, y1: float, y2: float, mesh: int) -> bool:
    """Whether a mesh is left so slowly that `complete_chatter` may sum up its impacts: the speed
    that is bounded there.

    No contact acceleration exceeds what the terms of all add up to.
    """
    p1, p2, driver = _pulls(c, tau, y1, y2)
    most = (abs(p1) + abs(p2) + abs(driver)) / (1.0 - c.mu)
    return (1.0 - c.epsilon) * CHATTER_LIMIT * most >= abs(y1 if mesh == 1 else y2)


@internal
def complete_chatter(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, mesh: int, side: int
) -> tuple[float, Sides]:
    """Whether impacts at a mesh accumulate (chatter), the time until they have, and the meshes that
    then stick.

    The speed shrinks by epsilon from bounce to bounce, and the flight times ``2 w / a`` with it.
    Their sum is ``2 w / (a (1 - epsilon))``, w the speed after the impact and a the acceleration
    towards the wall.  The sum is used where it is short, a changes by less than the share
    `CHATTER_LIMIT` in it, and the other mesh meets no wall; its relative error is about
    `CHATTER_LIMIT`.  Two meshes that throw each other back stick together, at once, when both are
    that slow and that close to their walls: they are hardly ever on both at the same instant.

    Returns: Time until the chatter is complete; infinite where impacts do not accumulate, or cannot
    be summed up yet.
    """
    if c.epsilon == 1.0:
        return math.inf, (0, 0)
    p1, p2, driver = _pulls(c, tau, y1, y2)
    force = c.alpha * motion.most_acceleration(c.drive)
    jolt = c.alpha * motion.most_jerk(c.drive)
    jerk1 = jolt + c.beta1 * abs(p1)
    jerk2 = c.beta1 * abs(p1) + c.beta2 * abs(p2)
    longest = 2.0 / (1.0 - c.epsilon)
    if c.stages == 2:
        sides = (1 if x1 > 0.0 else -1), (1 if x2 > 0.0 else -1)
        press1, press2 = presses(c, tau, y1, y2, sides)
        weakest = min(press1, press2)
        if weakest > 0.0:
            gap = max(c.wall1 - abs(x1), c.wall2 - abs(x2), 0.0)
            speed = max(abs(y1), abs(y2)) + math.sqrt(2.0 * max(press1, press2) * gap)
            t = longest * speed / weakest
            if t <= CHATTER_LIMIT and t * (jerk1 + jerk2) <= CHATTER_LIMIT * weakest:
                return 0.0, sides
    if mesh == 1:
        press = side * (p1 + driver)
        speed = -side * y1
        change = jerk1
        sides = (side, 0)
    else:
        press = side * (p1 - p2)
        speed = -side * y2
        change = jerk2
        sides = (0, side)
    if not (press > 0.0 and speed >= 0.0):
        return math.inf, (0, 0)
    t = longest * speed / press
    if t > CHATTER_LIMIT or t * change > CHATTER_LIMIT * press:
        return math.inf, (0, 0)
    if c.stages == 2:
        if mesh == 1:
            x = x2
            y = y2
            wall = c.wall2
            f = -(p2 + driver)
            most = abs(p2) + force
        else:
            x = x1
            y = y1
            wall = c.wall1
            f = p1 + driver - c.mu * (p1 - p2)
            most = abs(p1) + abs(p2) + force
        if min(safe_time(wall - x, y, f, most, 0.0), safe_time(wall + x, -y, -f, most, 0.0)) < t:
            return math.inf, (0, 0)
    return t, sides
