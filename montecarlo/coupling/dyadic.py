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
    accurate_flight,
    flight_forcing,
)
from rattle.montecarlo.schemes.lanes import lanes_of
from rattle.montecarlo.schemes.short_flight import phase_at, short_flight
from rattle.montecarlo.schemes.step_state import (
    FORCING,
    MARGIN,
    MOST_IN_A_STEP,
    TERMS_AND_NOISE,
    clip,
    copy_state,
    due_side,
    parent_deviation,
    put_on_wall,
)
from rattle.montecarlo.schemes.sticking import is_any, leave_lifted, put_all
from rattle.scene import Constants, Floats, InputError, Ints, Scene
from rattle.scene.compiled import ZERO, internal, lean_internal, little_code, not_inlined, splice
from rattle.scene.drive import velocity_acceleration
from rattle.scene.impact import strike
from rattle.scene.orbit import find_touching
from rattle.scene.sticking import (
    as_bodies,
    close,
    contact_motion,
    find_sticking,
    open_meshes,
    put_open,
    take_open,
)
from rattle.scene.types import BODY
from rattle.scene.wheel import flanks_of, with_known_noise

Pair = tuple[float, float]

TREE = BRIDGE + LEVELS
"""Substream of the normals of this module, see the purposes of `rattle.montecarlo.noise.philox`."""

# most levels below a step: of a random number's index 26 bits are the node, the 30 above the step
DEEPEST = 26
TREE_BITS = Word(DEEPEST)
STEPS_OF_A_PERIOD = 128  # fewest steps of a period


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
    if any(wheel.law.sd for wheel in scene.tree):
        why = "a path on a shared Brownian tree needs a restitution that is not random: 0"
        raise InputError("restitution.sd", max(wheel.law.sd for wheel in scene.tree), why)
    if scene.correlation_time:
        raise InputError(
            "correlation_time",
            scene.correlation_time,
            "a shared Brownian tree is of white noise only, 0",
        )
    if len(scene.noise_sources) > 1:
        given = scene.to_dict()["scene"]["noise"]
        raise InputError("noise", given, "a shared Brownian tree is of one noise: a name")
    h = step_time(scene)
    times = np.array([n * h for n in range(round(2.0 * math.pi / h))])
    return clockwork_at(scene, times, h, depth)


def clockwork_at(scene: Scene, begins: Floats, h: float, depth: int) -> Clockwork:
    """Tables of steps that begin at given times."""
    state = np.zeros((2 * scene.stages, 1))
    _, room = lanes_of(1, 0, state, state, 0.0, 0, np.zeros(scene.stages))
    table = np.empty((begins.size, scene.stages, FORCING))
    for row, begin in zip(table, begins, strict=True):
        flight_forcing(scene.constants, begin, h, room.scratch)
        row[:] = room.scratch.forcing
    return Clockwork(h, depth, table)


class TreeRoom(NamedTuple):
    """Buffers of a path within a step."""

    state: Floats  # state, end: present state, and that at the end of a trial; (2 wheels,)
    end: Floats
    walls: Floats  # distances of the flanks from the middle; (2 wheels,)
    # intervals still to be walked: increment and area, and their place in the tree, level and
    # node; (depth + 2, 4)
    pending: Floats
    series: Floats  # Taylor series, as of `rattle.montecarlo.schemes.step_state.Scratch`
    forcing: Floats  # margins of the walls of each gap, in their place; (wheels, FORCING)
    sides: Ints  # sides on which meshes are closed to the end of the step, or 0; (wheels,)
    contacts: Ints  # of each mesh in this step; (wheels,)


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
        state=np.empty(2 * wheels),
        end=np.empty(2 * wheels),
        walls=flanks_of(c),
        pending=np.empty((clock.depth + 2, 4)),
        series=np.zeros((3 + wheels, TERMS_AND_NOISE)),
        forcing=np.empty((wheels, FORCING)),
        sides=np.zeros(wheels, np.int64),
        contacts=np.zeros(wheels, np.int64),
    )
    return Tree(c, clock, key_of(seed), room)


def tree_of(scene: Scene, seed: int, depth: int) -> Tree:
    """The tree of a scene and a seed."""
    return grow_tree(scene.constants, clockwork(scene, depth), np.random.SeedSequence(seed))


@internal
def new_hits(c: Constants, most: int) -> Floats:
    """Room for the impacts of a path in a step, so many of each mesh: time since its start, ``mesh
    * side``, the state just before.

    Shapes: result (most wheels, 2 + 2 wheels).
    """
    return np.empty((most * c.wheels.size, 2 + 2 * c.wheels.size))


@internal
def _beside(tree: Tree) -> Tree:
    """The bodies that closed meshes leave, with their state."""
    little_code()
    not_inlined()
    room = tree.room
    free = open_meshes(room.sides)
    state = np.empty(2 * free.size)
    walls = np.empty(2 * free.size)
    take_open(room.state, free, state)
    take_open(room.walls, free, walls)
    bodies = TreeRoom(state, np.empty(state.size), walls, *room[3:])
    return Tree(as_bodies(tree.c, room.sides), tree.clock, tree.key, bodies)


