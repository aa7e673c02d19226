"""Vector lanes: paths side by side in arrays, lists of marked lanes, and the retirement of finished
paths."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.noise.philox import Word
from rattle.montecarlo.schemes.step_state import (
    CHOICES,
    FORCING,
    MOST_PARTS,
    TERMS_AND_NOISE,
    Scratch,
)
from rattle.scene import Bools, Constants, Floats, Ints
from rattle.scene.compiled import inline, lean_internal, splice, vector_memory, widest_vectors
from rattle.scene.types import BODY, WHEEL

# finest steps between retirements of finished paths; a multiple of 4 (steps of a draw, coarsest
# step)
CHUNK = 16
ROOT_HALF = math.sqrt(0.5)
SPARE_LANES = 256  # lanes beyond those in use, so that rows do not share lines of the cache


class Lanes(NamedTuple):
    """Paths side by side: arrays of shape (levels, ..., lanes); for one level (..., lanes).

    A level is a step size: dt, 2 dt, 4 dt.
    """

    # state, before: present state, and the state at the start of the step; (levels, 2 wheels,
    # lanes)
    state: Floats
    before: Floats
    # distances of the flanks +1, -1, +2, -2, ... from the middle; (levels, 2 wheels, lanes)
    walls: Floats
    # w, area: increment and area of the step's noise, in units of their sd; (levels, lanes)
    w: Floats
    area: Floats
    # increment and area of the noises of single wheels alone; (levels, wheels, 2, lanes)
    alone: Floats
    last: Floats  # time of the last impact; (levels, lanes)
    impacts: Ints  # number of impacts so far; (levels, lanes)


class Room(NamedTuple):
    """Buffers of a block.

    A draw of four normals serves four steps, or two steps of a scheme that uses the area.
    """

    path: NDArray[Word]  # number of the path in each lane; (lanes,)
    bits: NDArray[Word]  # random bits of two-point increments; (lanes,)
    eta: Floats  # noise with a memory, at the end of the last step; (lanes,)
    z: Floats  # four normals; the fifth row stays zero; (5, lanes)
    z_alone: Floats  # those of the noises of single wheels alone; (wheels, 4, lanes)
    # what else goes with a path: perturbations of the linearised path, or what
    # `rattle.montecarlo.kernel.mixture.condition` keeps; (5 or more, lanes)
    carried: Floats
    marks: Bools  # lanes that may have an impact in this step; (lanes,)
    groups: Ints  # groups, hits: scratch and output of `list_marked`
    hits: Ints
    scratch: Scratch
    # of the motion at closed meshes: energy lost at each mesh, time, and bound on the number of
    # impacts that are not slow; (wheels + 2, lanes)
    closed: Floats


def lanes_of(
    levels: int,
    first: int,
    start: Floats,
    walls: Floats,
    tau: float,
    carried: int,
    intensity: Floats,
) -> tuple[Lanes, Room]:
    """Lanes and buffers of a block; allocated outside compiled code, which takes longer to compile
    if it allocates.

    `carried`: Rows of `Room.carried`.  `intensity`: Of noises of single wheels alone.  Shapes:
    `start`, `walls` (2 wheels, paths); `intensity` (wheels,).
    """
    states, paths = start.shape
    wheels = states // 2
    # whole vectors; results of lanes without a path are ignored
    lanes = (paths + 7) // 8 * 8 + SPARE_LANES
    shaken = bool(intensity.any())
    sources = wheels if shaken else 0
    state, before, wall = vector_memory((3, levels, states, lanes))
    w, area = vector_memory((2, levels, lanes))
    state[:, :, :paths] = start
    before[:, :, :paths] = start
    wall[:, :, :paths] = walls
    wall[:, :, paths:] = 1.0
    every = Lanes(
        state=state,
        before=before,
        walls=wall,
        w=w,
        area=area,
        alone=vector_memory((levels, sources, 2, lanes)),
        last=np.full((levels, lanes), tau),
        impacts=np.zeros((levels, lanes), np.int64),
    )
    room = Room(
        path=np.arange(first, first + lanes, dtype=np.uint64),
        bits=np.zeros(lanes, np.uint64),
        eta=vector_memory((lanes,)),
        z=vector_memory((5, lanes)),
        z_alone=vector_memory((sources, 4, lanes)),
        carried=vector_memory((carried, lanes)),
        marks=np.zeros(lanes, np.bool_),
        groups=np.empty(lanes // 8 + 1, np.int64),
        hits=np.empty(lanes + 1, np.int64),
        scratch=Scratch(
            wheels=wheels,
            shaken=shaken,
            state=np.zeros(states),
            end=np.zeros(states),
            walls=np.zeros(states),
            whole=np.zeros(states),
            series=np.zeros((3 + wheels, TERMS_AND_NOISE)),
            ahead=np.zeros((MOST_PARTS, 3 + states)),
            sides=np.zeros(wheels, np.int64),
            unfollowed=np.zeros((2, wheels)),
            forcing=np.zeros((wheels, FORCING)),
            speeds=vector_memory((wheels, lanes)),
            bodies=np.zeros(wheels, BODY),
            choices=np.zeros((CHOICES, wheels), np.int64),
            wheels_beside=np.zeros(wheels, WHEEL),
            beside=np.zeros((3, states)),
            intensity=intensity,
            alone=np.zeros(states),
            effects=np.zeros((wheels, 2, states)),
        ),
        closed=np.zeros((wheels + 2, lanes)),
    )
    return every, room


@lean_internal
def fill_speeds(c: Constants, state: Floats, speeds: Floats, lanes: int) -> None:
    """Deviations of the speeds of the wheels that stand between other wheels, of all lanes; that of
    a wheel at the driver is the rate of its gap.  Of a wheel that a spring holds, its displacement.

    Shapes: `state` (2 wheels, lanes); `speeds` (wheels, lanes).
    """
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        parent = wheel.parent
        if wheel.stiffness > 0.0:
            for p in range(lanes):
                speeds[i, p] = state[2 * i, p]
        if parent >= 0 and wheel.drives:
            v = vector_beside(c, i, state, speeds, speeds[i])
            _put_speeds(wheel.ratio, v, state[2 * i + 1], speeds[i], lanes)


@splice
def vector_beside(c: Constants, i: int, state: Floats, speeds: Floats, z: Floats) -> Floats:
    """What the step of a gap needs of all lanes beside its own state: the deviation of its parent's
    speed, or of a wheel that a spring holds the displacement; `z` where it needs nothing.

    Shapes: as of `fill_speeds`, which has filled `speeds`; result (lanes,).
    """
    wheel = c.wheels[i]
    parent = wheel.parent
    v = z
    if wheel.stiffness > 0.0:
        v = speeds[i]
    elif parent >= 0:
        v = state[2 * parent + 1] if c.wheels[parent].parent < 0 else speeds[parent]
    return v


@inline
def add_scaled(to: Floats, factor: float, v: Floats, lanes: int) -> None:
    """Add a multiple of a vector to another one.  Vectorises."""
    for p in range(lanes):
        to[p] += factor * v[p]


@inline
def _put_speeds(ratio: float, v: Floats, y: Floats, out: Floats, lanes: int) -> None:
    """Deviations of the speed of a wheel from those of its parent and the rates of its gap."""
    for p in range(lanes):
        out[p] = ratio * v[p] - y[p]


@splice
def of_level(every: Lanes, level: int, w: Floats, area: Floats) -> Lanes:
    """The lanes of one level, with given noise.

    Shapes: `w`, `area` (lanes,).
    """
    return Lanes(
        every.state[level],
        every.before[level],
        every.walls[level],
        w,
        area,
        every.alone[level],
        every.last[level],
        every.impacts[level],
    )


@lean_internal
def list_marked(marks: Bools, lanes: int, groups: Ints, out: Ints) -> int:
    """List the marked lanes, by groups of eight first since marks are rare.

    There is no branch on a mark, which would be mispredicted: every index is written, and
    overwritten if it is not marked.
    """
    words = marks.view(np.int64)
    # unsigned, for numba checks every signed index for being negative
    whole = Word((lanes + 7) // 8)
    some = Word(0)
    marked = Word(0)
    for p in range(lanes, 8 * ((lanes + 7) // 8)):
        marks[p] = False
    for g in range(whole):
        groups[some] = g
        some += Word(words[g] != 0)
    for i in range(some):
        first = Word(8) * Word(groups[i])
        for q in range(8):
            lane = first + Word(q)
            out[marked] = lane
            marked += Word(marks[lane])
    return int(np.int64(marked))


@lean_internal
def join_halves(
    fine_w: Floats, fine_area: Floats, w: Floats, area: Floats, second: bool, live: int
) -> None:
    """Noise of a coarse step from that of its halves, in units of the sd
    (`rattle.montecarlo.noise.brownian.join`).

    `w`, `area`: Of the coarse step; hold the first half until the second is taken.  Output. Shapes:
    `fine_w`, `fine_area` (lanes,); `w`, `area` (lanes,).
    """
    root2 = math.sqrt(2.0)
    root3 = math.sqrt(3.0)
    for p in range(live):
        w1 = w[p]
        w2 = fine_w[p]
        if second:
            w[p] = (w1 + w2) / root2
            area[p] = (root3 * (w2 - w1) + area[p] + fine_area[p]) / (2.0 * root2)
        else:
            w[p], area[p] = w2, fine_area[p]


@lean_internal
def join_increments(
    fine_w: Floats, fine_area: Floats, w: Floats, area: Floats, second: bool, live: int
) -> None:
    """As `join_halves`, without areas."""
    widest_vectors()
    for p in range(live):
        w[p] = (w[p] + fine_w[p]) * ROOT_HALF if second else fine_w[p]


@lean_internal
def retire(every: Lanes, room: Room, impacts: int, live: int) -> int:
    """Move the last path in use to the lane of each finished one.

    `every`: Of all levels; a path is finished once it has had its impacts at all of them.
    """
    path = room.path
    bits = room.bits
    own = room.carried
    marks = room.marks
    groups = room.groups
    hits = room.hits
    widest_vectors()
    for p in range(live):
        marks[p] = every.impacts[0, p] >= impacts
    for level in range(1, len(every.impacts)):
        for p in range(live):
            marks[p] &= every.impacts[level, p] >= impacts
    finished = list_marked(marks, live, groups, hits)
    for i in range(finished - 1, -1, -1):  # from the last, so that what is moved is in use
        p = hits[i]
        live -= 1
        path[p], path[live] = path[live], path[p]
        bits[p] = bits[live]
        room.eta[p] = room.eta[live]
        for j in range(len(own)):
            own[j, p] = own[j, live]
        for level in range(len(every.impacts)):
            for j in range(every.state.shape[1]):
                every.state[level, j, p] = every.state[level, j, live]
                every.walls[level, j, p] = every.walls[level, j, live]
            every.last[level, p] = every.last[level, live]
            every.impacts[level, p] = every.impacts[level, live]
    return live
