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

from rattle.montecarlo.noise.brownian import Noise, join, split
from rattle.montecarlo.noise.philox import BRIDGE, Word, normals
from rattle.montecarlo.schemes.crossing import (
    CLOSE_TO_WALL,
    NEAR_WALL,
    cut_share,
    margins,
    near_wall,
    noise_free_reach,
)
from rattle.montecarlo.schemes.lanes import Lanes, four, join_halves
from rattle.montecarlo.schemes.scheme import Scheme
from rattle.montecarlo.schemes.short_flight import (
    Phase,
    kick,
    phase_at,
    shift_phase,
    short_flight,
    third_of,
)
from rattle.montecarlo.schemes.step_state import (
    MOST_IN_A_STEP,
    SPLITS,
    TOGETHER,
    Inside,
    Progress,
    State,
    Walls,
    clip,
    flanks_of,
    of_mesh,
    put_on_wall,
)
from rattle.montecarlo.schemes.sticking import (
    close_meshes,
    find_closed,
    join_closed,
    open_part,
    stick_to_end,
)
from rattle.montecarlo.schemes.time_scales import (
    MEMORY_REASON,
    Limit,
    least_limit,
    memory_step,
    time_scales,
)
from rattle.scene import Bools, Constants, Floats, Scene
from rattle.scene.compiled import inline, lean, lean_internal, splice
from rattle.scene.damping import pair
from rattle.scene.drive import highest_order

MOST_CUTS = 1000  # per step; then the path is clipped to its walls
# shortest trial, relative to the time: two units in its last place, so that time goes on
TICK = 5e-16
# random numbers of one call of `advance_exactly`, of those that are reserved for a step
CUTS_APART = SPLITS // Word(MOST_IN_A_STEP + 1)


class FlightForcing(NamedTuple):
    """A step of all lanes: ``s' = J s + drift + z_w along + z_a across``, and the margins of the
    walls."""

    # entries of the flight's Jacobian J that are neither 0 nor 1: of x1 and y1 by y1, x2 by y1 and
    # y2, y2 by y1 and y2
    carry: tuple[float, float, float, float, float, float]
    drift: State  # effect of excitation and drag on ``(x1, y1, x2, y2)``
    along: State  # along, across: effect of a unit normal for the increment, and for the area
    across: State
    # margin1, margin2: of both stages, see `rattle.montecarlo.schemes.crossing.margins`
    margin1: float
    margin2: float


@lean
def flight_forcing(c: Constants, tau: float, h: float) -> FlightForcing:
    """Everything in a step that is the same for all paths."""
    p = pair(c.beta1, c.beta2, h)
    phase = phase_at(c.drive, tau)
    margin1, margin2 = margins(c, phase, h)
    drift, _ = short_flight(c, phase, h, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0)
    along = kick(c, tau, h, math.sqrt(h), 0.0)
    across = kick(c, tau, h, 0.0, math.sqrt(h / 12.0))
    return FlightForcing(
        (p.e1, p.d1, p.e12, p.e2, p.d12, p.d2), drift, along, across, margin1, margin2
    )


@inline
def first_stage(
    f: FlightForcing, x1: float, y1: float, z: float, area: float
) -> tuple[float, float]:
    """Stage 1 after a step, ignoring the walls."""
    return (
        x1 + f.carry[0] * y1 + (f.drift[0] + f.along[0] * z + f.across[0] * area),
        f.carry[1] * y1 + (f.drift[1] + f.along[1] * z + f.across[1] * area),
    )


@inline
def second_stage(
    f: FlightForcing, x2: float, y1: float, y2: float, z: float, area: float
) -> tuple[float, float]:
    """Stage 2 after a step, ignoring the walls."""
    return (
        x2
        + (f.carry[2] * y1 + f.carry[3] * y2 + (f.drift[2] + f.along[2] * z + f.across[2] * area)),
        f.carry[4] * y1 + f.carry[5] * y2 + (f.drift[3] + f.along[3] * z + f.across[3] * area),
    )