@internal
def _move_open(tree: Tree, part: Tree) -> None:
    """Take over the state of the bodies that closed meshes leave."""
    room = tree.room
    put_open(room.state, open_meshes(room.sides), part.room.state)


@lean_internal
def _fly(tree: Tree, tau: float, h: float, noise: Noise, end: Floats) -> None:
    """Write the state after a flight of time h, at most a step, with given noise."""
    c = tree.c
    room = tree.room
    phase = phase_at(c.drive, tau)
    increment = noise.increment
    area = noise.area
    short_flight(c, c.alpha, 1.0, phase, h, room.state, increment, area, room.series, end)


@lean_internal
def _is_near(c: Constants, h: float, s: Floats, end: Floats, f: Floats) -> bool:
    """Whether a flight between two states may meet a wall; `f` has the margins of the gaps."""
    third = h / 3.0
    for i in range(c.wheels.size):
        high = c.wheels[i].wall
        low = c.wheels[i].low
        x = 2 * i
        y = x + 1
        if near_wall(third, s[x], s[y], end[x], end[y], high, low, f[i, MARGIN]):
            return True
    return False


@lean_internal
def _first_wall(c: Constants, h: float, s: Floats, end: Floats) -> tuple[float, int]:
    """Share of a leaf after which the first wall is met, and its ``mesh * side``; 1 and 0 if none
    is."""
    share = 1.0
    code = 0
    for i in range(c.wheels.size):
        for side in (1, -1):
            wall = c.wheels[i].wall if side > 0 else c.wheels[i].low
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


@lean_internal
def _reach_wall(
    tree: Tree, tau: float, left: float, h: float, increment: float
) -> tuple[float, int]:
    """Carry a path to the first wall that it meets in what is left of a leaf, or to its end;
    returns the time, and ``mesh * side`` or 0.

    `increment`: of the noise in the whole leaf.
    """
    room = tree.room
    _fly(tree, tau, left, Noise(increment * (left / h), 0.0), room.end)
    share, code = _first_wall(tree.c, left, room.state, room.end)
    if code == 0:
        copy_state(room.state, room.end)
        return left, 0
    t = share * left
    _fly(tree, tau, t, Noise(increment * (t / h), 0.0), room.state)
    put_on_wall(room.state, code, room.walls)
    return t, code


@internal
def _reach_wall_beside(
    tree: Tree, tau: float, left: float, h: float, increment: float
) -> tuple[float, int]:
    """`_reach_wall` beside closed meshes."""
    little_code()
    not_inlined()
    part = _beside(tree)
    t, code = _reach_wall(part, tau, left, h, increment)
    _move_open(tree, part)
    if code != 0:
        code = due_side(code) * (open_meshes(tree.room.sides)[abs(code) - 1] + 1)
    return t, code


