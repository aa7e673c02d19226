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
from rattle.montecarlo.schemes.step_state import State
from rattle.scene import Constants, Floats, InputError, Scene
from rattle.scene.compiled import internal
from rattle.scene.impact import struck

Pair = tuple[float, float]

TREE = BRIDGE + LEVELS
"""Substream of the normals of this module, see the purposes of `rattle.montecarlo.noise.philox`."""

# most levels below a step: of a random number's index 26 bits are the node, the 30 above the step
DEEPEST = 26
TREE_BITS = Word(DEEPEST)
STEPS_OF_A_PERIOD = 128  # fewest steps of a period
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
    """Step of a path: a period over a power of two of at least `STEPS_OF_A_PERIOD`, shorter where
    damping is strong."""
    longest = 0.5 * accurate_flight(scene)[0]
    steps = STEPS_OF_A_PERIOD
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


@internal
def new_room(depth: int) -> Floats:
    """A stack of the intervals still to be walked, for a tree of given depth: increment and area,
    and their place in the tree, level and node.

    Shapes: result (depth + 2, 4).
    """
    return np.empty((depth + 2, 4))


@internal
def _fly(c: Constants, tau: float, s: State, h: float, noise: Noise) -> State:
    """State after a flight of time h, at most a step, with given noise."""
    return short_flight(c, phase_at(c.drive, tau), h, s, noise.increment, noise.area)[0]


@internal
def _is_near(c: Constants, h: float, s: State, end: State, margin: Pair) -> bool:
    """Whether a flight between two states may meet a wall."""
    third = h / 3.0
    if near_wall(third, s[0], s[1], end[0], end[1], c.wall1, c.wall1, margin[0]):
        return True
    return c.stages == 2 and near_wall(
        third, s[2], s[3], end[2], end[3], c.wall2, c.wall2, margin[1]
    )


@internal
def _first_wall(c: Constants, h: float, s: State, end: State) -> tuple[float, int]:
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
    c: Constants, tau: float, offset: float, h: float, noise: Noise, s: State, hits: Floats, n: int
) -> tuple[State, int]:
    """Carry a path through a leaf; returns its state and the number of impacts in the step so
    far."""
    left = h
    gone = 0.0
    for _ in range(IN_A_LEAF):
        end = _fly(c, tau + gone, s, left, Noise(noise.increment * (left / h), 0.0))
        share, code = _first_wall(c, left, s, end)
        if code == 0 or n == len(hits):
            s = end
            break
        t = share * left
        s = _fly(c, tau + gone, s, t, Noise(noise.increment * (t / h), 0.0))
        side = 1 if code > 0 else -1
        mesh = abs(code)
        s = (side * c.wall1, s[1], s[2], s[3]) if mesh == 1 else (s[0], s[1], side * c.wall2, s[3])
        gone = gone + t
        left = left - t
        if side * s[2 * mesh - 1] > 0.0:
            hits[n, 0] = offset + gone
            hits[n, 1] = code
            for i in range(4):
                hits[n, 2 + i] = s[i]
            n += 1
            y1, y2 = struck(c, mesh, s[1], s[3])
            s = s[0], y1, s[2], y2
    x1 = min(max(s[0], -c.wall1), c.wall1)
    x2 = min(max(s[2], -c.wall2), c.wall2) if c.stages == 2 else s[2]
    return (x1, s[1], x2, s[3]), n


@internal
def _step_freely(f: Floats, m: Floats, stages: int, s: State, z: Pair) -> State:
    """State after a step whose noise has the normals z, ignoring the walls.

    `f`, `m`: Of the step, rows of `Clockwork`. Shapes: `f` (14,); `m` (6,).
    """
    a, b = z
    x1 = s[0] + m[0] * s[1] + (f[0] + f[4] * a + f[8] * b)
    y1 = m[1] * s[1] + (f[1] + f[5] * a + f[9] * b)
    if stages == 1:
        return x1, y1, s[2], s[3]
    x2 = s[2] + m[2] * s[1] + m[3] * s[3] + (f[2] + f[6] * a + f[10] * b)
    y2 = m[4] * s[1] + m[5] * s[3] + (f[3] + f[7] * a + f[11] * b)
    return x1, y1, x2, y2


@internal
def walk_step(
    tree: Tree, pending: Floats, path: Word, step: int, z: Pair, state: Floats, hits: Floats
) -> tuple[int, bool]:
    """Carry a path through a step whose noise has the normals z, in place.

    Returns: Number of impacts, and whether `hits` was filled: the path then stays in this state to
    the end of the step. Shapes: `pending` as of `new_room`; `state` (4,); `hits` (at least 1, HIT).
    """
    c = tree.c
    w = tree.clock
    row = step % len(w.forcing)
    f = w.forcing[row]
    s = state[0], state[1], state[2], state[3]
    end = _step_freely(f, w.carry, c.stages, s, z)
    n = 0
    if _is_near(c, w.h, s, end, (f[12], f[13])):
        whole = Noise(z[0] * math.sqrt(w.h), z[1] * math.sqrt(w.h / 12.0))
        end, n = _walk_tree(tree, pending, path, step, whole, s, hits)
    for i in range(4):
        state[i] = end[i]
    return n, n == len(hits)


@internal
def _walk_tree(
    tree: Tree, pending: Floats, path: Word, step: int, whole: Noise, s: State, hits: Floats
) -> tuple[State, int]:
    """Carry a path through a step that may meet a wall, halved until it does not or is a leaf;
    returns its state and the number of impacts."""
    c = tree.c
    w = tree.clock
    tau = (step % len(w.forcing)) * w.h
    offset = 0.0
    n = 0
    _put(pending, 0, whole, 0, 1)
    top = 0
    while top >= 0:
        noise = Noise(pending[top, 0], pending[top, 1])
        level = int(pending[top, 2])
        node = int(pending[top, 3])
        top -= 1
        h = math.ldexp(w.h, -level)
        if level == w.depth:
            s, n = _leaf(c, tau + offset, offset, h, noise, s, hits, n)
            offset += h
            if n == len(hits):
                break
            continue
        if level > 0:  # of the whole step it is known
            phase = phase_at(c.drive, tau + offset)
            end, _ = short_flight(c, phase, h, s, noise.increment, noise.area)
            if not _is_near(c, h, s, end, margins(c, phase, h)):
                s = end
                offset += h
                continue
        z1 = 0.0
        z2 = 0.0
        if c.sigma > 0.0:
            index = (Word(step) << TREE_BITS) + Word(node)
            z1, z2, _, _ = normals(tree.key, path, index, Word(TREE))
        left, right = split(noise, h, 0.5, z1, z2)
        _put(pending, top + 1, right, level + 1, 2 * node + 1)
        _put(pending, top + 2, left, level + 1, 2 * node)
        top += 2
    return s, n


@internal
def _put(pending: Floats, top: int, noise: Noise, level: int, node: int) -> None:
    """Put an interval onto the stack."""
    pending[top, 0] = noise.increment
    pending[top, 1] = noise.area
    pending[top, 2] = level
    pending[top, 3] = node
