"""The distribution that paths are drawn from: mostly the plain one, and a few parts conditioned on
a rare branch.

A part draws its noise conditionally on ``u z > b``: z the standard normals of all steps, u the unit
vector towards a design point, b a threshold before it.  The likelihood ratio to the plain
distribution is ``1{u z > b} / Phi(-b)``, and given the steps so far ``Phi((r - b) / sqrt(s)) /
Phi(-b)``, with r what they add to ``u z`` and s the squared norm of u over the steps ahead.  A
path's weight is the inverse of the mixture's ratio (docs/theory/statistics.md).
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from rattle.scene import Floats, Ints

# thresholds before a design point, in sds: its boundary is curved, and further away where the noise
# is strong; the share of a part's paths that each has
BEFORE = np.array([2.0, 1.2, 0.6, 0.2])
SPLIT = np.array([0.15, 0.25, 0.3, 0.3])
TARGETS = 0x7A6  # spawn key of the random numbers of `draw_targets`


class BranchMixture(NamedTuple):
    """Parts of the mixture, for compiled code."""

    unit: Floats  # unit vectors towards the design points; (branches, steps)
    rest: Floats  # their squared norm from a step on; (branches, steps + 1)
    level: Floats  # thresholds b; (branches, thresholds)
    rate: Floats  # share of the paths over ``Phi(-b)``; (branches, thresholds)
    plain: float  # share of plain paths
    # paths of each part in a block: those of the first branch, by threshold, come first and the
    # plain ones last
    counts: Ints
    centre: Floats  # about which the moments of the section quantities are summed; (impacts, 6)

    def boost(self, shift: Floats) -> float:
        """How many times as often as by plain paths a point of the noise is drawn."""
        n = min(shift.size, self.unit.shape[1])
        inside = (self.unit[:, :n] @ shift[:n])[:, None] > self.level
        return float(self.plain + self.rate[inside].sum())


def tail(b: float) -> float:
    """Probability of a standard normal beyond b."""
    return 0.5 * math.erfc(b / math.sqrt(2.0))


def mixture_of(
    shifts: Sequence[Floats], shares: Sequence[float], centre: Floats, block: int
) -> BranchMixture:
    """Mixture of plain paths and of parts with given design points and shares of the paths of a
    block."""
    unit = np.zeros((len(shifts), max(s.size for s in shifts)))
    for row, s in zip(unit, shifts, strict=True):
        row[: s.size] = s / math.sqrt(float(s @ s))
    rest = np.zeros((len(shifts), unit.shape[1] + 1))
    rest[:, :-1] = np.cumsum(unit[:, ::-1] ** 2, axis=1)[:, ::-1]
    level = np.array([math.sqrt(float(s @ s)) - BEFORE for s in shifts])
    counts = np.floor(block * np.outer(shares, SPLIT) + 0.5).astype(np.int64)
    rate = counts / block / np.vectorize(tail)(level)
    plain = block - int(counts.sum())
    return BranchMixture(
        unit, rest, level, rate, plain / block, np.append(counts.ravel(), plain), centre
    )


def draw_targets(
    mixture: BranchMixture, seed: np.random.SeedSequence, block: int
) -> tuple[Ints, Floats]:
    """What the conditioned paths of a block have to reach along their unit vector.

    Returns: The branch of each path, -1 for a plain one, and its ``u z``. Shapes: result (paths of
    a block,) each.
    """
    paths = int(mixture.counts.sum())
    thresholds = mixture.level.shape[1]
    part = np.full(paths, -1)
    ahead = np.zeros(paths)
    at = 0
    normal = NormalDist()
    rng = np.random.default_rng(
        np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, TARGETS, block))
    )
    for i, n in enumerate(mixture.counts[:-1].tolist()):
        beyond = tail(mixture.level.flat[i])
        ahead[at : at + n] = [-normal.inv_cdf(beyond * u) for u in 1.0 - rng.random(n)]
        part[at : at + n] = i // thresholds
        at += n
    return part, ahead
