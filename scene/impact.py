"""Impacts at both meshes: restitution maps, and the next outward crossing of a wall (docs/model.md
section 3)."""

import math
from typing import TypeVar

import numpy as np

from rattle.scene.compiled import internal, jit
from rattle.scene.drive import acceleration, most_acceleration, most_jerk, most_velocity
from rattle.scene.flight import flow, wheel_speeds
from rattle.scene.types import Constants, Floats

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
MOST_SEARCH_STEPS = 1_000_000  # of the search for one impact; DAT21 takes about ten
# most times that a step is enlarged, each time by 8: the first step may be as short as 1e-80
SOON = 100
# slowest impact that is no graze, over the largest of excitation, drag and initial speeds
GRAZE = 1e-6


@jit
def struck(c: Constants, mesh: int, y1: float, y2: float) -> tuple[float, float]:
    """Velocities after an impact at a mesh (the restitution map)."""
    if mesh == 1:  # the driver's motion is prescribed: Eq. 10 uses this map, Eqs. 4 and 6 omit it
        return -c.epsilon * y1, y2 - (1.0 + c.epsilon) * y1
    return y1 - (1.0 + c.epsilon) * c.mu * y2, -c.epsilon * y2  # Eq. 4


def slowest_impact(c: Constants, state: Floats) -> float:
    """Impact speed below which an orbit that begins at a state grazes its wall: it has no
    derivative there."""
    return GRAZE * max(c.alpha, c.gamma1, abs(float(state[1])), abs(float(state[3])))


@internal
def energy_loss(c: Constants, mesh: int, y1: Number, y2: Number) -> Number:
    """Kinetic energy lost in impacts at a mesh, in units of ``I1 / R1^2 (nu1 omega)^2``, I1 / R1^2
    the mass of wheel 1.

    ``(1 - eps^2) y^2 / 2`` times the reduced mass: 1 at mesh 1, whose driver is prescribed, and mu
    at mesh 2.
    """
    share = 0.5 * (1.0 - c.epsilon * c.epsilon)
    return share * y1 * y1 if mesh == 1 else share * c.mu * y2 * y2


@internal
def safe_time(
    distance: float, speed: float, acceleration: float, most: float, jerk: float
) -> float:
    """A time within which a wall `distance` ahead cannot be reached.

    `jerk`: Upper bound of the rate of change of the acceleration; 0 if none is known.
    """
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
        found = _within(distance, speed, soon)
        if found < longer:
            return max(step, found)
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


