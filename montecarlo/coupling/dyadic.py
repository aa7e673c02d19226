"""Steps of a path on a shared Brownian tree: a Brownian path that is a function of time, the same
for all who use it.

The noise of a step is given by its increment and area (`rattle.montecarlo.noise.brownian`) and,
near a wall, halved recursively.  The normals of a split belong to the node of the dyadic tree, not
to the path, so that two paths on one tree have the same noise at every time.  At the leaves,
``2^-depth`` steps long, the noise is constant, the flight smooth and its impact a root: the only
discretisation.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.noise.brownian import Noise, split
from rattle.montecarlo.noise.philox import BRIDGE, LEVELS, Key, Word, key_of, normals
from rattle.montecarlo.schemes.crossing import first_root, margin_of, near_wall
from rattle.montecarlo.schemes.exact_flight import (
    ACROSS,
    ALONG,
    CARRY,
    DRIFT,
    MARGIN,
    accurate_flight,
    flight_forcing,
)
from rattle.montecarlo.schemes.lanes import lanes_of
from rattle.montecarlo.schemes.short_flight import phase_at, short_flight
from rattle.montecarlo.schemes.step_state import (
    FORCING,
    MOST_TERMS,
    clip,
    copy_state,
    due_side,
    parent_deviation,
    put_on_wall,
)
from rattle.scene import Constants, Floats, InputError, Scene
from rattle.scene.compiled import internal
from rattle.scene.impact import strike

Pair = tuple[float, float]

TREE = BRIDGE + LEVELS
"""Substream of the normals of this module, see the purposes of `rattle.montecarlo.noise.philox`."""

# most levels below a step: of a random number's index 26 bits are the node, the 30 above the step
DEEPEST = 26
TREE_BITS = Word(DEEPEST)
STEPS_OF_A_PERIOD = 128  # fewest steps of a period
# most wall contacts in a leaf; then the path is clipped to its walls and goes on at the next leaf
IN_A_LEAF = 8


class Clockwork(NamedTuple):
    """Tables of the steps, periodic with the excitation."""

    h: float  # step; a whole number of steps makes a period
    depth: int  # levels of the tree below a step
    # for each step of a period, see `rattle.montecarlo.schemes.exact_flight.flight_forcing`;
    # (steps, wheels, FORCING)
    forcing: Floats


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
    times = np.array([n * h for n in range(round(2.0 * math.pi / h))])
    return clockwork_at(scene, times, h, depth)


def clockwork_at(scene: Scene, begins: Floats, h: float, depth: int) -> Clockwork:
    """Tables of steps that begin at given times."""
    state = np.zeros((2 * scene.stages, 1))
    _, room = lanes_of(1, 0, state, state, 0.0, 0)
    table = np.empty((begins.size, scene.stages, FORCING))
    for row, begin in zip(table, begins, strict=True):
        flight_forcing(scene.constants, begin, h, room.scratch)
        row[:] = room.scratch.forcing
    return Clockwork(h, depth, table)


class TreeRoom(NamedTuple):
    """Buffers of a path within a step."""

    # intervals still to be walked: increment and area, and their place in the tree, level and
    # node; (depth + 2, 4)
    pending: Floats
    end: Floats  # state at the end of a trial; (2 wheels,)
    series: Floats  # Taylor series, as of `rattle.montecarlo.schemes.step_state.Scratch`
    margins: Floats  # of the walls of each gap; (wheels,)
    walls: Floats  # distances of the flanks from the middle; (2 wheels,)


class Tree(NamedTuple):
    """A scene on a shared Brownian tree, for compiled code, of one thread."""

    c: Constants
    clock: Clockwork
    key: Key  # of the random numbers
    room: TreeRoom


def grow_tree(c: Constants, clock: Clockwork, seed: np.random.SeedSequence) -> Tree:
    """The tree of given steps and a seed."""
    wheels = c.wheels.size
    room = TreeRoom(
        pending=np.empty((clock.depth + 2, 4)),
        end=np.empty(2 * wheels),
        series=np.zeros((3 + wheels, MOST_TERMS)),
        margins=np.empty(wheels),
        walls=np.repeat(c.wheels["wall"], 2),
    )
    return Tree(c, clock, key_of(seed), room)


def tree_of(scene: Scene, seed: int, depth: int) -> Tree:
    """The tree of a scene and a seed."""
    return grow_tree(scene.constants, clockwork(scene, depth), np.random.SeedSequence(seed))


@internal
def new_hits(c: Constants, most: int) -> Floats:
    """Room for the impacts of a path in a step: time since its start, ``mesh * side``, the state
    just before.

    Shapes: result (most, 2 + 2 wheels).
    """
    return np.empty((most, 2 + 2 * c.wheels.size))


@internal
def _fly(tree: Tree, tau: float, s: Floats, h: float, noise: Noise, end: Floats) -> None:
    """Write the state after a flight of time h, at most a step, with given noise."""
    c = tree.c
    phase = phase_at(c.drive, tau)
    short_flight(c, c.alpha, 1.0, phase, h, s, noise.increment, noise.area, tree.room.series, end)


@internal
def _is_near(c: Constants, h: float, s: Floats, end: Floats, margins: Floats) -> bool:
    """Whether a flight between two states may meet a wall."""
    third = h / 3.0
    for i in range(c.wheels.size):
        wall = c.wheels[i].wall
        x = 2 * i
        y = x + 1
        if near_wall(third, s[x], s[y], end[x], end[y], wall, wall, margins[i]):
            return True
    return False


@internal
def _first_wall(c: Constants, h: float, s: Floats, end: Floats) -> tuple[float, int]:
    """Share of a leaf after which the first wall is met, and its ``mesh * side``; 1 and 0 if none
    is."""
    share = 1.0
    code = 0
    for i in range(c.wheels.size):
        wall = c.wheels[i].wall
        for side in (1, -1):
            gap1 = wall - side * end[2 * i]
            if gap1 < 0.0:
                gap0 = max(wall - side * s[2 * i], 0.0)
                out0 = side * s[2 * i + 1]
                out1 = side * end[2 * i + 1]
                root = 0.0
                if gap0 > 0.0 or out0 < 0.0:
                    root = first_root(gap0, gap0 - out0 * h / 3.0, gap1 + out1 * h / 3.0, gap1)
                if root < share:
                    share = root
                    code = (i + 1) * side
    return share, code


@internal
def _leaf(
    tree: Tree, tau: float, offset: float, h: float, noise: Noise, s: Floats, hits: Floats, n: int
) -> int:
    """Carry a path through a leaf, in place; returns the number of impacts in the step so far."""
    c = tree.c
    end = tree.room.end
    left = h
    gone = 0.0
    for _ in range(IN_A_LEAF):
        _fly(tree, tau + gone, s, left, Noise(noise.increment * (left / h), 0.0), end)
        share, code = _first_wall(c, left, s, end)
        if code == 0 or n == len(hits):
            copy_state(s, end)
            break
        t = share * left
        _fly(tree, tau + gone, s, t, Noise(noise.increment * (t / h), 0.0), s)
        put_on_wall(s, code, tree.room.walls)
        gone = gone + t
        left = left - t
        mesh = abs(code)
        if due_side(code) * s[2 * mesh - 1] > 0.0:
            hits[n, 0] = offset + gone
            hits[n, 1] = code
            for i in range(s.size):
                hits[n, 2 + i] = s[i]
            n += 1
            strike(c, mesh, s)
    clip(s, tree.room.walls)
    return n


@internal
def _step_freely(c: Constants, f: Floats, s: Floats, z: Pair, end: Floats) -> None:
    """Write the state after a step whose noise has the normals z, ignoring the walls.

    `f`: Of the step. Shapes: `f` (wheels, FORCING).
    """
    a, b = z
    for i in range(c.wheels.size):
        x = s[2 * i]
        y = s[2 * i + 1]
        v = parent_deviation(c, s, i)
        row = f[i]
        forced = row[DRIFT] + row[ALONG] * a + row[ACROSS] * b
        driven = row[DRIFT + 1] + row[ALONG + 1] * a + row[ACROSS + 1] * b
        end[2 * i] = x + row[CARRY + 2] * v + row[CARRY] * y + forced
        end[2 * i + 1] = row[CARRY + 3] * v + row[CARRY + 1] * y + driven


@internal
def walk_step(
    tree: Tree, path: Word, step: int, z: Pair, state: Floats, hits: Floats
) -> tuple[int, bool]:
    """Carry a path through a step whose noise has the normals z, in place.

    Returns: Number of impacts, and whether `hits` was filled: the path then stays in this state to
    the end of the step. Shapes: `state` (2 wheels,); `hits` (at least 1, columns of `new_hits`).
    """
    c = tree.c
    w = tree.clock
    end = tree.room.end
    margins = tree.room.margins
    f = w.forcing[step % len(w.forcing)]
    _step_freely(c, f, state, z, end)
    for i in range(margins.size):
        margins[i] = f[i, MARGIN]
    if not _is_near(c, w.h, state, end, margins):
        copy_state(state, end)
        return 0, False
    whole = Noise(z[0] * math.sqrt(w.h), z[1] * math.sqrt(w.h / 12.0))
    n = _walk_tree(tree, path, step, whole, state, hits)
    return n, n == len(hits)


@internal
def _walk_tree(tree: Tree, path: Word, step: int, whole: Noise, s: Floats, hits: Floats) -> int:
    """Carry a path through a step that may meet a wall, halved until it does not or is a leaf, in
    place; returns the number of impacts."""
    c = tree.c
    w = tree.clock
    pending = tree.room.pending
    end = tree.room.end
    margins = tree.room.margins
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
            n = _leaf(tree, tau + offset, offset, h, noise, s, hits, n)
            offset += h
            if n == len(hits):
                break
            continue
        if level > 0:  # of the whole step it is known
            phase = phase_at(c.drive, tau + offset)
            _fly(tree, tau + offset, s, h, noise, end)
            for i in range(margins.size):
                margins[i] = margin_of(c, phase, h, i)
            if not _is_near(c, h, s, end, margins):
                copy_state(s, end)
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
    return n


@internal
def _put(pending: Floats, top: int, noise: Noise, level: int, node: int) -> None:
    """Put an interval onto the stack."""
    pending[top, 0] = noise.increment
    pending[top, 1] = noise.area
    pending[top, 2] = level
    pending[top, 3] = node
