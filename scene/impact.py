"""Impacts: restitution maps, and the next outward crossing of a wall (docs/model.md
section 3)."""

import math
from typing import TypeVar

import numpy as np

from rattle.scene.compiled import inline, internal, jit, lean, lean_internal, not_inlined, splice
from rattle.scene.drive import acceleration, most_acceleration, most_jerk, most_velocity
from rattle.scene.flight import displace, wheel_speeds
from rattle.scene.linear_algebra import add_outer
from rattle.scene.types import Constants, Floats, Ints

Number = TypeVar("Number", float, Floats)

# Codes that `next_impact` returns in place of a mesh.
NONE = 0  # no impact within the horizon
REST = -1  # a mesh sticks: it touches its wall at zero speed and is accelerated into it
LOST = -2  # the search was given up after MOST_SEARCH_STEPS steps
MISSES = {
    NONE: "no impact within the horizon",
    REST: "a mesh sticks",
    LOST: "the search for the next impact takes too long",
}
"""The same in words."""
# time step off a wall that is touched at zero speed; the displacement in it is below rounding
TOUCH_STEP = 1e-9
SPRING_SHARE = 0.25  # of the fastest rate of a wheel with a spring, over which bounds are taken
FALLING_POWER = 0.25  # of the restitution of fast impacts over their speed
MOST_SEARCH_STEPS = 1_000_000  # of the search for one impact; DAT21 takes about ten
# most times that a step is enlarged, each time by 8: the first step may be as short as 1e-80
SOON = 100
# slowest impact that is no graze, over the largest of excitation, drag and initial speeds
GRAZE = 1e-6


@inline
def falloff(c: Constants, i: int, speed: float) -> float:
    """What is left of the restitution of slow impacts at a speed."""
    if c.wheels[i].slowing == 0.0:
        return 1.0
    return falloff_derivatives(c, i, speed)[0]


@lean_internal
def falloff_derivatives(c: Constants, i: int, speed: float) -> tuple[float, float, float]:
    """`falloff`, and its first and second derivative by the size of the speed.

    A table, or the power law of a plastic contact ``(1 + |w| / speed)^(-1/4)`` (Johnson 1985,
    section 11.5), which is 1 for slow impacts.
    """
    not_inlined()
    wheel = c.wheels[i]
    size = abs(speed)
    if wheel.rows == 0:
        base = 1.0 + wheel.slowing * size
        rate = wheel.slowing / base
        left = math.pow(base, -FALLING_POWER)
        first = -FALLING_POWER * rate * left
        return left, first, -(1.0 + FALLING_POWER) * rate * first
    k = 0
    while k < wheel.rows and wheel.pieces[k + 1, 0] <= size:
        k += 1
    begin, constant, linear, square, cube = wheel.pieces[k]
    t = size - begin
    left = constant + t * (linear + t * (square + t * cube))
    return left, linear + t * (2.0 * square + 3.0 * t * cube), 2.0 * square + 6.0 * t * cube


@lean
def strike(c: Constants, mesh: int, s: Floats) -> None:
    """Apply an impact at a mesh to the rates of a state, in place (the restitution map).

    The driver's motion is prescribed: Eq. 10 uses this map, Eqs. 4 and 6 omit it.  An impact at
    another mesh is Eq. 4.  Which mesh it is cannot be predicted: there is no branch on it.

    Shapes: `s` (2 wheels,).
    """
    rebound(c, mesh, c.wheels[mesh - 1].epsilon, s)


@inline
def rebound(c: Constants, mesh: int, epsilon: float, s: Floats) -> None:
    """`strike` for a given restitution of slow impacts."""
    reflect(c, mesh, epsilon * falloff(c, mesh - 1, s[2 * mesh - 1]), s)


@inline
def reflect(c: Constants, mesh: int, epsilon: float, s: Floats) -> None:
    """`strike` for a given restitution at the impact speed."""
    i = mesh - 1
    wheel = c.wheels[i]
    rate = s[2 * i + 1]
    change = -(1.0 + epsilon) * rate
    # of the deviations of the wheel's and of its parent's speed
    own = wheel.sign * (1.0 - wheel.share) * change
    others = wheel.share * change / wheel.ratio
    for j in range(c.wheels.size):
        other = c.wheels[j]
        moved = own if other.parent == i else (others if other.parent == wheel.parent else 0.0)
        by_parent = other.ratio * moved if other.parent >= 0 else 0.0
        s[2 * j + 1] += other.sign * others if j == wheel.parent else by_parent
    s[2 * i + 1] = -epsilon * rate


