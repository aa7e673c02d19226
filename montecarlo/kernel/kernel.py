"""The kernel: a block of paths through a scheme, steps in vector lanes, impacts one path at a
time."""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple, cast

import numpy as np

from rattle.montecarlo.kernel import lanes as vector
from rattle.montecarlo.kernel.lanes import Lanes, Room
from rattle.montecarlo.noise.backlash import Backlash, half_gap
from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.memory import Memory, color_increments, color_noise
from rattle.montecarlo.noise.philox import (
    BRIDGE,
    Key,
    Word,
    fill_normals,
    fill_signs,
    fill_words,
    normals,
)
from rattle.montecarlo.schemes.control_variate import LinearPath, carry_along
from rattle.montecarlo.schemes.euler import at_end, plain_lanes, step_forcing
from rattle.montecarlo.schemes.euler_located import advance_inside, leaving, step_located_lanes
from rattle.montecarlo.schemes.exact_flight import advance_exactly, flight_forcing, flight_lanes
from rattle.montecarlo.schemes.short_flight import Phase, State, no_phase, phase_at
from rattle.montecarlo.schemes.step_state import MOST_IN_A_STEP, Progress, Walls
from rattle.montecarlo.schemes.sticking import OPEN, sides_of, stick_to_end, sticking_sides
from rattle.scene import Bools, Constants, Floats, Ints
from rattle.scene.compiled import lean, splice, widest_vectors
from rattle.scene.impact import struck

COLUMNS = 7  # recorded of an impact: tau, flight, x1, y1, x2, y2, mesh * side
SPLITS = Word(1 << 16)  # indices of random numbers reserved for the splits of one step
# of those, the ones of one call of `advance_exactly`
CUTS_APART = SPLITS // Word(MOST_IN_A_STEP + 1)

# codes of the schemes
PLAIN = 0
LOCATED = 1
EXACT = 2
ENDLESS = 2**62  # impacts of a path that is followed beyond those that are recorded
ZERO, FIRST, SECOND = cast(tuple[int, int, int], (np.int64(0), np.int64(1), np.int64(2)))
"""Integers of a non-literal type: numba compiles a function again for every literal argument."""
FLANK_DRAWS = Word(4)  # half gaps drawn at the start; the draws of the impacts follow


class Job(NamedTuple):
    """Settings of a run for compiled code."""

    c: Constants  # of the scene
    backlash: Backlash  # half gaps and their tolerance
    key: Key  # of the random numbers
    tau: float  # initial time
    dt: float  # finest step
    scheme: int  # code of the scheme
    two_point: bool  # whether increments are two-point
    most_steps: int  # finest steps after which a path is given up
    memory: Memory = Memory()  # of the noise, for the finest step; not used for white noise


class Output(NamedTuple):
    """What a kernel writes for a block of paths; what is not reached stays as given."""

    first: int  # number of the first path
    rows: Floats  # the state just before each impact; (levels, paths, impacts, COLUMNS)
    # finest steps, multiples of the coarsest, after which states are recorded; ascending
    fixed_steps: Ints
    fixed: Floats  # those states; (levels, paths, times, 4)
    controls: Floats  # section quantities of the linearised path; (paths, impacts, COLUMNS)


@splice
def next_event(
    scheme: int,
    c: Constants,
    key: Key,
    path: Word,
    step: int,
    level: int,
    met: int,
    at: Progress,
    phase: Phase,
    whole: State,
    walls: Walls,
    ahead: Floats,
) -> tuple[Progress, Phase]:
    """Go to the next impact within a step, or to the end of the step.

    `step`, `level`: Number of the step, in finest steps; its level (0 for dt, 1 for 2 dt, ...).
    Shapes: `ahead` (PARTS, 3).
    """
    if scheme == PLAIN:
        return at_end(c, at, walls), phase
    index = Word(step) * SPLITS
    purpose = Word(BRIDGE + level)
    if scheme == LOCATED:
        normal = 0.0 if c.memory > 0.0 else normals(key, path, index + Word(met), purpose)[0]
        return advance_inside(c, at, normal, walls), phase
    first = index + CUTS_APART * Word(met)
    return advance_exactly(c, key, path, first, purpose, at, phase, whole, met == 0, walls, ahead)


