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

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.schemes.crossing import MARGIN_SDS
from rattle.montecarlo.schemes.short_flight import kick, under
from rattle.montecarlo.schemes.step_state import Hold, Progress, Quiet, Walls, put_on_wall
from rattle.scene import Constants, Floats
from rattle.scene.compiled import inline, lean_internal
from rattle.scene.drive import velocity_acceleration
from rattle.scene.sticking import Sides, find_sticking, open_stage, presses, stick_on, stuck_on

# bound on the rate of fast impacts at a closed mesh, over ``exp(-tail w)``, in its units of time:
# 0.2 to 1.2 for restitutions up to 0.9 and speeds of 4 to 8 units, in 4e5 units of time each
PREFACTOR = 1.2
STEADY_PRESS = 0.1  # largest relative change of the press while a motion at a wall dies away


@inline
def hold_only(sides: Sides) -> Hold:
    """Meshes that are closed on some sides, none where both are 0, with nothing that is not
    followed."""
    return Hold(sides[0], sides[1], 0.0, 0.0, 0.0, 0.0, 0.0)


@inline
def stays_open(c: Constants, at: Progress, walls: Walls, quiet: Quiet) -> Hold:
    """Both meshes open: a scheme whose steps know no contact force."""
    return hold_only((0, 0))


@inline
def stay(c: Constants, at: Progress, sides: Sides, walls: Walls) -> Progress:
    """The path as it is: it has been at the end of its step all the time."""
    return at


@lean_internal
def sides_of(code: int) -> Sides:
    """The mesh of an impact closed on the side of that impact, the other open."""
    side = 1 if code > 0 else -1
    return (side, 0) if abs(code) == 1 else (0, side)


@lean_internal
def _accelerations(
    c: Constants, tau: float, y1: float, y2: float
) -> tuple[float, float, float, float]:
    """Free accelerations ``y1'`` and ``y2'``, and the modulation of the noise of both wheels."""
    first, second = velocity_acceleration(c.drive, tau)
    u1 = c.alpha * first - y1
    pull1 = c.beta1 * u1 + c.gamma1
    pull2 = c.beta2 * (u1 + y2) + c.gamma2
    m1 = second + c.beta1 * first
    m2 = second + c.beta2 * first
    return pull1 + c.alpha * second, pull1 - pull2, m1, m2


@lean_internal
def _pushes(
    c: Constants, tau: float, y1: float, y2: float, sides: Sides
) -> tuple[float, float, float, float]:
    """Accelerations into the walls of the meshes that are closed, infinite for an open one, and the
    noise's power (per sigma^2) at both.

    With both closed they are those of each wheel towards the driver.
    """
    f1, f2, m1, m2 = _accelerations(c, tau, y1, y2)
    first, second = sides
    if first != 0 and second != 0:
        mass = c.mu / (1.0 - c.mu)
        return first * f1, -second * (f1 - f2), 0.5 * m1 * m1, 0.5 * mass * m2 * m2
    if first != 0:
        return first * f1, math.inf, 0.5 * m1 * m1, 0.0
    apart = m1 - m2
    return math.inf, second * f2, 0.0, 0.5 * c.mu * apart * apart


@inline
def _nearest(x: float, high: float, low: float) -> tuple[int, float]:
    """The side whose wall is nearest, and the distance to it."""
    above = high - x
    below = low + x
    return (1, above) if above <= below else (-1, below)


@inline
def _touches(push: float, y: float, distance: float, speed: float) -> bool:
    """Whether a mesh rests at its wall, or bounces there below a speed."""
    if y == 0.0 and distance == 0.0:
        return True
    return push > 0.0 and y * y + 2.0 * push * distance <= speed * speed


