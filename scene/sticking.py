"""Closed meshes: when impacts accumulate, what holds a mesh shut, when it opens, and how the rest moves meanwhile.

A mesh is closed on a side while its contact pushes.  The contact at mesh 1 changes the accelerations of ``(y1, y2)`` in
the proportion (1, 1), that at mesh 2 in the proportion (mu, 1), as their impulses do (docs/model.md section 3).  With
``p_i = beta_i u_i + gamma_i`` and the free accelerations ``f1 = p1 - alpha sin tau``, ``f2 = p1 - p2``:

- mesh 1 closed: wheel 1 moves with the driver and ``-x2`` is a single stage with the damping and drag of wheel 2;
- mesh 2 closed: both wheels move as one, x1 is a single stage with ``(1 - mu) beta1 + mu beta2`` and the drag alike;
- both closed: all move with the driver.

Impacts that accumulate are added up as soon as all that are left take no longer than `SETTLED`, and the acceleration
cannot change by more than this share of itself meanwhile.
"""

import math

from rattle.scene.compiled import jit
from rattle.scene.flight import State, flow, wheel_speeds
from rattle.scene.impact import NONE, REST, TOUCH, next_impact, safe_time
from rattle.scene.scene import Constants

__all__ = [
    "Sides", "carried", "closed_sides", "next_contact", "open_stage", "opening", "presses", "settled", "settled_on",
    "settling",
]  # fmt: skip

Sides = tuple[int, int]
"""Side on which mesh 1 and mesh 2 are closed, +1 or -1; 0 for an open mesh."""

SETTLED = 1e-6


@jit
def _pulls(c: Constants, tau: float, y1: float, y2: float) -> tuple[float, float, float]:
    """``(p1, p2)`` and the acceleration of the driver, ``-alpha sin tau``."""
    u1, u2 = wheel_speeds(c, tau, y1, y2)
    return c.beta1 * u1 + c.gamma1, c.beta2 * u2 + c.gamma2, -c.alpha * math.sin(tau)


@jit
def presses(c: Constants, tau: float, y1: float, y2: float, sides: Sides) -> tuple[float, float]:
    """What the contacts of the closed meshes push with, as accelerations; 0 for an open mesh, negative if they pull."""
    p1, p2, driver = _pulls(c, tau, y1, y2)
    f1, f2 = p1 + driver, p1 - p2
    first, second = sides
    if first != 0 and second != 0:
        return first * (f1 - c.mu * f2) / (1.0 - c.mu), -second * (f1 - f2) / (1.0 - c.mu)
    return first * f1, second * f2


@jit
def closed_sides(c: Constants, tau: float, y1: float, y2: float, touching: Sides) -> Sides:
    """Which meshes stay closed, of those that are at a wall at no speed (`touching`; y of others is as it is).

    Two meshes at their walls are told by the one combination in which every contact pushes and every open mesh is
    drawn away: there is just one, for the contacts' effects on each other have a positive determinant, ``1 - mu``.

    Examples
    --------
    >>> from rattle.scene import Scene
    >>> c = Scene(alpha=0.5, epsilon=0.3, beta1=0.0, gamma1=1.0, stages=1).constants
    >>> closed_sides(c, 0.0, 0.0, 0.0, (1, 0))
    (1, 0)
    """
    first, second = touching
    press1, press2 = presses(c, tau, y1, y2, touching)
    if first != 0 and second != 0:
        if press1 > 0.0 and press2 > 0.0:
            return first, second
        p1, p2, driver = _pulls(c, tau, y1, y2)
        if first * (p1 + driver) > 0.0 and second * (p2 + driver) >= 0.0:  # y2' = -(p2 + driver) draws mesh 2 open
            return first, 0
        if second * (p1 - p2) > 0.0:
            return 0, second
        return 0, 0
    return (first if press1 > 0.0 else 0), (second if press2 > 0.0 else 0)


@jit
def _until_driver(side: int, beta: float, gamma: float, alpha: float, tau: float) -> float:
    """Time until ``side (gamma + alpha (beta cos tau - sin tau))`` falls to zero; infinite if it never does."""
    most = alpha * math.sqrt(1.0 + beta * beta)
    if side * gamma >= most:
        return math.inf
    falls = math.asin(max(gamma / most, -1.0)) if side > 0 else math.pi - math.asin(min(gamma / most, 1.0))
    return (falls + math.atan(beta) - tau) % (2.0 * math.pi)


