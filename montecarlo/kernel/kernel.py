"""The kernel: a block of paths through a scheme, steps in vector lanes, impacts one path at a
time."""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from rattle.montecarlo.kernel.mixture import BranchMixture, condition, weigh
from rattle.montecarlo.noise.backlash import Backlash, half_gap
from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.memory import Memory, color_noise
from rattle.montecarlo.noise.philox import STEP, Key, Word, fill_normals, fill_signs, fill_words
from rattle.montecarlo.noise.restitution import RandomRestitution, draw_restitution
from rattle.montecarlo.schemes import lanes as vector
from rattle.montecarlo.schemes.control_variate import LinearPath, carry_along
from rattle.montecarlo.schemes.lanes import Lanes, Room
from rattle.montecarlo.schemes.scheme import Scheme
from rattle.montecarlo.schemes.short_flight import Phase
from rattle.montecarlo.schemes.step_state import (
    LEFT,
    MOST_IN_A_STEP,
    Inside,
    Progress,
    Quiet,
    Scratch,
)
from rattle.montecarlo.schemes.sticking import add_closed, close_only, put_all
from rattle.montecarlo.schemes.wheel_noise import begin_alone, draw_alone
from rattle.scene import Constants, Floats, Ints
from rattle.scene.compiled import ZERO, lean, splice, widest_vectors
from rattle.scene.impact import rebound

Kernel = Callable[..., tuple[int, int]]
ENDLESS = 2**62  # impacts of a path that is followed beyond those that are recorded
FLANK_DRAWS = 4  # half gaps drawn at the start, of two wheels; the draws of the impacts follow

UNROLLED = 2
"""Most wheels that have a kernel of their own, in which loops over wheels are unrolled: impacts of
exact flights between two wheels take a fifth less time so, located ones of one wheel too."""


def columns_recorded(wheels: int) -> int:
    """Numbers that are recorded of an impact: tau, flight, the state, ``mesh * side``."""
    return 3 + 2 * wheels


class Job(NamedTuple):
    """Settings of a run for compiled code."""

    c: Constants  # of the scene
    backlash: Backlash  # half gaps and their tolerance
    key: Key  # of the random numbers
    dt: float  # finest step
    two_point: bool  # whether increments are two-point
    control: LinearPath  # carried along beside the finest level; empty for none
    mixture: BranchMixture  # from which paths are drawn, at one level; empty for plain paths
    restitution: RandomRestitution  # of slow impacts
    memory: Memory = Memory()  # of the noise, for the finest step; not used for white noise
    quiet: Quiet = Quiet()  # what of the motion at closed meshes is not followed


class Output(NamedTuple):
    """What a kernel writes for a block of paths; what is not reached stays as given."""

    first: int  # number of the first path
    rows: Floats  # the state just before each impact; (levels, paths, impacts, columns)
    # finest steps, multiples of the coarsest, after which states are recorded; ascending
    fixed_steps: Ints
    fixed: Floats  # those states; (levels, paths, times, 2 wheels)
    # section quantities of the linearised path, (paths, impacts, columns); or of a mixture the
    # weight of each impact, given the steps up to its own, and the noise up to there along each
    # unit vector, (paths, impacts, 1 + branches)
    controls: Floats


@splice
def record(
    job: Job,
    level: int,
    p: int,
    code: int,
    tau: float,
    lanes: Lanes,
    room: Room,
    scratch: Scratch,
    out: Output,
) -> None:
    """Record an impact of the path in lane p, and redraw the flank if impacts do."""
    k = lanes.impacts[p]
    path = room.path[p]
    states = 2 * scratch.wheels
    # after the sum of a step's pieces its end may be a rounding error late
    tau = max(tau, lanes.last[p])
    if k < out.rows.shape[2]:
        row = out.rows[level, int(path) - out.first, k]
        row[0] = tau
        row[1] = tau - lanes.last[p]
        for i in range(states):
            row[2 + i] = scratch.state[i]
        row[2 + states] = float(code)
    lanes.last[p] = tau
    lanes.impacts[p] = k + 1
    if job.backlash.redrawn:
        mesh = abs(code)
        opposite = 2 * mesh - 1 if code > 0 else 2 * mesh - 2
        draws = Word(max(FLANK_DRAWS, states))
        if lanes.walls[opposite, p] < math.inf:
            lanes.walls[opposite, p] = half_gap(job.backlash, job.key, path, Word(k) + draws, mesh)


