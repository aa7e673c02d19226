"""Paths on a GPU: one thread per path, the scalar functions of the CPU kernel, the same random numbers.

The functions called here are those that `rattle.montecarlo.kernel.kernel` calls; numba compiles the same source for
either device.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from rattle.montecarlo.kernel.kernel import EXACT, FLANK_DRAWS, LOCATED, PLAIN, next_event
from rattle.montecarlo.kernel.lanes import CHUNK
from rattle.montecarlo.noise.backlash import first_half_gap, half_gap
from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import STEP, Word, bits_of, normals, sign_of
from rattle.montecarlo.schemes.crossing import near_wall
from rattle.montecarlo.schemes.euler import StepForcing, euler_step, step_forcing
from rattle.montecarlo.schemes.euler_located import leaves
from rattle.montecarlo.schemes.exact_flight import PARTS, FlightForcing, first_stage, flight_forcing, second_stage
from rattle.montecarlo.schemes.short_flight import no_phase, phase_at
from rattle.montecarlo.schemes.step_state import MOST_IN_A_STEP, Progress, Walls
from rattle.montecarlo.schemes.sticking import OPEN, sides_of, stick_to_end, sticking_sides
from rattle.scene.impact import struck

TABLE = 64  # steps whose forcing a thread block tabulates together, one thread a step; also the bits of a Word
STEPS, STICKING, UNFINISHED = 0, 1, 2  # indices of `counts`


@cuda.jit(device=True)
def _tabulate(scheme, job, n, table):  # type: ignore[no-untyped-def]
    """Forcing of the steps from n on into the shared `table`, by all threads of a block."""
    for s in range(cuda.threadIdx.x, TABLE, cuda.blockDim.x):
        begin = job.tau + (n + s) * job.dt
        if scheme == EXACT:
            own = flight_forcing(job.c, begin, job.dt)
            for j in range(4):
                table[s, j], table[s, 4 + j], table[s, 8 + j] = own.drift[j], own.along[j], own.across[j]
            table[s, 12], table[s, 13] = own.margin1, own.margin2
        else:
            f = step_forcing(job.c, begin, job.dt)
            table[s, 0], table[s, 1], table[s, 2], table[s, 3] = f.push1, f.kick1, f.push2, f.kick2


@cuda.jit(device=True)
def _flight(c, h, whole, t, x1, y1, x2, y2, w, area, walls):  # type: ignore[no-untyped-def]
    """State after an exact-flight step, and whether it may have an impact; `t` is the step's row of the table."""
    drift, along, across = (t[0], t[1], t[2], t[3]), (t[4], t[5], t[6], t[7]), (t[8], t[9], t[10], t[11])
    f = FlightForcing(whole.carry, drift, along, across, t[12], t[13])
    third = h / 3.0
    a1, b1 = first_stage(f, x1, y1, w, area)
    meets = near_wall(third, x1, y1, a1, b1, walls.high1, walls.low1, f.margin1)
    if c.stages != 2:
        return a1, b1, x2, y2, meets
    a2, b2 = second_stage(f, x2, y1, y2, w, area)
    return a1, b1, a2, b2, meets | near_wall(third, x2, y2, a2, b2, walls.high2, walls.low2, f.margin2)


@cuda.jit(device=True)
def _euler(located, c, h, t, x1, y1, x2, y2, w, walls):  # type: ignore[no-untyped-def]
    """State after an Euler step, and whether it ends beyond a wall."""
    a1, b1, a2, b2 = euler_step(c, StepForcing(t[0], t[1], t[2], t[3]), h, x1, y1, x2, y2, w)
    if located:
        meets = leaves(h, x1, y1, walls.high1, walls.low1)
        if c.stages == 2:
            meets |= leaves(h, x2, y2, walls.high2, walls.low2)
    else:
        meets = (a1 > walls.high1) | (a1 < -walls.low1)
        if c.stages == 2:
            meets |= (a2 > walls.high2) | (a2 < -walls.low2)
    return a1, b1, a2, b2, meets


@cuda.jit(device=True)
def _first_walls(random, job, path):  # type: ignore[no-untyped-def]
    if not random:
        return Walls(job.c.wall1, job.c.wall1, job.c.wall2, job.c.wall2)
    b, key = job.backlash, job.key
    high1, low1 = first_half_gap(b, key, path, 0), first_half_gap(b, key, path, 1)
    return Walls(high1, low1, first_half_gap(b, key, path, 2), first_half_gap(b, key, path, 3))


@cuda.jit(device=True)
def _move(walls, code, drawn):  # type: ignore[no-untyped-def]
    """Walls after an impact: the flank opposite to the struck one is redrawn."""
    high1, low1 = drawn if code == -1 else walls.high1, drawn if code == 1 else walls.low1
    return Walls(high1, low1, drawn if code == -2 else walls.high2, drawn if code == 2 else walls.low2)


