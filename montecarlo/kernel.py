"""A block of paths through a scheme: paths side by side in lanes, impacts dealt with one by one."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from montecarlo.backlash import Backlash, half_gap
from montecarlo.control import LinearPath
from montecarlo.euler import at_end, euler_lanes, step_forcing
from montecarlo.euler_located import advance_inside, leaving, located_lanes
from montecarlo.exact_flight import advance_exactly, flight_forcing, flight_lanes, near_second
from montecarlo.noise import BRIDGE, Key, Word, fill_normals, fill_signs, fill_words, normals
from montecarlo.progress import MOST_IN_A_STEP, Noise, Progress, Walls
from scene.compiled import inlined, jit
from scene.impact import struck
from scene.scene import Constants

__all__ = [
    "CHUNK",
    "COLUMNS",
    "EXACT",
    "FLANK_DRAWS",
    "LOCATED",
    "PLAIN",
    "Job",
    "lanes_of",
    "next_event",
    "run_block",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CHUNK = 16  # finest steps between two looks at which paths are done; a multiple of the coarsest step, and of 4
COLUMNS = 7  # of an impact: tau, flight, x1, y1, x2, y2, mesh * side
SPLITS = Word(1 << 16)  # indices of random numbers that the splits of one step may use
CUTS_APART = SPLITS // Word(MOST_IN_A_STEP + 1)  # of those, for one call of the exact scheme

PLAIN, LOCATED, EXACT = 0, 1, 2
FLANK_DRAWS = Word(4)  # draws of the walls at the start; those of the impacts follow


class Job(NamedTuple):
    """What all paths of a run have in common."""

    c: Constants
    backlash: Backlash
    key: Key
    tau: float
    dt: float
    scheme: int
    two_point: bool
    most_steps: int


class Lanes(NamedTuple):
    """Paths side by side: arrays over (levels, ..., lanes), or for one level over (..., lanes).

    ``before`` is the state at the start of the step, ``w`` and ``area`` its noise in standard units, ``last`` the time
    of the last impact, ``impacts`` how many a path has had.
    """

    state: Floats
    before: Floats
    walls: Floats
    w: Floats
    area: Floats
    last: Floats
    impacts: Ints


class Room(NamedTuple):
    """Scratch of a block: numbers of the paths in the lanes, random bits and normals, perturbations, marked lanes.

    A draw of four normals serves four steps, or two that use the area; the fifth row of ``z`` stays zero.
    """

    path: NDArray[Word]
    bits: NDArray[Word]
    z: Floats
    xi: Floats
    marks: Bools
    hits: Ints


def lanes_of(levels: int, first: int, start: Floats, walls: Floats, tau: float) -> tuple[Lanes, Room]:
    """Lanes and scratch of a block; allocated here, for compiled code that allocates takes long to compile.

    Parameters
    ----------
    levels, first : int
        Step sizes side by side; number of the first path.
    start : ndarray, shape (4, paths)
        State after the start.
    walls : ndarray, shape (4, paths)
        Distance of the flanks +1, -1, +2, -2 from the middle.
    tau : float
        Time of the start.
    """
    paths = start.shape[1]
    lanes = (paths + 7) // 8 * 8  # whole vectors: what the last lanes compute when no path is in them is not looked at
    state, wall = np.zeros((levels, 4, lanes)), np.ones((levels, 4, lanes))
    state[:, :, :paths], wall[:, :, :paths] = start, walls
    every = Lanes(
        state, state.copy(), wall, np.zeros((levels, lanes)), np.zeros((levels, lanes)), np.full((levels, lanes), tau),
        np.zeros((levels, lanes), np.int64),
    )  # fmt: skip
    room = Room(
        np.arange(first, first + lanes, dtype=np.uint64), np.zeros(lanes, np.uint64), np.zeros((5, lanes)),
        np.zeros((5, lanes)), np.zeros(lanes, np.bool_), np.empty(lanes, np.int64),
    )  # fmt: skip
    return every, room


@inlined
def _level(every: Lanes, level: int, w: Floats, area: Floats) -> Lanes:
    """The lanes of one level, with this noise."""
    return Lanes(
        every.state[level], every.before[level], every.walls[level], w, area, every.last[level], every.impacts[level]
    )  # fmt: skip


@inlined
def next_event(
    scheme: int, c: Constants, key: Key, path: Word, step: int, level: int, met: int, at: Progress, walls: Walls
) -> Progress:
    """Go to the next impact within a step, or to the step's end; `met` counts the calls for one path and step.

    Cards and processors call it alike; `scheme` is a parameter of its own so that a kernel made for one scheme holds
    no other.
    """
    if scheme == PLAIN:
        return at_end(c, at, walls)
    index, purpose = Word(step) * SPLITS, Word(BRIDGE + level)
    if scheme == LOCATED:
        return advance_inside(c, at, normals(key, path, index + Word(met), purpose)[0], walls)
    return advance_exactly(c, key, path, index + CUTS_APART * Word(met), purpose, at, walls)


@inlined
def _finish_step(
    job: Job, path: Word, row: int, step: int, level: int, p: int, at: Progress, lanes: Lanes, rows: Floats
) -> bool:
    """Carry one path from `at` through its impacts to the end of the step; whether it had to be held there."""
    c, impacts = job.c, rows.shape[2]
    walls = Walls(lanes.walls[0, p], lanes.walls[1, p], lanes.walls[2, p], lanes.walls[3, p])
    held = False
    for met in range(MOST_IN_A_STEP + 1):
        if job.scheme != PLAIN and at.left <= 0.0:
            break
        at = next_event(job.scheme, c, job.key, path, step, level, met, at, walls)
        if at.code == 0:
            if job.scheme == PLAIN or at.left <= 0.0:
                break
            continue
        if met == MOST_IN_A_STEP:
            held = True
            break
        mesh, k = abs(at.code), lanes.impacts[p]
        if k < impacts:
            seen = (at.tau, at.tau - lanes.last[p], at.x1, at.y1, at.x2, at.y2, float(at.code))
            for i in range(COLUMNS):
                rows[level, row, k, i] = seen[i]
        lanes.last[p] = at.tau
        lanes.impacts[p] = k + 1
        if job.backlash.redrawn:
            opposite = 2 * mesh - 1 if at.code > 0 else 2 * mesh - 2
            lanes.walls[opposite, p] = half_gap(job.backlash, job.key, path, Word(k) + FLANK_DRAWS, mesh)
            walls = Walls(lanes.walls[0, p], lanes.walls[1, p], lanes.walls[2, p], lanes.walls[3, p])
        y1, y2 = struck(c, mesh, at.y1, at.y2)
        at = Progress(0, at.tau, at.left, at.noise, at.x1, y1, at.x2, y2)
    lanes.state[0, p], lanes.state[1, p], lanes.state[2, p], lanes.state[3, p] = at.x1, at.y1, at.x2, at.y2
    return held


@inlined
def _step_lanes(job: Job, tau: float, h: float, lanes: Lanes, marks: Bools, live: int) -> None:
    """One step of all lanes; marks those that need `_finish_step`."""
    c, state, before = job.c, lanes.state, lanes.before
    if job.scheme == PLAIN:
        euler_lanes(c, step_forcing(c, tau, h), h, job.backlash.random, lanes.walls, state, lanes.w, marks, live)
        return
    for i in range(2 * c.stages):
        for p in range(live):
            before[i, p] = state[i, p]
    if job.scheme == LOCATED:
        leaving(c, h, lanes.walls, state, marks, live)
        located_lanes(c, step_forcing(c, tau, h), h, state, lanes.w, live)
        return
    f = flight_forcing(c, tau, h)
    flight_lanes(c, f, h, lanes.walls, state, lanes.w, lanes.area, marks, live)
    if c.stages == 2:
        near_second(h, f.margin2, lanes.walls, before, state, marks, live)


@jit
def _list_marked(marks: Bools, lanes: int, out: Ints) -> int:
    """Indices of the marked lanes into `out`; eight lanes at a look, for marks are rare."""
    words = marks.view(np.int64)
    found = 0
    for w in range((lanes + 7) // 8):
        if words[w] != 0:
            for p in range(8 * w, min(8 * w + 8, lanes)):
                if marks[p]:
                    out[found] = p
                    found += 1
    return found


@jit
def _join_halves(fine_w: Floats, fine_area: Floats, w: Floats, area: Floats, second: bool, live: int) -> None:
    """Noise of a coarse step from its halves', in standard units (`montecarlo.brownian.joined` at share 1/2)."""
    root2, root3 = math.sqrt(2.0), math.sqrt(3.0)
    for p in range(live):
        w1, w2 = w[p], fine_w[p]
        if second:
            w[p] = (w1 + w2) / root2
            area[p] = (root3 * (w2 - w1) + area[p] + fine_area[p]) / (2.0 * root2)
        else:
            w[p], area[p] = w2, fine_area[p]