@jit
def next_impact(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, horizon: float
) -> tuple[float, int, int, float, float, float, float]:
    """The earliest outward wall crossing of a flight.

    The flight is followed by steps within which no crossing is possible.  With ``p_i = beta_i u_i +
    gamma_i``, which only decays along a flight, the acceleration ``x_1''`` towards a wall is at
    most that of the driver plus the part of ``p_1`` that acts towards it.  ``x_2''`` is at most the
    part of ``p_1 - p_2`` that acts towards the wall, plus what the difference of the dampings can
    add.  Near a transversal crossing these steps are Newton steps from the safe side; an excursion
    beyond the wall and back cannot be missed.

    Distances are from the initial distance and the displacement since: a flight of time 1e-12 is
    resolved too.

    Returns: 1 or 2; `NONE` if there is no impact within the horizon; `REST` if a mesh sticks;
    `LOST` after `MOST_SEARCH_STEPS` steps. If both meshes are struck at one instant mesh 1 comes
    first, and mesh 2 follows after a flight of time 0. Returns: State just before the impact; the
    displacement of the struck mesh is exactly that of its wall.
    """
    high1 = c.wall1 - x1
    low1 = c.wall1 + x1
    high2 = c.wall2 - x2
    low2 = c.wall2 + x2
    u1, u2 = wheel_speeds(c, tau, y1, y2)
    force = c.alpha * most_acceleration(c.drive)
    jolt = c.alpha * most_jerk(c.drive)
    # the rounding error of a displacement is about 1e-16 times this times t
    rate = abs(u1) + abs(u2) + c.alpha * most_velocity(c.drive)
    mismatch = abs(c.beta1 - c.beta2) / max(c.beta1, c.beta2) if c.beta1 != c.beta2 else 0.0
    t = 0.0
    d1 = 0.0
    d2 = 0.0
    b1 = y1
    b2 = y2
    for _ in range(MOST_SEARCH_STEPS):
        u1, u2 = wheel_speeds(c, tau + t, b1, b2)
        # -u_i'
        pull1 = c.beta1 * u1 + c.gamma1
        pull2 = c.beta2 * u2 + c.gamma2
        # accelerations
        f1 = pull1 + c.alpha * acceleration(c.drive, tau + t)
        f2 = pull1 - pull2
        up = force + max(pull1, 0.0)
        down = force + max(-pull1, 0.0)
        jerk = jolt + c.beta1 * abs(pull1)
        to_high1 = safe_time(high1 - d1, b1, f1, up, jerk)
        to_low1 = safe_time(low1 + d1, -b1, -f1, down, jerk)
        side1 = _touching(t, high1 - d1, low1 + d1, to_high1, to_low1, b1)
        to_high2 = to_low2 = math.inf
        side2 = 0
        if c.stages == 2:
            drift = mismatch * min(abs(pull1), abs(pull2))
            jerk = c.beta1 * abs(pull1) + c.beta2 * abs(pull2)
            to_high2 = safe_time(high2 - d2, b2, f2, max(f2, 0.0) + drift, jerk)
            to_low2 = safe_time(low2 + d2, -b2, -f2, max(-f2, 0.0) + drift, jerk)
            side2 = _touching(t, high2 - d2, low2 + d2, to_high2, to_low2, b2)
        if side1 != 0 and b1 * side1 > 0.0:
            slack = 1e-15 * rate * min(t, 10.0)
            if side2 != 0 or (
                min(high2 - d2, low2 + d2) <= slack and t > 0.0
            ):  # both walls at one instant
                x2 = c.wall2 if high2 - d2 < low2 + d2 else -c.wall2
                d2 = 0.0
            return t, 1, side1, side1 * c.wall1, b1, x2 + d2, b2
        if side2 != 0 and b2 * side2 > 0.0:
            slack = 1e-15 * rate * min(t, 10.0)
            if side1 != 0 or (min(high1 - d1, low1 + d1) <= slack and t > 0.0):
                side1 = 1 if high1 - d1 < low1 + d1 else -1
                x1 = side1 * c.wall1
                d1 = 0.0
                if b1 * side1 > 0.0:
                    return t, 1, side1, x1, b1, side2 * c.wall2, b2
            return t, 2, side2, x1 + d1, b1, side2 * c.wall2, b2
        if side1 != 0 and b1 == 0.0 and f1 * side1 > 0.0:
            return t, REST, side1, side1 * c.wall1, b1, x2 + d2, b2
        if side2 != 0 and b2 == 0.0 and f2 * side2 > 0.0:
            return t, REST, side2, x1 + d1, b1, side2 * c.wall2, b2
        if t >= horizon:
            return horizon, NONE, 0, x1 + d1, b1, x2 + d2, b2
        step = min(to_high1, to_low1, to_high2, to_low2)
        if (
            t + step == t
        ):  # touching a wall at zero speed and acceleration: shorter steps change nothing
            step = TOUCH_STEP
        t = min(t + step, horizon)
        d1, b1, d2, b2 = flow(c, tau, 0.0, y1, 0.0, y2, t)
    return t, LOST, 0, x1 + d1, b1, x2 + d2, b2


@internal
def contact_matrix(c: Constants, mesh: int, size: int = 4, at: int = 0) -> Floats:
    """The restitution map as a matrix on ``(x1, y1, x2, y2)``, or on more with these from place
    `at` on.

    Shapes: result (size, size).
    """
    r = np.zeros((size, size))
    for i in range(size):
        r[i, i] = 1.0
    if mesh == 1:
        r[at + 1, at + 1] = -c.epsilon
        r[at + 3, at + 1] = -(1.0 + c.epsilon)
    elif mesh == 2:
        r[at + 1, at + 3] = -(1.0 + c.epsilon) * c.mu
        r[at + 3, at + 3] = -c.epsilon
    return r
