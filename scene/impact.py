"""Impacts at both meshes: the contact laws, and the next outward crossing of a flight (MODEL section 3)."""

import math

import numpy as np

from scene.compiled import jit
from scene.flight import Floats, flow, wheel_speeds
from scene.scene import Constants

__all__ = ["CLOSE", "MISSES", "NONE", "REST", "contact_matrix", "energy_loss", "next_impact", "struck"]

NONE = 0  # mesh of an event that never came: no impact within the horizon
REST = -1  # the mesh is pressed shut: the next impact is now, and so is every later one
CLOSE = -2  # the flight is followed no further
MOST_LOOKS = 1_000_000  # at one flight: 0.1 s
TOUCH = 1e-9  # step off a wall that is touched at rest; the displacement in it is below rounding
MISSES = {NONE: "no impact within the horizon", REST: "a mesh rests closed", CLOSE: "a flight clings to a wall"}


@jit
def struck(c: Constants, mesh: int, y1: float, y2: float) -> tuple[float, float]:
    """Velocities after an impact at a mesh.

    Examples
    --------
    >>> from scene import DAT21, Scene
    >>> y1, y2 = struck(Scene.from_gears(DAT21).constants, 1, 2.0, 2.0)
    >>> round(y1, 12), round(y2, 12)
    (-1.8, -1.8)
    """
    if mesh == 1:  # the driver is prescribed: Eq. 10 uses this law, Eqs. 4 and 6 do not print it
        return -c.epsilon * y1, y2 - (1.0 + c.epsilon) * y1
    return y1 - (1.0 + c.epsilon) * c.mu * y2, -c.epsilon * y2  # Eq. 4


@jit
def energy_loss(c: Constants, mesh: int, y1: float, y2: float) -> float:
    """Kinetic energy that an impact takes, in units of ``I1 / R1^2 (nu1 omega)^2``, the mass of wheel 1 at its rim.

    ``(1 - eps^2) y^2 / 2`` times the reduced mass: 1 at mesh 1, whose driver is prescribed, and mu at mesh 2.

    Examples
    --------
    >>> from scene import DAT21, Scene
    >>> round(energy_loss(Scene.from_gears(DAT21).constants, 1, 2.0, 0.0), 12)
    0.38
    """
    share = 0.5 * (1.0 - c.epsilon * c.epsilon)
    return share * y1 * y1 if mesh == 1 else share * c.mu * y2 * y2


@jit
def safe_time(distance: float, speed: float, acceleration: float, most: float, jerk: float) -> float:
    """A time within which a wall `distance` ahead is not reached.

    Parameters
    ----------
    distance, speed, acceleration : float
        Towards the wall.
    most, jerk : float
        Bounds of the acceleration and of its rate from now on.
    """
    distance = max(distance, 0.0)
    root = math.sqrt(speed * speed + 2.0 * most * distance)
    if speed > 0.0:
        return 2.0 * distance / (speed + root)
    if most == 0.0:
        return math.inf
    step = (root - speed) / most
    if acceleration < 0.0 and jerk > 0.0:  # drawn away: it takes the jerk this long to turn that round
        step = max(step, -3.0 * acceleration / jerk)
    return step


@jit
def next_impact(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, horizon: float
) -> tuple[float, int, int, float, float, float, float]:
    """The earliest outward crossing of a wall by a flight from a state.

    The flight is followed by steps that no crossing fits into: ``|x_i''|`` is bounded by
    ``alpha + |beta_1 u_1 + gamma_1|`` and ``|beta_1 u_1 + gamma_1| + |beta_2 u_2 + gamma_2|``, which only
    decay along a flight.  Near a transversal hit these steps are Newton's, from the safe side; an
    excursion beyond the wall and back cannot hide between two of them.

    Parameters
    ----------
    c : Constants
    tau, x1, y1, x2, y2 : float
        Start of the flight, after the last impact.
    horizon : float
        Longest flight that is followed.

    Returns
    -------
    t : float
        Time of flight.
    mesh : int
        1 or 2; `NONE` if the horizon came first; `REST` if a mesh stays closed; `CLOSE` if the flight clings to a
        wall so long that `MOST_LOOKS` steps do not end it.  Two walls met at one instant are told apart by a second
        event of flight time 0, mesh 1 first.
    side : int
        +1 or -1.
    x1, y1, x2, y2 : float
        State just before the impact; the struck coordinate lies on its wall exactly.
    """
    t = 0.0
    a1, b1, a2, b2 = x1, y1, x2, y2
    tolerance1 = 1e-15 + 4e-16 * c.wall1
    tolerance2 = 1e-15 + 4e-16 * c.wall2
    for _ in range(MOST_LOOKS):
        if not t < horizon:
            return horizon, NONE, 0, a1, b1, a2, b2
        u1, u2 = wheel_speeds(c, tau + t, b1, b2)
        pull1, pull2 = c.beta1 * u1 + c.gamma1, c.beta2 * u2 + c.gamma2  # -u_i'
        f1, f2 = pull1 - c.alpha * math.sin(tau + t), pull1 - pull2  # accelerations
        if c.wall1 - abs(a1) <= tolerance1:
            side = 1 if a1 > 0.0 else -1
            if b1 * side > 0.0:
                return t, 1, side, side * c.wall1, b1, a2, b2
            if b1 == 0.0 and f1 * side > 0.0:
                return t, REST, side, a1, b1, a2, b2
        if c.stages == 2 and c.wall2 - abs(a2) <= tolerance2:
            side = 1 if a2 > 0.0 else -1
            if b2 * side > 0.0:
                return t, 2, side, a1, b1, side * c.wall2, b2
            if b2 == 0.0 and (f2 * side > 0.0 or (f2 == 0.0 and c.beta1 == c.beta2)):  # and then it stays 0
                return t, REST, side, a1, b1, a2, b2
        most, jerk = c.alpha + abs(pull1), c.alpha + c.beta1 * abs(pull1)
        step = min(safe_time(c.wall1 - a1, b1, f1, most, jerk), safe_time(c.wall1 + a1, -b1, -f1, most, jerk))
        if c.stages == 2:
            most, jerk = abs(pull1) + abs(pull2), c.beta1 * abs(pull1) + c.beta2 * abs(pull2)
            step = min(step, safe_time(c.wall2 - a2, b2, f2, most, jerk), safe_time(c.wall2 + a2, -b2, -f2, most, jerk))
        if t + step == t:  # touching a wall at no speed and no acceleration: too slow to matter below this
            step = TOUCH
        t = min(t + step, horizon)
        a1, b1, a2, b2 = flow(c, tau, x1, y1, x2, y2, t)
    return t, CLOSE, 0, a1, b1, a2, b2


@jit
def contact_matrix(c: Constants, mesh: int) -> Floats:
    """The contact law as a matrix on ``(x1, y1, x2, y2)``, shape (4, 4)."""
    r = np.eye(4)
    if mesh == 1:
        r[1, 1], r[3, 1] = -c.epsilon, -(1.0 + c.epsilon)
    elif mesh == 2:
        r[1, 3], r[3, 3] = -(1.0 + c.epsilon) * c.mu, -c.epsilon
    return r
