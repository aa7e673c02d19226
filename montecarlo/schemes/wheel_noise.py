"""Noises that act on single wheels alone, beside the common one: what they do in a step.

Each is a Brownian motion as the common noise is (`rattle.montecarlo.noise.brownian`), scaled by its
intensity.  Wheels that are locked together are moved by all of theirs, each in proportion to the
wheel's share of the momentum.
"""

import math

from rattle.montecarlo.noise.brownian import Noise, join, split
from rattle.montecarlo.noise.philox import (
    WHEEL_BRIDGE,
    WHEEL_STEP,
    Key,
    Word,
    fill_normals,
    normals,
)
from rattle.montecarlo.schemes.crossing import near_wall
from rattle.montecarlo.schemes.lanes import Lanes, Room, add_scaled
from rattle.montecarlo.schemes.short_flight import kick
from rattle.montecarlo.schemes.step_state import AREA, INCREMENT, MARGIN, Scratch
from rattle.scene import Bools, Constants, Floats, Ints
from rattle.scene.compiled import inline, lean_internal, not_inlined, widest_vectors
from rattle.scene.types import MOST_WHEELS, Bodies

ALONG_PARTS = 3  # first column of these noises in `Scratch.ahead`


@lean_internal
def draw_alone(key: Key, draws: int, n: int, room: Room, wide: int, alone: Floats) -> None:
    """The normals of step n of all lanes; a draw of four serves so many steps.

    Shapes: `alone` (wheels, 2, lanes).
    """
    not_inlined()
    place = n % draws
    for i in range(room.z_alone.shape[0]):
        z = room.z_alone[i]
        if room.scratch.intensity[i] == 0.0:
            continue
        if place == 0:
            fill_normals(key, room.path, Word(n // draws), Word(WHEEL_STEP + i), wide, z)
        for k in range(4 // draws):
            of_step = z[place * (4 // draws) + k]
            to = alone[i, k]
            for p in range(wide):
                to[p] = of_step[p]


@lean_internal
def add_kicks(c: Constants, h: float, lanes: Lanes, live: int) -> None:
    """What these noises add to the rates in an Euler step of all lanes."""
    not_inlined()
    widest_vectors()
    root = c.sigma * math.sqrt(h)
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        rates = lanes.state[2 * i + 1]
        own = root * wheel.sign * wheel.alone
        add_scaled(rates, own, lanes.alone[i, 0], live)
        if wheel.parent >= 0:
            carried = root * wheel.ratio * c.wheels[wheel.parent].alone
            add_scaled(rates, carried, lanes.alone[wheel.parent, 0], live)


@lean_internal
def flight_effects(c: Constants, tau: float, h: float, scratch: Scratch) -> None:
    """Write the effects of unit normals on all gaps in an exact step into ``scratch.effects``."""
    not_inlined()
    series = scratch.series
    for i in range(c.wheels.size):
        series[2 + i, INCREMENT] = 0.0
        series[2 + i, AREA] = 0.0
    for i in range(c.wheels.size):
        size = scratch.intensity[i]
        series[2 + i, INCREMENT] = size * math.sqrt(h)
        kick(c, tau, h, 0.0, 0.0, series, scratch.effects[i, 0])
        series[2 + i, INCREMENT] = 0.0
        series[2 + i, AREA] = size * math.sqrt(h / 12.0)
        kick(c, tau, h, 0.0, 0.0, series, scratch.effects[i, 1])
        series[2 + i, AREA] = 0.0


@lean_internal
def shake_lanes(
    c: Constants, h: float, lanes: Lanes, scratch: Scratch, near: Bools, live: int
) -> None:
    """What these noises do in an exact step of all lanes, after what the common noise did; marks
    those that may have an impact then."""
    not_inlined()
    for i in range(c.wheels.size):
        parent = c.wheels[i].parent
        _add_flights(i, i, lanes, scratch, live)
        if parent >= 0:
            _add_flights(i, parent, lanes, scratch, live)
        _mark_near(i, h, lanes, scratch, near, live)


@lean_internal
def _mark_near(i: int, h: float, lanes: Lanes, scratch: Scratch, near: Bools, live: int) -> None:
    """Mark also the lanes in which a gap may have an impact in an exact step."""
    widest_vectors()
    margin = scratch.forcing[i, MARGIN]
    x = lanes.state[2 * i]
    y = lanes.state[2 * i + 1]
    x0 = lanes.before[2 * i]
    y0 = lanes.before[2 * i + 1]
    high = lanes.walls[2 * i]
    low = lanes.walls[2 * i + 1]
    for p in range(live):
        near[p] |= near_wall(h / 3.0, x0[p], y0[p], x[p], y[p], high[p], low[p], margin)


@lean_internal
def _add_flights(i: int, source: int, lanes: Lanes, scratch: Scratch, live: int) -> None:
    """What the noise of one wheel adds to displacement and rate of a gap."""
    widest_vectors()
    for k in range(2):
        z = lanes.alone[source, k]
        for m in range(2):
            effect = scratch.effects[source, k, 2 * i + m]
            add_scaled(lanes.state[2 * i + m], effect, z, live)


@lean_internal
def begin_alone(normals_of: Floats, p: int, h: float, intensity: Floats, alone: Floats) -> None:
    """Increments and areas of the path in lane p, in the whole of a step.

    Shapes: `normals_of` (wheels, 2, lanes); `alone` (2 wheels,).
    """
    not_inlined()
    for i in range(intensity.size):
        alone[2 * i] = intensity[i] * normals_of[i, 0, p] * math.sqrt(h)
        alone[2 * i + 1] = intensity[i] * normals_of[i, 1, p] * math.sqrt(h / 12.0)


@lean_internal
def gather_alone(noise: Floats, count: int, bodies: Bodies, free: Ints, series: Floats) -> None:
    """Write what noises of the wheels do to the bodies that fly, so many, beside their series.

    `free`: Wheels that these bodies begin with.  Shapes: `noise` (2 wheels,).
    """
    not_inlined()
    wheels = bodies.size
    for k in range(count):
        to = series[2 + k]
        to[INCREMENT] = noise[2 * k] if count == wheels else 0.0
        to[AREA] = noise[2 * k + 1] if count == wheels else 0.0
        for j in range(wheels if count < wheels else 0):
            body = bodies[j]
            if free[k] == body.root:
                to[INCREMENT] += body.share * noise[2 * j]
                to[AREA] += body.share * noise[2 * j + 1]


@inline
def purpose_of(level: int, i: int) -> Word:
    """The substream that splits the noise of a wheel alone."""
    return Word(WHEEL_BRIDGE + MOST_WHEELS * level + i)


@lean_internal
def split_alone(
    key: Key,
    path: Word,
    index: Word,
    level: int,
    cut: int,
    share: float,
    ahead: Floats,
    top: int,
    intensity: Floats,
) -> None:
    """Split the noises of the part of the step on top of the stack, its cut of that number: the
    first part goes above the second."""
    not_inlined()
    h = ahead[top, 0]
    for i in range(intensity.size):
        size = intensity[i]
        z1, z2, z3, z4 = normals(key, path, index + Word(cut >> 1), purpose_of(level, i))
        if cut & 1 != 0:
            z1 = z3
            z2 = z4
        column = ALONG_PARTS + 2 * i
        whole = Noise(ahead[top, column], ahead[top, column + 1])
        first, second = split(whole, h, share, size * z1, size * z2)
        ahead[top, column] = second.increment
        ahead[top, column + 1] = second.area
        ahead[top + 1, column] = first.increment
        ahead[top + 1, column + 1] = first.area


@inline
def join_parts(ahead: Floats, top: int, column: int) -> Noise:
    """A noise of all waiting parts below `top` of the stack, from the column of its increments
    on."""
    noise = Noise(0.0, 0.0)
    length = 0.0
    for k in range(top):  # from the end of the step backwards
        h = ahead[k, 0]
        length = length + h
        part = Noise(ahead[k, column], ahead[k, column + 1])
        noise = join(part, noise, h / length)
    return noise


@lean_internal
def join_alone(ahead: Floats, top: int, alone: Floats) -> None:
    """Noises of single wheels of all waiting parts below `top` of the stack, as those of the time
    left."""
    not_inlined()
    for i in range(0, alone.size, 2):
        noise = join_parts(ahead, top, ALONG_PARTS + i)
        alone[i] = noise.increment
        alone[i + 1] = noise.area


@lean_internal
def divide_increments(
    key: Key,
    path: Word,
    index: Word,
    level: int,
    left: float,
    reach: float,
    intensity: Floats,
    alone: Floats,
    series: Floats,
) -> None:
    """Divide the increments of the time left at a wall, by Brownian bridges: what comes before goes
    beside the series of each wheel."""
    not_inlined()
    spread = math.sqrt(reach * (left - reach) / left)
    for i in range(intensity.size):
        normal = normals(key, path, index, purpose_of(level, i))[0]
        part = alone[2 * i] * reach / left + spread * intensity[i] * normal
        series[2 + i, INCREMENT] = part
        alone[2 * i] -= part


@lean_internal
def add_kick(c: Constants, s: Floats, series: Floats) -> None:
    """What increments beside the series of the wheels add to the rates of a path in an Euler
    step."""
    not_inlined()
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        pushed = wheel.sign * series[2 + i, INCREMENT]
        if wheel.parent >= 0:
            pushed += wheel.ratio * series[2 + wheel.parent, INCREMENT]
        s[2 * i + 1] += c.sigma * pushed