def slowest_impact(c: Constants, state: Floats) -> float:
    """Impact speed below which an orbit that begins at a state grazes its wall: it has no
    derivative there."""
    drag = float(c.wheels["gamma"].max())
    return GRAZE * max(c.alpha, drag, float(np.abs(state[1::2]).max()))


@internal
def energy_loss(c: Constants, mesh: int, y: Number) -> Number:
    """Kinetic energy lost in an impact at a mesh at a rate, in units of ``I1 / R1^2 (nu1
    omega)^2``, I1 / R1^2 the mass of wheel 1.

    ``(1 - eps^2) y^2 / 2`` times the reduced mass of the wheel and its parent, of a random
    restitution the mean; the driver's motion is prescribed.
    """
    wheel = c.wheels[mesh - 1]
    reduced = wheel.mass * (1.0 - wheel.share)
    square = wheel.epsilon * wheel.epsilon + wheel.variance
    if wheel.slowing > 0.0:
        left = falloff(c, mesh - 1, float(y))  # of one speed; `y` may be several otherwise
        square = square * left * left
    loss: Number = 0.5 * (1.0 - square) * reduced * y * y
    return loss


@internal
def safe_time(
    distance: float, speed: float, acceleration: float, most: float, jerk: float
) -> float:
    """A time within which a wall `distance` ahead cannot be reached.

    `jerk`: Upper bound of the rate of change of the acceleration; 0 if none is known.
    """
    if distance == math.inf:
        return distance
    distance = max(distance, 0.0)
    step = _within(distance, speed, most)
    if jerk == 0.0 or (speed > 0.0 and speed * speed > most * distance):
        return step
    if (
        speed <= 0.0 and acceleration < 0.0
    ):  # moving and accelerated away: no return before 3 |acceleration| / jerk
        step = max(step, -3.0 * acceleration / jerk)
    for _ in range(
        SOON
    ):  # over a short time the bound by the jerk is sharper: enlarge the step while it is
        longer = 8.0 * step
        soon = max(acceleration, 0.0) + jerk * longer
        if not soon < 0.5 * most:
            break
        within = _within(distance, speed, soon)
        if within < longer:
            return max(step, within)
        step = longer
    return step


@internal
def _within(distance: float, speed: float, most: float) -> float:
    """`safe_time` for an acceleration of at most `most`, without a bound on its rate."""
    root = math.sqrt(speed * speed + 2.0 * most * distance)
    if speed > 0.0:
        return 2.0 * distance / (speed + root)
    return (root - speed) / most if most > 0.0 else math.inf


@internal
def _touching(
    t: float, high: float, low: float, to_high: float, to_low: float, speed: float
) -> int:
    """The side of the wall that is reached, or 0: at zero distance, or at a distance too short to
    change the time."""
    if high <= 0.0 or (t + to_high == t and speed > 0.0):
        return 1
    if low <= 0.0 or (t + to_low == t and speed < 0.0):
        return -1
    return 0


@internal
def spring_step(c: Constants, i: int) -> float:
    """A time over which the bounds of `approach` hold; infinite without a spring."""
    wheel = c.wheels[i]
    if wheel.stiffness == 0.0:
        return math.inf
    step: float = SPRING_SHARE / wheel.fastest
    return step


@internal
def _approach_sprung(
    c: Constants, i: int, f: float, y: float, drive_rate: float
) -> tuple[float, float, float, float]:
    """`approach` of a wheel that a spring holds, over `spring_step`.

    ``|a'| <= beta |a| + stiffness |y| + drive_rate``, and in that time y and the acceleration a
    grow by no more than that makes of them.
    """
    not_inlined()
    wheel = c.wheels[i]
    t = spring_step(c, i)
    by_speed = wheel.stiffness * abs(y) + drive_rate
    kept = 1.0 - t * (wheel.beta + t * wheel.stiffness)
    most = (abs(f) + t * by_speed) / kept
    jerk = by_speed + (wheel.beta + t * wheel.stiffness) * most
    return f, max(f + t * jerk, 0.0), max(t * jerk - f, 0.0), jerk


