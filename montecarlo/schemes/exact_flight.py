"""``exact-flight``: the exact Gaussian distribution of the flight, and impacts located by refining
the Brownian path.

A whole step is taken of all paths side by side (`flight_lanes`): Eq. 5 is linear, so the state
after it is the flight of Eq. 3 plus the noise's increment and area
(`rattle.montecarlo.noise.brownian`) times vectors that all paths share. Projections on higher
Legendre polynomials are neglected: about ``h^4 / 720`` of the variance.  A step that may have an
impact (`rattle.montecarlo.schemes.crossing`) is cut where the cubic through its ends meets the
wall, its noise is split there, its first part is flown as a trial, and so on
(docs/theory/schemes.md).
"""

import math
from typing import NamedTuple

from rattle.montecarlo.noise.brownian import Noise, split
from rattle.montecarlo.noise.philox import BRIDGE, Word, normals
from rattle.montecarlo.schemes.crossing import (
    CLOSE_TO_WALL,
    NEAR_WALL,
    cut_share,
    margin_of,
    near_wall,
    noise_free_reach,
)
from rattle.montecarlo.schemes.lanes import Lanes, fill_speeds, join_halves, vector_beside
from rattle.montecarlo.schemes.scheme import Scheme
from rattle.montecarlo.schemes.short_flight import (
    Moved,
    Phase,
    kick,
    phase_at,
    shift_phase,
    short_flight,
    third_of,
)
from rattle.montecarlo.schemes.step_state import (
    FREE,
    MARGIN,
    MOST_IN_A_STEP,
    SPLITS,
    TOGETHER,
    Inside,
    Progress,
    Scratch,
    at_end,
    clip,
    copy_state,
    due_side,
    parent_deviation,
    put_on_wall,
)
from rattle.montecarlo.schemes.sticking import (
    close_meshes,
    find_closed,
    leave_bodies,
    part_beside,
    stick_to_end,
)
from rattle.montecarlo.schemes.time_scales import (
    MEMORY_REASON,
    SPRING_REASON,
    Limit,
    least_limit,
    memory_step,
    time_scales,
)
from rattle.montecarlo.schemes.wheel_noise import (
    ALONG_PARTS,
    flight_effects,
    gather_alone,
    join_alone,
    join_parts,
    shake_lanes,
    split_alone,
)
from rattle.scene import Bools, Constants, Floats, Scene
from rattle.scene.compiled import inline, lean, lean_internal, not_inlined, splice
from rattle.scene.damping import pair
from rattle.scene.drive import highest_order
from rattle.scene.flight import respond
from rattle.scene.sticking import put_open
from rattle.scene.wheel import with_wheels

MOST_CUTS = 1000  # per step; then the path is clipped to its walls
# shortest trial, relative to the time: two units in its last place, so that time goes on
TICK = 5e-16
# random numbers of one call of `advance_exactly`, of those that are reserved for a step
CUTS_APART = SPLITS // Word(MOST_IN_A_STEP + 1)
CALLS = MOST_IN_A_STEP + 2  # calls that these serve
# of the index of a random number: more calls, for more than two wheels, have it in the bits above
MORE_CALLS = Word(58)


CARRY = 0
"""First of the columns of a step's forcing: what the rate adds to displacement and rate, what the
deviation of the parent's speed does, or at the driver the displacement, against a spring; then of
excitation and drag, of a unit normal for the increment, and of one for the area, on displacement
and rate; and the margin of the walls."""
DRIFT = 4
ALONG = 6
ACROSS = 8


