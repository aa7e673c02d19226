"""Histograms of the section quantities; the first block fixes the bin edges."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.scene.moments import SECTION

Floats = NDArray[np.float64]

BINS, REACH = 240, 6.0  # equal bins over +- REACH sds of the first block


@dataclass
class Histograms:
    """Counts over equal bins, for every impact and section quantity."""

    low: Floats  # low, width: lower edge of the first bin, and width of a bin; (impacts, 6)
    width: Floats
    counts: NDArray[np.int64]  # the first and last count values below and above the bins; (impacts, 6, BINS + 2)

    @classmethod
    def for_sample(cls, section: Floats) -> "Histograms":
        """Empty histograms that reach `REACH` standard deviations of a sample to both sides of its mean.

        Shapes: `section` (paths, impacts, 6).
        """
        impacts = section.shape[1]
        seen = np.isfinite(section)
        n = np.maximum(seen.sum(axis=0), 1)
        mean = np.where(seen, section, 0.0).sum(axis=0) / n
        sd = np.sqrt((np.where(seen, section - mean, 0.0) ** 2).sum(axis=0) / n)
        sd = np.where(sd > 0.0, sd, 1e-12)
        return cls(mean - REACH * sd, 2.0 * REACH * sd / BINS, np.zeros((impacts, 6, BINS + 2), np.int64))

    def add(self, section: Floats) -> None:
        """Count a block of paths.

        Shapes: `section` (paths, impacts, 6).
        """
        _, impacts, quantities = section.shape
        seen = np.isfinite(section)
        with np.errstate(invalid="ignore"):
            place = np.clip(np.floor((section - self.low) / self.width), -1, BINS) + 1
        cell = np.arange(impacts * quantities).reshape(impacts, quantities) * (BINS + 2)
        flat = (cell + np.where(seen, place, 0)).astype(np.int64)[seen]
        self.counts += np.bincount(flat, minlength=self.counts.size).reshape(self.counts.shape)

    def density(self, impact: int, quantity: str) -> tuple[Floats, Floats]:
        """Probability density of a quantity at an impact, over all paths that reached it.

        Shapes: `edges` (BINS + 1,); `density` (BINS,).
        """
        k, i = impact - 1, SECTION.index(quantity)
        edges = self.low[k, i] + self.width[k, i] * np.arange(BINS + 1)
        counts = self.counts[k, i]
        return edges, counts[1:-1] / max(counts.sum(), 1) / self.width[k, i]