@jit
def _carry_linear(
    path: LinearPath, n: int, done: int, first: int, numbers: NDArray[Word], xi: Floats, w: Floats, area: Floats,
    controls: Floats, live: int,
) -> int:  # fmt: skip
    """Take the perturbations of all lanes through step n; returns how many of the orbit's impacts are behind it."""
    while done < path.at_step.size and path.at_step[done] == n:
        read, noise = path.read[done], path.read_noise[done]
        for p in range(live):
            row = int(numbers[p]) - first
            for i in range(6):
                total = noise[0, i] * w[p] + noise[1, i] * area[p]
                for j in range(5):
                    total += read[i, j] * xi[j, p]
                controls[row, done, i] = total
        done += 1
    if done < path.at_step.size:
        carry, noise = path.carry[n], path.noise[n]
        x1, y1, x2, y2, last = xi[0], xi[1], xi[2], xi[3], xi[4]
        for p in range(live):
            a, b, c, d, e = x1[p], y1[p], x2[p], y2[p], last[p]
            x1[p] = carry[0, 0] * a + carry[0, 1] * b + carry[0, 2] * c + carry[0, 3] * d
            y1[p] = carry[1, 0] * a + carry[1, 1] * b + carry[1, 2] * c + carry[1, 3] * d
            x2[p] = carry[2, 0] * a + carry[2, 1] * b + carry[2, 2] * c + carry[2, 3] * d
            y2[p] = carry[3, 0] * a + carry[3, 1] * b + carry[3, 2] * c + carry[3, 3] * d
            last[p] = carry[4, 0] * a + carry[4, 1] * b + carry[4, 2] * c + carry[4, 3] * d + carry[4, 4] * e
        for i in range(5):
            for p in range(live):
                xi[i, p] += noise[0, i] * w[p] + noise[1, i] * area[p]
    return done