@lean
def flight_forcing(c: Constants, tau: float, h: float, scratch: Scratch) -> None:
    """Write everything in a step that is the same for all paths, into ``scratch.forcing``."""
    phase = phase_at(c.drive, tau)
    forcing = scratch.forcing
    end = scratch.end
    if scratch.shaken:
        flight_effects(c, tau, h, scratch)
    kick(c, tau, h, math.sqrt(h), 0.0, scratch.series, end)
    _put_column(forcing, ALONG, end)
    kick(c, tau, h, 0.0, math.sqrt(h / 12.0), scratch.series, end)
    _put_column(forcing, ACROSS, end)
    for i in range(end.size):
        end[i] = 0.0
    short_flight(c, c.alpha, 1.0, phase, h, end, 0.0, 0.0, scratch.series, end)
    _put_column(forcing, DRIFT, end)
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        parent = wheel.parent if wheel.parent >= 0 else i
        p = pair(c.wheels[parent].beta, wheel.beta, h)
        forcing[i, CARRY] = p.e2
        forcing[i, CARRY + 1] = p.d2
        # k (e_p - e_i) and k (d_p - d_i)
        carried = wheel.ratio if wheel.parent >= 0 else 0.0
        forcing[i, CARRY + 2] = carried * p.e12
        forcing[i, CARRY + 3] = carried * p.d12
        if wheel.stiffness > 0.0:
            own = respond(c, i, h)
            forcing[i, CARRY] = own.e
            forcing[i, CARRY + 1] = own.d
            forcing[i, CARRY + 2] = -wheel.stiffness * own.g
            forcing[i, CARRY + 3] = -wheel.stiffness * own.e
        forcing[i, MARGIN] = margin_of(c, phase, h, i)


@inline
def _put_column(forcing: Floats, column: int, state: Floats) -> None:
    """Write a state, by gap, into two columns of the forcing."""
    for i in range(forcing.shape[0]):
        forcing[i, column] = state[2 * i]
        forcing[i, column + 1] = state[2 * i + 1]


class GapFlight(NamedTuple):
    """What a step makes of a gap, the same for all lanes."""

    third: float  # a third of its length
    carry: tuple[float, float]  # of the rate, on displacement and rate
    others: tuple[float, float]  # of the deviation of the parent's speed, or of the displacement
    drift: tuple[float, float]
    along: tuple[float, float]
    across: tuple[float, float]
    margin: float
    wall: float
    toleranced: bool  # whether the flanks of each lane are its own
    seen: bool  # whether other gaps have marked lanes in this step


@inline
def _fly_gap(
    f: GapFlight,
    x: Floats,
    y: Floats,
    x_before: Floats,
    y_before: Floats,
    v: Floats,
    z: Floats,
    area: Floats,
    highs: Floats,
    lows: Floats,
    near: Bools,
) -> None:
    """One step of a gap in all lanes, in place.  Vectorises: what is written is read nowhere
    else."""
    for p in range(near.size):
        x0 = x[p]
        y0 = y[p]
        forced = f.drift[0] + f.along[0] * z[p] + f.across[0] * area[p]
        end = x0 + (f.others[0] * v[p] + f.carry[0] * y0 + forced)
        driven = f.drift[1] + f.along[1] * z[p] + f.across[1] * area[p]
        rate = f.others[1] * v[p] + f.carry[1] * y0 + driven
        high = highs[p] if f.toleranced else f.wall
        low = lows[p] if f.toleranced else f.wall
        meets = near_wall(f.third, x0, y0, end, rate, high, low, f.margin)
        near[p] = meets | (f.seen & near[p])
        x_before[p] = x0
        y_before[p] = y0
        x[p] = end
        y[p] = rate