@lean_internal
def _rests(s: Floats) -> bool:
    """Whether a gap has no rate at all: a mesh that was closed."""
    resting = False
    for i in range(s.size // 2):
        resting = resting or s[2 * i + 1] == 0.0
    return resting


@internal
def _close_resting(tree: Tree, tau: float, noise: float, held: Ints) -> None:
    """Close, beside those that are held, the meshes at rest that a noise of known value keeps
    shut."""
    little_code()
    not_inlined()
    c = tree.c
    room = tree.room
    s = room.state
    touching = find_touching(c, s)
    for i in range(held.size):
        touching[i] = touching[i] if touching[i] != 0 else held[i]
    pushed = with_known_noise(c, noise)
    sticking = np.empty(held.size, np.int64)
    driver = velocity_acceleration(c.drive, tau)
    find_sticking(pushed, driver, s, touching, sticking, np.empty(held.size, BODY))
    for i in range(held.size):
        room.sides[i] = held[i] if held[i] != 0 else sticking[i]


@internal
def _put_closed(tree: Tree) -> None:
    """Put the closed meshes on their walls, at rest."""
    not_inlined()
    room = tree.room
    close(tree.c, room.state, room.sides, room.walls, np.empty(room.sides.size, BODY))


@internal
def _strike(tree: Tree, mesh: int, held: Ints) -> None:
    """An impact; a mesh that it shakes is closed no longer, unless its contacts are used up."""
    room = tree.room
    strike(tree.c, mesh, room.state)
    for i in range(held.size):
        if room.state[2 * i + 1] != 0.0 and room.contacts[i] < MOST_IN_A_STEP:
            held[i] = 0
            room.sides[i] = 0
    if is_any(room.sides):
        _put_closed(tree)


@splice
def _leaf(
    tree: Tree, tau: float, offset: float, h: float, increment: float, hits: Floats, n: int
) -> int:
    """Carry a path through a leaf, in place; returns the number of impacts in the step so far."""
    c = tree.c
    room = tree.room
    s = room.state
    left = h
    gone = 0.0
    held = room.sides.copy()
    while n < len(hits):
        if _rests(s):
            _close_resting(tree, tau + gone, c.sigma * increment / h, held)
        if is_any(room.sides):
            t, code = _reach_wall_beside(tree, tau + gone, left, h, increment)
        else:
            t, code = _reach_wall(tree, tau + gone, left, h, increment)
        gone = gone + t
        left = left - t
        if code == 0:
            break
        mesh = abs(code)
        side = due_side(code)
        room.contacts[mesh - 1] += 1
        if side * s[2 * mesh - 1] > 0.0:
            hits[n, 0] = offset + gone
            hits[n, 1] = code
            for i in range(s.size):
                hits[n, 2 + i] = s[i]
            n += 1
            _strike(tree, mesh, held)
        if room.contacts[mesh - 1] >= MOST_IN_A_STEP:
            held[mesh - 1] = side
            room.sides[mesh - 1] = side
            _put_closed(tree)
    copy_state(room.sides, held)
    clip(s, room.walls)
    return n


@lean_internal
def _passes(tree: Tree, tau: float, h: float, noise: Noise) -> bool:
    """Whether a path meets no wall in a part of a step: then it is carried to its end."""
    c = tree.c
    room = tree.room
    phase = phase_at(c.drive, tau)
    _fly(tree, tau, h, noise, room.end)
    for i in range(c.wheels.size):
        room.forcing[i, MARGIN] = margin_of(c, phase, h, i)
    if _is_near(c, h, room.state, room.end, room.forcing):
        return False
    copy_state(room.state, room.end)
    return True


@internal
def _passes_beside(tree: Tree, tau: float, h: float, noise: Noise) -> bool:
    """`_passes` beside closed meshes."""
    little_code()
    not_inlined()
    part = _beside(tree)
    passes = _passes(part, tau, h, noise)
    if passes:
        _move_open(tree, part)
    return passes


@lean_internal
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

    A mesh that has had `MOST_IN_A_STEP` contacts in the step, or that rests and sticks at its start
    (`rattle.montecarlo.schemes.sticking`), stays closed to its end, or until an impact shakes it.

    Returns: Number of impacts, and whether a mesh was closed at the end of the step. Where `hits`
    was filled the path stays in this state to the end of the step. Shapes: `state` (2 wheels,);
    `hits` (at least 1, columns of `new_hits`).
    """
    little_code()
    c = tree.c
    w = tree.clock
    room = tree.room
    f = w.forcing[step % len(w.forcing)]
    put_all(room.sides, 0)
    copy_state(room.state, state)
    if _rests(state):
        _close_for_step(tree, (step % len(w.forcing)) * w.h)
    if not is_any(room.sides):
        _step_freely(c, f, state, z, room.end)
        if not _is_near(c, w.h, state, room.end, f):
            copy_state(state, room.end)
            return 0, False
    put_all(room.contacts, 0)
    whole = Noise(z[0] * math.sqrt(w.h), z[1] * math.sqrt(w.h / 12.0))
    n = _walk_tree(tree, path, step, whole, hits)
    copy_state(state, room.state)
    return n, is_any(room.sides)


@internal
def _close_for_step(tree: Tree, tau: float) -> None:
    """Close the meshes at rest that stick for a step."""
    little_code()
    not_inlined()
    c = tree.c
    room = tree.room
    _close_resting(tree, tau, 0.0, room.sides.copy())
    bodies = np.empty(room.sides.size, BODY)
    contact_motion(c, velocity_acceleration(c.drive, tau), room.state, room.sides, bodies)
    leave_lifted(c, tree.clock.h, room.sides, c.sigma, bodies)


@splice
def _walk_tree(tree: Tree, path: Word, step: int, whole: Noise, hits: Floats) -> int:
    """Carry a path through a step that may meet a wall, halved until it does not or is a leaf, in
    place; returns the number of impacts."""
    c = tree.c
    w = tree.clock
    pending = tree.room.pending
    tau = (step % len(w.forcing)) * w.h
    offset = 0.0
    n = ZERO
    _put(pending, 0, whole, 0, 1)
    top = 0
    while top >= 0:
        noise = Noise(pending[top, 0], pending[top, 1])
        level = int(pending[top, 2])
        node = int(pending[top, 3])
        top -= 1
        h = math.ldexp(w.h, -level)
        if level == w.depth:
            n = _leaf(tree, tau + offset, offset, h, noise.increment, hits, n)
            offset += h
            if n == len(hits):
                break
            continue
        if is_any(tree.room.sides):
            passes = _passes_beside(tree, tau + offset, h, noise)
        else:  # of the whole step it is known
            passes = level > 0 and _passes(tree, tau + offset, h, noise)
        if passes:
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


@lean_internal
def _put(pending: Floats, top: int, noise: Noise, level: int, node: int) -> None:
    """Put an interval onto the stack."""
    pending[top, 0] = noise.increment
    pending[top, 1] = noise.area
    pending[top, 2] = level
    pending[top, 3] = node
