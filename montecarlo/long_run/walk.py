"""Paths followed without end: the kernel of `simulate`, then the sums, a stretch of steps at a
time.

A block of paths goes through the compiled kernel of the exact flights for a part of a period; its
impacts are added to sums, and it goes on.  Many stretches are one call, over which its overhead is
spread.  A stretch has random numbers of its own: in stretch s path p has the number ``s 2^32 + p``.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from rattle.montecarlo.kernel.block import Plan, begin_block
from rattle.montecarlo.kernel.kernel import Job, Output, columns_recorded, kernel_of
from rattle.montecarlo.long_run.noise_work import add_noise_work, has_controls
from rattle.montecarlo.long_run.sums import NOISE, SAMPLES, Sums, add_left_out, add_stretch
from rattle.montecarlo.noise.philox import Word
from rattle.montecarlo.schemes.exact_flight import EXACT
from rattle.montecarlo.schemes.lanes import Lanes, Room
from rattle.montecarlo.schemes.step_size import default_step
from rattle.montecarlo.schemes.step_state import Quiet
from rattle.montecarlo.schemes.time_scales import time_scales
from rattle.scene import Constants, Floats, Ints, Scene
from rattle.scene.compiled import as_argument, jit
from rattle.scene.drive import PERIOD
from rattle.scene.linear_algebra import put, put_row

WALK_LANES = 128
"""Paths of a block: what all paths of a step share is computed once for so many."""
# impacts of a path in a stretch for which there is space at first: little space stays in the cache
IMPACT_ROOM = 33
MOST_STRETCHES_OF_A_PERIOD = 8  # stretches of a period at the most
STRETCHES_APART = 2**32  # between the numbers of a path in two stretches
MANY_IMPACTS = 256  # impacts of a path in a stretch from which on stretches become shorter
ALL_FOLLOWED = Quiet()  # the whole motion at closed meshes
BEGIN, PERIODS, STRETCHES, LONG = range(4)
"""Entries of `Block.counters`: step of the period at which the next stretch begins; periods and
stretches followed so far; stretches of the period in which a path had very many impacts."""


class Block(NamedTuple):
    """A block of paths that is followed without end."""

    job: Job  # settings
    tau: float  # time at which every period begins
    controls: bool  # whether the noise's work is summed
    first: int  # first, steps: number of the first path, and of steps in a period
    steps: int
    every: Lanes  # every, room: paths side by side, and buffers
    room: Room
    state: Floats  # states at the end of the last stretch; (paths, 2 wheels)
    struck: Floats  # time of the last impact at each mesh; (paths, wheels)
    # buffer of recorded states.  One more than is used: at powers of two, paths would share lines
    # of the cache; (1, paths, samples + 1, 2 wheels)
    samples: Floats
    none: Floats  # output of no control variate; (0, 1, columns)
    counters: Ints  # of what `BEGIN` to `LONG` say


def impacts_of(rows: Floats, impacts: Ints, struck: Floats) -> Floats:
    """The impacts of a stretch one below the other, path by path.

    Returns: Mesh, time since the last impact and since the last one at this mesh, velocity at this
    mesh. Shapes: `rows` (paths, impacts or more, columns); `impacts` (paths,); `struck` (paths,
    wheels); result (impacts, 4).
    """
    happened = np.arange(rows.shape[1]) < impacts[:, None]
    path, _ = np.nonzero(happened)
    seen = rows[happened]
    mesh = np.abs(seen[:, -1]).astype(int)
    since = np.empty(len(seen))
    for i in range(struck.shape[1]):
        here = np.flatnonzero(mesh == i + 1)
        times = seen[here, 0]
        is_first = np.diff(path[here], prepend=-1) != 0
        since[here] = times - np.where(is_first, struck[path[here], i], np.roll(times, 1))
    velocity = seen[np.arange(len(seen)), 2 * mesh + 1]
    return np.column_stack([mesh, seen[:, 1], since, velocity])


@jit
def follow_stretches(
    run: Any,
    b: Block,
    rows: Floats,
    fixed: Ints,
    stretches: int,
    until: int,
    length: int,
    sums: Sums,
) -> int:
    """Follow a block for some stretches; in loops, for numba's own sums and copies take seconds to
    compile.

    `run`: The kernel. `fixed`: Steps of a stretch after which states are recorded, and one beyond
    its end: the kernel retires no path before all are past, and a path that it retires is
    overwritten by another. `stretches`, `until`, `length`: Stretches to follow at most, the number
    of periods to end at: the end of a batch, and the periods of a batch. Returns: 0; or, where a
    path had more impacts in a stretch than there is space for, how many.  The block is then as
    before that stretch. Shapes: `rows` (1, paths, impacts, columns).
    """
    count = b.counters
    job = b.job
    every = b.every
    room = b.room
    state = b.state
    struck = b.struck
    flanks = every.walls[0]
    samples = fixed.size - 1
    part = fixed[samples - 1]
    between = fixed[0] * job.dt
    paths = len(state)
    impacts = every.impacts[0, :paths]
    lacking = 0
    for _ in range(stretches):
        if count[PERIODS] == until:
            break
        tau = b.tau + count[BEGIN] * job.dt
        number = count[STRETCHES] * STRETCHES_APART + b.first
        for i in range(room.path.size):
            room.path[i] = Word(number + i)
        walls = flanks.copy()
        last = every.last.copy()
        eta = room.eta.copy()
        every.impacts[:] = 0
        room.closed[:] = 0.0
        run(job, tau, part, every, room, Output(number, rows, fixed, b.samples, b.none))
        most = 0
        for p in range(paths):
            most = max(most, impacts[p])
        if most >= rows.shape[2]:
            put(flanks, walls)
            put(every.last, last)
            put_row(room.eta, eta)
            put(every.state[0, :, :paths], state.T)
            lacking = most
            break
        states = b.samples[0, :, :samples]
        at = tau + between
        if b.controls and len(sums.power) > 0:
            out = sums.main[:, sums.batch[0], NOISE:]
            add_noise_work(job.c, rows[0], impacts, state, states, at, between, out)
        put(state, states[:, samples - 1])
        add_stretch(job.c, rows[0], impacts, struck, states, flanks, at, between, sums)
        add_left_out(room.closed, sums)
        count[STRETCHES] += 1
        count[BEGIN] += part
        count[LONG] += most >= MANY_IMPACTS
        if count[BEGIN] == b.steps:
            count[BEGIN] = 0
            count[PERIODS] += 1
            for p in range(every.last.shape[1]):
                every.last[0, p] -= PERIOD
            for p in range(paths):
                for mesh in range(struck.shape[1]):
                    struck[p, mesh] -= PERIOD
            if (until - count[PERIODS]) % length == 0:
                sums.batch[0] += 1
            if count[LONG] > 0:
                break
    return int(lacking)


def steps_per_period(scene: Scene) -> int:
    """Steps in a period of the excitation, a multiple of `SAMPLES`: those of exact flights or a
    little shorter."""
    return SAMPLES * math.ceil(PERIOD / default_step(scene, "exact-flight") / SAMPLES - 1e-9)


def _spread_starts(
    scene: Scene, state: Floats, walls: Floats, seed: np.random.SeedSequence, first: int
) -> None:
    """Put all paths but path 0, which has the scene's own start, anywhere between their walls, or
    in the size of a body before the one that it has.

    What all paths have in common at the end is then not what they had in common at the start.

    Shapes: `state`, `walls` (2 wheels, paths).
    """
    others = slice(1 if first == 0 else 0, None)
    size = scene.constants.wheels["size"]
    speed = float(size.min()) / time_scales(scene).crossing
    speed = speed if 0.0 < speed < math.inf else 1.0
    rng = np.random.default_rng(np.random.SeedSequence([*seed.generate_state(4), first]))
    u = rng.uniform(size=walls.shape)
    high = walls[0::2]
    low = np.minimum(walls[1::2], size[:, None])
    state[0::2, others] = (-low + (0.01 + 0.98 * u[0::2]) * (high + low))[:, others]
    state[1::2, others] = (speed * (2.0 * u[1::2] - 1.0))[:, others]


class Walk:
    """A block of paths, followed as long as wanted; `first`: number of the first path; `steps`: in
    a period."""

    def __init__(
        self,
        scene: Scene,
        seed: np.random.SeedSequence,
        first: int,
        paths: int,
        quiet: Quiet = ALL_FOLLOWED,
    ) -> None:
        self.first = first
        self.paths = paths
        self.steps = steps_per_period(scene)
        self._columns = columns_recorded(scene.stages)
        dt = PERIOD / self.steps
        plan = Plan(scene, paths, 0, dt, "exact-flight", seed, 0, np.empty(0, np.int64), {}, 1)
        job, every, room = begin_block(plan, first, paths)
        state = every.state[0, :, :paths]
        _spread_starts(scene, state, every.walls[0, :, :paths], seed, first)
        self._block = Block(
            job=job._replace(quiet=quiet),
            tau=scene.phase,
            controls=has_controls(scene.constants),
            first=first,
            steps=self.steps,
            every=every,
            room=room,
            state=state.T.copy(),
            struck=np.full((paths, scene.stages), scene.phase),
            samples=np.empty((1, paths, SAMPLES + 1, 2 * scene.stages)),
            none=np.zeros((0, 1, self._columns)),
            counters=np.zeros(4, np.int64),
        )
        self._fixed = self._instants(self.steps)
        self._rows = np.empty((1, paths, IMPACT_ROOM, self._columns))
        b = self._block
        out = Output(first, self._rows, self._fixed, b.samples, b.none)
        kernel = kernel_of(job.c, EXACT)
        self._run = as_argument(kernel, b.job, b.tau, self.steps, every, room, out)

    def leave_out(self, most: float) -> None:
        """Hold meshes closed from now on while impacts that are not slow have at most this rate
        there."""
        job = self._block.job
        self.change_constants(job.c, job.quiet._replace(most=most))

    @property
    def periods(self) -> int:
        """Periods followed so far."""
        return int(self._block.counters[PERIODS])

    def follow(
        self, sums: Sums, periods: int = 1, length: int = 1, seen: list[Floats] | None = None
    ) -> None:
        """Follow all paths for some periods, batches of a given length, and add what they do.

        `seen`: Takes every impact.
        """
        b = self._block
        rows = self._rows
        until = self.periods + periods
        batch = sums.batch[0]
        while self.periods < until:
            at_once = (
                MOST_STRETCHES_OF_A_PERIOD * periods if seen is None and rows is self._rows else 1
            )
            struck = b.struck.copy()
            most = follow_stretches(self._run, b, rows, self._fixed, at_once, until, length, sums)
            if most:  # again with the same random numbers, and space for all impacts
                rows = np.empty((1, self.paths, 2 * most, self._columns))
                continue
            if seen is not None:
                impacts = b.every.impacts[0, : self.paths]
                seen.append(impacts_of(rows[0], impacts, struck))
            if rows.shape[2] < MANY_IMPACTS:
                self._rows = rows  # from now on
            rows = self._rows
            if b.counters[BEGIN] == 0:
                self._shorten()
        sums.batch[0] = batch

    def change_constants(self, constants: Constants, quiet: Quiet) -> None:
        """Follow all paths with other constants from here on; their states stay as they are.

        `quiet`: What of the motion at closed meshes is not followed any longer.
        """
        job = self._block.job._replace(c=constants, quiet=quiet)
        self._block = self._block._replace(job=job)

    def _shorten(self) -> None:
        """Take shorter stretches from the next period on if some of this period had very many
        impacts.

        What happens in a stretch must not choose its own end.
        """
        part = int(self._fixed[-2])
        least = self.steps // MOST_STRETCHES_OF_A_PERIOD
        for _ in range(int(self._block.counters[LONG])):
            part = part // 2 if part > least else part
        self._block.counters[LONG] = 0
        self._fixed = self._instants(part)

    def _instants(self, part: int) -> Ints:
        """Steps of a stretch at which states are recorded, and one beyond its end."""
        apart = self.steps // SAMPLES
        return np.append(np.arange(apart, part + 1, apart), part + 1)