@lean_internal
def find_closed(c: Constants, at: Progress, walls: Walls, quiet: Quiet) -> Hold:
    """The meshes that are closed for what is left of a step: those that stick, or that noise moves
    too little to be followed.

    Noise with a memory is a known force within a step, and part of the drive's.
    """
    x1, y1, x2, y2 = at.state
    side1, distance1 = _nearest(x1, walls.high1, walls.low1)
    side2, distance2 = _nearest(x2, walls.high2, walls.low2) if c.stages == 2 else (0, math.inf)
    slow1 = abs(y1) <= quiet.speed
    slow2 = c.stages == 2 and abs(y2) <= quiet.speed
    due1 = distance1 == 0.0 and side1 * y1 > 0.0 and not slow1
    due2 = distance2 == 0.0 and side2 * y2 > 0.0 and not slow2
    if due1 or due2 or not (slow1 or slow2):
        return hold_only((0, 0))  # an impact comes first
    spread = c.sigma
    if c.memory > 0.0:
        alpha = c.alpha + c.sigma * at.noise.increment / at.left
        c = under(c, alpha, c.gamma1, c.gamma2)
        spread = 0.0
    f1, f2, _, _ = _accelerations(c, at.tau, y1, y2)
    touches1 = slow1 and _touches(side1 * f1, y1, distance1, quiet.speed)
    push2 = -side2 * (f1 - f2) if touches1 else side2 * f2
    touches2 = slow2 and _touches(push2, y2, distance2, quiet.speed)
    if not (touches1 or touches2):
        return hold_only((0, 0))
    if quiet.speed > 0.0:
        touching = side1 if touches1 else 0, side2 if touches2 else 0
        sides = find_sticking(c, at.tau, y1, y2, touching)
        if touches1 and sides[0] == 0:
            sides = 0, 0  # every impact at mesh 1 shakes mesh 2
        hold = _hold_quiet(c, at, distance1, distance2, sides, spread, quiet)
        if hold.first == 0 and hold.second == 0 and sides[1] != 0:
            hold = _hold_quiet(c, at, distance1, distance2, (sides[0], 0), spread, quiet)
        if hold.first != 0 or hold.second != 0:
            return hold
    first = side1 if y1 == 0.0 and distance1 == 0.0 else 0
    second = side2 if y2 == 0.0 and distance2 == 0.0 else 0
    if first == 0 and second == 0:
        return hold_only((0, 0))
    sides = find_sticking(c, at.tau, y1, y2, (first, second))
    return _hold_still(c, at, sides, spread)


@lean_internal
def _hold_still(c: Constants, at: Progress, sides: Sides, spread: float) -> Hold:
    """Meshes at rest that stick: whose contact force exceeds what noise could overcome over the
    time left (`MARGIN_SDS` sds of it)."""
    _, y1, _, y2 = at.state
    if sides[0] == 0 and sides[1] == 0:
        return hold_only((0, 0))
    press1, press2 = presses(c, at.tau, y1, y2, sides)
    lift = MARGIN_SDS * spread / math.sqrt(at.left)
    by_driver = lift * math.sqrt(1.0 + max(c.beta1, c.beta2) ** 2)
    lift2 = by_driver if sides[0] != 0 else lift * abs(c.beta1 - c.beta2)
    if (sides[0] != 0 and press1 <= by_driver) or (sides[1] != 0 and press2 <= lift2):
        return hold_only((0, 0))
    return hold_only(sides)


@lean_internal
def _hold_quiet(
    c: Constants,
    at: Progress,
    distance1: float,
    distance2: float,
    sides: Sides,
    spread: float,
    quiet: Quiet,
) -> Hold:
    """Meshes that noise moves too little to be followed: none if they are not pressed shut long and
    hard enough for that.

    A wheel that is pressed against its wall with an acceleration a has under white noise of
    intensity s impacts of about the speed ``s^2 / a`` every ``s^2 / a^2``.  Pushes and noise are
    those at the start of the time left and at its end, whichever is worse.
    """
    tau = at.tau
    left = at.left
    first, second = sides
    if first == 0 and second == 0:
        return hold_only((0, 0))
    _, y1, _, y2 = at.state
    push1, push2, noise1, noise2 = _pushes(c, tau, y1, y2, sides)
    end1 = 0.0
    end2 = 0.0 if second != 0 else y2
    if first == 0:  # the common speed of both wheels hardly changes
        end1 = y1 + c.alpha * (
            velocity_acceleration(c.drive, tau + left)[0] - velocity_acceleration(c.drive, tau)[0]
        )
    later1, later2, more1, more2 = _pushes(c, tau + left, end1, end2, sides)
    push = min(push1, push2)
    later = min(later1, later2)
    least = min(push, later)
    if least <= 0.0:
        return hold_only((0, 0))
    slope = abs(later - push) / left
    power = spread * spread
    # of the noise that moves the mesh: s^2, twice its power over the mass that it moves
    square = 2.0 * power * max(noise1, more1)
    slow = quiet.slow
    speed = abs(y1)
    if second != 0 and first == 0:
        square = 2.0 * power * max(noise2, more2) / c.mu
        speed = abs(y2)
    elif second != 0:
        # an impact at mesh 1 moves wheel 1 alone, and mesh 2 closes 1 + epsilon times faster
        mass = c.mu / (1.0 - c.mu)
        square = max(square, 2.0 * power * max(noise2, more2) / mass)
        slow = slow / (1.0 + c.epsilon)
        speed = max(speed, abs(y2))
    if quiet.relaxed * square * slope > least * least * least:
        return hold_only((0, 0))
    if 2.0 * speed * slope > STEADY_PRESS * (1.0 - c.epsilon) * least * least:
        return hold_only((0, 0))
    above = 0.0
    if square > 0.0:
        per_time = least * least / square
        above = PREFACTOR * per_time * math.exp(-quiet.tail * slow * least / square)
    if above > quiet.most:
        return hold_only((0, 0))
    ended1 = 0.5 * y1 * y1 + push1 * distance1 if first != 0 else 0.0
    ended2 = 0.0
    if second != 0:
        mass = c.mu if first == 0 else c.mu / (1.0 - c.mu)
        moves = y2 if first == 0 else y1 - y2
        ended2 = mass * (0.5 * moves * moves + push2 * distance2)
    power1 = 0.5 * power * (noise1 + more1)
    power2 = 0.5 * power * (noise2 + more2)
    return Hold(first, second, ended1, ended2, power1, power2, above)


