"""Where a path may meet a wall between two known states: the cubic between them and the noise about
it.

Given both end states of a time h and the noise's increment and area, the displacement inside
deviates from the cubic Hermite interpolant by a Gaussian of sd at most ``sigma m h^(3/2) (s (1 -
s))^(3/2) / sqrt(3)`` at the share s of the time, m the modulation of the noise.  A cubic lies
between its Bernstein coefficients, and one that stays away from the walls by `MARGIN_SDS` such sds
has no impact.
"""

import math

from rattle.montecarlo.schemes.short_flight import Phase
from rattle.montecarlo.schemes.step_state import parent_deviation
from rattle.scene import Constants, Floats
from rattle.scene.compiled import inline, lean_internal
from rattle.scene.drive import (
    highest_order,
    most_acceleration,
    most_velocity,
)

# bound on a path's deviation from the cubic, in sds; exceeded in 2e-9 of the steps near a wall
MARGIN_SDS = 6.0
# distance to the wall, in half gaps, at which an impact is accepted at any speed
CLOSE_TO_WALL = 1e-10
NEAR_WALL = 1e-6  # distance to the wall, in half gaps, that a fast path flies without noise
STEADY = 30.0  # least speed of such a path, in sds of what the noise makes of it on the way
STRAIGHT = 1e-4  # and largest relative change of that speed by excitation and drag
# margin on the inner Bernstein coefficients that covers (s (1-s))^1.5 / sqrt(3)
SCALE = 1.0 / (6.0 * math.sqrt(3.0))
SHORTEST_TRIAL = 1e-12  # share at which a trial is cut
SETTLED_ROOT = 1e-8  # relative change of a root at which its search ends
CUBIC_PIECES = 8  # of the interval in which the first zero of a cubic that turns is looked for


@inline
def margin_of(c: Constants, phase: Phase, h: float, i: int) -> float:
    """Margin on the inner Bernstein coefficients of a gap's cubic, for noise and for the
    interpolation error.

    A gap has no impact if its coefficients stay away from the walls by it.  The noise is taken at
    its largest modulation in this time, not at its largest ever: where the modulation vanishes, a
    path that sticks to its wall must not be cut as if it were noisy.
    """
    wheel = c.wheels[i]
    # of the wheel, or of the parent whose noise acts on the gap between both
    beta = wheel.beta
    share = wheel.turn
    force = c.alpha * wheel.turn * wheel.modulation + abs(wheel.drag)
    if wheel.parent >= 0:
        beta = c.wheels[wheel.parent].beta
        share = abs(wheel.first)
        force += wheel.ratio * c.wheels[wheel.parent].gamma
    now = abs(beta * phase[1] - phase[0])
    modulation = min(wheel.modulation, now + h * wheel.modulation_rate)
    if wheel.parent >= 0:
        driver = min(most_velocity(c.drive), abs(phase[1]) + h * most_acceleration(c.drive))
        modulation = driver + h * modulation
    spread = MARGIN_SDS * abs(c.sigma) * h * math.sqrt(h) * SCALE
    force += wheel.stiffness * wheel.size
    stiff = highest_order(c.drive) + max(beta, wheel.fastest)
    square = h * h
    # Hermite error: h^4 / 384 times the 4th derivative
    bend: float = square * square / 96.0 * force * (stiff * stiff)
    common = c.modulates * share * modulation + abs(wheel.force)
    noise: float = spread * (common + wheel.shaking)
    return noise + bend


@inline
def near_wall(
    third: float, x0: float, y0: float, x: float, y: float, high: float, low: float, margin: float
) -> bool:
    """Whether the cubic through both end states of a stage comes within its margin of a wall.

    That is, whether an inner Bernstein coefficient a, b of it is, or its end is beyond one.
    """
    a = x0 + third * y0
    b = x - third * y
    return (max(a, b) > high - margin) | (min(a, b) < margin - low) | (x > high) | (x < -low)


