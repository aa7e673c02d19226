"""All paths of a long run, followed together, and the batches of time that their sums fill."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rattle.montecarlo.long_run.collected import Collected, collect
from rattle.montecarlo.long_run.pilot import no_scales
from rattle.montecarlo.long_run.sums import CONTACT, Scales, new_sums
from rattle.montecarlo.long_run.walk import LANES, PERIOD, SAMPLES, Walk
from rattle.montecarlo.settings.budget import Budget, clock
from rattle.scene.scene import Scene

__all__ = ["BATCHES", "LongPaths"]

Floats = NDArray[np.float64]

BATCHES = 64
"""Batches of each path; when they are full, each two become one."""
AT_ONCE = 8  # batches between two looks at the progress
TOGETHER, MANY = 4, 128  # paths that share a histogram, and paths from which on they do


class LongPaths:
    """All blocks of paths, and the batches that they are filling.

    Parameters
    ----------
    scene : Scene
        What is simulated.
    paths : int
        Number of paths.
    seed : SeedSequence
        Of all random numbers.
    slow : float
        Speed below which an impact is slow.
    limit : Budget
        Time that following them may take.

    Attributes
    ----------
    walks : list of Walk
        The blocks.
    sums : list of Sums
        Of each block.
    length, periods : int
        Periods of a batch, and in all batches.
    pace : float
        Processor time of a period, as measured last.
    """

    def __init__(self, scene: Scene, paths: int, seed: np.random.SeedSequence, slow: float, limit: Budget) -> None:
        starts = range(0, paths, LANES)
        self.walks = [Walk(scene, seed, first, min(LANES, paths - first)) for first in starts]
        self.scene, self.slow, self.limit, self.pace = scene, slow, limit, math.nan
        self.begin(no_scales(slow), detail=False)

    def begin(self, scales: Scales, detail: bool) -> None:
        """Begin to sum anew from here."""
        self.detail = detail
        together = TOGETHER if sum(walk.paths for walk in self.walks) >= MANY else 1
        self.sums = [new_sums(walk.paths, BATCHES, scales, detail, together) for walk in self.walks]
        self.length, self.periods = 1, 0  # periods of a batch, and in all batches

    def follow(
        self, pool: ThreadPoolExecutor, until: int, bar: tqdm[NoReturn], seen: list[Floats] | None = None
    ) -> None:
        """Follow all paths for at least `until` periods since the sums began, to the end of a batch.

        Less where the budget has no room for the next batch.
        """
        while self.periods < until:
            if self.periods == BATCHES * self.length:
                self._merge()
            batch = self.periods // self.length
            missing = -(-(until - self.periods) // self.length)
            batches = min(missing, BATCHES - batch, AT_ONCE, self._affordable())
            if batches == 0:
                return
            began, before = clock(), self.periods
            self._advance(pool, batch, batches, bar, seen)
            self.pace = (clock() - began) / (self.periods - before)

    def _affordable(self) -> int:
        """Batches for which the budget has room; one where no period has been measured yet."""
        if math.isnan(self.pace):
            return 1
        return int(min(max(self.limit.remaining, 0.0) / max(self.pace * self.length, 1e-9), AT_ONCE))

    def _advance(
        self, pool: ThreadPoolExecutor, batch: int, batches: int, bar: tqdm[NoReturn], seen: list[Floats] | None
    ) -> None:
        """Some batches."""
        periods = batches * self.length

        def one(i: int) -> list[Floats]:
            walk, sums = self.walks[i], self.sums[i]
            sums.batch[0] = batch
            own: list[Floats] = []
            walk.follow(sums, self.detail, own if seen is not None else None, periods, self.length)
            return own

        for own in pool.map(one, range(len(self.walks))):
            if seen is not None:
                seen += own
        self.periods += periods
        bar.update(periods)

    def _merge(self) -> None:
        for sums in self.sums:
            half = sums.main[:, 0::2] + sums.main[:, 1::2]
            sums.main[:, : BATCHES // 2] = half
            sums.main[:, BATCHES // 2 :] = 0.0
        self.length *= 2

    def warm_up(self) -> None:
        """Compile everything."""
        seen: list[Floats] = []
        self.walks[0].follow(self.sums[0], False, seen)
        self.begin(no_scales(self.slow), detail=True)
        self.walks[0].follow(self.sums[0], True)

    def at_rest(self) -> bool:
        """Whether a mesh of every path is closed at all instants of the last half."""
        main = self.main
        half = main[:, main.shape[1] // 2 :, CONTACT : CONTACT + 2].sum(axis=1).max(axis=1)
        return bool((half >= 0.5 * SAMPLES * self.periods - 0.5).all())

    @property
    def elapsed(self) -> int:
        """Periods since the start."""
        return self.walks[0].periods

    @property
    def own_walls(self) -> bool:
        """Whether each path has a backlash of its own for good."""
        t = self.scene.tolerance
        return t is not None and t.distribution != "fixed" and t.draw != "contact"

    @property
    def main(self) -> Floats:
        """Main sums of all paths over the batches that are full."""
        full = self.periods // self.length
        return np.concatenate([sums.main[:, :full] for sums in self.sums])

    def collect(self) -> Collected:
        """Everything that was summed."""
        full = self.periods // self.length
        return collect(self.sums, full, PERIOD * self.periods, float(SAMPLES * self.periods), self.scene.stages)
