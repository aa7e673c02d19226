"""Paths followed without end: the kernel of `simulate`, a stretch of steps at a time.

A block of paths goes through the compiled kernel of the exact flights for a part of a period; its impacts are added to
sums, and it goes on (`rattle.montecarlo.long_run.stretches`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.block import start_state
from rattle.montecarlo.kernel.control_variate import no_control
from rattle.montecarlo.kernel.kernel import COLUMNS, EXACT, Job
from rattle.montecarlo.kernel.lanes import lanes_of
from rattle.montecarlo.long_run.noise_work import has_controls
from rattle.montecarlo.long_run.pilot import impacts_of
from rattle.montecarlo.long_run.stretches import MANY, Block, follow_stretches
from rattle.montecarlo.long_run.sums import Sums
from rattle.montecarlo.noise.backlash import backlash_of, draw_walls
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.schemes.step_size import default_step, time_scales
from rattle.scene.scene import Scene

Floats = NDArray[np.float64]

PERIOD = 2.0 * math.pi
LANES = 128
"""Paths of a block: what all paths of a step share is computed once for so many."""
SAMPLES = 64
"""Instants of a period at which states are taken for averages over time."""
ROOM = 33  # impacts of a path in a stretch for which there is space at first: little space stays in the cache
SHORTEST = 8  # stretches of a period at the most


def steps_per_period(scene: Scene) -> int:
    """Steps in a period of the excitation: the default step of exact flights or a little less, a multiple of `SAMPLES`.

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
    speed = min(c.wall1, c.wall2 if scene.stages == 2 else c.wall1) / time_scales(scene).crossing
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

    `steps`: in a period. `periods`: followed so far. `stretches`: stretches followed so far.
    """

    def __init__(self, scene: Scene, seed: np.random.SeedSequence, first: int, paths: int) -> None:
        c = scene.constants
        self.paths, self.first, self.steps = paths, first, steps_per_period(scene)
        backlash, key = backlash_of(scene), key_of(seed)
        walls = np.repeat([[c.wall1], [c.wall1], [c.wall2], [c.wall2]], paths, axis=1)
        if backlash.random:
            draw_walls(backlash, key, first, walls)
        job = Job(c, backlash, key, scene.phase, PERIOD / self.steps, EXACT, False, 0)
        starts = _spread_starts(scene, walls, seed, first)
        every, room = lanes_of(1, first, starts, walls, scene.phase)
        counters = (np.zeros(1, np.int64) for _ in range(4))
        self._block = Block(
            job,
            no_control(),
            first,
            paths,
            self.steps,
            every,
            room,
            starts.T.copy(),
            np.full((paths, 2), scene.phase),
            np.empty((1, paths, SAMPLES + 1, 4)),
            np.zeros((0, 1, COLUMNS)),
            *counters,
        )
        self._controls, self._fixed = has_controls(c), self._instants(self.steps)
        self._rows = np.empty((1, paths, ROOM, COLUMNS))

    @property
    def periods(self) -> int:
        """Periods followed so far."""
        return int(self._block.periods[0])

    @property
    def stretches(self) -> int:
        """Stretches followed so far."""
        return int(self._block.stretches[0])

    def follow(
        self, sums: Sums, detail: bool, seen: list[Floats] | None = None, periods: int = 1, length: int = 1
    ) -> None:
        """Follow all paths for some periods, and add what they do."""
        b, rows, until, batch = self._block, self._rows, self.periods + periods, sums.batch[0]
        while self.periods < until:
            at_once = SHORTEST * periods if seen is None and rows is self._rows else 1
            struck = b.struck.copy()
            most = follow_stretches(b, rows, self._fixed, PERIOD, at_once, until, length, sums, detail, self._controls)
            if most:  # again with the same random numbers, and space for all impacts
                rows = np.empty((1, self.paths, 2 * most, COLUMNS))
                continue
            if seen is not None:
                seen.append(impacts_of(rows[0], b.every.impacts[0], struck))
            if rows.shape[2] < MANY:
                self._rows = rows  # from now on
            rows = self._rows
            if b.begin[0] == 0:
                self._shorten()
        sums.batch[0] = batch

    def _shorten(self) -> None:
        """Take shorter stretches from the next period on if some of this period had very many impacts.

        What happens in a stretch must not choose its own end.
        """
        part, least = int(self._fixed[-2]), self.steps // SHORTEST
        for _ in range(int(self._block.long[0])):
            part = part // 2 if part > least else part
        self._block.long[0] = 0
        self._fixed = self._instants(part)

    def _instants(self, part: int) -> NDArray[np.int64]:
        """Steps of a stretch at which states are recorded, and one beyond its end."""
        apart = self.steps // SAMPLES
        return np.append(np.arange(apart, part + 1, apart), part + 1)