@lean_internal
def first_root(a: float, b: float, c: float, d: float) -> float:
    """First zero in (0, 1] of a cubic, by safeguarded Newton steps on the first of eight pieces
    that ends below zero.

    A cubic that falls all the way, as that of a transversal impact does, has one zero and needs no
    pieces.  The error is about the square of the last Newton step, which is below `SETTLED_ROOT`.
    """
    p1 = 3.0 * (b - a)
    p2 = 3.0 * (a - 2.0 * b + c)
    p3 = (d - a) + 3.0 * (b - c)
    low = 0.0
    high = 1.0
    falling = a > b > c > d and d < 0.0
    if not falling:
        part = 1
        while (
            part <= CUBIC_PIECES
            and a
            + part / CUBIC_PIECES * (p1 + part / CUBIC_PIECES * (p2 + part / CUBIC_PIECES * p3))
            >= 0.0
        ):
            part += 1
        if part > CUBIC_PIECES:
            return 2.0
        low = (part - 1) / CUBIC_PIECES
        high = part / CUBIC_PIECES
    guess = a / (a - d) if falling else 0.5 * (low + high)
    for _ in range(60):
        value = a + guess * (p1 + guess * (p2 + guess * p3))
        slope = p1 + guess * (2.0 * p2 + guess * (3.0 * p3))
        if value < 0.0:
            high = guess
        else:
            low = guess
        last = guess
        newton = guess - value / slope if slope < 0.0 else -1.0
        guess = newton if low <= newton <= high else 0.5 * (low + high)
        if abs(guess - last) <= SETTLED_ROOT * guess:
            break
    return guess


@inline
def _cut_at(
    gap0: float,
    rate0: float,
    gap1: float,
    rate1: float,
    h: float,
    margin: float,
    rest: float,
    close: float,
) -> float:
    """Share of the time h after which a wall must be looked at again: 1 if there can be no impact
    before its end."""
    third = h * (1.0 / 3.0)
    b = gap0 + rate0 * third
    c = gap1 - rate1 * third
    if (
        b > margin - rest and c > margin - rest and gap1 >= -close
    ):  # `rest` lets a path at rest on its wall start
        return 1.0
    root = first_root(max(gap0, 0.0), b, c, gap1)
    return max(root, SHORTEST_TRIAL) if root < 1.0 else 0.5


@inline
def noise_free_reach(c: Constants, i: int, speed: float, other: float) -> float:
    """Distance from its wall within which a gap is taken to fly on without noise; `other` is the
    deviation of the parent's speed.

    The noise left out acts later by the time of that flight, after the impact instead of before:
    below 1e-6 of a variance at `NEAR_WALL`.
    """
    wheel = c.wheels[i]
    modulation = wheel.turn * wheel.modulation
    noise = c.modulates * modulation + abs(wheel.force)
    most = noise * noise + wheel.shaking * wheel.shaking
    force = abs(wheel.drag) + wheel.beta * abs(speed) + wheel.stiffness * wheel.size
    if wheel.parent < 0:
        force += c.alpha * modulation
    else:
        force += abs(wheel.first) * c.alpha * most_velocity(c.drive) + abs(wheel.coupling * other)
    noisy = (STEADY * STEADY) * c.sigma * c.sigma * most
    bent = force / STRAIGHT
    square = speed * speed
    near: float = NEAR_WALL * wheel.size
    if square * abs(speed) < noisy * near or square < bent * near:
        near = min(
            square * abs(speed) / noisy if noisy > 0.0 else near,
            square / bent if bent > 0.0 else near,
        )
    return near


@inline
def cut_share(c: Constants, phase: Phase, s: Floats, end: Floats, h: float, walls: Floats) -> float:
    """Share of a trial at which to cut it, over all walls; an end within the reach of a noise-free
    flight counts as an impact."""
    share = 1.0
    for i in range(c.wheels.size):
        margin = margin_of(c, phase, h, i)
        x0 = s[2 * i]
        y0 = s[2 * i + 1]
        x1 = end[2 * i]
        y1 = end[2 * i + 1]
        rest = CLOSE_TO_WALL * c.wheels[i].size
        high = walls[2 * i]
        low = walls[2 * i + 1]
        close = 0.0
        if x1 > high or x1 < -low:
            close = noise_free_reach(c, i, y1, parent_deviation(c, end, i))
        above = _cut_at(high - x0, -y0, high - x1, -y1, h, margin, rest, close)
        below = _cut_at(low + x0, y0, low + x1, y1, h, margin, rest, close)
        share = min(share, above, below)
    return share
