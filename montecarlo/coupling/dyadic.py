"""Steps of a path on a shared Brownian tree: a Brownian path that is a function of time, the same
for all who use it.

The noise of a step is given by its increment and area (`rattle.montecarlo.noise.brownian`) and,
near a wall, halved recursively.  The normals of a split belong to the node of the dyadic tree, not
to the path, so that two paths on one tree have the same noise at every time.  At the leaves,
``2^-depth`` steps long, the noise is constant, the flight smooth and its impact a root: the only
discretisation.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.noise.brownian import Noise, split
from rattle.montecarlo.noise.philox import BRIDGE, LEVELS, Key, Word, key_of, normals
from rattle.montecarlo.schemes.crossing import first_root, margins, near_wall
from rattle.montecarlo.schemes.exact_flight import (
    FlightForcing,
    accurate_flight,
    flight_forcing,
)
from rattle.montecarlo.schemes.short_flight import phase_at, short_flight
from rattle.scene import Constants, Floats, InputError, Ints, Scene
from rattle.scene.compiled import internal, jit
from rattle.scene.impact import struck
from rattle.scene.linear_algebra import put_row

Pair = tuple[float, float]

TREE = BRIDGE + LEVELS
"""Substream of the normals of this module, see the purposes of `rattle.montecarlo.noise.philox`."""

# most levels below a step: of a random number's index 26 bits are the node, the 30 above the step
DEEPEST = 26
TREE_BITS = Word(DEEPEST)
STEPS = 128  # fewest steps of a period
# most wall contacts in a leaf; then the path is clipped to its walls and goes on at the next leaf
IN_A_LEAF = 8
HIT = 6
"""Columns of an impact: time since the start of the step, ``mesh * side``, state just before."""


class Clockwork(NamedTuple):
    """Tables of the steps, periodic with the excitation."""

    h: float  # step; a whole number of steps makes a period
    depth: int  # levels of the tree below a step
    # for each step of a period: drift, effect of a unit normal of the increment and of the area (4
    # each), margins of both stages; (steps, 14)
    forcing: Floats
    carry: Floats  # of a step, see `rattle.montecarlo.schemes.exact_flight.FlightForcing`; (6,)


def step_time(scene: Scene) -> float:
    """Step of a path: a period over a power of two of at least `STEPS`, shorter where damping is
    strong."""
    longest = 0.5 * accurate_flight(scene)[0]
    steps = STEPS
    while 2.0 * math.pi / steps > longest:
        steps *= 2
    return 2.0 * math.pi / steps


def clockwork(scene: Scene, depth: int) -> Clockwork:
    """The step tables of a scene."""
    if scene.tolerance is not None and scene.tolerance.distribution != "fixed":
        why = (
            "a path on a shared Brownian tree needs gaps that do not vary: give 'fixed', or no"
            " tolerance"
        )
        raise InputError("tolerance.distribution", scene.tolerance.distribution, why)
    if scene.correlation_time:
        raise InputError(
            "correlation_time",
            scene.correlation_time,
            "a shared Brownian tree is of white noise only, 0",
        )
    h = step_time(scene)
    return clockwork_of(
        [flight_forcing(scene.constants, n * h, h) for n in range(round(2.0 * math.pi / h))],
        h,
        depth,
    )


def clockwork_of(steps: Sequence[FlightForcing], h: float, depth: int) -> Clockwork:
    """Tables of given steps."""
    table = np.array([(*f.drift, *f.along, *f.across, f.margin1, f.margin2) for f in steps])
    f = steps[0]
    return Clockwork(h, depth, table, np.array(f.carry))


class Tree(NamedTuple):
    """A scene on a shared Brownian tree, for compiled code."""

    c: Constants
    clock: Clockwork
    key: Key  # of the random numbers


def tree_of(scene: Scene, seed: int, depth: int) -> Tree:
    """The tree of a scene and a seed."""
    return Tree(scene.constants, clockwork(scene, depth), key_of(np.random.SeedSequence(seed)))


class TreeRoom(NamedTuple):
    """Buffers of a walk."""

    end: Floats  # state at the end of a trial; (4,)
    pending: Floats  # stack of the intervals still to be walked: increment and area; (depth + 2, 2)
    level: Ints  # level, node: their places in the tree; (depth + 2,)
    node: Ints


@internal
def new_room(depth: int) -> TreeRoom:
    """Buffers for a tree of given depth."""
    size = depth + 2
    return TreeRoom(
        np.empty(4), np.empty((size, 2)), np.empty(size, np.int64), np.empty(size, np.int64)
    )


@jit
def fly(
    c: Constants, tau: float, s: Floats, h: float, noise: Noise, end: Floats
) -> tuple[float, float]:
    """State after a flight of time h, at most a step, with given noise, into `end`.

    Shapes: `s` (4,); `end` (4,).
    """
    phase = phase_at(c.drive, tau)
    state = s[0], s[1], s[2], s[3]
    (end[0], end[1], end[2], end[3]), _ = short_flight(
        c, phase, h, state, noise.increment, noise.area
    )
    return margins(c, phase[0], phase[1], h)


@internal
def _is_near(
    c: Constants, h: float, s: Floats, end: Floats, margin1: float, margin2: float
) -> bool:
    third = h / 3.0
    if near_wall(third, s[0], s[1], end[0], end[1], c.wall1, c.wall1, margin1):
        return True
    return c.stages == 2 and near_wall(third, s[2], s[3], end[2], end[3], c.wall2, c.wall2, margin2)


@internal
def _first_wall(c: Constants, h: float, s: Floats, end: Floats) -> tuple[float, int]:
    """Share of a leaf after which the first wall is met, and its ``mesh * side``; 1 and 0 if none
    is."""
    share = 1.0
    code = 0
    for mesh in range(1, c.stages + 1):
        j = 2 * (mesh - 1)
        wall = c.wall1 if mesh == 1 else c.wall2
        for side in (1, -1):
            gap1 = wall - side * end[j]
            if gap1 < 0.0:
                gap0 = max(wall - side * s[j], 0.0)
                out0 = side * s[j + 1]
                out1 = side * end[j + 1]
                root = 0.0
                if gap0 > 0.0 or out0 < 0.0:
                    root = first_root(gap0, gap0 - out0 * h / 3.0, gap1 + out1 * h / 3.0, gap1)
                if root < share:
                    share = root
                    code = mesh * side
    return share, code


@internal
def _leaf(
    c: Constants,
    tau: float,
    offset: float,
    h: float,
    noise: Noise,
    s: Floats,
    end: Floats,
    hits: Floats,
    n: int,
) -> int:
    """Carry a path through a leaf; returns the number of impacts in the step so far."""
    left = h
    gone = 0.0
    for _ in range(IN_A_LEAF):
        fly(c, tau + gone, s, left, Noise(noise.increment * (left / h), 0.0), end)
        share, code = _first_wall(c, left, s, end)
        if code != 0 and n < len(hits):
            t = share * left
            fly(c, tau + gone, s, t, Noise(noise.increment * (t / h), 0.0), end)
            j = 2 * (abs(code) - 1)
            side = 1 if code > 0 else -1
            end[j] = side * (c.wall1 if j == 0 else c.wall2)
            put_row(s, end)
            gone = gone + t
            left = left - t
            if side * s[j + 1] > 0.0:
                hits[n, 0] = offset + gone
                hits[n, 1] = code
                put_row(hits[n, 2:], s)
                n += 1
                s[1], s[3] = struck(c, abs(code), s[1], s[3])
            continue
        put_row(s, end)
        left = 0.0
        break
    s[0] = min(max(s[0], -c.wall1), c.wall1)
    if c.stages == 2:
        s[2] = min(max(s[2], -c.wall2), c.wall2)
    return n


@internal
def walk_step(
    tree: Tree, room: TreeRoom, path: Word, step: int, z: Pair, s: Floats, hits: Floats
) -> tuple[int, bool]:
    """Carry a path through a step whose noise has the normals z, in place.

    Returns: Number of impacts, and whether `hits` was filled: the path then stays in this state to
    the end of the step. Shapes: `s` (4,); `hits` (at least 1, HIT).
    """
    c = tree.c
    w = tree.clock
    row = step % len(w.forcing)
    f = w.forcing[row]
    m = w.carry
    end = room.end
    pending = room.pending
    level = room.level
    node_of = room.node
    a, b = z
    end[0] = s[0] + m[0] * s[1] + (f[0] + f[4] * a + f[8] * b)
    end[1] = m[1] * s[1] + (f[1] + f[5] * a + f[9] * b)
    end[2] = s[2]
    end[3] = s[3]
    if c.stages == 2:
        end[2] = s[2] + m[2] * s[1] + m[3] * s[3] + (f[2] + f[6] * a + f[10] * b)
        end[3] = m[4] * s[1] + m[5] * s[3] + (f[3] + f[7] * a + f[11] * b)
    if not _is_near(c, w.h, s, end, f[12], f[13]):
        put_row(s, end)
        return 0, False
    tau = row * w.h
    offset = 0.0
    n = 0
    pending[0, 0], pending[0, 1] = a * math.sqrt(w.h), b * math.sqrt(w.h / 12.0)
    level[0] = 0
    node_of[0] = 1
    top = 0
    first = True
    while top >= 0:
        noise = Noise(pending[top, 0], pending[top, 1])
        depth = level[top]
        number = node_of[top]
        top -= 1
        h = math.ldexp(w.h, -int(depth))
        if depth == w.depth:
            n = _leaf(c, tau + offset, offset, h, noise, s, end, hits, n)
            offset += h
            if n == len(hits):
                return n, True
            continue
        if not first:  # of the whole step it is known
            margin1, margin2 = fly(c, tau + offset, s, h, noise, end)
            if not _is_near(c, h, s, end, margin1, margin2):
                put_row(s, end)
                offset += h
                continue
        first = False
        z1 = 0.0
        z2 = 0.0
        if c.sigma > 0.0:
            z1, z2, _, _ = normals(
                tree.key, path, (Word(step) << TREE_BITS) + Word(number), Word(TREE)
            )
        left, right = split(noise, h, 0.5, z1, z2)
        pending[top + 1, 0] = right.increment
        pending[top + 1, 1] = right.area
        pending[top + 2, 0] = left.increment
        pending[top + 2, 1] = left.area
        level[top + 1] = level[top + 2] = depth + 1
        node_of[top + 1] = 2 * number + 1
        node_of[top + 2] = 2 * number
        top += 2
    return n, False
