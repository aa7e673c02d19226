"""Paths followed without end: the kernel of `simulate`, then the sums, a stretch of steps at a
time.

A block of paths goes through the compiled kernel of the exact flights for a part of a period; its
impacts are added to sums, and it goes on.  A stretch has random numbers of its own: in stretch s
path p has the number ``s 2^32 + p``.
"""

import math

import numpy as np

from rattle.montecarlo.kernel.block import Plan, begin_block
from rattle.montecarlo.kernel.kernel import COLUMNS, Output, block_kernel
from rattle.montecarlo.long_run.noise_work import has_controls
from rattle.montecarlo.long_run.sums import PERIOD, SAMPLES, Sums, add_stretch
from rattle.montecarlo.noise.philox import Word
from rattle.montecarlo.schemes.exact_flight import EXACT
from rattle.montecarlo.schemes.step_size import default_step
from rattle.montecarlo.schemes.time_scales import time_scales
from rattle.scene import Floats, Ints, Scene
from rattle.scene.compiled import jit

LANES = 128
"""Paths of a block: what all paths of a step share is computed once for so many."""
# impacts of a path in a stretch for which there is space at first: little space stays in the cache
ROOM = 33
SHORTEST = 8  # stretches of a period at the most
APART = 2**32  # between the numbers of a path in two stretches
MANY = 256  # impacts of a path in a stretch from which on stretches become shorter


@jit
def impacts_of(rows: Floats, impacts: Ints, struck: Floats) -> Floats:
    """The impacts of a stretch one below the other.

    Returns: Mesh, time since the last impact and since the last one at this mesh, velocity at this
    mesh. Shapes: result (impacts, 4).
    """
    out = np.empty((impacts.sum(), 4))
    n = 0
    for p in range(len(rows)):
        for k in range(impacts[p]):
            mesh = int(abs(rows[p, k, 6]))
            tau = rows[p, k, 0]
            out[n, 0] = mesh
            out[n, 3] = rows[p, k, 2 * mesh + 1]
            out[n, 1] = tau - max(struck[p, 0], struck[p, 1])
            out[n, 2] = tau - struck[p, mesh - 1]
            struck[p, mesh - 1] = tau
            n += 1
    return out


def steps_per_period(scene: Scene) -> int:
    """Steps in a period of the excitation, a multiple of `SAMPLES`: those of exact flights or a
    little shorter."""
    return SAMPLES * math.ceil(PERIOD / default_step(scene, "exact-flight") / SAMPLES - 1e-9)


def _spread_starts(
    scene: Scene, state: Floats, walls: Floats, seed: np.random.SeedSequence, first: int
) -> None:
    """Put all paths but path 0, which has the scene's own start, anywhere between their walls.

    What all paths have in common at the end is then not what they had in common at the start.

    Shapes: `state`, `walls` (4, paths).
    """
    c = scene.constants
    others = slice(1 if first == 0 else 0, None)
    speed = min(c.wall1, c.wall2 if scene.stages == 2 else c.wall1) / time_scales(scene).crossing
    speed = speed if 0.0 < speed < math.inf else 1.0
    rng = np.random.default_rng(np.random.SeedSequence([*seed.generate_state(4), first]))
    u = rng.uniform(size=(4, walls.shape[1]))
    for stage in range(scene.stages):
        high = walls[2 * stage]
        low = walls[2 * stage + 1]
        state[2 * stage, others] = (-low + (0.01 + 0.98 * u[2 * stage]) * (high + low))[others]
        state[2 * stage + 1, others] = (speed * (2.0 * u[2 * stage + 1] - 1.0))[others]