@jit
def _retire(every: Lanes, path: NDArray[Word], bits: NDArray[Word], xi: Floats, impacts: int, live: int) -> int:
    """Give the lane of a finished path to the last one; returns how many are left."""
    p = 0
    while p < live:
        fewest = every.impacts[0, p]
        for level in range(1, len(every.impacts)):
            fewest = min(fewest, every.impacts[level, p])
        if fewest < impacts:
            p += 1
            continue
        live -= 1
        path[p], path[live] = path[live], path[p]
        bits[p] = bits[live]
        for i in range(5):
            xi[i, p] = xi[i, live]
        for level in range(len(every.impacts)):
            for i in range(4):
                every.state[level, i, p] = every.state[level, i, live]
                every.walls[level, i, p] = every.walls[level, i, live]
            every.last[level, p] = every.last[level, live]
            every.impacts[level, p] = every.impacts[level, live]
    return live


@jit
def run_block(
    job: Job,
    control: LinearPath,
    first: int,
    every: Lanes,
    room: Room,
    rows: Floats,
    clock_steps: Ints,
    clock: Floats,
    controls: Floats,
) -> tuple[int, int, int]:
    """Follow a block of paths until each has had its impacts, at one or more step sizes on one noise.

    Parameters
    ----------
    job : Job
        Level l steps by ``2**l dt``; after ``most_steps`` finest steps paths are given up.
    control : LinearPath
        Carried along beside the finest level; empty for none.
    first : int
        Number of the block's first path.
    every, room : Lanes, Room
        From `lanes_of`.
    rows : ndarray, shape (levels, paths, impacts, COLUMNS)
        Output: each impact, just before it; what is never reached stays as given.
    clock_steps : ndarray of int, ascending
        Finest steps, multiples of the coarsest, at which states go to `clock`.
    clock : ndarray, shape (levels, paths, times, 4)
        Output.
    controls : ndarray, shape (paths, impacts, COLUMNS)
        Output: what the linearised path says of each section quantity; as given where there is none.

    Returns
    -------
    path_steps, held, unfinished : int
        Steps taken, times a path was held at its wall, paths given up.
    """
    levels, paths, impacts = rows.shape[0], rows.shape[1], rows.shape[2]
    path, bits, z, xi, marks, hits = room.path, room.bits, room.z, room.xi, room.marks, room.hits
    draws = 2 if job.scheme == EXACT else 4
    work, held, live, next_clock, linear, n = 0, 0, paths, 0, 0, 0
    while n < job.most_steps and live > 0:
        wide = (live + 7) // 8 * 8
        for _ in range(min(CHUNK, job.most_steps - n)):
            use = 0 if job.two_point else n % draws
            if job.two_point and job.c.sigma > 0.0:
                if n % 64 == 0:
                    fill_words(job.key, path, Word(n // 64), wide, bits)
                fill_signs(bits, n % 64, wide, z[0])
            elif use == 0 and job.c.sigma > 0.0:
                fill_normals(job.key, path, Word(n // draws), wide, z)
            w, area = z[use * (4 // draws)], z[use * (4 // draws) + 1 if draws == 2 else 4]
            if linear < control.at_step.size:
                linear = _carry_linear(control, n, linear, first, path, xi, w, area, controls, live)
            n += 1
            for level in range(levels):
                multiple = 1 << level
                if level > 0:
                    if n % (multiple // 2) != 0:
                        break
                    _join_halves(w, area, every.w[level], every.area[level], n % multiple == 0, wide)
                    w, area = every.w[level], every.area[level]
                    if n % multiple != 0:
                        break
                lanes = _level(every, level, w, area)
                h, begin = job.dt * multiple, job.tau + (n - multiple) * job.dt
                _step_lanes(job, begin, h, lanes, marks, wide)
                for i in range(_list_marked(marks, live, hits)):
                    p = hits[i]
                    if job.scheme == PLAIN:
                        s = lanes.state
                        at = Progress(0, begin + h, 0.0, Noise(0.0, 0.0), s[0, p], s[1, p], s[2, p], s[3, p])
                    else:
                        s = lanes.before
                        noise = Noise(lanes.w[p] * math.sqrt(h), lanes.area[p] * math.sqrt(h / 12.0))
                        at = Progress(0, begin, h, noise, s[0, p], s[1, p], s[2, p], s[3, p])
                    row = int(path[p]) - first
                    held += _finish_step(job, path[p], row, n - multiple, level, p, at, lanes, rows)
                work += live
            if next_clock < clock_steps.size and clock_steps[next_clock] == n:
                for level in range(levels):
                    for p in range(live):
                        for i in range(4):
                            clock[level, int(path[p]) - first, next_clock, i] = every.state[level, i, p]
                next_clock += 1
        if next_clock == clock_steps.size and linear == control.at_step.size:
            live = _retire(every, path, bits, xi, impacts, live)
    return work, held, live
