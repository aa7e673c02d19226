"""All paths of a long run, followed together, and the batches of time that their sums fill."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from rattle.montecarlo.kernel.blocks import HOUR, Budget, clock
from rattle.montecarlo.long_run import sums as tally
from rattle.montecarlo.long_run.sums import Scales, Sums
from rattle.montecarlo.long_run.walk import WALK_LANES, Walk
from rattle.montecarlo.schemes.quiet import LEFT_OUT_SHARE
from rattle.montecarlo.schemes.step_state import Quiet
from rattle.scene import Floats, Scene
from rattle.scene.drive import PERIOD
from rattle.scene.progress import ProgressBar

PATH_BATCHES = 64
"""Batches of each path; when they are full, each two become one."""
AT_ONCE = 8  # batches between two looks at the progress
LEAST_BLOCKS = 2  # blocks of paths at least, so that two threads have work
# paths that share a histogram, and paths from which on they do
SHARING_PATHS = 4
SHARED_FROM = 128
STATIONARY_PERIODS = 8  # periods of the stationary motion after which its intervals are looked at
IMPACT_SECONDS = 1.5e-6
"""Nominal processor time of an impact, steps included: what is refused does not depend on the
machine."""


@dataclass
class LongPaths:
    """All blocks of paths, and the batches that they are filling.

    `seed`: of all random numbers. `slow`: speed below which an impact is slow. `quiet`: what of the
    motion at closed meshes is not followed. `limit`: time that following them may take. `reserve`:
    seconds of it that are kept for later. `bar`: counts periods. `sums`: of each block. `length`,
    `periods`: periods of a batch, and in all batches. `pace`: processor time of a period, as
    measured last.
    """

    scene: Scene
    paths: int
    seed: np.random.SeedSequence
    slow: float
    quiet: Quiet
    limit: Budget
    pool: ThreadPoolExecutor
    bar: ProgressBar
    reserve: float = 0.0
    periods: int = 0
    pace: float = math.nan

    def __post_init__(self) -> None:
        lanes = min(WALK_LANES, -(-self.paths // LEAST_BLOCKS))
        self._walks = [
            Walk(self.scene, self.seed, first, min(lanes, self.paths - first), self.quiet)
            for first in range(0, self.paths, lanes)
        ]
        self._together = SHARING_PATHS if self.paths >= SHARED_FROM else 1
        self.begin()

    def begin(self, scales: Scales | None = None) -> None:
        """Begin to sum anew from here; distributions too, where a pilot run has set their
        scales."""
        if self.periods > 0:
            self._allow_left_out()
        own = scales or tally.no_scales(self.scene.stages, self.slow)
        detail = scales is not None
        self.sums = [
            tally.new_sums(walk.paths, PATH_BATCHES, own, detail, self._together)
            for walk in self._walks
        ]
        self.length = 1
        self.periods = 0

    def _allow_left_out(self) -> None:
        """Hold closed meshes as long as what that leaves out is a small share of the impacts that
        are not slow."""
        main = self.main
        above = main[:, :, tally.NUMBER].sum() - main[:, :, tally.SLOW].sum()
        rate = float(above) / (PERIOD * self.periods * len(main))
        for walk in self._walks:
            walk.leave_out(LEFT_OUT_SHARE * rate)

    def follow(self, until: int, seen: list[Floats] | None = None) -> None:
        """Follow all paths for at least `until` periods since the sums began, to the end of a
        batch.

        Less where the budget has no room for the next batch. `seen`: Takes every impact.
        """
        while self.periods < until:
            if self.periods == PATH_BATCHES * self.length:
                self._merge()
            batch = self.periods // self.length
            missing = -(-(until - self.periods) // self.length)
            batches = min(missing, PATH_BATCHES - batch, AT_ONCE, self._affordable())
            if batches == 0:
                return
            began = clock()
            periods = batches * self.length
            self._advance(batch, periods, seen)
            self.pace = (clock() - began) / periods

    def expect(self, periods: float) -> None:
        """Have the bar say how many periods more are expected."""
        self.bar.total = self.elapsed + math.ceil(periods)

    def _affordable(self) -> int:
        """Batches for which the budget has room; the first one in any case."""
        if self.periods == 0:
            return 1
        room = max(self.limit.remaining - self.reserve, 0.0)
        return int(min(room / max(self.pace * self.length, 1e-9), AT_ONCE))

    def _advance(self, batch: int, periods: int, seen: list[Floats] | None) -> None:
        def one(walk: Walk, sums: Sums) -> list[Floats]:
            sums.batch[0] = batch
            own: list[Floats] = []
            walk.follow(sums, periods, self.length, None if seen is None else own)
            return own

        for own in self.pool.map(one, self._walks, self.sums):
            if seen is not None:
                seen += own
        self.periods += periods
        self.bar.update(periods)

    def _merge(self) -> None:
        for sums in self.sums:
            sums.main[:, : PATH_BATCHES // 2] = sums.main[:, 0::2] + sums.main[:, 1::2]
            sums.main[:, PATH_BATCHES // 2 :] = 0.0
        self.length *= 2

    def left_out(self) -> float:
        """Bound of the rate of impacts that are not slow and were left out at closed meshes."""
        main = self.main
        above = float(main[:, :, tally.LEFT_OUT + 2].sum())
        return above / (PERIOD * self.periods * len(main))

    def at_rest(self) -> bool:
        """Whether a mesh of every path is closed at all instants of the last half."""
        main = self.main
        columns = tally.columns_of(self.scene.stages)
        closed = main[:, main.shape[1] // 2 :, columns.contact : columns.open]
        half = closed.sum(axis=1).max(axis=1)
        return bool((half >= 0.5 * tally.SAMPLES * self.periods - 0.5).all())

    @property
    def elapsed(self) -> int:
        """Periods since the start."""
        return self._walks[0].periods

    @property
    def are_sets(self) -> bool:
        """Whether each path is a gear set with backlashes of its own."""
        return self.scene.differs_by_set

    @property
    def main(self) -> Floats:
        """Main sums of all paths over the batches that are full."""
        full = self.periods // self.length
        return np.concatenate([sums.main[:, :full] for sums in self.sums])

    @property
    def nominal(self) -> float:
        """Nominal processor time of a period."""
        return IMPACT_SECONDS * float(self.main[:, :, tally.NUMBER].sum()) / self.periods

    def is_refused(self, periods: float) -> bool:
        """Whether so many periods more are expected to take more than an hour, and no budget is
        given."""
        return math.isinf(self.limit.seconds) and periods * self.nominal > HOUR

    def collect(self) -> Sums:
        """Everything that was summed."""
        return tally.collect(self.sums, self.periods // self.length, self.periods)


def warm_up(scene: Scene, slow: float) -> None:
    """Compile everything."""
    walk = Walk(scene, np.random.SeedSequence(0), 0, 1)
    scales = tally.no_scales(scene.stages, slow)
    walk.follow(tally.new_sums(1, 1, scales, False), seen=[])
    walk.follow(tally.new_sums(1, 1, scales))