@cache
def path_kernel(scheme: int, noise: str, random: bool, redrawn: bool) -> Callable[..., Any]:
    """CUDA kernel that follows paths by one scheme; code that the scene does not need is not compiled.

    The kernel is called with ``(job, first, start, flanks, rows, fixed_steps, fixed, counts)``: number of the first
    path; state after the start as a tuple; +1, -1 or 0 per mesh for a coordinate that starts on a flank; then device
    arrays: `rows` of shape (impacts, COLUMNS, paths), the steps of the fixed times, `fixed` of shape (times, 4, paths),
    and three integer `counts` that are added to.
    """
    gaussian, two_point = noise == "gaussian", noise == "two-point"
    width = 14 if scheme == EXACT else 4
    draws = 2 if scheme == EXACT else 4  # steps per draw of four normals

    @cuda.jit
    def follow(job, first, start, flanks, rows, fixed_steps, fixed, counts):  # type: ignore[no-untyped-def]
        c, h, impacts, paths = job.c, job.dt, rows.shape[0], rows.shape[2]
        table = cuda.shared.array((TABLE, width), np.float64)
        ahead = cuda.local.array((PARTS if scheme == EXACT else 1, 3), np.float64)
        row = cuda.grid(1)
        path = Word(first + row)
        walls = _first_walls(random, job, path)
        x1, y1, x2, y2 = start
        if flanks[0] != 0:
            x1 = walls.high1 if flanks[0] > 0 else -walls.low1
        if flanks[1] != 0:
            x2 = walls.high2 if flanks[1] > 0 else -walls.low2
        last, k, sticking, tick, n = job.tau, 0, 0, 0, 0
        z0, z1, z2, z3, bits = 0.0, 0.0, 0.0, 0.0, Word(0)
        whole = flight_forcing(c, job.tau, h)
        done = row >= paths
        while n < job.most_steps:
            if cuda.syncthreads_or(0 if done else 1) == 0:  # also the barrier before the table is overwritten
                break
            _tabulate(scheme, job, n, table)
            cuda.syncthreads()
            stop, s = min(TABLE, job.most_steps - n), 0
            if two_point:
                bits = Word(bits_of(job.key, path, Word(n // TABLE)))
            while s < stop and not done:
                end = min(stop, s + CHUNK - s % CHUNK)  # the CPU kernel retires finished paths at these steps
                if tick < fixed_steps.size:
                    end = min(end, fixed_steps[tick] - n)
                for s in range(s, end):  # noqa: B020
                    if two_point:
                        z0 = sign_of(bits, s)
                    elif gaussian:
                        if s & (draws - 1) == 0:  # bits, not remainders: the compiler does not know that s >= 0
                            z0, z1, z2, z3 = normals(job.key, path, Word((n + s) >> (draws // 2)), Word(STEP))
                        elif draws == 4:
                            z0, z1, z2 = z1, z2, z3
                        else:
                            z0, z1 = z2, z3
                    a1, b1, a2, b2 = x1, y1, x2, y2
                    own = table[s & (TABLE - 1)]
                    if scheme == EXACT:
                        x1, y1, x2, y2, meets = _flight(c, h, whole, own, a1, b1, a2, b2, z0, z1, walls)
                    else:
                        x1, y1, x2, y2, meets = _euler(scheme == LOCATED, c, h, own, a1, b1, a2, b2, z0, walls)
                    if not meets:
                        continue
                    begin, whole_end = job.tau + (n + s) * h, (x1, y1, x2, y2)
                    phase = phase_at(c.drive, begin) if scheme == EXACT else no_phase(c.drive)
                    if scheme == PLAIN:
                        at = Progress(0, begin + h, 0.0, Noise(0.0, 0.0), x1, y1, x2, y2)
                    else:
                        noise = Noise(z0 * math.sqrt(h), (z1 if scheme == EXACT else 0.0) * math.sqrt(h / 12.0))
                        at = Progress(0, begin, h, noise, a1, b1, a2, b2)
                    for met in range(MOST_IN_A_STEP + 1):
                        enough = k >= impacts and tick == fixed_steps.size
                        if scheme != PLAIN and (at.left <= 0.0 or enough):
                            break
                        sides = sticking_sides(c, at, walls) if scheme == EXACT else OPEN
                        if sides[0] == 0 and sides[1] == 0:
                            at, phase = next_event(
                                scheme, c, job.key, path, n + s, 0, met, at, phase, whole_end, walls, ahead
                            )
                        if sides[0] != 0 or sides[1] != 0 or (at.code != 0 and met == MOST_IN_A_STEP):
                            if scheme != PLAIN:
                                at = stick_to_end(c, at, sides if at.code == 0 else sides_of(at.code), walls)
                            sticking += 1
                            break
                        if at.code == 0:
                            if scheme == PLAIN or at.left <= 0.0:
                                break
                            continue
                        mesh = abs(at.code)
                        if k < impacts:
                            tau = max(at.tau, last)
                            rows[k, 0, row], rows[k, 1, row] = tau, tau - last
                            rows[k, 2, row], rows[k, 3, row] = at.x1, at.y1
                            rows[k, 4, row], rows[k, 5, row] = at.x2, at.y2
                            rows[k, 6, row] = at.code
                        last = max(at.tau, last)
                        if redrawn:
                            drawn = half_gap(job.backlash, job.key, path, Word(k) + FLANK_DRAWS, mesh)
                            walls = _move(walls, at.code, drawn)
                        k += 1
                        u1, u2 = struck(c, mesh, at.y1, at.y2)
                        at = Progress(0, at.tau, at.left, at.noise, at.x1, u1, at.x2, u2)
                    x1, y1, x2, y2 = at.x1, at.y1, at.x2, at.y2
                s = end
                if tick < fixed_steps.size and fixed_steps[tick] == n + s:
                    fixed[tick, 0, row], fixed[tick, 1, row] = x1, y1
                    fixed[tick, 2, row], fixed[tick, 3, row] = x2, y2
                    tick += 1
                if (s % CHUNK == 0 or s == stop) and k >= impacts and tick == fixed_steps.size:
                    done = True
                    cuda.atomic.add(counts, STEPS, n + s)
            n += stop
        if row < paths:
            if not done:
                cuda.atomic.add(counts, STEPS, n)
            if k < impacts:
                cuda.atomic.add(counts, UNFINISHED, 1)
            cuda.atomic.add(counts, STICKING, sticking)
            for unmet in range(k, impacts):
                for j in range(rows.shape[1]):
                    rows[unmet, j, row] = math.nan

    return follow  # type: ignore[no-any-return]