@lean_internal
def step_lanes(
    c: Constants, tau: float, h: float, toleranced: bool, lanes: Lanes, near: Bools, live: int
) -> None:
    """One step of all lanes in place, ignoring the walls; marks those that may have an impact.
    Vectorises.

    The flanks of the lanes are read only if they are toleranced.
    """
    f = flight_forcing(c, tau, h)
    z = lanes.w
    area = lanes.area
    x1, y1, x2, y2 = four(lanes.state)
    x1_before, y1_before, x2_before, y2_before = four(lanes.before)
    high1, low1, high2, low2 = four(lanes.walls)
    third = h / 3.0
    for p in range(live):
        x = x1[p]
        y = y1[p]
        end, speed = first_stage(f, x, y, z[p], area[p])
        high, low = (high1[p], low1[p]) if toleranced else (c.wall1, c.wall1)
        meets = near_wall(third, x, y, end, speed, high, low, f.margin1)
        x1_before[p] = x
        y1_before[p] = y
        x1[p] = end
        y1[p] = speed
        if c.stages == 2:
            u = x2[p]
            v = y2[p]
            end, speed = second_stage(f, u, y, v, z[p], area[p])
            high, low = (high2[p], low2[p]) if toleranced else (c.wall2, c.wall2)
            meets |= near_wall(third, u, v, end, speed, high, low, f.margin2)
            x2_before[p] = u
            y2_before[p] = v
            x2[p] = end
            y2[p] = speed
        near[p] = meets


@splice
def _due(c: Constants, s: State, walls: Walls) -> tuple[int, float, float]:
    """The impact that is due: ``mesh * side``, or 0; the time to its wall; and that to the next
    wall ahead.

    Both times are at the present velocity.  The first is that of the flight without noise, zero for
    a path so slow that it must come within `CLOSE_TO_WALL` of its wall, and negative for one that
    is just beyond it.  Mesh 1 comes before mesh 2 where both are met within `TOGETHER`.
    """
    code = 0
    lead = math.inf
    reach = math.inf
    for mesh in range(1, c.stages + 1):
        x, y, other = of_mesh(mesh, s)
        high, low = flanks_of(mesh, walls)
        wall = c.wall1 if mesh == 1 else c.wall2
        gap = high - x if y > 0.0 else low + x
        if y == 0.0:
            continue
        if gap > NEAR_WALL * wall:
            reach = min(reach, gap / abs(y))
            continue
        swift = abs(gap) <= noise_free_reach(c, mesh, y, other, wall)
        if swift or gap <= CLOSE_TO_WALL * wall:
            own = gap / abs(y) if swift else 0.0
            if own < lead - TOGETHER:
                code = mesh if y > 0.0 else -mesh
                lead = own
        else:
            reach = min(reach, gap / abs(y))
    return code, lead, reach


@inline
def _struck(
    c: Constants, at: Progress, phase: Phase, code: int, lead: float, walls: Walls
) -> tuple[Progress, Phase]:
    """The path at the impact that is due, after its flight without noise to the wall: along a
    parabola."""
    sine = phase[0]
    cosine = phase[1]
    third = third_of(c.drive, phase)
    apart = c.beta1 - c.beta2
    x1, y1, x2, y2 = at.state
    rate1 = c.gamma1 - c.beta1 * y1 + c.alpha * (c.beta1 * cosine - sine)
    rate2 = (c.gamma1 - c.gamma2) - c.beta2 * y2 + apart * (c.alpha * cosine - y1)
    speed, rate = (y1, rate1) if abs(code) == 1 else (y2, rate2)
    lead = min(lead - 0.5 * lead * lead * rate / speed, at.left)
    half = 0.5 * lead
    bend1 = c.beta1 * rate1 + c.alpha * (c.beta1 * sine + third)
    bend2 = c.beta2 * rate2 + apart * (c.alpha * sine + rate1)
    x1 = x1 + lead * (y1 + half * rate1)
    y1 = y1 + lead * (rate1 - half * bend1)
    if c.stages == 2:
        x2 = x2 + lead * (y2 + half * rate2)
        y2 = y2 + lead * (rate2 - half * bend2)
    phase = shift_phase(c.drive, phase, lead)
    x1, x2 = put_on_wall(x1, x2, code, walls)
    return Progress(code, at.tau + lead, at.left - lead, at.noise, (x1, y1, x2, y2)), phase


@inline
def _part(ahead: Floats, top: int) -> tuple[float, Noise]:
    """Length and noise of a part of the step on the stack."""
    return ahead[top, 0], Noise(ahead[top, 1], ahead[top, 2])


@inline
def _join(ahead: Floats, top: int) -> Noise:
    """Noise of all waiting parts below `top` of the stack."""
    noise = Noise(0.0, 0.0)
    length = 0.0
    for i in range(top):  # from the end of the step backwards
        h, part = _part(ahead, i)
        length = length + h
        noise = join(part, noise, h / length)
    return noise