@lean_internal
def step_lanes(
    c: Constants,
    tau: float,
    h: float,
    toleranced: bool,
    lanes: Lanes,
    scratch: Scratch,
    marks: Bools,
    live: int,
) -> None:
    """One step of all lanes in place, ignoring the walls; marks those that may have an impact.

    Children before their parents, whose speeds at the start of the step they need.  The flanks of
    the lanes are read only if they are toleranced.
    """
    flight_forcing(c, tau, h, scratch)
    state = lanes.state
    before = lanes.before
    walls = lanes.walls
    near = marks[:live]
    z = lanes.w
    area = lanes.area
    fill_speeds(c, state, scratch.speeds, live)
    last = c.wheels.size - 1
    for i in range(last, -1, -1):
        row = scratch.forcing[i]
        f = GapFlight(
            h / 3.0,
            (row[CARRY], row[CARRY + 1]),
            (row[CARRY + 2], row[CARRY + 3]),
            (row[DRIFT], row[DRIFT + 1]),
            (row[ALONG], row[ALONG + 1]),
            (row[ACROSS], row[ACROSS + 1]),
            row[MARGIN],
            c.wheels[i].wall,
            toleranced,
            i != last,
        )
        x = state[2 * i]
        y = state[2 * i + 1]
        x0 = before[2 * i]
        y0 = before[2 * i + 1]
        high = walls[2 * i]
        low = walls[2 * i + 1]
        v = vector_beside(c, i, state, scratch.speeds, z)
        _fly_gap(f, x, y, x0, y0, v, z, area, high, low, near)
    if scratch.shaken:
        shake_lanes(c, h, lanes, scratch, near, live)


@splice
def _due(c: Constants, s: Floats, walls: Floats) -> tuple[int, float, float]:
    """The impact that is due: ``mesh * side``, or 0; the time to its wall; and that to the next
    wall ahead.

    Both times are at the present velocity.  The first is that of the flight without noise, zero for
    a path so slow that it must come within `CLOSE_TO_WALL` of its wall, and negative for one that
    is just beyond it.  The first mesh comes first where two are met within `TOGETHER`.
    """
    code = 0
    lead = math.inf
    reach = math.inf
    for i in range(c.wheels.size):
        x = s[2 * i]
        y = s[2 * i + 1]
        size = c.wheels[i].size
        high = walls[2 * i] - x
        low = walls[2 * i + 1] + x
        gap = high if y > 0.0 else low
        if y == 0.0:
            continue
        if gap > NEAR_WALL * size:
            reach = min(reach, gap / abs(y))
            continue
        swift = abs(gap) <= noise_free_reach(c, i, y, parent_deviation(c, s, i))
        if swift or gap <= CLOSE_TO_WALL * size:
            time = gap / abs(y) if swift else 0.0
            if time < lead - TOGETHER:
                code = i + 1 if y > 0.0 else -(i + 1)
                lead = time
        else:
            reach = min(reach, gap / abs(y))
    return code, lead, reach


@inline
def _land(
    c: Constants,
    s: Floats,
    walls: Floats,
    at: Progress,
    phase: Phase,
    code: int,
    lead: float,
    v: Floats,
) -> Moved:
    """The path at the impact that is due, after its flight without noise to the wall: along a
    parabola.

    `v`: scratch; by wheel, in its rows from 2 on, the deviation of its speed and the first two
    derivatives of that.
    """
    second = -phase[0]
    first = phase[1]
    third = -third_of(c.drive, phase)
    struck = abs(code) - 1
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        others = rate_of_others = 0.0
        if wheel.parent >= 0:
            others = v[2 + wheel.parent, 0]
            rate_of_others = v[2 + wheel.parent, 1]
        m = wheel.second * second + wheel.first * first
        m_rate = wheel.second * third + wheel.first * second
        y = s[2 * i + 1]
        steady = wheel.drag - wheel.stiffness * s[2 * i]
        rate = (steady - wheel.beta * y) + (wheel.coupling * others + c.alpha * m)
        turned = wheel.beta * rate + wheel.stiffness * y
        bend = (wheel.coupling * rate_of_others - turned) + c.alpha * m_rate
        carried = wheel.ratio if wheel.parent >= 0 else 0.0
        v[2 + i, 0] = wheel.sign * y + carried * others
        v[2 + i, 1] = wheel.sign * rate + carried * rate_of_others
        v[2 + i, 2] = rate
        v[2 + i, 3] = bend
    correction = 0.5 * lead * lead * v[2 + struck, 2] / s[2 * struck + 1]
    lead = min(lead - correction, at.left)
    half = 0.5 * lead
    for i in range(c.wheels.size):
        rate = v[2 + i, 2]
        s[2 * i] += lead * (s[2 * i + 1] + half * rate)
        s[2 * i + 1] += lead * (rate + half * v[2 + i, 3])
    phase = shift_phase(c.drive, phase, lead)
    put_on_wall(s, code, walls)
    return Progress(code, at.tau + lead, at.left - lead, at.noise), phase


