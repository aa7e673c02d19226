"""Paths followed while the constants of the motion change slowly, as in a run-up.

The motion is followed a stretch of whole periods at a time, each with its own constants; states are
carried over as they are.  What the change of speed itself does to dimensionless states is part of
the constants (docs/guide/run-up.md).
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.long_run import sums as tally
from rattle.montecarlo.long_run.estimates import groups as mesh_groups
from rattle.montecarlo.long_run.sums import new_sums, no_scales
from rattle.montecarlo.long_run.walk import Walk, steps_per_period
from rattle.montecarlo.schemes.quiet import quiet_of
from rattle.scene import Constants, Floats, Scene

WALKED_TOGETHER = 32
"""Paths of a block: few, so that a small number of paths keeps several threads busy."""
COUNTED = ("number above", "speed above", "energy")
"""What a stretch sums for each group of impacts."""


class RampStretch(NamedTuple):
    """A stretch of the ramp."""

    constants: Constants
    slow: float  # speed below which an impact is slow
    periods: int


def count_impacts(main: Floats, wheels: int) -> Floats:
    """What is counted of each group of impacts.

    Shapes: `main` (paths, columns); result (paths, groups, `COUNTED`).
    """
    groups = np.array([group for group, _ in mesh_groups(wheels)])
    number = main[:, 4 * groups + tally.NUMBER] - main[:, 4 * groups + tally.SLOW]
    speed = main[:, tally.columns_of(wheels).above_speed + groups]
    energy = main[:, 4 * groups + tally.ENERGY]
    return np.stack([number, speed, energy], axis=2)


class RampPaths:
    """Paths that are followed through stretches.

    `scenes`: at several speeds of the ramp; the paths start at the first, and have steps that are
    short enough for all of them.
    """

    def __init__(self, scenes: Sequence[Scene], paths: int, seed: np.random.SeedSequence) -> None:
        finest = max(scenes, key=steps_per_period)
        self._scene = scenes[0]
        self._walks = [
            Walk(finest, seed, first, min(WALKED_TOGETHER, paths - first))
            for first in range(0, paths, WALKED_TOGETHER)
        ]

    def follow(
        self, stretches: Sequence[RampStretch], pool: ThreadPoolExecutor
    ) -> Iterator[Floats]:
        """Follow all paths through the stretches, one after the other.

        Shapes: each result (paths, groups, `COUNTED`).
        """

        def follow_one(walk: Walk, stretch: RampStretch) -> Floats:
            sums = new_sums(walk.paths, 1, no_scales(self._scene.stages, stretch.slow), False)
            quiet = quiet_of(self._scene, stretch.slow, None)
            walk.change_constants(stretch.constants, quiet)
            walk.follow(sums, stretch.periods, stretch.periods)
            return sums.main[:, 0]

        for stretch in stretches:
            parts = pool.map(follow_one, self._walks, [stretch] * len(self._walks))
            yield count_impacts(np.concatenate(list(parts)), self._scene.stages)
