"""The sums of all paths of a long run, joined."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.long_run.sums import NOISE, SPEED, WORK, Scales, Sums

Floats = NDArray[np.float64]


class Collected(NamedTuple):
    """The sums of all paths."""

    main: Floats  # as of `Sums`, over the batches that are full; (paths, batches, MAIN)
    time: float  # time, samples: duration of each path, and number of samples of its state
    samples: float
    power: Floats  # power, products, histogram, section, together: as of `Sums`, of all paths
    products: Floats
    histogram: NDArray[np.uint32]
    section: NDArray[np.uint32]
    together: int
    scales: Scales  # of the pilot run
    stages: int  # of the scene

    @property
    def paths(self) -> int:
        """Number of paths."""
        return len(self.main)

    def of_units(self, of_paths: Floats) -> Floats:
        """Sums over the paths that share a unit of the distributions.

        Shapes: `of_paths` (paths,); result (units,).
        """
        return np.asarray(np.add.reduceat(of_paths, np.arange(0, self.paths, self.together)))


def collect(parts: list[Sums], batches: int, time: float, samples: float, stages: int) -> Collected:
    """Join the sums of all blocks of paths."""

    def join(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts])

    power, products, histogram = join("power"), join("products"), join("histogram")
    if stages == 2:  # all impacts: those at either mesh
        for sums in (power[:, :, SPEED:], products[:, :, 0], histogram[:, :, SPEED:]):
            sums[:, 0] = sums[:, 1] + sums[:, 2]
    return Collected(
        join("main")[:, :batches],
        time,
        samples,
        power,
        products,
        histogram,
        join("section"),
        parts[0].together,
        parts[0].scales,
        stages,
    )


def time_averages(c: Collected) -> Floats:
    """Averages over time on each path, shape (paths, 4): of y1^2, v2^2, m1 y1, m2 v2 (docs/model.md section 10)."""
    return np.asarray(c.main[:, :, WORK:NOISE].sum(axis=1) / c.samples)