class Walk:
    """A block of paths, followed as long as wanted; `steps`: in a period; `periods`: followed so
    far."""

    def __init__(self, scene: Scene, seed: np.random.SeedSequence, first: int, paths: int) -> None:
        self.paths = paths
        self.steps = steps_per_period(scene)
        self.periods = 0
        plan = Plan(
            scene,
            paths,
            0,
            PERIOD / self.steps,
            "exact-flight",
            seed,
            0,
            np.empty(0, np.int64),
            {},
            1,
        )
        self._first = first
        self._job, self._every, self._room = begin_block(plan, first, paths)
        lanes = self._every.state[0, :, :paths]
        _spread_starts(scene, lanes, self._every.walls[0, :, :paths], seed, first)
        self._state = lanes.T.copy()  # at the end of the last stretch
        self._struck = np.full((paths, 2), scene.phase)  # time of the last impact at each mesh
        self._has_controls = has_controls(scene.constants)
        # recorded states.  One more than is used: at powers of two, paths would share lines of the
        # cache
        self._samples = np.empty((1, paths, SAMPLES + 1, 4))
        self._rows = np.empty((1, paths, ROOM, COLUMNS))
        self._no_controls = np.zeros((0, 1, COLUMNS))
        self._begin = 0  # step of the period at which the next stretch begins
        self._stretches = 0  # followed so far
        self._long = 0  # stretches of the period in which a path had very many impacts
        self._fixed = self._instants(self.steps)

    def follow(
        self, sums: Sums, periods: int = 1, length: int = 1, seen: list[Floats] | None = None
    ) -> None:
        """Follow all paths for some periods, batches of a given length, and add what they do.

        `seen`: Takes every impact.
        """
        until = self.periods + periods
        batch = sums.batch[0]
        while self.periods < until:
            rows = self._follow_stretch()
            impacts = self._every.impacts[0, : self.paths]
            if seen is not None:
                seen.append(impacts_of(rows, impacts, self._struck.copy()))
            self._add(rows, impacts, sums)
            if self._begin == 0 and (until - self.periods) % length == 0:
                sums.batch[0] += 1
        sums.batch[0] = batch

    def _follow_stretch(self) -> Floats:
        """Follow all paths for a stretch; their impacts, in space for all of them.

        Shapes: result (paths, impacts or more, COLUMNS).
        """
        every = self._every
        samples = self._fixed.size - 1
        first = self._stretches * APART + self._first
        self._room.path[:] = np.arange(first, first + self._room.path.size, dtype=Word)
        job = self._job._replace(tau=self._time(), most_steps=int(self._fixed[samples - 1]))
        rows = self._rows
        kept = every.walls[0], every.last[0], self._room.eta
        before = [values.copy() for values in kept]
        while True:
            every.impacts.fill(0)
            out = Output(first, rows, self._fixed, self._samples, self._no_controls)
            block_kernel(EXACT)(job, every, self._room, out)
            most = int(every.impacts[0, : self.paths].max())
            if most < rows.shape[2]:
                break
            # again with the same random numbers, and space for all impacts
            rows = np.empty((1, self.paths, 2 * most, COLUMNS))
            every.state[0, :, : self.paths] = self._state.T
            for values, start in zip(kept, before, strict=True):
                values[:] = start
        if rows.shape[2] < MANY:
            self._rows = rows  # from now on
        self._long += most >= MANY
        return np.asarray(rows[0])

    def _time(self) -> float:
        """Time at which the next stretch begins, since the period's start is the scene's."""
        return float(self._job.tau + self._begin * self._job.dt)

    def _add(self, rows: Floats, impacts: Ints, sums: Sums) -> None:
        """Add a stretch to the sums, and go on to the next."""
        part = int(self._fixed[-2])
        between = self._fixed[0] * self._job.dt
        states = self._samples[0, :, : self._fixed.size - 1]
        add_stretch(
            self._job.c,
            rows,
            impacts,
            self._state,
            self._struck,
            states,
            self._every.walls[0],
            self._time() + between,
            between,
            self._has_controls,
            sums,
        )
        self._state[:] = states[:, -1]
        self._stretches += 1
        self._begin += part
        if self._begin == self.steps:
            self._begin = 0
            self.periods += 1
            self._every.last[0] -= PERIOD
            self._struck -= PERIOD
            self._shorten(part)

    def _shorten(self, part: int) -> None:
        """Take shorter stretches from the next period on if some of this period had very many
        impacts.

        What happens in a stretch must not choose its own end.
        """
        least = self.steps // SHORTEST
        for _ in range(self._long):
            part = part // 2 if part > least else part
        self._long = 0
        self._fixed = self._instants(part)

    def _instants(self, part: int) -> Ints:
        """Steps of a stretch after which states are recorded, and one beyond its end.

        The kernel retires no path before all are past, and a path that it retires is overwritten by
        another.
        """
        apart = self.steps // SAMPLES
        return np.append(np.arange(apart, part + 1, apart), part + 1)
