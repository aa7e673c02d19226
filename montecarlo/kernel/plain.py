"""The kernel of ``euler-maruyama``: steps in fours, and the lanes that met a wall in them once more with their impacts.

Most lanes meet no wall in four steps.  So all take them without walls, in registers, and those that were beyond a wall
at the end of a step are taken back and walked through the four one at a time.  A tile of lanes goes through a whole
chunk of steps before the next does.
"""

import math
from typing import NamedTuple

from numpy.typing import NDArray

from rattle.montecarlo.kernel.control_variate import LinearPath
from rattle.montecarlo.kernel.kernel import Job, Output, rebound, record, walls_of
from rattle.montecarlo.kernel.lanes import (
    CHUNK,
    CODE,
    HIGH1,
    HIGH2,
    LOW1,
    LOW2,
    TILE,
    X1,
    X2,
    Y1,
    Y2,
    Lanes,
    Room,
    list_marked,
    of_level,
    retire,
)
from rattle.montecarlo.noise.memory import color_increments
from rattle.montecarlo.noise.philox import Word, fill_normals, fill_signs, fill_words
from rattle.montecarlo.schemes.euler import (
    FORCING,
    QUAD,
    StepForcing,
    euler_step,
    four_euler_steps,
    put_on_wall,
    step_forcing,
)
from rattle.montecarlo.schemes.euler import due as impact_due
from rattle.montecarlo.schemes.step_state import MOST_IN_A_STEP
from rattle.scene.compiled import inline, lean, splice, widest_vectors
from rattle.scene.constants import Constants
from rattle.scene.types import Bools, Floats, Ints

WORD = 64  # bits, each a two-point increment
ROOT_HALF = math.sqrt(0.5)