@inline
def _put(ahead: Floats, top: int, length: float, noise: Noise) -> None:
    """Put a part of the step, still ahead, onto the stack."""
    ahead[top, 0] = length
    ahead[top, 1] = noise.increment
    ahead[top, 2] = noise.area


@inline
def advance_exactly(
    inside: Inside, met: int, at: Progress, phase: Phase, walls: Walls
) -> tuple[Progress, Phase]:
    """Go to the next wall that the path meets in this step, or to the end of the step.

    The time left is tried as a whole.  A trial that may have an impact is cut at the wall and its
    first part is tried; the second waits on a stack.  Waiting parts must not be joined before an
    impact: a trial is cut because of what its end would be, and forgetting that end and sampling it
    anew would give the path a second chance to miss the wall.  At an impact they may be joined,
    since it is a stopping time of the path.

    On the stack, ``inside.ahead``, are length, increment and area of the parts of the step still
    ahead, the nearest on top.  Cuts 2 i and 2 i + 1 share the four normals of an index.
    Beside a closed mesh the other stage flies as a single one.
    """
    if inside.hold.first == 0 and inside.hold.second == 0:
        return _advance(inside, inside.c, not inside.known, met, at, phase, walls)
    return _advance_beside(inside, met, at, phase, walls)


@inline
def _advance(
    inside: Inside, c: Constants, flown: bool, met: int, at: Progress, phase: Phase, walls: Walls
) -> tuple[Progress, Phase]:
    """`advance_exactly` where no mesh is closed; `flown`: whether the end of the flight is not that
    of the whole step."""
    ahead = inside.ahead
    index = Word(inside.step) * SPLITS + CUTS_APART * Word(met)
    tau = at.tau
    left = at.left
    s = at.state
    code, lead, _ = _due(c, s, walls)
    if code != 0 and lead < left:
        return _struck(c, at, phase, code, max(lead, 0.0), walls)
    end = inside.whole
    turned = phase
    cuts = top = 0
    z3 = z4 = 0.0
    _put(ahead, 0, left, at.noise)
    while True:
        h, noise = _part(ahead, top)
        if flown:
            end, turned = short_flight(c, phase, h, s, noise.increment, noise.area)
        cut = cut_share(c, phase, s, end, h, walls)
        tick = TICK * (1.0 + abs(tau))
        used_up = cuts >= MOST_CUTS or top + 1 >= len(ahead) or h <= tick
        if cut == 1.0 or used_up:
            if used_up:
                end = clip(end, walls)
            tau = tau + h
            left = left - h if top > 0 else 0.0
            code, lead, reach = _due(c, end, walls)
            if code != 0 and lead <= left:
                at = Progress(code, tau, left, _join(ahead, top), end)
                phase = turned if flown else phase_at(c.drive, tau)
                return _struck(c, at, phase, code, max(lead, -0.5 * h), walls)
            if top == 0:
                return Progress(0, tau, 0.0, Noise(0.0, 0.0), end), turned
            s = end
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
        cuts += 1
        cut = max(cut, tick / h)
        first, second = split(noise, h, cut, z1, z2)
        _put(ahead, top, h - cut * h, second)
        top += 1
        _put(ahead, top, cut * h, first)


@lean_internal
def _advance_beside(
    inside: Inside, met: int, at: Progress, phase: Phase, walls: Walls
) -> tuple[Progress, Phase]:
    """`advance_exactly` beside a closed mesh; called, for the flight of open meshes must not wait
    for which constants it takes."""
    hold = inside.hold
    if hold.first != 0 and (hold.second != 0 or inside.c.stages == 1):
        sides = hold.first, hold.second
        return stick_to_end(inside.c, at, sides, walls), phase
    before = close_meshes(inside.c, at, hold, walls)
    c, alone, beside = open_part(inside.c, before, hold, walls)
    moved, phase = _advance(inside, c, True, met, alone, phase, beside)
    return join_closed(before, moved, hold), phase


def accurate_flight(scene: Scene) -> Limit:
    """The longest accurate step of ``exact-flight``, which neglects part of the noise within a
    step; and its reason.

    The neglected part (of relative order h^4 of the variance) matters where the variance grows from
    zero: at this limit 0.8 % of sd(x1) after a flight of 0.2 from tau = 0, at half of it 0.05 %.
    """
    limits = {
        MEMORY_REASON: memory_step(scene),
        "a longer step cannot follow the damping": 0.2 * time_scales(scene).damping,
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
