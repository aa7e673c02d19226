"""Which rare branches are worth paths of their own: each is probed by a block of paths near its
design point.

A probe estimates without bias what a branch adds to the kurtosis of each row, however far the
first-order estimate of its probability is off.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from rattle.montecarlo.branches.search import SEARCHED_STEPS, SMALLEST, Branch, search_of
from rattle.montecarlo.kernel.block import BLOCK, Plan, sample_mixture
from rattle.montecarlo.kernel.mixture import SPLIT, BranchMixture, mixture_of, tail
from rattle.montecarlo.seed import child_seed
from rattle.montecarlo.statistics.section_statistics import stack_section
from rattle.scene import Floats

PROBED_BRANCHES = 12  # branches that are probed
LIKELY = 0.02  # probability from which plain paths take a branch often enough
# sds of a design point beyond which no path can be drawn: the tail there is below 1e-300.  Where
# first order fails, the noise that it asks for may be that far away
FARTHEST_POINT = 37.0
LEAST_KURTOSIS = 12.0  # kurtosis added to a row below which a branch is not worth it
# share of the paths by which parts grow; largest of a part, and of all
GRAIN = 0.01
MOST_OF_ONE = 0.2
MOST_NEAR_BRANCHES = 0.5
LEAST_OF_ONE = 0.04  # share of a part: fewer paths know too little of their own error
KNOWN_PATHS = 100.0  # paths in a part from which on plain paths know what it adds
# paths that make up a kurtosis, below which it is known within a factor of ten alone
FEW_PATHS = 10.0
# ratio of the largest kurtosis without parts to that with them from which on they are worth it
WORTH = 1.5
ALIKE = 0.9  # cosine from which two design points are one
PROBE_KEY = 0x9170  # spawn key of the probes' random numbers


def steps_of(run: Any) -> int:
    """Steps of a run until most of its paths have had all their impacts."""
    last = run.phase_reduced.columns
    end = np.nan_to_num(last["tau"] + 6.0 * last["sd_tau"]).max() - run.plan.scene.phase
    return int(min(max(end / run.plan.dt, 0.0) + 1.0, SEARCHED_STEPS))


def choose_mixture(run: Any) -> BranchMixture | None:
    """The mixture from which the paths of a scene are better drawn than plainly; None where no
    branch is worth it.

    `run`: Of plain paths by exact flights.
    """
    columns = run.phase_reduced.columns
    plan = run.plan
    search = search_of(plan.scene.phase_reduced, plan.impacts, plan.dt).until(SMALLEST)
    branches = search.within(steps_of(run))
    # in the order of memory of every other one: the kernel is compiled for one order alone
    centre = np.ascontiguousarray(np.nan_to_num(stack_section(columns).T))
    sd = stack_section(columns, "sd_").T
    for mesh in range(1, plan.scene.stages + 1):
        sd[columns["mesh"] == mesh, 2 * mesh] = 0.0  # known exactly
    sd[~(sd > 1e-12 * (1.0 + np.abs(centre)))] = np.inf
    probed = list_distinct(by_influence(branches, sd), PROBED_BRANCHES)
    shifts = [branch.shift for branch in probed]
    added = [_probe(plan, centre, sd, branch, number) for number, branch in enumerate(probed, 1)]
    kurtosis = np.nan_to_num(stack_section(columns, "kurt_").T)
    kurtosis = 3.0 + np.where(np.isfinite(sd), kurtosis, 0.0)
    tails = np.array([tail(math.sqrt(float(s @ s))) for s in shifts])
    shares = _share_out(kurtosis, added, tails, run.paths)
    kept = np.flatnonzero(shares)
    if kept.size == 0:
        return None
    return mixture_of([shifts[i] for i in kept], shares[kept].tolist(), centre, BLOCK)


def _share_out(kurtosis: Floats, added: list[Floats], tails: Floats, paths: int) -> Floats:
    """Share of the paths for each part, such that the largest kurtosis of a row becomes small; 0
    where nothing helps.

    Parts grow by `GRAIN`, always the one that lowers it most.

    `kurtosis`: Of so many plain paths. Shapes: `kurtosis` (impacts, quantities); `added`, each
    (impacts, quantities), of each branch.
    """
    shares = np.zeros(len(added))
    each = np.array(added).reshape(len(added), *kurtosis.shape)
    # branches that plain paths have taken: together they add at most the kurtosis that was measured
    seen = tails * paths > KNOWN_PATHS
    each[seen] *= np.minimum(1.0, kurtosis / np.maximum(each[seen].sum(axis=0), 1e-300))
    rest = np.maximum(kurtosis - each[seen].sum(axis=0), 3.0)
    # where the other branches are expected to make much of the measured kurtosis, it may come from
    # a few chance visits to them: the rest then counts as normal, with a kurtosis of 3
    rest[each[~seen].sum(axis=0) > np.where(kurtosis * FEW_PATHS > paths, 0.03, 0.3) * kurtosis] = (
        3.0
    )

    def largest(shares: Floats) -> float:
        plain = 1.0 - shares.sum()
        often = plain + SPLIT[-1] * shares / tails
        return float((rest / plain + np.tensordot(1.0 / often, each, 1)).max())

    before = best = largest(shares)
    while added and shares.sum() < MOST_NEAR_BRANCHES:
        tried = [
            (largest(shares + GRAIN * one), i)
            for i, one in enumerate(np.eye(len(added)))
            if shares[i] < MOST_OF_ONE
        ]
        if not tried or min(tried)[0] > 0.999 * best:
            break
        best, i = min(tried)
        shares[i] += GRAIN
    return np.where(shares > 0.0, np.maximum(shares, LEAST_OF_ONE), 0.0) * (before > WORTH * best)


def list_distinct(branches: Iterable[Branch], most: int) -> list[Branch]:
    """The first branches whose design points are not those of earlier ones."""
    distinct = list[Branch]()
    for branch in branches:
        if len(distinct) < most and all(
            _cosine(branch.shift, other.shift) < ALIKE for other in distinct
        ):
            distinct.append(branch)
    return distinct


def by_influence(branches: tuple[Branch, ...], sd: Floats) -> list[Branch]:
    """Rare branches by what they are expected to add to the kurtosis of a row, the most influential
    first; none whose design point no path reaches."""
    rare = [
        b
        for b in branches
        if b.probability < LIKELY and 0.0 < math.hypot(*b.shift.tolist()) < FARTHEST_POINT
    ]
    added = [(float((np.abs(b.added[2]) / sd**4).max()), b) for b in rare]
    return [b for most, b in sorted(added, key=lambda one: -one[0]) if most > 0.1 * LEAST_KURTOSIS]


def _probe(plan: Plan, centre: Floats, sd: Floats, branch: Branch, number: int) -> Floats:
    """What paths beyond a design point's thresholds add to the kurtosis of each row.

    Where none of them leaves the orbit as far as it was predicted, what so few paths may have
    missed.
    """
    mixture = mixture_of([branch.shift], [0.75], centre, BLOCK)
    probe = plan._replace(seed=child_seed(plan.seed, PROBE_KEY, number))
    rows, weights, _, _ = sample_mixture(probe, mixture, 0)
    near = int(mixture.counts[:-1].sum())
    fourth = weights[:near, :, None] * ((rows[:near, :, :-1] - centre) / sd) ** 4
    predicted = np.abs(branch.added[2]) / sd**4
    missed = 3.0 * tail(float(mixture.level[0, -1])) / (near * SPLIT[-1])
    return np.asarray(
        np.maximum(
            np.nansum(fourth, axis=0) / BLOCK, predicted * min(1.0, missed / branch.probability)
        )
    )


def _cosine(a: Floats, b: Floats) -> float:
    """Of the angle between two points of the noise, the shorter filled up with zeros."""
    n = min(a.size, b.size)
    return float(a[:n] @ b[:n]) / math.sqrt(float(a @ a) * float(b @ b))
