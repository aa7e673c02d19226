"""A block of paths through a scheme: paths side by side in lanes, impacts dealt with one by one."""

import math

import numpy as np
from numpy.typing import NDArray

from montecarlo.backlash import deviation
from montecarlo.schemes import (
    MOST_IN_A_STEP,
    Progress,
    StepForcing,
    advance_at_end,
    advance_inside,
    euler_step,
    step_forcing,
)  # fmt: skip
from scene.compiled import jit
from scene.impact import struck
from scene.scene import Constants

__all__ = ["CHUNK", "run_block"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Generator = np.random.Generator

CHUNK = 64  # finest steps between two looks at which paths are done; a multiple of the coarsest step


@jit
def _draw(steps: Generator, z: Floats, lanes: int) -> None:
    for p in range(lanes):
        z[p] = steps.standard_normal()


@jit
def _advance(
    c: Constants, f: StepForcing, h: float, x1: Floats, y1: Floats, x2: Floats, y2: Floats, z: Floats, lanes: int
) -> None:
    """One Euler-Maruyama step of all lanes; vectorises."""
    if c.stages == 2:
        for p in range(lanes):
            x1[p], y1[p], x2[p], y2[p] = euler_step(c, f, h, x1[p], y1[p], x2[p], y2[p], z[p])
    else:
        for p in range(lanes):
            x1[p], y1[p], _, _ = euler_step(c, f, h, x1[p], y1[p], 0.0, 0.0, z[p])


@jit
def _leaving(
    c: Constants, h: float, toleranced: bool, walls: Floats,
    x1: Floats, y1: Floats, x2: Floats, y2: Floats, leaves: Bools, lanes: int,
) -> None:  # fmt: skip
    """Mark the lanes whose next step ends beyond a wall (Euler moves x by h y); vectorises."""
    if toleranced:
        w1, v1, w2, v2 = walls[0], walls[1], walls[2], walls[3]
        for p in range(lanes):
            a = x1[p] + h * y1[p]
            leaves[p] = (a > w1[p]) | (a < -v1[p])
        if c.stages == 2:
            for p in range(lanes):
                b = x2[p] + h * y2[p]
                leaves[p] |= (b > w2[p]) | (b < -v2[p])
    elif c.stages == 2:
        for p in range(lanes):
            leaves[p] = (abs(x1[p] + h * y1[p]) > c.wall1) | (abs(x2[p] + h * y2[p]) > c.wall2)
    else:
        for p in range(lanes):
            leaves[p] = abs(x1[p] + h * y1[p]) > c.wall1


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
def run_block(
    c: Constants, tau: float, dt: float, most_steps: int, located: bool, toleranced: bool,
    steps: Generator, bridges: tuple[Generator, Generator, Generator],
    start: Floats, walls: Floats, fresh: Floats,
    gaps: tuple[float, float], c_max: tuple[float, float], law: int, later: Generator,
    rows: Floats, clock_steps: Ints, clock: Floats,
) -> tuple[int, int, int]:  # fmt: skip
    """Follow a block of paths until each has had its impacts, at one or more step sizes on one noise.

    Parameters
    ----------
    c, tau, dt
        Constants, start time, finest step; level l steps by ``2**l dt``.
    most_steps : int
        Finest steps after which paths are given up.
    located, toleranced : bool
        Whether impacts are located inside the step; whether walls differ between paths.
    steps, bridges : generators
        See `montecarlo.noise`.
    start : ndarray, shape (4, paths)
        State after the start.
    walls : ndarray, shape (4, paths)
        Distance of the flanks +1, -1, +2, -2 from the middle.
    fresh : ndarray, shape (2, draws, paths)
        Half gaps that a flank of mesh 1, 2 takes when the opposite flank is struck; no draws: it keeps its own.
    gaps, c_max, law, later
        Nominal half gaps, largest deviations, law and generator, for a path that has used up its draws.
    rows : ndarray, shape (levels, paths, impacts, 6)
        Output: tau, x1, y1, x2, y2 just before each impact, and mesh * side; what is never reached stays as given.
    clock_steps : ndarray of int, ascending
        Finest steps, multiples of the coarsest, at which states go to `clock`.
    clock : ndarray, shape (levels, paths, times, 4)
        Output.

    Returns
    -------
    path_steps, held, unfinished : int
        Steps taken, times a stage was held at its wall, paths given up.
    """
    levels, paths, impacts = rows.shape[0], rows.shape[1], rows.shape[2]
    state = np.empty((levels, 4, paths))
    own_walls = np.empty((levels, 4, paths))
    for level in range(levels):
        state[level], own_walls[level] = start, walls
    count = np.zeros((levels, paths), np.int64)
    held = np.zeros(levels, np.int64)
    draws = fresh.shape[1]
    path = np.arange(paths)
    z = np.zeros((levels, paths))  # level 0: the increments; above: what they add up to since the last coarse step
    leaves = np.zeros((paths + 7) // 8 * 8, np.bool_)
    hits = np.empty(paths, np.int64)
    before = np.empty((paths, 4))
    work, lanes, next_clock, n = 0, paths, 0, 0
    while n < most_steps and lanes > 0:
        for _ in range(min(CHUNK, most_steps - n)):
            if c.sigma > 0.0:
                _draw(steps, z[0], lanes)
            for level in range(levels):
                multiple = 1 << level
                if level > 0:
                    for p in range(lanes):
                        z[level, p] += z[0, p]
                    if (n + 1) % multiple != 0:
                        continue
                    for p in range(lanes):
                        z[level, p] /= math.sqrt(multiple)
                h = dt * multiple
                begin = tau + (n + 1 - multiple) * dt
                f = step_forcing(c, begin, h)
                x1, y1, x2, y2 = state[level, 0], state[level, 1], state[level, 2], state[level, 3]
                _leaving(c, h, toleranced, own_walls[level], x1, y1, x2, y2, leaves, lanes)
                found = _list_marked(leaves, lanes, hits)
                for i in range(found):
                    before[i] = state[level, :, hits[i]]
                _advance(c, f, h, x1, y1, x2, y2, z[level], lanes)
                for i in range(found):
                    p = hits[i]
                    at = Progress(
                        0, begin, h, z[level, p] * math.sqrt(h), before[i, 0], before[i, 1], before[i, 2], before[i, 3]
                    )  # fmt: skip
                    met = 0
                    while at.left > 0.0 or at.code != 0:
                        a, b, d, e = (
                            own_walls[level, 0, p],
                            own_walls[level, 1, p],
                            own_walls[level, 2, p],
                            own_walls[level, 3, p],
                        )
                        if located:
                            at = advance_inside(c, at, bridges[level].standard_normal(), a, b, d, e)
                        else:
                            at = advance_at_end(c, at, 0.0, a, b, d, e)
                        if at.code != 0:
                            mesh, k = abs(at.code), count[level, p]
                            if k < impacts:
                                row = rows[level, path[p], k]
                                row[0], row[1], row[2], row[3], row[4], row[5] = (
                                    at.tau,
                                    at.x1,
                                    at.y1,
                                    at.x2,
                                    at.y2,
                                    at.code,
                                )
                            count[level, p] = k + 1
                            if draws > 0:
                                opposite = 2 * mesh - 1 if at.code > 0 else 2 * mesh - 2
                                own_walls[level, opposite, p] = (
                                    fresh[mesh - 1, k, path[p]]
                                    if k < draws
                                    else gaps[mesh - 1] + c_max[mesh - 1] * deviation(law, later)
                                )
                            y1p, y2p = struck(c, mesh, at.y1, at.y2)
                            at = Progress(at.code, at.tau, at.left, at.increment, at.x1, y1p, at.x2, y2p)
                        met += 1
                        if met == MOST_IN_A_STEP:
                            held[level] += 1
                            break
                    x1[p], y1[p], x2[p], y2[p] = at.x1, at.y1, at.x2, at.y2
                if level > 0:
                    z[level, :lanes] = 0.0
                work += lanes
            n += 1
            if next_clock < clock_steps.size and clock_steps[next_clock] == n:
                for level in range(levels):
                    for p in range(lanes):
                        clock[level, path[p], next_clock] = state[level, :, p]
                next_clock += 1
        if next_clock == clock_steps.size:
            p = 0
            while p < lanes:  # a finished path gives its lane to the last one
                if count[:, p].min() >= impacts:
                    lanes -= 1
                    path[p], path[lanes] = path[lanes], path[p]
                    for level in range(levels):
                        state[level, :, p] = state[level, :, lanes]
                        own_walls[level, :, p] = own_walls[level, :, lanes]
                        count[level, p] = count[level, lanes]
                else:
                    p += 1
    return work, held.sum(), lanes
