"""Paths followed without end: the kernel of `simulate`, then the sums, a stretch of steps at a
time.

A block of paths goes through the compiled kernel of the exact flights for a part of a period; its
impacts are added to sums, and it goes on.  A stretch has random numbers of its own: in stretch s
path p has the number ``s 2^32 + p``.
"""

import math

import numpy as np

from rattle.montecarlo.kernel.block import Plan, begin_block
from rattle.montecarlo.kernel.kernel import Output, columns_recorded, kernel_of
from rattle.montecarlo.long_run.noise_work import add_noise_work, has_controls
from rattle.montecarlo.long_run.sums import NOISE, SAMPLES, Sums, add_left_out, add_stretch
from rattle.montecarlo.schemes.exact_flight import EXACT
from rattle.montecarlo.schemes.step_size import default_step
from rattle.montecarlo.schemes.step_state import Quiet
from rattle.montecarlo.schemes.time_scales import time_scales
from rattle.scene import Constants, Floats, Ints, Scene
from rattle.scene.compiled import jit
from rattle.scene.drive import PERIOD

WALK_LANES = 128
"""Paths of a block: what all paths of a step share is computed once for so many."""
# impacts of a path in a stretch for which there is space at first: little space stays in the cache
IMPACT_ROOM = 33
MOST_STRETCHES_OF_A_PERIOD = 8  # stretches of a period at the most
STRETCHES_APART = 2**32  # between the numbers of a path in two stretches
MANY_IMPACTS = 256  # impacts of a path in a stretch from which on stretches become shorter
ALL_FOLLOWED = Quiet()  # the whole motion at closed meshes


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
def _add_stretch(
    c: Constants,
    rows: Floats,
    impacts: Ints,
    struck: Floats,
    before: Floats,
    samples: Floats,
    n: int,
    walls: Floats,
    closed: Floats,
    tau: float,
    apart: float,
    controls: bool,
    sums: Sums,
) -> None:
    """Add a stretch to the sums of each path.

    `rows` to `sums`: As of `rattle.montecarlo.long_run.sums.add_stretch`. `before`: States at its
    start, (paths, 2 wheels). `samples`: States after it began, of which the first n of each path
    count. `closed`: As of `rattle.montecarlo.long_run.sums.add_left_out`. `controls`: Whether the
    noise's work is summed.
    """
    states = samples[:, :n]
    if controls and len(sums.power) > 0:
        out = sums.main[:, sums.batch[0], NOISE:]
        add_noise_work(c, rows, impacts, before, states, tau, apart, out)
    add_stretch(c, rows, impacts, struck, states, walls, tau, apart, sums)
    add_left_out(closed, sums)


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
        self.periods = 0  # followed so far
        self._columns = columns_recorded(scene.stages)
        dt = PERIOD / self.steps
        plan = Plan(scene, paths, 0, dt, "exact-flight", seed, 0, np.empty(0, np.int64), {}, 1)
        job, every, room = begin_block(plan, first, paths)
        state = every.state[0, :, :paths]
        _spread_starts(scene, state, every.walls[0, :, :paths], seed, first)
        self._kernel = kernel_of(job.c, EXACT)
        self._job = job._replace(quiet=quiet)
        self._every = every  # paths side by side
        self._room = room
        self._phase = scene.phase  # time at which every period begins
        self._controls = has_controls(scene.constants)
        self._state = state.T.copy()  # at the end of the last stretch; (paths, 2 wheels)
        # time of the last impact at each mesh; (paths, wheels)
        self._struck = np.full((paths, scene.stages), scene.phase)
        self._begin = 0  # step of the period at which the next stretch begins
        self._stretches = 0  # followed so far
        self._long = 0  # stretches of the period in which a path had very many impacts
        # buffers: one sample more than is used, for at powers of two paths would share lines of
        # the cache
        self._samples = np.empty((1, paths, SAMPLES + 1, 2 * scene.stages))
        self._rows = np.empty((1, paths, IMPACT_ROOM, self._columns))
        self._fixed = self._instants(self.steps)

    def leave_out(self, most: float) -> None:
        """Hold meshes closed from now on while impacts that are not slow have at most this rate
        there."""
        self.change_constants(self._job.c, self._job.quiet._replace(most=most))

    def change_constants(self, constants: Constants, quiet: Quiet) -> None:
        """Follow all paths with other constants from here on; their states stay as they are.

        `quiet`: What of the motion at closed meshes is not followed any longer.
        """
        self._job = self._job._replace(c=constants, quiet=quiet)

    def follow(
        self, sums: Sums, periods: int = 1, length: int = 1, seen: list[Floats] | None = None
    ) -> None:
        """Follow all paths for some periods, batches of a given length, and add what they do.

        `seen`: Takes every impact.
        """
        until = self.periods + periods
        batch = sums.batch[0]
        while self.periods < until:
            struck = self._struck.copy()
            rows = self._follow_stretch(sums)
            if seen is not None:
                seen.append(impacts_of(rows, self._every.impacts[0, : self.paths], struck))
            if self._begin == self.steps:
                self._end_period()
                if (until - self.periods) % length == 0:
                    sums.batch[0] += 1
        sums.batch[0] = batch

    def _follow_stretch(self, sums: Sums) -> Floats:
        """Follow all paths for a stretch, and add what they do; their impacts, shape (paths,
        impacts, columns)."""
        job = self._job
        tau = self._phase + self._begin * job.dt
        rows = self._run_kernel(tau)
        samples = self._fixed.size - 1
        between = self._fixed[0] * job.dt
        impacts = self._every.impacts[0, : self.paths]
        _add_stretch(
            job.c,
            rows,
            impacts,
            self._struck,
            self._state,
            self._samples[0],
            samples,
            self._every.walls[0],
            self._room.closed,
            tau + between,
            between,
            self._controls,
            sums,
        )
        self._state[:] = self._samples[0, :, samples - 1]
        self._stretches += 1
        self._begin += int(self._fixed[-2])
        self._long += impacts.max() >= MANY_IMPACTS
        return rows

    def _run_kernel(self, tau: float) -> Floats:
        """Run the kernel over a stretch, again with the same random numbers and space for all
        impacts where a path had too many; the impacts, shape (paths, impacts, columns)."""
        every = self._every
        room = self._room
        impacts = every.impacts[0, : self.paths]
        number = self._stretches * STRETCHES_APART + self.first
        room.path[:] = np.arange(number, number + room.path.size, dtype=np.uint64)
        walls = every.walls[0].copy()
        last = every.last.copy()
        eta = room.eta.copy()
        none = np.zeros((0, 1, self._columns))  # of control variates
        rows = self._rows
        while True:
            every.impacts[:] = 0
            room.closed[:] = 0.0
            out = Output(number, rows, self._fixed, self._samples, none)
            self._kernel(self._job, tau, int(self._fixed[-2]), every, room, out)
            most = int(impacts.max())
            if most < rows.shape[2]:
                break
            every.walls[0] = walls
            every.last[:] = last
            room.eta[:] = eta
            every.state[0, :, : self.paths] = self._state.T
            rows = np.empty((1, self.paths, 2 * most, self._columns))
        if rows.shape[2] < MANY_IMPACTS:
            self._rows = rows  # from now on
        recorded: Floats = rows[0]
        return recorded

    def _end_period(self) -> None:
        """Begin the next period, in shorter stretches if some of this one had very many impacts.

        What happens in a stretch must not choose its own end.
        """
        self.periods += 1
        self._begin = 0
        self._every.last[0] -= PERIOD
        self._struck -= PERIOD
        part = int(self._fixed[-2])
        least = self.steps // MOST_STRETCHES_OF_A_PERIOD
        for _ in range(self._long):
            part = part // 2 if part > least else part
        self._long = 0
        self._fixed = self._instants(part)

    def _instants(self, part: int) -> Ints:
        """Steps of a stretch after which states are recorded, and one beyond its end.

        The kernel retires no path before all are past, and a path that it retires is overwritten
        by another.
        """
        apart = self.steps // SAMPLES
        return np.append(np.arange(apart, part + 1, apart), part + 1)
