"""The sums of all paths of a long run, joined."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.long_run.sums import NOISE, SPEED, WORK, Scales, Sums

__all__ = ["Collected", "collected", "time_averages"]

Floats = NDArray[np.float64]


class Collected(NamedTuple):
    """The sums of all paths.

    Attributes
    ----------
    main : ndarray, shape (paths, batches, MAIN)
        As of `Sums`, over the batches that are full.
    time, samples : float
        Duration of each path, and number of samples of its state.
    power, products, histogram, section, together
        As of `Sums`, of all paths.
    scales : Scales
        Of the pilot run.
    stages : int
        Of the scene.
    """

    main: Floats
    time: float
    samples: float
    power: Floats
    products: Floats
    histogram: NDArray[np.uint32]
    section: NDArray[np.uint32]
    together: int
    scales: Scales
    stages: int

    @property
    def paths(self) -> int:
        """Number of paths."""
        return len(self.main)

    def of_units(self, of_paths: Floats) -> Floats:
        """Sums over the paths that share a unit of the distributions.

        Parameters
        ----------
        of_paths : ndarray, shape (paths,)
            Of each path.

        Returns
        -------
        ndarray, shape (units,)
        """
        return np.asarray(np.add.reduceat(of_paths, np.arange(0, self.paths, self.together)))


def collected(parts: list[Sums], batches: int, time: float, samples: float, stages: int) -> Collected:
    """Join the sums of all blocks of paths.

    Parameters
    ----------
    parts : list of Sums
        One for each block.
    batches : int
        Number of batches that are full.
    time, samples : float
        Duration of these batches, and number of samples of the state in them.
    stages : int
        Of the scene.

    Returns
    -------
    Collected
    """

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts])

    power, products, histogram = joined("power"), joined("products"), joined("histogram")
    if stages == 2:  # all impacts: those at either mesh
        for sums in (power[:, :, SPEED:], products[:, :, 0], histogram[:, :, SPEED:]):
            sums[:, 0] = sums[:, 1] + sums[:, 2]
    return Collected(
        joined("main")[:, :batches], time, samples, power, products, histogram, joined("section"), parts[0].together,
        parts[0].scales, stages,
    )  # fmt: skip


def time_averages(c: Collected) -> Floats:
    """Averages over time on each path, shape (paths, 4): of y1^2, v2^2, m1 y1, m2 v2 (docs/model.md section 10).

    Parameters
    ----------
    c : Collected
        The sums of all paths.

    Returns
    -------
    ndarray
    """
    return np.asarray(c.main[:, :, WORK:NOISE].sum(axis=1) / c.samples)