@splice
def record(
    job: Job,
    level: int,
    p: int,
    code: int,
    tau: float,
    state: State,
    lanes: Lanes,
    room: Room,
    out: Output,
) -> None:
    """Record an impact of the path in lane p, and redraw the flank if impacts do."""
    k = lanes.impacts[p]
    path = room.path[p]
    # after the sum of a step's pieces its end may be a rounding error late
    tau = max(tau, lanes.last[p])
    if k < out.rows.shape[2]:
        seen = (tau, tau - lanes.last[p], state[0], state[1], state[2], state[3], float(code))
        for i in range(COLUMNS):
            out.rows[level, int(path) - out.first, k, i] = seen[i]
    lanes.last[p] = tau
    lanes.impacts[p] = k + 1
    if job.backlash.redrawn:
        mesh = abs(code)
        opposite = 2 * mesh - 1 if code > 0 else 2 * mesh - 2
        lanes.walls[opposite, p] = half_gap(
            job.backlash, job.key, path, Word(k) + FLANK_DRAWS, mesh
        )


@splice
def rebound(c: Constants, mesh: float, y1: float, y2: float) -> tuple[float, float]:
    """Velocities after an impact.  Without a branch on the mesh, which cannot be predicted."""
    a1, a2 = struck(c, FIRST, y1, y2)
    b1, b2 = struck(c, SECOND, y1, y2)
    y1 = a1 if mesh == 1 else (b1 if mesh == 2 else y1)
    y2 = a2 if mesh == 1 else (b2 if mesh == 2 else y2)
    return y1, y2


@splice
def finish_inside(
    scheme: int,
    job: Job,
    step: int,
    level: int,
    p: int,
    at: Progress,
    phase: Phase,
    lanes: Lanes,
    room: Room,
    out: Output,
    enough: int,
) -> bool:
    """Carry one path from `at` through its impacts to the end of the step; whether a mesh had to
    stay closed.

    `enough`: Impacts after which it is not followed any further.
    """
    sticking = False
    state = lanes.state
    path = room.path[p]
    ahead = room.ahead
    whole = state[0, p], state[1, p], state[2, p], state[3, p]
    for met in range(MOST_IN_A_STEP + 1):
        if at.left <= 0.0 or lanes.impacts[p] >= enough:
            break
        walls = Walls(lanes.walls[0, p], lanes.walls[1, p], lanes.walls[2, p], lanes.walls[3, p])
        sides = sticking_sides(job.c, at, walls) if scheme == EXACT else OPEN
        if sides[0] == 0 and sides[1] == 0:
            at, phase = next_event(
                scheme, job.c, job.key, path, step, level, met, at, phase, whole, walls, ahead
            )
        if sides[0] != 0 or sides[1] != 0 or (at.code != 0 and met == MOST_IN_A_STEP):
            if scheme != PLAIN:
                at = stick_to_end(job.c, at, sides if at.code == 0 else sides_of(at.code), walls)
            sticking = True
            break
        if at.code != 0:
            record(job, level, p, at.code, at.tau, (at.x1, at.y1, at.x2, at.y2), lanes, room, out)
            y1, y2 = rebound(job.c, abs(at.code), at.y1, at.y2)
            at = Progress(0, at.tau, at.left, at.noise, at.x1, y1, at.x2, y2)
    state[0, p] = at.x1
    state[1, p] = at.y1
    state[2, p] = at.x2
    state[3, p] = at.y2
    return sticking


@splice
def step_lanes(
    scheme: int, job: Job, tau: float, h: float, lanes: Lanes, marks: Bools, live: int
) -> None:
    """One step of all lanes; marks those that may have an impact."""
    c = job.c
    state = lanes.state
    before = lanes.before
    if scheme == PLAIN:
        forcing = step_forcing(c, tau, h)
        toleranced = job.backlash.random
        plain_lanes(c, forcing, h, toleranced, lanes.walls, state, lanes.w, marks[:live])
    elif scheme == LOCATED:
        for i in range(2 * c.stages):
            for p in range(live):
                before[i, p] = state[i, p]
        leaving(c, h, lanes.walls, state, marks, live)
        step_located_lanes(c, step_forcing(c, tau, h), h, state, lanes.w, live)
    else:
        f = flight_forcing(c, tau, h)
        toleranced = job.backlash.random
        flight_lanes(
            c, f, h, toleranced, lanes.walls, state, before, lanes.w, lanes.area, marks, live
        )


