"""The distribution that paths are drawn from: mostly the plain one, and a few parts conditioned on a rare branch.

A part draws its noise conditionally on ``u z > b``: z the standard normals of all steps, u the unit vector towards a
design point, b a threshold a little before it.  The likelihood ratio to the plain distribution is ``1{u z > b} /
Phi(-b)``, and given the steps so far ``Phi((r - b) / sqrt(s)) / Phi(-b)``, with r what they add to ``u z`` and s the
squared norm of u over the steps ahead.  A path's weight is the inverse of the mixture's ratio (balance heuristic, Veach
and Guibas 1995), so at most 1 over the plain share.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.rare.design_points import RareBranch

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PLAIN = 0.8  # share of paths drawn from the plain distribution: no row loses more than a factor 1 / PLAIN
MOST = 3  # branches that are sampled
LIKELY = 0.02  # probability from which plain paths take a branch often enough
LEAST_KURTOSIS = 20.0  # added kurtosis below which a branch is not worth it
WORTH = 0.1  # and relative to the branch that adds most
BEFORE = (0.2, 0.7)  # how far the thresholds are before a design point, in sds: its boundary is curved
SPLIT = (0.7, 0.3)  # share of each threshold
TARGETS = 0x7A6  # spawn key of the random numbers of `targets`


class BranchMixture(NamedTuple):
    """Parts of the mixture, for compiled code."""

    unit: Floats  # unit vectors towards the design points; (branches, steps)
    rest: Floats  # their squared norm from a step on; (branches, steps + 1)
    level: Floats  # thresholds b; (branches, thresholds)
    rate: Floats  # share of the paths over ``Phi(-b)``; (branches, thresholds)
    plain: float  # share of plain paths
    # paths of a part in a block of `BLOCK`: the first rows, the plain ones after them; (branches, thresholds)
    counts: Ints


def choose_branches(branches: Sequence[RareBranch]) -> list[RareBranch]:
    """The branches that are worth paths of their own."""
    rare = [b for b in branches if b.probability < LIKELY and b.kurtosis > LEAST_KURTOSIS]
    return [b for b in rare if b.kurtosis > WORTH * rare[0].kurtosis][:MOST]


def mixture_of(branches: Sequence[RareBranch]) -> BranchMixture:
    """Give each branch paths in proportion to the root of the kurtosis that it adds.

    Examples
    --------
    >>> mixture_of([]).plain
    1.0
    """
    steps = max((b.shift.size for b in branches), default=0)
    unit = np.zeros((len(branches), steps))
    for row, b in zip(unit, branches, strict=True):
        row[: b.shift.size] = b.shift / math.sqrt(float(b.shift @ b.shift))
    rest = np.zeros((len(branches), steps + 1))
    rest[:, :-1] = np.cumsum(unit[:, ::-1] ** 2, axis=1)[:, ::-1]
    share = np.sqrt([b.kurtosis for b in branches])
    counts = np.floor((1.0 - PLAIN) * BLOCK * np.outer(share / share.sum(), SPLIT)) if len(branches) else share
    counts = counts.astype(np.int64).reshape(-1, len(SPLIT))
    level = np.array([[b.beta - before for before in BEFORE] for b in branches]).reshape(-1, len(SPLIT))
    tail = np.array([0.5 * math.erfc(b / math.sqrt(2.0)) for b in level.ravel()]).reshape(level.shape)
    return BranchMixture(unit, rest, level, counts / BLOCK / tail, float(1.0 - counts.sum() / BLOCK), counts)


def targets(mixture: BranchMixture, seed: np.random.SeedSequence, block: int) -> tuple[Ints, Floats]:
    """What the conditioned paths of a block have to reach along their unit vector.

    Shapes: `part` (BLOCK,); `ahead` (BLOCK,).
    """
    part, ahead, at, normal = np.full(BLOCK, -1), np.zeros(BLOCK), 0, NormalDist()
    rng = np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, TARGETS, block)))
    for (k, t), count in np.ndenumerate(mixture.counts):
        n = int(count)
        tail = mixture.counts[k, t] / BLOCK / mixture.rate[k, t] if n else 1.0
        ahead[at : at + n] = [-normal.inv_cdf(tail * u) for u in 1.0 - rng.random(n)]
        part[at : at + n] = k
        at += n
    return part, ahead