@inline
def _part(ahead: Floats, top: int) -> tuple[float, Noise]:
    """Length and noise of a part of the step on the stack."""
    return ahead[top, 0], Noise(ahead[top, 1], ahead[top, 2])


@inline
def _put(ahead: Floats, top: int, length: float, noise: Noise) -> None:
    """Put a part of the step, still ahead, onto the stack."""
    ahead[top, 0] = length
    ahead[top, 1] = noise.increment
    ahead[top, 2] = noise.area


@splice
def advance_exactly(inside: Inside, met: int, at: Progress, phase: Phase) -> Moved:
    """Go to the next wall that the path meets in this step, or to the end of the step.

    The time left is tried as a whole.  A trial that may have an impact is cut at the wall and its
    first part is tried; the second waits on a stack.  Waiting parts must not be joined before an
    impact: a trial is cut because of what its end would be, and forgetting that end and sampling it
    anew would give the path a second chance to miss the wall.  At an impact they may be joined,
    since it is a stopping time of the path.

    On the stack, ``Scratch.ahead``, are length, increment and area of the parts of the step still
    ahead, the nearest on top.  Cuts 2 i and 2 i + 1 share the four normals of an index.
    Beside closed meshes the bodies that they leave fly by themselves.
    """
    if not inside.closed:
        return _advance(inside, inside.c, not inside.known, met, at, phase)
    close_meshes(inside.c, inside.scratch)
    count = leave_bodies(inside.c, inside.scratch)
    if count == 0:
        return at_end(at), phase
    return _advance_beside(inside, count, met, at, phase)