@splice
def finish_inside(
    advance: Any,
    find_sticking: Any,
    stick_to_end: Any,
    has_area: bool,
    job: Job,
    step: int,
    level: int,
    p: int,
    at: Progress,
    phase: Phase,
    lanes: Lanes,
    room: Room,
    scratch: Scratch,
    out: Output,
    enough: int,
) -> bool:
    """Carry one path from `at` through its impacts to the end of the step; whether a mesh had to
    stay closed.

    `advance`, `find_sticking`, `stick_to_end`: Of the scheme. `enough`: Impacts after which it is
    not followed any further.  Its state is that of ``room.scratch``.
    """
    sticking = False
    states = 2 * scratch.wheels
    if has_area:
        for i in range(states):
            scratch.whole[i] = lanes.state[i, p]
    known = True
    forced = 0
    # meshes of several wheels chatter side by side; one or two in a row share their impacts
    most = MOST_IN_A_STEP * (scratch.wheels if scratch.wheels > 2 else 1)
    for met in range(most + 2):
        if at.left <= 0.0 or lanes.impacts[p] >= enough:
            break
        for i in range(states):
            scratch.walls[i] = lanes.walls[i, p]
        above = find_sticking(job.c, at, scratch, job.quiet)
        if met > most:
            close_only(forced, scratch)
            above = 0.0
        closed = above >= 0.0
        inside = Inside(job.c, job.key, room.path[p], step, level, known, closed, scratch)
        left = at.left
        at, phase = advance(inside, met, at, phase)
        known = False
        if closed:
            add_closed(room.closed, p, scratch, left - at.left, above)
            sticking = True
        if at.code == 0:
            continue
        if met > most:
            close_only(at.code, scratch)
            at = stick_to_end(job.c, at, scratch)
            sticking = True
            continue
        if met == most:
            forced = at.code
        else:
            record(job, level, p, at.code, at.tau, lanes, room, scratch, out)
            mesh = abs(at.code)
            epsilon = job.c.wheels[mesh - 1].epsilon
            if job.restitution.random:
                impact = lanes.impacts[p]
                path = room.path[p]
                epsilon = draw_restitution(job.restitution, job.key, path, impact, mesh)
            rebound(job.c, mesh, epsilon, scratch.state)
        at = Progress(0, at.tau, at.left, at.noise)
    for i in range(states):
        lanes.state[i, p] = scratch.state[i]
    return sticking