@jit
def opening(c: Constants, tau: float, y1: float, y2: float, sides: Sides) -> tuple[float, int]:
    """Time until the first of the closed meshes is no longer pressed shut, and which; infinite for never.

    Examples
    --------
    >>> from rattle.scene import Scene
    >>> c = Scene(alpha=2.0, epsilon=0.3, beta1=0.0, gamma1=1.0, stages=1).constants
    >>> t, mesh = opening(c, 0.0, 0.0, 0.0, (1, 0))
    >>> round(2.0 * math.sin(t), 12), mesh     # the driver's acceleration has come up to the drag
    (1.0, 1)
    """
    first, second = sides
    if first != 0 and second != 0:
        beta, gamma = _as_one(c)
        t1 = _until_driver(first, beta, gamma, c.alpha, tau)
        t2 = _until_driver(-second, c.beta2, c.gamma2, c.alpha, tau)
        return (t1, 1) if t1 <= t2 else (t2, 2)
    if first != 0:
        return _until_driver(first, c.beta1, c.gamma1, c.alpha, tau), 1
    # both wheels as one: the contact pulls from the speed on at which their decelerations are the same
    beta, gamma = _as_one(c)
    u, _ = wheel_speeds(c, tau, y1, y2)
    if c.beta1 == c.beta2:
        return math.inf, 2
    left = u + (c.gamma1 - c.gamma2) / (c.beta1 - c.beta2)  # of the speed u to lose
    rate = beta * u + gamma
    share = left / rate if rate != 0.0 else math.inf  # of E = (1 - exp(-beta t)) / beta
    if not share > 0.0 or beta * share >= 1.0:
        return math.inf, 2
    return (share if beta == 0.0 else -math.log1p(-beta * share) / beta), 2


@jit
def _as_one(c: Constants) -> tuple[float, float]:
    """Damping and drag of both wheels moving as one."""
    return (1.0 - c.mu) * c.beta1 + c.mu * c.beta2, (1.0 - c.mu) * c.gamma1 + c.mu * c.gamma2


@jit
def open_stage(c: Constants, sides: Sides) -> Constants:
    """The single stage that is left while one mesh is closed: ``x1``, or ``-x2``."""
    if sides[0] != 0:
        return Constants(
            c.alpha, c.epsilon, c.beta2, 0.0, c.gamma2, 0.0, 0.0, c.wall2, c.wall2, c.sigma, 1
        )  # fmt: skip
    beta, gamma = _as_one(c)
    return Constants(c.alpha, c.epsilon, beta, 0.0, gamma, 0.0, 0.0, c.wall1, c.wall1, c.sigma, 1)


@jit
def carried(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, sides: Sides, t: float
) -> State:  # fmt: skip
    """State after a time t in which the same meshes stay closed, and no other is struck."""
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


@jit
def next_contact(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, sides: Sides, horizon: float
) -> tuple[float, int, int, float, float, float, float, Sides]:
    """What comes next while meshes are closed: an impact of the open mesh, or the opening of a closed one.

    Parameters
    ----------
    c : Constants
    tau, x1, y1, x2, y2 : float
        Now.
    sides : (int, int)
        Closed meshes; at least one.
    horizon : float
        Longest time that is followed.

    Returns
    -------
    t, mesh, side, x1, y1, x2, y2
        As of `rattle.scene.impact.next_impact`; `REST` says that a mesh has opened, or that the open one has come to
        its wall at no speed.
    sides : (int, int)
        Meshes that are known to be still closed.
    """
    first, second = sides
    opens, which = opening(c, tau, y1, y2, sides)
    until = min(opens, horizon)
    t, mesh, side = until, NONE, 0
    if first == 0:
        t, mesh, side, x1, y1, _, _ = next_impact(open_stage(c, sides), tau, x1, y1, 0.0, 0.0, until)
    elif second == 0 and c.stages == 2:
        t, mesh, side, x2, y2, _, _ = next_impact(open_stage(c, sides), tau, -x2, -y2, 0.0, 0.0, until)
        x2, y2 = -x2, -y2
        mesh, side = (2 if mesh == 1 else mesh), -side
    if mesh == REST:
        return t, mesh, side, x1, y1, x2, y2, (0, 0)
    if mesh == NONE and opens <= horizon:
        # a moment later the mesh moves inward, if by less than rounding of its place: it is open from then on
        mesh, side = REST, (first if which == 1 else second)
        first, second = (0, second) if which == 1 else (first, 0)
        x1, y1, x2, y2 = flow(c, tau + t, x1, y1, x2, y2, TOUCH)
        x1, y1, x2, y2 = settled(c, x1, y1, x2, y2, (first, second))
        if which == 1:
            x1, y1 = side * c.wall1, -side * max(-side * y1, 1e-300)
        else:
            x2, y2 = side * c.wall2, -side * max(-side * y2, 1e-300)
        t += TOUCH
    return t, mesh, side, x1, y1, x2, y2, (first, second)


