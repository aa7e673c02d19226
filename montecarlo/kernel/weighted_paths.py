"""Paths drawn near rare branches, with the weight of each impact, reduced to weighted sums."""

import numpy as np

from rattle.montecarlo.kernel import block
from rattle.montecarlo.kernel.mixture import BranchMixture
from rattle.montecarlo.statistics.weighted_sums import (
    WEIGHTED_ORDERS,
    WeightedSums,
    add,
    add_products,
)
from rattle.scene import Floats


def sample_mixture(
    plan: block.Plan, mixture: BranchMixture, number: int
) -> tuple[Floats, Floats, Floats, block.Raw]:
    """Run the paths of a block.

    Returns: Impacts; weights, that is the likelihood ratio of the plain distribution to the mixture
    given the steps up to each impact, 0 of those that a path did not have; the noise up to each
    impact along each unit vector; and the output that these are of. Shapes: result (BLOCK, impacts,
    COLUMNS), (BLOCK, impacts), (BLOCK, impacts, branches).
    """
    raw = block.sample(plan._replace(mixture=mixture), number)
    weights = np.ascontiguousarray(raw.controls[:, :, 0])
    return raw.rows[0], weights, raw.controls[:, :, 1:], raw


def run_mixture(
    plan: block.Plan, mixture: BranchMixture, number: int
) -> tuple[block.BlockResult, None]:
    """Run a block and reduce it."""
    rows, weights, _, raw = sample_mixture(plan, mixture, number)
    if plan.scene.stages == 1:
        rows[:, :, 4:6] = 0.0  # a single stage leaves these columns undefined
    values = rows[:, :, :6]
    centre = mixture.centre
    if plan.energy:
        values = np.concatenate([values, block.energy_losses(plan.scene.constants, rows)], axis=2)
        centre = np.column_stack([centre, np.zeros(plan.impacts)])
    pairs = np.array(block.SECTION_PAIRS)

    def weighted(weights: Floats) -> WeightedSums:
        sums = np.zeros((mixture.counts.size, *centre.shape, WEIGHTED_ORDERS))
        ends = np.cumsum(mixture.counts)
        for i, (end, n) in enumerate(zip(ends, mixture.counts, strict=True)):
            add(values[end - n : end], weights[end - n : end], centre, sums[i])
        products = np.zeros((plan.impacts, len(pairs)))
        add_products(rows, weights, centre, pairs, products)
        return WeightedSums(mixture.counts.astype(float), centre, sums, products)

    codes, followed = block.tally(plan, rows, weights)
    # in paths: their weights add up to the number of paths only on average
    scale = np.isfinite(rows[:, :, 6]).sum(axis=0) / np.maximum(codes.sum(axis=1), 1e-300)
    codes = codes * scale[:, None]
    followed = {name: agreeing * scale for name, agreeing in followed.items()}
    followers = {}
    for name in plan.apart:
        left = np.zeros((3, plan.impacts, len(block.CODES)))
        stays = np.zeros(block.BLOCK)
        block.count_followed(
            rows, weights, np.array(plan.itineraries[name], dtype=float), stays, left
        )
        kept = np.where(np.arange(plan.impacts) < stays[:, None], weights, 0.0)
        followers[name] = block.Followers({"weighted": weighted(kept)}, left)
    sums = {"weighted": weighted(weights)}
    counts = raw.path_steps, raw.sticking_steps, raw.unfinished
    return block.BlockResult(sums, codes, followed, *counts, followers), None