@splice
def draw_noise(has_area: bool, job: Job, n: int, room: Room, wide: int) -> tuple[Floats, Floats]:
    """The normals of step n of all lanes: of its increment, and of its area where a scheme has
    one."""
    z = room.z
    draws = 2 if has_area else 4  # steps per draw of four normals
    use = 0 if job.two_point else n % draws
    if not has_area and job.two_point and job.c.sigma != 0.0:
        if n % 64 == 0:
            fill_words(job.key, room.path, Word(n // 64), wide, room.bits)
        fill_signs(room.bits, n % 64, wide, z[0])
    elif use == 0 and job.c.sigma != 0.0:
        fill_normals(job.key, room.path, Word(n // draws), Word(STEP), wide, z)
    w = z[use * (4 // draws)]
    area = z[2 * use + 1 if has_area else 4]
    if job.c.memory > 0.0 and job.c.sigma != 0.0:
        color_noise(job.memory, room.eta, w, area, has_area, wide)
    return w, area


@splice
def carry_beside(
    job: Job,
    n: int,
    linear: int,
    room: Room,
    w: Floats,
    area: Floats,
    out: Output,
    live: int,
    wide: int,
) -> int:
    """Carry what goes beside the paths through step n: the linearised path, of which so many
    impacts are done, or what a mixture's increments depend on."""
    control = job.control
    if linear < control.at_step.size:
        linear = carry_along(
            control, n, linear, out.first, room.path, room.carried, w, area, out.controls, live
        )
    if n < job.mixture.unit.shape[1]:
        condition(job.mixture, n, w, room.carried, wide)
    return linear


@splice
def finish_marked(
    advance: Any,
    find_sticking: Any,
    stick_to_end: Any,
    at_end: bool,
    has_area: bool,
    job: Job,
    n: int,
    level: int,
    begin: float,
    phase: Phase,
    lanes: Lanes,
    room: Room,
    scratch: Scratch,
    out: Output,
    enough: int,
    live: int,
) -> int:
    """Carry the marked paths through the impacts of their step, the one that ends after n finest
    steps, from its start or `at_end`; returns in how many a mesh had to stay closed."""
    multiple = 1 << level
    h = job.dt * multiple
    now = begin + h if at_end else begin
    s = lanes.state if at_end else lanes.before
    sticking = ZERO
    for i in range(vector.list_marked(room.marks, live, room.groups, room.hits)):
        p = room.hits[i]
        noise = Noise(lanes.w[p] * math.sqrt(h), lanes.area[p] * math.sqrt(h / 12.0))
        at = Progress(0, now, h, noise)
        for j in range(2 * scratch.wheels):
            scratch.state[j] = s[j, p]
        if scratch.shaken:
            begin_alone(lanes.alone, p, h, scratch.intensity, scratch.alone)
        met = lanes.impacts[p]
        sticking += finish_inside(
            advance,
            find_sticking,
            stick_to_end,
            has_area,
            job,
            n - multiple,
            level,
            p,
            at,
            phase,
            lanes,
            room,
            scratch,
            out,
            enough,
        )
        if has_area and job.mixture.unit.shape[1] > 0 and lanes.impacts[p] > met:
            weights = out.controls[int(room.path[p]) - out.first, met : lanes.impacts[p]]
            weigh(job.mixture, n, room.carried, p, weights)
    return sticking


@splice
def record_states(every: Lanes, room: Room, out: Output, k: int, live: int) -> None:
    """Record the states of all paths at a fixed time."""
    for level in range(out.fixed.shape[0]):
        for p in range(live):
            for i in range(out.fixed.shape[3]):
                out.fixed[level, int(room.path[p]) - out.first, k, i] = every.state[level, i, p]


def kernel_of(c: Constants, scheme: Scheme) -> Kernel:
    """The kernel for a scene, compiled when it first runs."""
    special = c.wheels["stiffness"].any() or c.wheels["alone"].any()
    known = c.wheels.size <= UNROLLED and not special
    return block_kernel(scheme, c.wheels.size if known else 0)


@cache
def block_kernel(scheme: Scheme, wheels: int = 0) -> Kernel:
    """Kernel that follows a block of paths by one scheme; code of other schemes is not compiled in.

    It follows paths from tau on until they have had their impacts, or so many finest steps, at step
    sizes ``2**level dt`` on the same Brownian path; gives path-steps, and in how many a mesh stuck.
    """
    has_area = scheme.normals == 2
    at_end = scheme.detects_at_end
    step_lanes = scheme.step_lanes
    join_noise = scheme.join_noise
    phase_at = scheme.phase_at
    advance = scheme.advance
    find_sticking = scheme.find_sticking
    stick_to_end = scheme.stick_to_end

    def run_block(
        job: Job, tau: float, most_steps: int, every: Lanes, room: Room, out: Output
    ) -> tuple[int, int]:
        widest_vectors()
        levels, live, impacts, _ = out.rows.shape
        if wheels > 0 and job.c.wheels.size != wheels:
            return 0, 0  # never: it tells the compiler how many there are
        buffers = room.scratch
        scratch = Scratch(
            wheels if wheels > 0 else buffers.wheels,
            wheels == 0 and buffers.shaken,
            *buffers[2:],
        )
        put_all(scratch.choices[LEFT], 0)  # the constants may be others than before
        times = out.fixed_steps.size
        work = sticking = recorded = linear = n = ZERO
        while n < most_steps and live > 0:
            wide = (live + 7) // 8 * 8
            for _ in range(min(vector.CHUNK, most_steps - n)):
                w, area = draw_noise(has_area, job, n, room, wide)
                if scratch.shaken:
                    draw_alone(job.key, 2 if has_area else 4, n, room, wide, every.alone[0])
                if has_area:
                    linear = carry_beside(job, n, linear, room, w, area, out, live, wide)
                n += 1
                enough = ENDLESS if at_end or recorded < times else impacts
                for level in range(levels):
                    multiple = 1 << level
                    if level > 0:
                        if n % (multiple // 2) != 0:
                            break
                        whole = n % multiple == 0
                        join_noise(w, area, every.w[level], every.area[level], whole, wide)
                        for i in range(every.alone.shape[1]):
                            fine = every.alone[level - 1, i]
                            coarse = every.alone[level, i]
                            join_noise(fine[0], fine[1], coarse[0], coarse[1], whole, wide)
                        w = every.w[level]
                        area = every.area[level]
                        if not whole:
                            break
                    lanes = vector.of_level(every, level, w, area)
                    h = job.dt * multiple
                    begin = tau + (n - multiple) * job.dt
                    step_lanes(
                        job.c,
                        begin,
                        h,
                        job.backlash.uneven,
                        lanes,
                        scratch,
                        room.marks,
                        wide,
                    )
                    sticking += finish_marked(
                        advance,
                        find_sticking,
                        stick_to_end,
                        at_end,
                        has_area,
                        job,
                        n,
                        level,
                        begin,
                        phase_at(job.c.drive, begin),
                        lanes,
                        room,
                        scratch,
                        out,
                        enough,
                        live,
                    )
                    work += live
                if recorded < times and out.fixed_steps[recorded] == n:
                    record_states(every, room, out, recorded, live)
                    recorded += 1
            if recorded == times and linear == job.control.at_step.size:
                live = vector.retire(every, room, impacts, live)
        return work, sticking

    return lean(run_block, by_address=True)