@internal
def approach(
    c: Constants, i: int, x: float, y: float, u: Floats, driver: float, force: float, jolt: float
) -> tuple[float, float, float, float]:
    """Acceleration of a gap, its bounds towards both walls, and one of its rate of change.

    What a wheel loses, ``p_i = beta_i u_i + gamma_i``, only decays along a flight.  At the driver
    the acceleration towards a wall is at most that of the driver plus the part of p_i that acts
    towards it.  Between two wheels it is at most the part of ``k p_p - p_i`` that does, plus what
    the difference of the dampings can add.
    """
    wheel = c.wheels[i]
    pull = wheel.beta * u[i] + wheel.gamma
    if wheel.parent < 0:
        f = wheel.sign * (pull + wheel.turn * driver) - wheel.stiffness * x
        if wheel.stiffness > 0.0:
            return _approach_sprung(c, i, f, y, wheel.turn * (jolt + wheel.beta * force))
        push = wheel.sign * pull
        most = wheel.turn * force
        jerk = wheel.turn * jolt + wheel.beta * abs(pull)
        return f, most + max(push, 0.0), most + max(-push, 0.0), jerk
    parent = c.wheels[wheel.parent]
    other = wheel.ratio * (parent.beta * u[wheel.parent] + parent.gamma)
    f = other - pull
    drift = 0.0
    if parent.beta != wheel.beta:
        mismatch = abs(parent.beta - wheel.beta) / max(parent.beta, wheel.beta)
        drift = mismatch * min(abs(other), abs(pull))
    jerk = parent.beta * abs(other) + wheel.beta * abs(pull)
    return f, max(f, 0.0) + drift, max(-f, 0.0) + drift, jerk


@splice
def _put_touching(
    c: Constants, high: Floats, low: Floats, moved: Floats, sides: Ints, slack: float
) -> int:
    """The first mesh that is struck, or 0; all that touch their wall or are within the slack of it
    are put on it: struck at one instant, they follow after flights of time 0."""
    mesh = 0
    for i in range(c.wheels.size):
        above = high[i] - moved[2 * i]
        below = low[i] + moved[2 * i]
        if sides[i] == 0 and min(above, below) <= slack:
            sides[i] = 1 if above < below else -1
        if mesh == 0 and sides[i] * moved[2 * i + 1] > 0.0:
            mesh = i + 1
    return mesh


@jit
def next_impact(
    c: Constants, tau: float, s: Floats, horizon: float
) -> tuple[float, int, int, Floats]:
    """The earliest outward wall crossing of a flight.

    The flight is followed by steps within which no crossing is possible (`approach`).  Near a
    transversal crossing these steps are Newton steps from the safe side; an excursion beyond the
    wall and back cannot be missed.

    Distances are from the initial distance and the displacement since: a flight of time 1e-12 is
    resolved too.

    Returns: Time; mesh, or `NONE` if there is no impact within the horizon, `REST` if a mesh
    sticks, `LOST` after `MOST_SEARCH_STEPS` steps; side; and the state just before the impact, in
    which the displacement of the struck mesh is exactly that of its wall. If several meshes are
    struck at one instant the first comes first, and the others follow after a flight of time 0.
    Shapes: `s`, state (2 wheels,).
    """
    n = c.wheels.size
    high = np.empty(n)
    low = np.empty(n)
    begin = wheel_speeds(c, tau, s)
    # what has been added to the displacements, and the rates
    moved = s.copy()
    # the rounding error of a displacement is about 1e-16 times this times t
    rate = c.alpha * most_velocity(c.drive)
    for i, wheel in enumerate(c.wheels):
        high[i] = wheel.wall - s[2 * i]
        low[i] = wheel.low + s[2 * i]
        moved[2 * i] = 0.0
        rate += abs(begin[i])
    force = c.alpha * most_acceleration(c.drive)
    jolt = c.alpha * most_jerk(c.drive)
    sides = np.zeros(n, np.int64)
    t = 0.0
    mesh = LOST
    for _ in range(MOST_SEARCH_STEPS):
        u = wheel_speeds(c, tau + t, moved)
        driver = c.alpha * acceleration(c.drive, tau + t)
        step = math.inf
        due = False
        resting = -1
        for i in range(n):
            y = moved[2 * i + 1]
            x = s[2 * i] + moved[2 * i]
            f, up, down, jerk = approach(c, i, x, y, u, driver, force, jolt)
            above = high[i] - moved[2 * i]
            below = low[i] + moved[2 * i]
            to_high = safe_time(above, y, f, up, jerk)
            to_low = safe_time(below, -y, -f, down, jerk)
            sides[i] = _touching(t, above, below, to_high, to_low, y)
            due = due or sides[i] * y > 0.0
            if resting < 0 and y == 0.0 and f * sides[i] > 0.0:
                resting = i
            step = min(step, to_high, to_low, spring_step(c, i))
        if due:
            slack = 1e-15 * rate * min(t, 10.0) if t > 0.0 else -1.0
            mesh = _put_touching(c, high, low, moved, sides, slack)
            break
        if resting >= 0:
            mesh = REST
            for i in range(n):
                sides[i] = sides[i] if i == resting else 0
            break
        if t >= horizon:
            mesh = NONE
            break
        if (
            t + step == t
        ):  # touching a wall at zero speed and acceleration: shorter steps change nothing
            step = TOUCH_STEP
        t = min(t + step, horizon)
        displace(c, tau, begin, s, t, moved)
    side = 0
    for i in range(n):
        moved[2 * i] += s[2 * i]
        if mesh in (LOST, NONE) or sides[i] == 0:
            continue
        moved[2 * i] = sides[i] * c.wheels[i].wall
        if mesh in (REST, i + 1):
            side = sides[i]
    return t, mesh, side, moved


