"""Probability of leaving the noise-free itinerary, by branch: from a run, and from paths drawn near rare branches.

An interval is that of a weighted sum of Poisson counts (Fay and Feuer 1997); with equal weights it is the exact one of
Garwood (1936).  Weights are bounded and their sums unbiased, whichever branches the search has found
(`rattle.montecarlo.kernel.mixture`).  A branch that neither the search nor the run has found is in no row.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import chdtri

from rattle.montecarlo.branches.choose import LIKELY, list_distinct, steps_of
from rattle.montecarlo.branches.search import SMALLEST, search_of
from rattle.montecarlo.kernel.block import BLOCK, CODES, Followers, count_followed
from rattle.montecarlo.kernel.mixture import mixture_of
from rattle.montecarlo.kernel.weighted_paths import sample_mixture
from rattle.montecarlo.schemes.step_size import default_step
from rattle.montecarlo.settings import EXACT, NOISE_FREE, begins
from rattle.montecarlo.statistics.intervals import CONFIDENCE
from rattle.scene import Floats

MOST = 24  # branches near which paths are drawn, the most probable first
BLOCKS, LEAST_BLOCKS = 2, 8  # blocks of paths for each branch, and for all
NEAR = 0.8  # share of these paths that are drawn near a branch
KNOWN = 100.0  # paths of a run that left by a branch from which on they are enough
LEFT = 0x1EA  # spawn key of the random numbers of these paths
COLUMNS = ("impact", "mesh", "side", "probability", "low", "high", "paths", "near")


def find_leaving(run: Any, followers: Mapping[str, Followers]) -> pd.DataFrame:
    """`Ensemble.leaving` of a run, from what it summed over the paths that follow an itinerary.

    Its own paths are counted where so many left, or more than are drawn near the branches that were found.
    """
    name = next(n for n in run.plan.apart if begins(run.plan.itineraries[NOISE_FREE], run.plan.itineraries[n]))
    plain, near = _share(followers[name].left, run.paths), _sample_near(run)
    rows = []
    for k, i in zip(*np.nonzero(plain[0] + near[0]), strict=True):
        found, other, code = plain[:, k, i], near[:, k, i], CODES[i]
        known = found[0] ** 2 >= KNOWN * found[1] > 0.0 or other[0] == 0.0
        seen = bool(known or interval(*other)[1] < interval(*found)[0])
        found = found if seen else other
        if found[0] >= SMALLEST:
            bounds, paths = interval(*found), found[0] ** 2 / found[1]
            rows.append((k + 1, abs(code), int(np.sign(code)), found[0], *bounds, paths, not seen))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"near": bool})


def _share(left: Floats, paths: int) -> Floats:
    """`Followers.left` of so many paths, in probabilities."""
    return np.asarray(left / np.array([paths, paths**2, paths], dtype=float)[:, None, None])


def interval(total: float, squares: float, largest: float) -> tuple[float, float]:
    """Interval of a weighted sum of Poisson counts, from the sum of the weights, of their squares, and the largest."""
    tail, more, wide = 0.5 - 0.5 * CONFIDENCE, total + largest, squares + largest**2
    low = 0.5 * squares / total * chdtri(2.0 * total**2 / squares, 1.0 - tail) if squares > 0.0 else 0.0
    high = 0.5 * wide / more * chdtri(2.0 * more**2 / wide, tail) if wide > 0.0 else 0.0
    return float(low), float(high)


def _sample_near(run: Any) -> Floats:
    """What `Followers.left` has, in probabilities, from paths drawn near the rare branches of the orbit.

    None are drawn without noise, nor where it has a memory.
    """
    scene, left = run.plan.scene, np.zeros((3, run.plan.impacts, len(CODES)))
    if scene.sigma == 0.0 or scene.correlation_time:
        return left
    dt = default_step(scene, EXACT)
    steps = math.ceil(steps_of(run) * run.plan.dt / dt)
    found = search_of(scene.phase_reduced, run.plan.impacts, steps, dt).until(1.0)
    likely = min(LIKELY, 2.0 * KNOWN / run.paths)  # the run's own paths know the others
    rare = [branch for branch in found.branches if branch.probability < likely and branch.shift.any()]
    shifts = [branch.shift for branch in list_distinct(sorted(rare, key=lambda b: -b.probability), MOST)]
    if not shifts:
        return left
    mixture = mixture_of(shifts, [NEAR / len(shifts)] * len(shifts), np.zeros((run.plan.impacts, 6)), BLOCK)
    seed = np.random.SeedSequence(run.plan.seed.entropy, spawn_key=(*run.plan.seed.spawn_key, LEFT))
    most = math.ceil(run.plan.most_steps * run.plan.dt / dt)
    plan = run.plan._replace(scene=scene.phase_reduced, scheme=EXACT, dt=dt, most_steps=most, seed=seed)
    itinerary = np.array(run.plan.itineraries[NOISE_FREE], dtype=float)
    blocks = max(LEAST_BLOCKS, BLOCKS * len(shifts))
    for block in range(blocks):
        rows, weights, _, _ = sample_mixture(plan, mixture, block)
        count_followed(rows, weights, itinerary, np.zeros(BLOCK), left)
    return _share(left, blocks * BLOCK)