@inline
def _advance(
    inside: Inside, c: Constants, flown: bool, met: int, at: Progress, phase: Phase
) -> Moved:
    """`advance_exactly` where no mesh is closed; `flown`: whether the end of the flight is not that
    of the whole step."""
    ahead = inside.scratch.ahead
    series = inside.scratch.series
    walls = inside.scratch.walls
    s = inside.scratch.state
    end = inside.scratch.end
    index = Word(inside.step) * SPLITS + CUTS_APART * Word(met % CALLS)
    index += Word(met // CALLS) << MORE_CALLS
    tau = at.tau
    left = at.left
    code, lead, _ = _due(c, s, walls)
    if code != 0 and lead < left:
        return _land(c, s, walls, at, phase, code, max(lead, 0.0), series)
    if not flown:
        copy_state(end, inside.scratch.whole)
    turned = phase
    cuts = top = 0
    z3 = z4 = 0.0
    _put(ahead, 0, left, at.noise)
    shaken = inside.scratch.shaken
    if shaken:
        copy_state(ahead[0, ALONG_PARTS:], inside.scratch.alone)
    while True:
        h, noise = _part(ahead, top)
        if flown:
            if shaken:
                of_part = ahead[top, ALONG_PARTS:]
                free = inside.scratch.choices[FREE]
                gather_alone(of_part, c.wheels.size, inside.scratch.bodies, free, series)
            turned = short_flight(
                c, c.alpha, 1.0, phase, h, s, noise.increment, noise.area, series, end
            )
        cut = cut_share(c, phase, s, end, h, walls)
        tick = TICK * (1.0 + abs(tau))
        used_up = cuts >= MOST_CUTS or top + 1 >= len(ahead) or h <= tick
        if cut == 1.0 or used_up:
            if used_up:
                clip(end, walls)
            tau = tau + h
            left = left - h if top > 0 else 0.0
            copy_state(s, end)
            code, lead, reach = _due(c, s, walls)
            if code != 0 and lead <= left:
                at = Progress(code, tau, left, join_parts(ahead, top, 1))
                if shaken:
                    join_alone(ahead, top, inside.scratch.alone)
                phase = turned if flown else phase_at(c.drive, tau)
                return _land(c, s, walls, at, phase, code, max(lead, -0.5 * h), series)
            if top == 0:
                return Progress(0, tau, 0.0, Noise(0.0, 0.0)), turned
            phase = turned
            top -= 1
            h, noise = _part(ahead, top)
            if reach >= h or h <= tick:
                continue
            cut = reach / h
        flown = True
        if c.memory > 0.0:
            # the integral of noise with a memory is a parabola within the step
            z1 = z2 = 0.0
        elif cuts & 1 == 0:
            purpose = Word(BRIDGE + inside.level)
            z1, z2, z3, z4 = normals(inside.key, inside.path, index + Word(cuts >> 1), purpose)
        else:
            z1 = z3
            z2 = z4
        cut = max(cut, tick / h)
        if shaken:
            split_alone(
                inside.key,
                inside.path,
                index,
                inside.level,
                cuts,
                cut,
                ahead,
                top,
                inside.scratch.intensity,
            )
        cuts += 1
        first, second = split(noise, h, cut, z1, z2)
        _put(ahead, top, h - cut * h, second)
        top += 1
        _put(ahead, top, cut * h, first)


@lean_internal
def _advance_beside(inside: Inside, count: int, met: int, at: Progress, phase: Phase) -> Moved:
    """`advance_exactly` of the bodies that closed meshes leave, so many; called, for the flight of
    open meshes must not wait for which constants it takes."""
    not_inlined()
    whole = inside.scratch
    free = whole.choices[FREE, :count]
    part = part_beside(whole, count)
    c = with_wheels(inside.c, whole.wheels_beside[:count])
    beside = Inside(c, inside.key, inside.path, inside.step, inside.level, False, False, part)
    flown = inside.closed  # always: of a type that is not literal, as that of open meshes
    moved, phase = _advance(beside, c, flown, met, at, phase)
    put_open(whole.state, free, part.state)
    code = moved.code
    if code != 0:
        code = due_side(code) * (free[abs(code) - 1] + 1)
    return Progress(code, moved.tau, moved.left, moved.noise), phase


def accurate_flight(scene: Scene) -> Limit:
    """The longest accurate step of ``exact-flight``, which neglects part of the noise within a
    step; and its reason.

    The neglected part (of relative order h^4 of the variance) matters where the variance grows from
    zero: at this limit 0.8 % of sd(x1) after a flight of 0.2 from tau = 0, at half of it 0.05 %.
    """
    limits = {
        MEMORY_REASON: memory_step(scene),
        "a longer step cannot follow the damping": 0.2 * time_scales(scene).damping,
        SPRING_REASON: 0.2 * time_scales(scene).swing,
        "a longer step cannot follow the noise's modulation": (
            0.1 / highest_order(scene.constants.drive)
        ),
    }
    return least_limit(limits)


def longest_flight(scene: Scene) -> Limit:
    """The longest accurate step that does not hold too many impacts."""
    t = time_scales(scene)
    accurate, why = accurate_flight(scene)
    too_many = "a longer step holds too many impacts"
    return least_limit({why: accurate, too_many: 2.0 * min(t.crossing, t.shaking)})


EXACT = Scheme(
    weak_order=None,
    normals=2,
    step=math.pi / 96.0,
    step_ns=5.1,
    impact_ns=740.0,
    detects_at_end=False,
    longest_step=longest_flight,
    trusted_step=longest_flight,
    step_lanes=step_lanes,
    join_noise=join_halves,
    phase_at=phase_at,
    advance=advance_exactly,
    find_sticking=find_closed,
    stick_to_end=stick_to_end,
)