@splice
def _tabulate(job: Job, n: int, stop: int, forcing: Floats) -> None:
    """Forcing of the steps of all levels from finest step n on, shape (levels, CHUNK, FORCING)."""
    for level in range(forcing.shape[0]):
        multiple = 1 << level
        for i in range((stop - n) // multiple):
            f = step_forcing(job.c, job.tau + (n + i * multiple) * job.dt, job.dt * multiple)
            for j in range(FORCING):
                forcing[level, i, j] = f[j]


@splice
def _draw(job: Job, path: NDArray[Word], bits: NDArray[Word], eta: Floats, n: int, lanes: int, z: Floats) -> None:
    """Increments of four steps from step n on, a multiple of four, in units of their sd."""
    if job.c.sigma != 0.0 and not job.two_point:
        fill_normals(job.key, path, Word(n // QUAD), lanes, z)
    elif job.c.sigma != 0.0:
        if n % WORD == 0:
            fill_words(job.key, path, Word(n // WORD), lanes, bits)
        for i in range(QUAD):
            fill_signs(bits, n % WORD + i, lanes, z[i])
    if job.c.memory > 0.0 and job.c.sigma != 0.0:
        for i in range(QUAD):
            color_increments(job.memory, eta, z[i], lanes)


@lean
def _join(steps: int, lanes: int, z: Floats) -> None:
    """Increments of steps twice as long from those of their halves, in place."""
    widest_vectors()
    for i in range(steps):
        first, second, whole = z[2 * i], z[2 * i + 1], z[i]
        for p in range(lanes):
            whole[p] = (first[p] + second[p]) * ROOT_HALF


@inline
def _of(row: int, j: int) -> Word:
    """Where a row of ``Room.few`` has its lane j; without a sign, which would be looked at."""
    return Word(row + j)


@lean
def _pick_states(before: Floats, z: Floats, tile: int, hits: Ints, found: int, few: Floats, noise: Floats) -> None:
    """States and noise of the lanes `hits`, counted from lane `tile` on, side by side."""
    x1, y1, x2, y2 = before[0][tile:], before[1][tile:], before[2][tile:], before[3][tile:]
    for j in range(found):
        p = Word(hits[j])
        few[_of(X1, j)], few[_of(Y1, j)], few[_of(X2, j)], few[_of(Y2, j)] = x1[p], y1[p], x2[p], y2[p]
    for i in range(z.shape[0]):
        every, picked = z[i], noise[i]
        for j in range(found):
            picked[j] = every[Word(hits[j])]


@lean
def _pick_walls(walls: Floats, tile: int, hits: Ints, found: int, few: Floats) -> None:
    """Flanks of the lanes `hits`, counted from lane `tile` on, side by side."""
    high1, low1, high2, low2 = walls[0][tile:], walls[1][tile:], walls[2][tile:], walls[3][tile:]
    for j in range(found):
        p = Word(hits[j])
        few[_of(HIGH1, j)], few[_of(LOW1, j)] = high1[p], low1[p]
        few[_of(HIGH2, j)], few[_of(LOW2, j)] = high2[p], low2[p]


@lean
def _put_back(few: Floats, tile: int, hits: Ints, found: int, state: Floats) -> None:
    """States of the picked lanes back where they came from."""
    x1, y1, x2, y2 = state[0][tile:], state[1][tile:], state[2][tile:], state[3][tile:]
    for j in range(found):
        p = Word(hits[j])
        x1[p], y1[p], x2[p], y2[p] = few[_of(X1, j)], few[_of(Y1, j)], few[_of(X2, j)], few[_of(Y2, j)]


@inline
def _beyond(x: float, high: float, low: float) -> float:
    """Side of the wall that a mesh is beyond: 1, -1, or 0 for none."""
    return 1.0 if x > high else (-1.0 if x < -low else 0.0)


@lean
def _step_few(
    c: Constants, forcing: Floats, h: float, few: Floats, z: Floats, due: Bools, crowded: Bools, lanes: int
) -> None:
    """One step of the picked lanes; those with an impact at its end are marked, and put back on the wall.

    Their ``mesh * side`` is written beside their states, where others have 0; those beyond walls of both meshes, whose
    first impact may bring about another, are marked as `crowded`.  Vectorises.
    """
    widest_vectors()
    f, two = StepForcing(forcing[0], forcing[1], forcing[2], forcing[3]), 1.0 if c.stages == 2 else 0.0
    for j in range(lanes):
        x1, y1, x2, y2 = euler_step(c, f, h, few[_of(X1, j)], few[_of(Y1, j)], few[_of(X2, j)], few[_of(Y2, j)], z[j])
        high1, low1, high2, low2 = few[_of(HIGH1, j)], few[_of(LOW1, j)], few[_of(HIGH2, j)], few[_of(LOW2, j)]
        side1, side2 = _beyond(x1, high1, low1), two * _beyond(x2, high2, low2)
        second = 2.0 * side2 if side2 * y2 > 0.0 else 0.0
        code = side1 if side1 * y1 > 0.0 else second
        due[j] = code != 0.0
        crowded[j] = (side1 != 0.0) & (side2 != 0.0)
        few[_of(CODE, j)] = code
        few[_of(X1, j)] = high1 if code == 1.0 else (-low1 if code == -1.0 else x1)
        few[_of(X2, j)] = high2 if code == 2.0 else (-low2 if code == -2.0 else x2)
        few[_of(Y1, j)], few[_of(Y2, j)] = y1, y2


@inline
def _rebound(c: Constants, few: Floats, lanes: int) -> None:
    """Velocities of the picked lanes after the impacts that are due in them.  Vectorises."""
    for j in range(lanes):
        few[_of(Y1, j)], few[_of(Y2, j)] = rebound(c, abs(few[_of(CODE, j)]), few[_of(Y1, j)], few[_of(Y2, j)])


class Tile(NamedTuple):
    """Lanes of a level that are taken through some steps together."""

    job: Job
    level: int
    first: int  # first, live: the first lane, and how many there are
    live: int
    lanes: Lanes  # of the level
    room: Room
    out: Output


@splice
def _have_more_impacts(t: Tile, tau: float, found: int) -> int:
    """Further impacts at the end of a step, in the first `found` of the picked lanes ``room.struck``.

    Returns in how many an impact is still due after `MOST_IN_A_STEP`.
    """
    c, few, struck = t.job.c, t.room.few, t.room.struck
    for met in range(1, MOST_IN_A_STEP + 1):
        more = 0
        for i in range(found):
            j = struck[i]
            p = t.first + t.room.hits[j]
            x1, y1, x2, y2 = few[_of(X1, j)], few[_of(Y1, j)], few[_of(X2, j)], few[_of(Y2, j)]
            walls = walls_of(t.lanes, p)
            code = impact_due(c, x1, y1, x2, y2, walls)
            if code != 0 and met < MOST_IN_A_STEP:
                x1, x2 = put_on_wall(code, x1, x2, walls)
                record(t.job, t.level, p, code, tau, (x1, y1, x2, y2), t.lanes, t.room, t.out)
                y1, y2 = rebound(c, abs(code), y1, y2)
                few[_of(X1, j)], few[_of(Y1, j)], few[_of(X2, j)], few[_of(Y2, j)] = x1, y1, x2, y2
            struck[more] = j
            more += code != 0
        found = more
        if found == 0:
            break
    return found


@splice
def _have_impacts(t: Tile, tau: float, found: int, wide: int) -> int:
    """Impacts at the end of a step, in the first `found` of the picked lanes ``room.struck``, one at a time in each.

    Returns in how many lanes an impact is still due after `MOST_IN_A_STEP`.
    """
    few, struck, more = t.room.few, t.room.struck, 0
    for i in range(found):
        j = struck[i]
        p, code = t.first + t.room.hits[j], int(few[_of(CODE, j)])
        state = few[_of(X1, j)], few[_of(Y1, j)], few[_of(X2, j)], few[_of(Y2, j)]
        record(t.job, t.level, p, code, tau, state, t.lanes, t.room, t.out)
        struck[more] = j
        more += t.room.crowded[j]
    _rebound(t.job.c, few, wide)
    return _have_more_impacts(t, tau, more)


@splice
def _walk(t: Tile, n: int, forcing: Floats, z: Floats, steps: int, found: int, before: Floats) -> int:
    """The first `found` lanes of ``room.hits`` from the states `before` through some steps one at a time, with impacts.

    Returns in how many steps of them an impact is still due after `MOST_IN_A_STEP`.
    """
    late, multiple, room, walls = 0, 1 << t.level, t.room, t.lanes.walls
    h, wide = t.job.dt * multiple, (found + 7) // 8 * 8
    _pick_states(before, z[:steps], t.first, room.hits, found, room.few, room.few_noise)
    if t.job.backlash.random:
        _pick_walls(walls, t.first, room.hits, found, room.few)
    for i in range(steps):
        _step_few(t.job.c, forcing[i], h, room.few, room.few_noise[i], room.marks, room.crowded, wide)
        struck = 0
        for j in range(found):  # without a branch, as in `list_marked`
            room.struck[struck] = j
            struck += room.marks[j]
        if struck > 0:
            late += _have_impacts(t, t.job.tau + (n + i * multiple) * t.job.dt + h, struck, wide)
            if t.job.backlash.redrawn:
                _pick_walls(walls, t.first, room.hits, found, room.few)
    _put_back(room.few, t.first, room.hits, found, t.lanes.state)
    return late


@splice
def _take_steps(t: Tile, n: int, forcing: Floats, steps: int) -> int:
    """At most four steps of a level, from finest step n on."""
    lanes, room, z, found, before = t.lanes, t.room, t.room.z[n % QUAD :], t.live, t.lanes.state
    if steps == QUAD:
        h, wide, toleranced, marks = t.job.dt * (1 << t.level), (t.live + 7) // 8 * 8, t.job.backlash.random, room.marks
        four_euler_steps(
            t.job.c, forcing, h, toleranced, lanes.walls, t.first, lanes.state, lanes.before, z, marks, wide
        )
        found, before = list_marked(marks, t.live, room.groups, room.hits), lanes.before
    else:
        for j in range(found):
            room.hits[j] = j
    return _walk(t, n, forcing, z, steps, found, before) if found > 0 else 0


@splice
def _take_chunk(
    job: Job, n: int, stop: int, tile: int, live: int, every: Lanes, room: Room, ticks: int, out: Output
) -> int:
    """All levels of the `live` lanes from lane `tile` on, from finest step n to step `stop`."""
    wide, late, levels, fixed_steps = (live + 7) // 8 * 8, 0, out.rows.shape[0], out.fixed_steps
    path, bits, eta = room.path[tile : tile + wide], room.bits[tile : tile + wide], room.eta[tile : tile + wide]
    s = n
    while s < stop:
        end = min(s - s % QUAD + QUAD, stop)
        if ticks < fixed_steps.size:
            end = min(end, fixed_steps[ticks])  # within four steps only where there is one level
        if s % QUAD == 0:
            _draw(job, path, bits, eta, s, wide, room.z)
        for level in range(levels):
            steps = (end - s) >> level
            if level > 0:
                _join(steps, wide, room.z)
            if steps > 0:
                lanes = of_level(every, level, every.w[level], every.area[level])
                own = Tile(job, level, tile, live, lanes, room, out)
                late += _take_steps(own, s, room.forcing[level, (s - n) >> level :], steps)
        s = end
        if ticks < fixed_steps.size and fixed_steps[ticks] == s:
            for level in range(levels):
                for p in range(live):
                    for i in range(4):
                        out.fixed[level, int(path[p]) - out.first, ticks, i] = every.state[level, i, tile + p]
            ticks += 1
    return late


@lean
def plain_block(job: Job, control: LinearPath, every: Lanes, room: Room, out: Output) -> tuple[int, int]:
    """Follow a block of paths by ``euler-maruyama``."""
    widest_vectors()
    (levels, live, impacts, _), fixed_steps = out.rows.shape, out.fixed_steps
    work, sticking, ticks, n = 0, 0, 0, 0
    while n < job.most_steps and live > 0:
        stop = min(n + CHUNK, job.most_steps)
        _tabulate(job, n, stop, room.forcing)
        for tile in range(0, live, TILE):
            sticking += _take_chunk(job, n, stop, tile, min(TILE, live - tile), every, room, ticks, out)
        while ticks < fixed_steps.size and fixed_steps[ticks] <= stop:
            ticks += 1
        for level in range(levels):
            work += ((stop - n) >> level) * live
        n = stop
        if ticks == fixed_steps.size:
            live = retire(every, room, impacts, live)
    return work, sticking
