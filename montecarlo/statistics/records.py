"""What a simulation records beside central sums: means and sds of batches of paths, and
histograms."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rattle.montecarlo.statistics.section_statistics import ratio_or_zero, undefined
from rattle.scene import Floats, Ints, section_names

RUN_BATCHES = 32
"""Number of batches; a standard error estimated from 32 batches is itself known to 1/8 (1 / sqrt(2
* 31))."""


@dataclass(repr=False)
class Batches:
    """Number, mean and sum of squares of each section quantity in each batch; block b belongs to
    batch ``b % RUN_BATCHES``.

    Two runs with one seed use the same noise in each batch.  The spread of the differences between
    their batches is therefore the standard error of the difference, with the correlation of the
    runs taken into account.
    """

    # n, mean, squares: paths that had the impact, their mean, and the sum of squares about it;
    # (RUN_BATCHES, impacts, quantities)
    n: Floats
    mean: Floats
    squares: Floats
    # mean of the control variate, whose expectation is zero; 0 without one; (RUN_BATCHES, impacts,
    # quantities)
    control: Floats

    @classmethod
    def empty(cls, impacts: int, quantities: int) -> "Batches":
        """Batches without paths."""
        return cls(*np.zeros((4, RUN_BATCHES, impacts, quantities)))

    def add(self, block: int, sums: dict[str, Any]) -> None:
        """Add a block's sums, by the pairwise update of Chan, Golub and LeVeque (1979)."""
        b = block % RUN_BATCHES
        s = sums.get("section")
        before = self.n[b]
        own, mean, squares = (
            (s.n, s.mean[0], s.sums[0]) if s else sums["weighted"].batch(before.shape[1])
        )
        n = before + own
        share = ratio_or_zero(own, n)
        away = mean - self.mean[b]
        self.squares[b] += squares + away**2 * before * share
        self.mean[b] += away * share
        if "control" in sums:
            self.control[b] += (sums["control"].mean[1] - self.control[b]) * share
        self.n[b] = n

    @property
    def sd(self) -> Floats:
        """Standard deviation in each batch, shape (RUN_BATCHES, impacts, quantities); NaN where no
        path had the impact."""
        with undefined():
            return np.asarray(np.sqrt(self.squares / self.n))


# equal bins over +- HISTOGRAM_REACH sds of the first block
HISTOGRAM_BINS = 240
HISTOGRAM_REACH = 6.0


@dataclass(repr=False)
class Histograms:
    """Counts over equal bins, for every impact and section quantity."""

    # low, width: lower edge of the first bin, and width of a bin; (impacts, quantities)
    low: Floats
    width: Floats
    # the first and last count values below and above the bins; (impacts, quantities,
    # HISTOGRAM_BINS + 2)
    counts: Ints

    @classmethod
    def for_sample(cls, section: Floats) -> "Histograms":
        """Empty histograms that reach `HISTOGRAM_REACH` standard deviations of a sample to both
        sides of its mean.

        Shapes: `section` (paths, impacts, quantities).
        """
        _, impacts, quantities = section.shape
        seen = np.ma.masked_invalid(section)
        mean = seen.mean(axis=0).filled(0.0)
        sd = seen.std(axis=0).filled(0.0)
        sd = np.where(sd > 0.0, sd, 1e-12)
        return cls(
            mean - HISTOGRAM_REACH * sd,
            2.0 * HISTOGRAM_REACH * sd / HISTOGRAM_BINS,
            np.zeros((impacts, quantities, HISTOGRAM_BINS + 2), np.int64),
        )

    def add(self, section: Floats) -> None:
        """Count a block of paths.

        Shapes: `section` (paths, impacts, quantities).
        """
        _, impacts, quantities = section.shape
        seen = np.isfinite(section)
        with np.errstate(invalid="ignore"):
            place = np.clip(np.floor((section - self.low) / self.width), -1, HISTOGRAM_BINS) + 1
        cell = np.arange(impacts * quantities).reshape(impacts, quantities) * (HISTOGRAM_BINS + 2)
        flat = (cell + np.where(seen, place, 0)).astype(np.int64)[seen]
        self.counts += np.bincount(flat, minlength=self.counts.size).reshape(self.counts.shape)

    def density(self, impact: int, quantity: str) -> tuple[Floats, Floats]:
        """Probability density of a quantity at an impact, over all paths that reached it.

        Shapes: `edges` (HISTOGRAM_BINS + 1,); `density` (HISTOGRAM_BINS,).
        """
        k = impact - 1
        i = section_names(self.low.shape[1] // 2 - 1).index(quantity)
        edges = self.low[k, i] + self.width[k, i] * np.arange(HISTOGRAM_BINS + 1)
        counts = self.counts[k, i]
        return edges, counts[1:-1] / max(counts.sum(), 1) / self.width[k, i]