@internal
def _unit_rebound(c: Constants, mesh: int, epsilon: float) -> Floats:
    """State after an impact of unit rate with a given restitution."""
    unit = np.zeros(2 * c.wheels.size)
    unit[2 * mesh - 1] = 1.0
    reflect(c, mesh, epsilon, unit)
    return unit


@internal
def contact_matrix(c: Constants, mesh: int, speed: float, size: int = 0, at: int = 0) -> Floats:
    """Derivative of the restitution map on the state at an impact speed, or on more with the state
    from place `at` on; the identity for mesh 0.

    Shapes: result (size, size), by default (2 wheels, 2 wheels).
    """
    states = 2 * c.wheels.size
    r = np.eye(max(size, states))
    if mesh > 0:
        left, first, _ = falloff_derivatives(c, mesh - 1, speed)
        # derivative of epsilon(w) w
        slope = c.wheels[mesh - 1].epsilon * (left + first * abs(speed))
        unit = _unit_rebound(c, mesh, slope)
        for i in range(states):
            r[at + i, at + 2 * mesh - 1] = unit[i]
    return r


@internal
def rebound_axis(c: Constants, mesh: int, size: int) -> Floats:
    """Derivative of the section state after an impact by ``epsilon(w) w``.

    Shapes: result (size,), 0 from the state on.
    """
    elastic = _unit_rebound(c, mesh, 1.0)
    plastic = _unit_rebound(c, mesh, 0.0)
    axis = np.zeros(size)
    for i in range(elastic.size):
        axis[1 + i] = elastic[i] - plastic[i]
    return axis


@internal
def rebound_bend(c: Constants, mesh: int, speed: float) -> float:
    """Second derivative of ``epsilon(w) w`` at an impact speed."""
    _, first, second = falloff_derivatives(c, mesh - 1, speed)
    bend = 2.0 * first + second * abs(speed)
    return math.copysign(c.wheels[mesh - 1].epsilon, speed) * bend


@internal
def add_scatter(c: Constants, mesh: int, speed: float, spread: float, covariance: Floats) -> None:
    """Add to the covariance of a section state what a random restitution adds at an impact, in
    place.

    `spread`: Variance of the impact speed.
    """
    wheel = c.wheels[mesh - 1]
    if wheel.variance == 0.0:
        return
    axis = rebound_axis(c, mesh, covariance.shape[0])
    left = falloff(c, mesh - 1, speed)
    square = wheel.variance * left * left * (speed * speed + spread)
    add_outer(covariance, square, axis, axis)
