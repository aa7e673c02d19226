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

from rattle.montecarlo.schemes.lanes import add_scaled
from rattle.montecarlo.seed import child_seed
from rattle.scene import Floats, Ints
from rattle.scene.compiled import lean_internal, widest_vectors

# thresholds before a design point, in sds: its boundary is curved, and further away where the noise
# is strong; the share of a part's paths that each has
BEFORE = np.array([2.0, 1.2, 0.6, 0.2])
SPLIT = np.array([0.15, 0.25, 0.3, 0.3])
TARGETS = 0x7A6  # spawn key of the random numbers of `draw_targets`
FAR = 6.0  # argument from which erfc is 0, and below whose negative it is 2


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
    centre: Floats  # about which the moments of the section quantities are summed; (impacts,
    # quantities)

    def boost(self, shift: Floats) -> float:
        """How many times as often as by plain paths a point of the noise is drawn."""
        n = min(shift.size, self.unit.shape[1])
        inside = (self.unit[:, :n] @ shift[:n])[:, None] > self.level
        return float(self.plain + self.rate[inside].sum())


def no_mixture() -> BranchMixture:
    """A mixture without parts: all paths are plain."""
    none = np.zeros((0, 0))
    return BranchMixture(none, none, none, none, 1.0, np.zeros(0, np.int64), none)


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
    rng = np.random.default_rng(child_seed(seed, TARGETS, block))
    for i, n in enumerate(mixture.counts[:-1].tolist()):
        beyond = tail(mixture.level.flat[i])
        ahead[at : at + n] = [-normal.inv_cdf(beyond * u) for u in 1.0 - rng.random(n)]
        part[at : at + n] = i // thresholds
        at += n
    return part, ahead


@lean_internal
def condition(mixture: BranchMixture, n: int, z: Floats, carried: Floats, lanes: int) -> None:
    """Draw the increments of step n conditionally, for the paths of every part.

    `carried`: Of each path the branch of its part, what the steps ahead add along the branch's unit
    vector, and along each unit vector the sum so far. Shapes: `z` (lanes,); `carried` (2 +
    branches, lanes).
    """
    widest_vectors()
    for k in range(mixture.unit.shape[0]):
        u = mixture.unit[k, n]
        if u != 0.0:
            _condition_part(z, u, mixture.rest[k, n], k, carried[0], carried[1], lanes)
    for k in range(mixture.unit.shape[0]):  # after all parts have shifted their normals
        u = mixture.unit[k, n]
        if u != 0.0:
            add_scaled(carried[2 + k], u, z, lanes)


@lean_internal
def _condition_part(
    z: Floats, u: float, rest: float, k: int, part: Floats, ahead: Floats, lanes: int
) -> None:
    """Replace a step's normals of the paths of one part by their values given ``u z`` in all;
    vectorises.

    Given that the steps ahead, this one among them, add `ahead` to ``u z``, a step's normal has
    mean ``u ahead / rest`` and variance ``1 - u^2 / rest``.
    """
    widest_vectors()
    pull = u / rest
    spread = math.sqrt(max(0.0, 1.0 - u * u / rest))
    for p in range(lanes):
        of_part = part[p] == k
        x = pull * ahead[p] + spread * z[p] if of_part else z[p]
        z[p] = x
        ahead[p] -= u * x if of_part else 0.0


@lean_internal
def weigh(mixture: BranchMixture, n: int, carried: Floats, p: int, weights: Floats) -> None:
    """Write the weight of the path in lane p after n steps, and its ``u z`` along each unit
    vector, for some of its impacts.

    Shapes: `carried` (2 + branches, lanes); `weights` (impacts, 1 + branches).
    """
    total = mixture.plain
    last = mixture.rest.shape[1] - 1
    for k in range(mixture.unit.shape[0]):
        rest = mixture.rest[k, min(n, last)]
        scale = 1.0 / math.sqrt(2.0 * rest) if rest > 1e-12 else 1e9
        for t in range(mixture.level.shape[1]):
            short = (mixture.level[k, t] - carried[2 + k, p]) * scale
            if short < -FAR:
                total += mixture.rate[k, t]
            elif short < FAR:
                total += mixture.rate[k, t] * 0.5 * math.erfc(short)
    for i in range(weights.shape[0]):
        weights[i, 0] = 1.0 / total
        for k in range(mixture.unit.shape[0]):
            weights[i, 1 + k] = carried[2 + k, p]