@jit
def settled_on(c: Constants, x1: float, y1: float, x2: float, y2: float, mesh: int, place: float) -> State:
    """The state with a mesh at rest on its wall; what the contact does not act on keeps its place and speed.

    That is wheel 2 at mesh 1, and the momentum of both wheels at mesh 2.
    """
    if mesh == 1:
        return place, 0.0, x2 + (place - x1), y2 - y1
    return x1 + c.mu * (place - x2), y1 - c.mu * y2, place, 0.0


@jit
def settled(c: Constants, x1: float, y1: float, x2: float, y2: float, sides: Sides) -> State:
    """The same for one closed mesh, or for both."""
    first, second = sides
    if first != 0 and second != 0:
        return first * c.wall1, 0.0, second * c.wall2, 0.0
    if first != 0:
        return settled_on(c, x1, y1, x2, y2, 1, first * c.wall1)
    if second != 0:
        return settled_on(c, x1, y1, x2, y2, 2, second * c.wall2)
    return x1, y1, x2, y2


@jit
def settling(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, mesh: int, side: int
) -> tuple[float, Sides]:
    """Whether the impacts at a mesh accumulate from here on: the time that they take, and the meshes then closed.

    The speed shrinks by epsilon from bounce to bounce, flights of ``2 w / a`` with it, and their sum is
    ``2 w / (a (1 - epsilon))``, w the speed after the impact and a what presses the mesh shut.  It is taken where it is
    short, a changes by less than `SETTLED` of itself in it, and the other mesh meets no wall: right to this share.
    Meshes that throw each other back are closed together, at once, when both are that slow.

    Returns
    -------
    t : float
        Infinite where impacts do not accumulate, or cannot be added up yet.
    sides : (int, int)
    """
    if c.epsilon == 1.0:
        return math.inf, (0, 0)
    p1, p2, driver = _pulls(c, tau, y1, y2)
    jerk1, jerk2 = c.alpha + c.beta1 * abs(p1), c.beta1 * abs(p1) + c.beta2 * abs(p2)
    longest = 2.0 / (1.0 - c.epsilon)
    if c.stages == 2 and abs(x1) == c.wall1 and abs(x2) == c.wall2:
        sides = (1 if x1 > 0.0 else -1), (1 if x2 > 0.0 else -1)
        press1, press2 = presses(c, tau, y1, y2, sides)
        jerk = jerk1 + jerk2
        if press1 > 0.0 and press2 > 0.0:
            weakest = min(press1, press2)
            t = longest * max(abs(y1), abs(y2)) / weakest
            if t > SETTLED or t * jerk > SETTLED * weakest:
                return math.inf, (0, 0)
            return 0.0, sides
    if mesh == 1:
        press, speed, jerk = side * (p1 + driver), -side * y1, jerk1
        sides = (side, 0)
    else:
        press, speed, jerk = side * (p1 - p2), -side * y2, jerk2
        sides = (0, side)
    if not (press > 0.0 and speed >= 0.0):
        return math.inf, (0, 0)
    t = longest * speed / press
    if t > SETTLED or t * jerk > SETTLED * press:
        return math.inf, (0, 0)
    if c.stages == 2:
        if mesh == 1:
            x, y, wall, f, most = x2, y2, c.wall2, -(p2 + driver), abs(p2) + c.alpha
        else:
            x, y, wall, f, most = x1, y1, c.wall1, p1 + driver - c.mu * (p1 - p2), abs(p1) + abs(p2) + c.alpha
        if min(safe_time(wall - x, y, f, most, 0.0), safe_time(wall + x, -y, -f, most, 0.0)) < t:
            return math.inf, (0, 0)
    return t, sides
