"""The kernel of ``euler-maruyama``: steps in fours, and the lanes that met a wall in them once more with their impacts.

Most lanes meet no wall in four steps.  So all take them without walls, in registers, and those that were beyond a wall
at the end of a step are taken back and walked through the four one at a time.  A tile of lanes goes through a whole
chunk of steps before the next does.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.control_variate import LinearPath
from rattle.montecarlo.kernel.kernel import Job, record, walls_of
from rattle.montecarlo.kernel.lanes import CHUNK, TILE, Lanes, Room, list_marked, of_level, retire
from rattle.montecarlo.noise.philox import Word, fill_normals, fill_signs, fill_words
from rattle.montecarlo.schemes.euler import (
    FORCING,
    QUAD,
    StepForcing,
    euler_step,
    four_euler_steps,
    step_forcing,
)
from rattle.montecarlo.schemes.euler import due as impact_due
from rattle.montecarlo.schemes.step_state import MOST_IN_A_STEP
from rattle.scene.compiled import lean, spliced
from rattle.scene.constants import Constants
from rattle.scene.instructions import widest_vectors

__all__ = ["plain_block"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

WORD = 64  # bits, each a two-point increment
ROOT_HALF = math.sqrt(0.5)


@spliced
def _tabulate(job: Job, n: int, stop: int, forcing: Floats) -> None:
    """Forcing of the steps of all levels from finest step n on, shape (levels, CHUNK, FORCING)."""
    for level in range(forcing.shape[0]):
        multiple = 1 << level
        for i in range((stop - n) // multiple):
            f = step_forcing(job.c, job.tau + (n + i * multiple) * job.dt, job.dt * multiple)
            for j in range(FORCING):
                forcing[level, i, j] = f[j]


@spliced
def _draw(job: Job, path: NDArray[Word], bits: NDArray[Word], n: int, lanes: int, z: Floats) -> None:
    """Increments of four steps from step n on, a multiple of four, in units of their sd."""
    if job.c.sigma != 0.0 and not job.two_point:
        fill_normals(job.key, path, Word(n // QUAD), lanes, z)
    elif job.c.sigma != 0.0:
        if n % WORD == 0:
            fill_words(job.key, path, Word(n // WORD), lanes, bits)
        for i in range(QUAD):
            fill_signs(bits, n % WORD + i, lanes, z[i])


@lean
def _join(steps: int, lanes: int, z: Floats) -> None:
    """Increments of steps twice as long from those of their halves, in place."""
    widest_vectors()
    for i in range(steps):
        first, second, whole = z[2 * i], z[2 * i + 1], z[i]
        for p in range(lanes):
            whole[p] = (first[p] + second[p]) * ROOT_HALF


@lean
def _pick(source: Floats, tile: int, hits: Ints, found: int, few: Floats) -> None:
    """The lanes `hits` of the four rows of an array, counted from lane `tile` on, side by side."""
    widest_vectors()
    for i in range(4):
        every, picked = source[i][tile:], few[i]
        for j in range(found):
            picked[j] = every[hits[j]]


@lean
def _step_few(c: Constants, forcing: Floats, h: float, few: Floats, walls: Floats, due: Bools, lanes: int) -> None:
    """One step of some lanes, in place; marks those with an impact at its end.  Vectorises."""
    widest_vectors()
    f = StepForcing(forcing[0], forcing[1], forcing[2], forcing[3])
    x1, y1, x2, y2, z = few[0], few[1], few[2], few[3], few[4]
    high1, low1, high2, low2 = walls[0], walls[1], walls[2], walls[3]
    for j in range(lanes):
        x1[j], y1[j], x2[j], y2[j] = euler_step(c, f, h, x1[j], y1[j], x2[j], y2[j], z[j])
    for j in range(lanes):
        due[j] = ((x1[j] > high1[j]) & (y1[j] > 0.0)) | ((x1[j] < -low1[j]) & (y1[j] < 0.0))
    if c.stages == 2:
        for j in range(lanes):
            due[j] |= ((x2[j] > high2[j]) & (y2[j] > 0.0)) | ((x2[j] < -low2[j]) & (y2[j] < 0.0))


@spliced
def _have_impacts(
    job: Job, first: int, level: int, tau: float, tile: int, hits: Ints, struck: Ints, found: int, few: Floats,
    lanes: Lanes, path: NDArray[Word], rows: Floats,
) -> int:  # fmt: skip
    """Impacts at the end of a step, in the first `found` of the picked lanes `struck`.

    All lanes have their first impact, then those that have one their second, and so on.  Returns in how many lanes an
    impact is still due after `MOST_IN_A_STEP`.
    """
    c = job.c
    for met in range(MOST_IN_A_STEP + 1):
        more = 0
        for i in range(found):
            j = struck[i]
            p = tile + hits[j]
            code = impact_due(c, few[0, j], few[1, j], few[2, j], few[3, j], walls_of(lanes, p))
            # by place in memory, not by choice among values, for the mesh and side of an impact are unpredictable
            mesh, high = abs(code), code > 0
            wall = lanes.walls[2 * mesh - 1 - high, p]
            few[2 * mesh - 2, j] = wall if high else -wall
            if met < MOST_IN_A_STEP:
                few[1, j], few[3, j] = record(
                    job, path[p], int(path[p]) - first, level, p, code, tau, few[0, j], few[1, j], few[2, j], few[3, j],
                    lanes, rows,
                )  # fmt: skip
            struck[more] = j
            more += impact_due(c, few[0, j], few[1, j], few[2, j], few[3, j], walls_of(lanes, p)) != 0
        found = more if met < MOST_IN_A_STEP else found
        if found == 0:
            break
    return found


@spliced
def _walk(
    job: Job, first: int, level: int, n: int, forcing: Floats, z: Floats, tile: int, steps: int, found: int,
    before: Floats, lanes: Lanes, room: Room, rows: Floats,
) -> int:  # fmt: skip
    """The first `found` lanes of ``room.hits`` from the states `before` through some steps one at a time, with impacts.

    Returns in how many steps of them an impact is still due after `MOST_IN_A_STEP`.
    """
    late, multiple, hits, few, walls = 0, 1 << level, room.hits, room.few, room.few_walls
    h, wide = job.dt * multiple, (found + 7) // 8 * 8
    _pick(before, tile, hits, found, few)
    _pick(lanes.walls, tile, hits, found, walls)
    for i in range(steps):
        every, picked = z[i], few[4]
        for j in range(found):
            picked[j] = every[hits[j]]
        _step_few(job.c, forcing[i], h, few, walls, room.marks, wide)
        struck = list_marked(room.marks, found, room.groups, room.struck)
        if struck > 0:
            tau = job.tau + (n + i * multiple) * job.dt + h
            late += _have_impacts(
                job, first, level, tau, tile, hits, room.struck, struck, few, lanes, room.path, rows
            )  # fmt: skip
            if job.backlash.redrawn:
                _pick(lanes.walls, tile, hits, found, walls)
    for i in range(4):
        every, picked = lanes.state[i][tile:], few[i]
        for j in range(found):
            every[hits[j]] = picked[j]
    return late


@spliced
def _take_steps(
    job: Job, first: int, level: int, n: int, forcing: Floats, z: Floats, tile: int, steps: int, live: int,
    lanes: Lanes, room: Room, rows: Floats,
) -> int:  # fmt: skip
    """At most four steps of a level, from finest step n on, of the `live` lanes from lane `tile` on."""
    if steps == QUAD:
        wide = (live + 7) // 8 * 8
        four_euler_steps(
            job.c, forcing, job.dt * (1 << level), job.backlash.random, lanes.walls, tile, lanes.state, lanes.before, z,
            room.marks, wide,
        )  # fmt: skip
        found, before = list_marked(room.marks, live, room.groups, room.hits), lanes.before
    else:
        for j in range(live):
            room.hits[j] = j
        found, before = live, lanes.state
    late = 0
    if found > 0:
        late = _walk(job, first, level, n, forcing, z, tile, steps, found, before, lanes, room, rows)
    return late


@spliced
def _take_chunk(
    job: Job, first: int, n: int, stop: int, tile: int, live: int, every: Lanes, room: Room, rows: Floats,
    fixed_steps: Ints, ticks: int, fixed: Floats,
) -> int:  # fmt: skip
    """All levels of the `live` lanes from lane `tile` on, from finest step n to step `stop`."""
    wide, late, levels = (live + 7) // 8 * 8, 0, rows.shape[0]
    path, bits = room.path[tile : tile + wide], room.bits[tile : tile + wide]
    s = n
    while s < stop:
        end = min(s - s % QUAD + QUAD, stop)
        if ticks < fixed_steps.size:
            end = min(end, fixed_steps[ticks])  # within four steps only where there is one level
        if s % QUAD == 0:
            _draw(job, path, bits, s, wide, room.z)
        for level in range(levels):
            steps = (end - s) >> level
            if level > 0:
                _join(steps, wide, room.z)
            if steps > 0:
                late += _take_steps(
                    job, first, level, s, room.forcing[level, (s - n) >> level :], room.z[s % QUAD :], tile, steps,
                    live, of_level(every, level, every.w[level], every.area[level]), room, rows,
                )  # fmt: skip
        s = end
        if ticks < fixed_steps.size and fixed_steps[ticks] == s:
            for level in range(levels):
                for p in range(live):
                    for i in range(4):
                        fixed[level, int(path[p]) - first, ticks, i] = every.state[level, i, tile + p]
            ticks += 1
    return late


@lean
def plain_block(
    job: Job, control: LinearPath, first: int, every: Lanes, room: Room, rows: Floats, fixed_steps: Ints, fixed: Floats,
    controls: Floats,
) -> tuple[int, int]:  # fmt: skip
    """Follow a block of paths by ``euler-maruyama``.

    Parameters
    ----------
    job, first, every, room, rows, fixed_steps, fixed
        As of the kernels of `rattle.montecarlo.kernel.kernel.block_kernel`.
    control, controls
        Not used: the scheme has no control variate.

    Returns
    -------
    work, sticking : int
        Path-steps, and those with an impact still due after `MOST_IN_A_STEP`.
    """
    widest_vectors()
    levels, impacts = rows.shape[0], rows.shape[2]
    work, sticking, live, ticks, n = 0, 0, rows.shape[1], 0, 0
    while n < job.most_steps and live > 0:
        stop = min(n + CHUNK, job.most_steps)
        _tabulate(job, n, stop, room.forcing)
        for tile in range(0, live, TILE):
            sticking += _take_chunk(
                job, first, n, stop, tile, min(TILE, live - tile), every, room, rows, fixed_steps, ticks, fixed
            )  # fmt: skip
        while ticks < fixed_steps.size and fixed_steps[ticks] <= stop:
            ticks += 1
        for level in range(levels):
            work += ((stop - n) >> level) * live
        n = stop
        if ticks == fixed_steps.size:
            live = retire(every, room, impacts, live)
    return work, sticking
