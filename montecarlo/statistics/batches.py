"""Means and sds of a few batches of paths: what two runs on common random numbers are compared by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.statistics.central_sums import CentralSums

__all__ = ["BATCHES", "Batches"]

Floats = NDArray[np.float64]

BATCHES = 32
"""Number of batches: enough for a standard error that is known to an eighth."""


@dataclass
class Batches:
    """Number, mean and sum of squares of each section quantity in each batch; block b belongs to batch ``b % BATCHES``.

    Two runs of one seed follow the same noise in each batch, so the spread of the batches' differences is the
    standard error of the difference, paths that are alike in both runs taken into account.

    Attributes
    ----------
    n, mean, squares : ndarray, shape (BATCHES, impacts, 6)
        Paths that were seen, their mean, and the sum of squares about it.
    control : ndarray, shape (BATCHES, impacts, 6)
        Mean of the control variate, whose mean is known to be zero; 0 without one.
    """

    n: Floats
    mean: Floats
    squares: Floats
    control: Floats

    @classmethod
    def empty(cls, impacts: int) -> Batches:
        """No paths yet."""
        return cls(*np.zeros((4, BATCHES, impacts, 6)))

    def copy(self) -> Batches:
        """The same, to be added to."""
        return Batches(self.n.copy(), self.mean.copy(), self.squares.copy(), self.control.copy())

    def add(self, block: int, sums: dict[str, CentralSums]) -> None:
        """Add a block's sums, by the pairwise rule of Chan, Golub and LeVeque (1979)."""
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
        """Standard deviation in each batch; NaN where nothing was seen."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(self.squares / self.n))
