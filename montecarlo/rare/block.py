"""One block of a mixture of plain paths and of paths near rare branches, reduced to weighted sums."""

from __future__ import annotations

import numpy as np

from rattle.montecarlo.kernel.block import (
    BLOCK,
    CODES,
    SECTION_PAIRS,
    BlockResult,
    Followers,
    Plan,
    begin_block,
    count_followed,
    energy_losses,
)
from rattle.montecarlo.kernel.kernel import COLUMNS, Output
from rattle.montecarlo.rare.kernel import run_weighted
from rattle.montecarlo.rare.mixture import BranchMixture, draw_targets
from rattle.montecarlo.rare.weighted_sums import ORDERS, WeightedSums, add
from rattle.scene.compiled import lean
from rattle.scene.types import Floats


def sample_mixture(plan: Plan, mixture: BranchMixture, block: int) -> tuple[Floats, Floats, int, int]:
    """Run the paths of a block.

    Returns: Impacts; weights, that is the likelihood ratio of the plain distribution to the mixture given the steps up
    to each impact; path-steps; and those in which a mesh stayed closed. Shapes: result (BLOCK, impacts, COLUMNS),
    (BLOCK, impacts).
    """
    first = block * BLOCK
    job, every, room = begin_block(plan, first, BLOCK)
    rows, weights = np.full((1, BLOCK, plan.impacts, COLUMNS), np.nan), np.full((BLOCK, plan.impacts, 1), np.nan)
    lanes = every.w.shape[1]
    part, ahead = np.full(lanes, -1), np.zeros(lanes)
    part[:BLOCK], ahead[:BLOCK] = draw_targets(mixture, plan.seed, block)
    done = np.zeros((len(mixture.unit), lanes))
    out = Output(first, rows, plan.fixed_steps, np.empty((1, 0, 0, 4)), weights)
    steps, sticking = run_weighted(job, mixture, every, room, part, ahead, done, out)
    return rows[0], weights[:, :, 0], int(steps), int(sticking)


def run_mixture(plan: Plan, mixture: BranchMixture, block: int) -> tuple[BlockResult, None]:
    """Run a block and reduce it."""
    rows, weights, steps, sticking = sample_mixture(plan, mixture, block)
    if plan.scene.stages == 1:
        rows[:, :, 4:6] = 0.0  # a single stage leaves these columns undefined
    values, centre = rows[:, :, :6], mixture.centre
    if plan.energy:
        values = np.concatenate([values, energy_losses(plan.scene.constants, rows)], axis=2)
        centre = np.column_stack([centre, np.zeros(plan.impacts)])
    pairs = np.array(SECTION_PAIRS)

    def weighted(weights: Floats, products: Floats) -> WeightedSums:
        sums, ends = np.zeros((mixture.counts.size, *centre.shape, ORDERS)), np.cumsum(mixture.counts)
        for i, (end, n) in enumerate(zip(ends, mixture.counts, strict=True)):
            add(values[end - n : end], weights[end - n : end], centre, sums[i])
        return WeightedSums(mixture.counts.astype(float), centre, sums, products)

    products, codes = np.zeros((plan.impacts, len(pairs))), np.zeros((plan.impacts, len(CODES)))
    listed = np.array(list(plan.itineraries.values()), dtype=float).reshape(-1, plan.impacts)
    agreeing = np.zeros((len(listed), plan.impacts))
    _tally(rows, weights, centre, pairs, listed, products, codes, agreeing)
    # in paths: their weights add up to the number of paths only on average
    scale = np.isfinite(rows[:, :, 6]).sum(axis=0) / np.maximum(codes.sum(axis=1), 1e-300)
    codes, agreeing = codes * scale[:, None], agreeing * scale
    followers = {}
    for name in plan.apart:
        left, stays, of = np.zeros((3, plan.impacts, len(CODES))), np.zeros(BLOCK), np.zeros_like(products)
        count_followed(rows, weights, np.array(plan.itineraries[name], dtype=float), stays, left)
        kept = np.where(np.arange(plan.impacts) < stays[:, None], weights, 0.0)
        _tally(rows, kept, centre, pairs, listed[:0], of, np.zeros_like(codes), agreeing[:0])
        followers[name] = Followers({"weighted": weighted(kept, of)}, left)
    followed, unfinished = dict(zip(plan.itineraries, agreeing, strict=True)), int(np.isnan(rows[:, -1, 0]).sum())
    found = {"weighted": weighted(weights, products)}
    return BlockResult(found, codes, followed, steps, sticking, unfinished, followers), None


@lean
def _tally(
    rows: Floats,
    weights: Floats,
    centre: Floats,
    pairs: Floats,
    itineraries: Floats,
    products: Floats,
    codes: Floats,
    agreeing: Floats,
) -> None:
    """Weighted products of pairs, weights by each of `CODES`, and of the paths that have followed each itinerary."""
    for p in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            w = weights[p, k]
            if w > 0.0:
                for j in range(pairs.shape[0]):
                    a, b = pairs[j]
                    products[k, j] += w * (rows[p, k, a] - centre[k, a]) * (rows[p, k, b] - centre[k, b])
                for i, code in enumerate(CODES):
                    codes[k, i] += w * (rows[p, k, 6] == code)
        for i in range(len(itineraries)):
            for k in range(rows.shape[1]):
                if rows[p, k, 6] != itineraries[i, k]:
                    break
                agreeing[i, k] += weights[p, k]
