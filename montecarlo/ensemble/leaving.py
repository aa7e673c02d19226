"""Probability of leaving the noise-free itinerary, by exit: from a run, and from paths drawn near
rare exits.

Which of the two an exit is known from is settled before anything is counted, by pilots that depend
on the scene alone (`rattle.montecarlo.ensemble.aim`): paths are drawn near exits of which the run
is expected to have few, and which the pilots know well enough to aim at; elsewhere the paths of the
run are counted, though there be none.  An exit that the pilots do not know is in no row unless a
path of the run has taken it.

An interval is that of a weighted sum of Poisson counts (Fay and Feuer 1997); with equal weights it
is the exact one of Garwood (1936).  Weights are bounded and their sums unbiased, whichever exits
were aimed at (`rattle.montecarlo.kernel.mixture`).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import chdtri

from rattle.montecarlo.branches.choose import LIKELY
from rattle.montecarlo.branches.search import search_of
from rattle.montecarlo.ensemble.aim import ENOUGH_PATHS, Exit, aim, share_out
from rattle.montecarlo.kernel.block import (
    BLOCK,
    Followers,
    add_exits,
    follow_itinerary,
    impact_codes,
    sample_mixture,
)
from rattle.montecarlo.kernel.mixture import mixture_of
from rattle.montecarlo.schemes.step_size import default_step
from rattle.montecarlo.seed import child_seed
from rattle.montecarlo.settings import EXACT_SCHEME, NOISE_FREE, begins
from rattle.montecarlo.statistics.intervals import CONFIDENCE
from rattle.scene import Floats

# blocks of paths for each exit, and for all
BLOCKS_OF_AN_EXIT = 4
LEAST_LEAVING_BLOCKS = 16
ENOUGH_EXITS = 100.0  # expected paths of a run that leave by an exit from which on they are enough
LEAVING_KEY = 0x1EA  # spawn key of the random numbers of these paths
LEAVING_COLUMNS = ("impact", "mesh", "side", "probability", "low", "high", "paths", "near")


def find_leaving(run: Any, followers: Mapping[str, Followers]) -> pd.DataFrame:
    """`Ensemble.leaving` of a run, from what it summed over the paths that follow an itinerary."""
    name = next(
        n
        for n in run.plan.apart
        if begins(run.plan.itineraries[NOISE_FREE], run.plan.itineraries[n])
    )
    plain = _share(followers[name].left, run.paths)
    exits = _list_exits(run)
    aimed = [
        one
        for one in exits
        if one.effective >= ENOUGH_PATHS and one.probability < min(LIKELY, ENOUGH_EXITS / run.paths)
    ]
    near = _sample_near(run, aimed)
    one_path = 1.0 / run.paths
    codes = impact_codes(run.scene.stages)
    listed, near_ones = ([(one.impact, one.code) for one in some] for some in (exits, aimed))
    rows = []
    for k, i in np.ndindex(plain.shape[1:]):
        code = codes[i]
        key = (k + 1, code)
        is_near = key in near_ones
        total, squares, largest = near[:, k, i] if is_near else plain[:, k, i]
        if key not in listed and total == 0.0:
            continue
        bounds = interval(total, squares, max(largest, 0.0 if is_near else one_path))
        paths = total**2 / squares if squares > 0.0 else 0.0
        side = int(np.sign(code))
        rows.append((k + 1, abs(code), side, total, *bounds, paths, is_near))
    return pd.DataFrame(rows, columns=LEAVING_COLUMNS).astype({"near": bool})


def _share(left: Floats, paths: int) -> Floats:
    """`Followers.left` of so many paths, in probabilities."""
    return np.asarray(left / np.array([paths, paths**2, paths], dtype=float)[:, None, None])


def interval(total: float, squares: float, largest: float) -> tuple[float, float]:
    """Interval of a weighted sum of Poisson counts, from the sum of the weights, of their squares,
    and the largest."""
    tail = 0.5 - 0.5 * CONFIDENCE
    more = total + largest
    wide = squares + largest**2
    low = (
        0.5 * squares / total * chdtri(2.0 * total**2 / squares, 1.0 - tail)
        if squares > 0.0
        else 0.0
    )
    high = 0.5 * wide / more * chdtri(2.0 * more**2 / wide, tail) if wide > 0.0 else 0.0
    return float(low), float(high)


def expect_leaving(run: Any, impacts: int) -> float:
    """Share of paths that is expected to leave the noise-free itinerary by an impact, to first
    order in the noise.

    It is that of the search for branches and depends on the scene alone, not on what is counted
    later.
    """
    scene = run.plan.scene
    if scene.sigma == 0.0:
        return 0.0
    branches = search_of(scene.phase_reduced, run.plan.impacts).until(1.0).branches
    return float(sum(branch.probability for branch in branches if branch.impact <= impacts))


def _list_exits(run: Any) -> Sequence[Exit]:
    """The rare exits that pilots know; none without noise, nor where it has a memory."""
    scene = run.plan.scene
    if scene.sigma == 0.0 or scene.correlation_time:
        return ()
    return aim(scene.phase_reduced, run.plan.impacts, default_step(scene, EXACT_SCHEME))


def _sample_near(run: Any, exits: Sequence[Exit]) -> Floats:
    """What `Followers.left` has, in probabilities, from paths drawn near exits."""
    wheels = run.scene.stages
    left = np.zeros((3, run.plan.impacts, len(impact_codes(wheels))))
    if not exits:
        return left
    centre = np.zeros((run.plan.impacts, 2 + 2 * wheels))
    mixture = mixture_of(*share_out(exits), centre, BLOCK)
    seed = child_seed(run.plan.seed, LEAVING_KEY)
    dt = default_step(run.plan.scene, EXACT_SCHEME)
    most = math.ceil(run.plan.most_steps * run.plan.dt / dt)
    scene = run.plan.scene.phase_reduced
    plan = run.plan._replace(scene=scene, scheme=EXACT_SCHEME, dt=dt, most_steps=most, seed=seed)
    itinerary = run.plan.itineraries[NOISE_FREE]
    blocks = max(LEAST_LEAVING_BLOCKS, BLOCKS_OF_AN_EXIT * len(exits))
    for block in range(blocks):
        rows, weights, _, _ = sample_mixture(plan, mixture, block)
        _, stays = follow_itinerary(rows, weights, itinerary)
        add_exits(rows, weights, itinerary, stays, left)
    return _share(left, blocks * BLOCK)
