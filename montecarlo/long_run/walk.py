"""Paths followed without end: the kernel of `simulate`, a stretch of steps at a time.

A block of paths goes through the compiled kernel of the exact flights for a part of a period; its impacts are added to
sums, and it goes on.  A stretch has random numbers of its own: in stretch s path p has the number ``s 2^32 + p``.
Of the fixed times that the kernel is given, the last is beyond the end: it retires no path before all fixed times are
past, and a path that it retires is overwritten by another.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.block import start_state
from rattle.montecarlo.kernel.control_variate import no_control
from rattle.montecarlo.kernel.kernel import COLUMNS, EXACT, Job, block_kernel
from rattle.montecarlo.kernel.lanes import lanes_of
from rattle.montecarlo.long_run.noise_work import add_noise_work, has_controls
from rattle.montecarlo.long_run.pilot import impacts_of
from rattle.montecarlo.long_run.sums import NOISE, Sums, add_stretch
from rattle.montecarlo.noise.backlash import backlash_of, draw_walls
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.schemes.step_size import default_step, scales_of
from rattle.scene.scene import Scene

__all__ = ["LANES", "PERIOD", "SAMPLES", "Walk", "steps_per_period"]

Floats = NDArray[np.float64]

PERIOD = 2.0 * math.pi
LANES = 128
"""Paths of a block: what all paths of a step share is computed once for so many."""
SAMPLES = 64
"""Instants of a period at which states are taken for averages over time."""
APART = 2**32  # between the numbers of a path in two stretches
ROOM = 32  # impacts of a path in a stretch for which there is space at first: little space stays in the cache
MANY = 256  # impacts of a path in a stretch from which on stretches become shorter
SHORTEST = 8  # stretches of a period at the most


def steps_per_period(scene: Scene) -> int:
    """Steps in a period of the excitation: the default step of exact flights or a little less, a multiple of `SAMPLES`.

    Parameters
    ----------
    scene : Scene
        What is simulated.

    Returns
    -------
    int

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> steps_per_period(Scene.from_gears(DAT21, sigma=0.1))
    192
    """
    return SAMPLES * math.ceil(PERIOD / default_step(scene, "exact-flight") / SAMPLES - 1e-9)


def _spread_starts(scene: Scene, walls: Floats, seed: np.random.SeedSequence, first: int) -> Floats:
    """Initial states, shape (4, paths): the scene's own for path 0, all others anywhere between the walls.

    What all paths have in common at the end is then not what they had in common at the start.
    """
    own = start_state(scene, walls)
    c = scene.constants
    speed = min(c.wall1, c.wall2 if scene.stages == 2 else c.wall1) / scales_of(scene).crossing
    speed = speed if 0.0 < speed < math.inf else 1.0
    rng = np.random.default_rng(np.random.SeedSequence([*seed.generate_state(4), first]))
    u = rng.uniform(size=(4, walls.shape[1]))
    out = own.copy()
    for stage in range(scene.stages):
        high, low = walls[2 * stage], walls[2 * stage + 1]
        out[2 * stage] = -low + (0.01 + 0.98 * u[2 * stage]) * (high + low)
        out[2 * stage + 1] = speed * (2.0 * u[2 * stage + 1] - 1.0)
    if first == 0:
        out[:, 0] = own[:, 0]
    return out


class Walk:
    """A block of paths, followed as long as wanted.

    Parameters
    ----------
    scene : Scene
        What is simulated.
    seed : SeedSequence
        Of all random numbers.
    first, paths : int
        Number of the first path, and of paths.

    Attributes
    ----------
    steps : int
        In a period.
    periods : int
        Followed so far.
    stretches : int
        Stretches followed so far.
    """

    def __init__(self, scene: Scene, seed: np.random.SeedSequence, first: int, paths: int) -> None:
        c = scene.constants
        self.paths, self.first, self.steps = paths, first, steps_per_period(scene)
        backlash, key = backlash_of(scene), key_of(seed)
        walls = np.repeat([[c.wall1], [c.wall1], [c.wall2], [c.wall2]], paths, axis=1)
        if backlash.random:
            draw_walls(backlash, key, first, walls)
        self.dt = PERIOD / self.steps
        self._job = Job(c, backlash, key, scene.phase, self.dt, EXACT, False, 0)
        starts = _spread_starts(scene, walls, seed, first)
        self._controls, self._state = has_controls(c), starts.T.copy()  # state at the end of the last stretch
        self._every, self._room = lanes_of(1, first, starts, walls, scene.phase)
        self._struck = np.full((paths, 2), scene.phase)  # time of the last impact at each mesh
        self.periods, self.stretches, self._part = 0, 0, self.steps
        self._rows, self._states = np.empty((1, paths, ROOM, COLUMNS)), np.empty((1, paths, SAMPLES, 4))

    def follow(self, sums: Sums, detail: bool, seen: list[Floats] | None = None) -> None:
        """Follow all paths for a period, and add what they do.

        Parameters
        ----------
        sums : Sums
            To be added to.
        detail : bool
            Whether distributions and the section are counted too.
        seen : list, optional
            Impacts are appended to it, as of `rattle.montecarlo.long_run.pilot.impacts_of`.
        """
        part = self._part  # steps of a stretch, fixed before it begins: what happens in it must not choose it
        for begin in range(0, self.steps, part):
            self._shorten(self._stretch(begin, part, sums, detail, seen))
        self._every.last[0] -= PERIOD
        self._struck -= PERIOD
        self.periods += 1

    def _shorten(self, most: int) -> None:
        """Take shorter stretches from the next period on if one of this period had very many impacts."""
        if most >= MANY and self._part > self.steps // SHORTEST:
            self._part //= 2

    def _stretch(self, begin: int, steps: int, sums: Sums, detail: bool, seen: list[Floats] | None) -> int:
        """One stretch; returns the most impacts of a path in it."""
        every = self._every
        before = [array.copy() for array in every]
        every.impacts[:] = 0
        tau, first = self._job.tau + begin * self.dt, self.stretches * APART + self.first
        self._room.path[:] = np.arange(first, first + self._room.path.size, dtype=np.uint64)
        job = self._job._replace(tau=tau, most_steps=steps)
        apart = self.steps // SAMPLES
        at = np.arange(apart, steps + 1, apart)
        if self._states.shape[2] != at.size:
            self._states = np.empty((1, self.paths, at.size, 4))
        states, fixed = self._states, np.append(at, steps + 1)
        run = block_kernel(EXACT)
        run(job, no_control(), first, every, self._room, self._rows, fixed, states, NO_CONTROLS)
        most = int(every.impacts[0, : self.paths].max())
        if most >= self._rows.shape[2]:  # again with the same random numbers, and space for all impacts
            for array, old in zip(every, before, strict=True):
                array[...] = old
            every.impacts[:] = 0
            self._room.path[:] = np.arange(first, first + self._room.path.size, dtype=np.uint64)
            rows = np.empty((1, self.paths, 2 * most, COLUMNS))
            run(job, no_control(), first, every, self._room, rows, fixed, states, NO_CONTROLS)
            if 2 * most < MANY:
                self._rows = rows  # from now on
        else:
            rows = self._rows
        if seen is not None:
            seen.append(impacts_of(rows[0], every.impacts[0], self._struck.copy()))
        c, own, first_at, dt = self._job.c, every.impacts[0], tau + apart * self.dt, apart * self.dt
        if detail and self._controls:
            out = sums.main[:, sums.batch[0], NOISE:]
            add_noise_work(c, rows[0], own, self._state, states[0], first_at, dt, out)
        self._state = states[0, :, -1].copy()
        add_stretch(c, rows[0], own, self._struck, states[0], first_at, dt, sums, detail)
        self.stretches += 1
        return most


NO_CONTROLS = np.zeros((0, 1, COLUMNS))