@cache
def block_kernel(scheme: int) -> Callable[..., tuple[int, int]]:
    """Kernel that follows a block of paths by one scheme; code of other schemes is not compiled in.

    The kernel is called with ``(job, control, every, room, out)``.  It follows each path until it
    has had its impacts, at one or more step sizes on the same Brownian path, and returns the number
    of path-steps, and of those in which a mesh stayed closed to the end.

    - job : Job.  Level l has the step ``2**l dt``; after ``most_steps`` finest steps paths are
      given up.
    - control : LinearPath, carried along beside the finest level; empty for none.
    - every, room : Lanes, Room, from `rattle.montecarlo.kernel.lanes.lanes_of`.
    - out : Output.
    """
    draws = 2 if scheme == EXACT else 4  # steps per draw of four normals
    apart = 4 // draws  # normals per step

    @lean
    def run_block(
        job: Job, control: LinearPath, every: Lanes, room: Room, out: Output
    ) -> tuple[int, int]:
        widest_vectors()
        levels, paths, impacts, _ = out.rows.shape
        fixed_steps = out.fixed_steps
        path = room.path
        bits = room.bits
        z = room.z
        xi = room.carried
        marks = room.marks
        hits = room.hits
        work = ZERO
        sticking = ZERO
        live = paths
        next_fixed = ZERO
        linear = ZERO
        n = ZERO
        while n < job.most_steps and live > 0:
            wide = (live + 7) // 8 * 8
            for _ in range(min(vector.CHUNK, job.most_steps - n)):
                use = 0 if job.two_point else n % draws
                if scheme != EXACT and job.two_point and job.c.sigma != 0.0:
                    if n % 64 == 0:
                        fill_words(job.key, path, Word(n // 64), wide, bits)
                    fill_signs(bits, n % 64, wide, z[0])
                elif use == 0 and job.c.sigma != 0.0:
                    fill_normals(job.key, path, Word(n // draws), wide, z)
                w = z[use * apart]
                area = z[use * apart + 1 if scheme == EXACT else 4]
                if job.c.memory > 0.0 and job.c.sigma != 0.0:
                    if scheme == EXACT:
                        color_noise(job.memory, room.eta, w, area, wide)
                    else:
                        color_increments(job.memory, room.eta, w, wide)
                if scheme == EXACT and linear < control.at_step.size:
                    linear = carry_along(
                        control, n, linear, out.first, path, xi, w, area, out.controls, live
                    )
                n += 1
                for level in range(levels):
                    multiple = 1 << level
                    if level > 0:
                        if n % (multiple // 2) != 0:
                            break
                        if scheme == PLAIN:
                            vector.join_increments(w, every.w[level], n % multiple == 0, wide)
                        else:
                            vector.join_halves(
                                w, area, every.w[level], every.area[level], n % multiple == 0, wide
                            )
                        w = every.w[level]
                        area = every.area[level]
                        if n % multiple != 0:
                            break
                    lanes = vector.of_level(every, level, w, area)
                    h = job.dt * multiple
                    begin = job.tau + (n - multiple) * job.dt
                    step_lanes(scheme, job, begin, h, lanes, marks, wide)
                    found = vector.list_marked(marks, live, room.groups, hits)
                    phase = (
                        phase_at(job.c.drive, begin) if scheme == EXACT else no_phase(job.c.drive)
                    )
                    enough = (
                        impacts if next_fixed == fixed_steps.size and scheme != PLAIN else ENDLESS
                    )
                    for i in range(found):  # from the start of the step, or the impacts at its end
                        p = hits[i]
                        s = lanes.state if scheme == PLAIN else lanes.before
                        noise = Noise(
                            lanes.w[p] * math.sqrt(h), lanes.area[p] * math.sqrt(h / 12.0)
                        )
                        now = begin + h if scheme == PLAIN else begin
                        at = Progress(0, now, h, noise, s[0, p], s[1, p], s[2, p], s[3, p])
                        sticking += finish_inside(
                            scheme, job, n - multiple, level, p, at, phase, lanes, room, out, enough
                        )
                    work += live
                if next_fixed < fixed_steps.size and fixed_steps[next_fixed] == n:
                    for level in range(levels):
                        for p in range(live):
                            for i in range(4):
                                out.fixed[level, int(path[p]) - out.first, next_fixed, i] = (
                                    every.state[level, i, p]
                                )
                    next_fixed += 1
            if next_fixed == fixed_steps.size and linear == control.at_step.size:
                live = vector.retire(every, room, impacts, live)
        return work, sticking

    return run_block
