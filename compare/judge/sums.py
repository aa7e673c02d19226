"""Central sums of samples, in one pass through blocks of paths and without a compiler: whoever has
samples of his own waits for nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import comb
from typing import Any

import numpy as np

from rattle.scene import Floats

Powers = tuple[int, int]
"""Exponents of the deviations of two variables."""

BLOCK_VALUES = 2**17
"""Values that are summed at once: about a megabyte, which the cache of a processor holds."""


@dataclass(frozen=True)
class SampleSums:
    """Sums ``sum (a - mean_a)^p (b - mean_b)^q`` over the paths that have both, for many cells at
    once; merged about the joint mean (Pebay 2008).

    It has the `n`, `mean` and `moment` that `rattle.montecarlo.statistics.section_statistics`
    takes.
    """

    n: Floats  # paths of each cell; (cells,)
    mean: Floats  # of both variables; (2, cells)
    sums: dict[Powers, Floats]  # by their exponents; (cells,)
    # least and largest value of the first variable; (cells,)
    least: Floats
    largest: Floats

    @classmethod
    def of_block(cls, a: Floats, b: Floats, orders: Sequence[Powers]) -> "SampleSums":
        """Sums over one block of paths; paths where either variable is missing do not count.

        Shapes: `a`, `b` (paths, cells).
        """
        seen = np.isfinite(a)
        if b is not a:
            seen &= np.isfinite(b)
        whole = bool(seen.all())
        n = np.full(a.shape[1], float(len(a))) if whole else seen.sum(axis=0).astype(float)
        mean_a, d = _centre(a, None if whole else seen, n)
        mean_b, e = (mean_a, d) if b is a else _centre(b, None if whole else seen, n)
        sums = _power_sums(d, orders) if b is a else _product_sums(d, e, orders)
        least = d.min(axis=0) + mean_a
        largest = d.max(axis=0) + mean_a
        return cls(n, np.stack([mean_a, mean_b]), sums, least, largest)

    def merge(self, other: "SampleSums") -> "SampleSums":
        """The sums over both sets of paths."""
        n = self.n + other.n
        weight = np.divide(other.n, n, out=np.zeros_like(n), where=n > 0)
        mean = self.mean + (other.mean - self.mean) * weight
        sums = {order: np.zeros_like(n) for order in self.sums}
        for part in (self, other):
            shift = part.mean - mean
            for (p, q), total in sums.items():
                for j, k in product(range(p + 1), range(q + 1)):
                    if j + k == 1:
                        continue  # deviations from a part's own mean sum to zero
                    inner = part.n if j + k == 0 else part.sums[j, k]
                    powers = shift[0] ** (p - j) * shift[1] ** (q - k)
                    total += comb(p, j) * comb(q, k) * powers * inner
        least = np.fmin(self.least, other.least)
        largest = np.fmax(self.largest, other.largest)
        return SampleSums(n, mean, sums, least, largest)

    def moment(self, p: int, q: int) -> Floats:
        """Central moment ``E[(a - E a)^p (b - E b)^q]``, without bias correction."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.sums[p, q] / self.n


def _centre(values: Floats, seen: Any, n: Floats) -> tuple[Floats, Floats]:
    """Means, and deviations from them, 0 where a value is missing; about the first value, so that a
    constant comes out exact."""
    if seen is None:
        origin = values[0]
        d = values - origin
    else:
        first = seen.argmax(axis=0)
        origin = np.where(seen.any(axis=0), values[first, np.arange(values.shape[1])], 0.0)
        d = np.where(seen, values, origin) - origin
    shift = d.sum(axis=0) / np.maximum(n, 1.0)
    d -= shift
    if seen is not None:
        d *= seen
    return origin + shift, d


def _power_sums(d: Floats, orders: Sequence[Powers]) -> dict[Powers, Floats]:
    """Sums of the powers of one variable; `orders` ascend from 2 without a gap."""
    power = d * d
    sums = {}
    for order in orders:
        sums[order] = power.sum(axis=0)
        power *= d
    return sums


def _product_sums(d: Floats, e: Floats, orders: Sequence[Powers]) -> dict[Powers, Floats]:
    """Sums of products of powers of two variables."""
    most = max(map(max, orders))
    powers_d = [np.ones_like(d), d]
    powers_e = [np.ones_like(e), e]
    for _ in range(most - 1):
        powers_d.append(powers_d[-1] * d)
        powers_e.append(powers_e[-1] * e)
    return {(p, q): np.einsum("ij,ij->j", powers_d[p], powers_e[q]) for p, q in orders}


def standardised(single: SampleSums) -> list[Floats]:
    """Standardised moments, from the zeroth to the eighth."""
    sd = np.sqrt(single.moment(2, 0))
    one = np.ones_like(sd)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        higher = [single.moment(p, 0) / sd**p for p in range(3, 9)]
    return [one, 0.0 * one, one, *higher]
