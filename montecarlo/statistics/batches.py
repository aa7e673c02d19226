"""Means and sds of batches of paths, for the comparison of runs on common random numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.statistics.central_sums import CentralSums

Floats = NDArray[np.float64]

BATCHES = 32
"""Number of batches; a standard error estimated from 32 batches is itself known to 1/8 (1 / sqrt(2 * 31))."""


@dataclass
class Batches:
    """Number, mean and sum of squares of each section quantity in each batch; block b belongs to batch ``b % BATCHES``.

    Two runs with one seed use the same noise in each batch.  The spread of the differences between their batches is
    therefore the standard error of the difference, with the correlation of the runs taken into account.
    """

    # n, mean, squares: paths that had the impact, their mean, and the sum of squares about it; (BATCHES, impacts, 6)
    n: Floats
    mean: Floats
    squares: Floats
    control: Floats  # mean of the control variate, whose expectation is zero; 0 without one; (BATCHES, impacts, 6)

    @classmethod
    def empty(cls, impacts: int) -> Batches:
        """Batches without paths."""
        return cls(*np.zeros((4, BATCHES, impacts, 6)))

    def copy(self) -> Batches:
        """A copy that can be added to without changing the original."""
        return Batches(self.n.copy(), self.mean.copy(), self.squares.copy(), self.control.copy())

    def add(self, block: int, sums: dict[str, CentralSums]) -> None:
        """Add a block's sums, by the pairwise update of Chan, Golub and LeVeque (1979)."""
        s, b = sums["section"], block % BATCHES
        n = self.n[b] + s.n
        share = np.divide(s.n, n, out=np.zeros_like(n), where=n > 0.0)
        away = s.mean[0] - self.mean[b]
        self.squares[b] += s.sums[0] + away**2 * self.n[b] * share
        self.mean[b] += away * share
        if "control" in sums:
            self.control[b] += (sums["control"].mean[1] - self.control[b]) * share
        self.n[b] = n

    @property
    def sd(self) -> Floats:
        """Standard deviation in each batch, shape (BATCHES, impacts, 6); NaN where no path had the impact."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(self.squares / self.n))