@lean_internal
def add_closed(closed: Floats, p: int, hold: Hold, time: float) -> None:
    """Add what is not followed of path p while meshes are closed for a time.

    Shapes: `closed` (4, lanes), see `rattle.montecarlo.schemes.lanes.Room`.
    """
    closed[0, p] += hold.ended1 + hold.power1 * time
    closed[1, p] += hold.ended2 + hold.power2 * time
    closed[2, p] += time
    closed[3, p] += hold.above * time


@lean_internal
def close_meshes(c: Constants, at: Progress, hold: Hold, walls: Walls) -> Progress:
    """The path with its closed meshes on their walls."""
    x1, y1, x2, y2 = at.state
    wall1, _ = put_on_wall(x1, x2, hold.first, walls)
    _, wall2 = put_on_wall(x1, x2, 2 * hold.second, walls)
    if hold.first != 0:
        x1, y1, x2, y2 = stuck_on(c, x1, y1, x2, y2, 1, wall1)
    if hold.second != 0 and hold.first != 0:
        x2 = wall2
        y2 = 0.0
    elif hold.second != 0:
        x1, y1, x2, y2 = stuck_on(c, x1, y1, x2, y2, 2, wall2)
    return Progress(0, at.tau, at.left, at.noise, (x1, y1, x2, y2))


@lean_internal
def open_part(
    c: Constants, at: Progress, hold: Hold, walls: Walls
) -> tuple[Constants, Progress, Walls]:
    """The stage that is open beside a closed mesh, as a single stage; everything where none is
    closed."""
    if hold.first == 0 and hold.second == 0:
        return c, at, walls
    x1, y1, x2, y2 = at.state
    if hold.first != 0:
        x1 = -x2
        y1 = -y2
        walls = Walls(walls.low2, walls.high2, walls.low2, walls.high2)
    alone = Progress(0, at.tau, at.left, at.noise, (x1, y1, 0.0, 0.0))
    return open_stage(c, (hold.first, hold.second)), alone, walls


@lean_internal
def join_closed(before: Progress, moved: Progress, hold: Hold) -> Progress:
    """The path after its open stage has moved, with the closed mesh where it was `before`."""
    if hold.first == 0 and hold.second == 0:
        return moved
    x1, y1, x2, y2 = before.state
    code = moved.code
    if hold.first != 0:
        x2 = -moved.state[0]
        y2 = -moved.state[1]
        code = -2 * code
    else:
        x1 = moved.state[0]
        y1 = moved.state[1]
    return Progress(code, moved.tau, moved.left, moved.noise, (x1, y1, x2, y2))


@lean_internal
def stop_at_wall(
    x: float, y: float, before: float, t: float, high: float, low: float
) -> tuple[float, float]:
    """A stage that went beyond a wall in a time t: put on it, with the speed that it had there,
    until the next step.

    `before`: Velocity at the start of that time.  The acceleration is taken as constant: what is
    gained beyond the wall must not go into the next impact.
    """
    side, beyond = (1.0, x - high) if x > 0.0 else (-1.0, -low - x)
    if beyond <= 0.0:
        return x, y
    gained = 2.0 * beyond * side * (y - before) / t
    return (high if side > 0.0 else -low), side * math.sqrt(max(y * y - gained, 0.0))


@lean_internal
def stick_to_end(c: Constants, at: Progress, sides: Sides, walls: Walls) -> Progress:
    """The path at the end of its step, with some meshes closed until then."""
    first, second = sides
    x1, y1, x2, y2 = close_meshes(c, at, hold_only(sides), walls).state
    before1 = y1
    before2 = y2
    x1, y1, x2, y2 = stick_on(c, at.tau, x1, y1, x2, y2, sides, at.left)
    if c.stages == 2 and (first == 0 or second == 0):
        moved, pushed, _, _ = kick(
            open_stage(c, sides), at.tau, at.left, at.noise.increment, at.noise.area
        )
        if first != 0:
            x2 = x2 - moved
            y2 = y2 - pushed
        else:
            x1 = x1 + moved
            y1 = y1 + pushed
    x1, y1 = stop_at_wall(x1, y1, before1, at.left, walls.high1, walls.low1)
    x2, y2 = stop_at_wall(x2, y2, before2, at.left, walls.high2, walls.low2)
    return Progress(0, at.tau + at.left, 0.0, Noise(0.0, 0.0), (x1, y1, x2, y2))
