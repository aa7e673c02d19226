"""Exact flights of a block of paths, some of them drawn near rare branches, with the weight of each
impact.

They are reduced to weighted sums.
"""

import math

import numpy as np

from rattle.montecarlo.kernel import block
from rattle.montecarlo.kernel.kernel import COLUMNS, EXACT, Job, Output, finish_inside, step_lanes
from rattle.montecarlo.kernel.lanes import CHUNK, Lanes, Room, list_marked, of_level, retire
from rattle.montecarlo.kernel.mixture import BranchMixture, draw_targets
from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import Word, fill_normals
from rattle.montecarlo.schemes.short_flight import phase_at
from rattle.montecarlo.schemes.step_state import Progress
from rattle.montecarlo.statistics.weighted_sums import ORDERS, WeightedSums, add, add_products
from rattle.scene import Floats
from rattle.scene.compiled import lean, lean_internal, widest_vectors

FAR = 6.0  # argument from which erfc is 0, and below whose negative it is 2


@lean_internal
def _condition(
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
        own = part[p] == k
        x = pull * ahead[p] + spread * z[p] if own else z[p]
        z[p] = x
        ahead[p] -= u * x if own else 0.0


@lean_internal
def _add_along(z: Floats, u: float, done: Floats, lanes: int) -> None:
    """Add a step's normals to ``u z``; vectorises."""
    widest_vectors()
    for p in range(lanes):
        done[p] += u * z[p]


@lean_internal
def _weight(mixture: BranchMixture, n: int, p: int, done: Floats) -> float:
    """Weight of a path after n steps."""
    total = mixture.plain
    last = mixture.rest.shape[1] - 1
    for k in range(mixture.unit.shape[0]):
        rest = mixture.rest[k, min(n, last)]
        scale = 1.0 / math.sqrt(2.0 * rest) if rest > 1e-12 else 1e9
        for t in range(mixture.level.shape[1]):
            short = (mixture.level[k, t] - done[k, p]) * scale
            if short < -FAR:
                total += mixture.rate[k, t]
            elif short < FAR:
                total += mixture.rate[k, t] * 0.5 * math.erfc(short)
    return 1.0 / total


@lean
def run_weighted(
    job: Job, mixture: BranchMixture, every: Lanes, room: Room, out: Output
) -> tuple[int, int]:
    """Follow a block of paths until each has had its impacts; gives path-steps, and those in which
    a mesh sticks.

    `room`: Of each path it carries the branch, what the steps ahead add along the branch's unit
    vector, and along each unit vector the sum so far. `out`: Its `controls` take the weight of each
    impact, given the steps up to its own, and as many of these sums there as there is room for,
    shape (paths, impacts, 1 + sums).
    """
    widest_vectors()
    part = room.carried[0]
    ahead = room.carried[1]
    done = room.carried[2:]
    _, live, impacts, _ = out.rows.shape
    n = 0
    z = room.z
    steps = mixture.unit.shape[1]
    work = 0
    sticking = 0
    while n < job.most_steps and live > 0:
        wide = (live + 7) // 8 * 8
        for _ in range(min(CHUNK, job.most_steps - n)):
            if n % 2 == 0:
                fill_normals(job.key, room.path, Word(n // 2), wide, z)
            w = z[n % 2 * 2]
            area = z[n % 2 * 2 + 1]
            for k in range(mixture.unit.shape[0]):
                if n < steps and mixture.unit[k, n] != 0.0:
                    _condition(w, mixture.unit[k, n], mixture.rest[k, n], k, part, ahead, wide)
            for k in range(mixture.unit.shape[0]):  # after all parts have shifted their normals
                if n < steps and mixture.unit[k, n] != 0.0:
                    _add_along(w, mixture.unit[k, n], done[k], wide)
            begin = job.tau + n * job.dt
            lanes = of_level(every, 0, w, area)
            step_lanes(EXACT, job, begin, job.dt, lanes, room.marks, wide)
            found = list_marked(room.marks, live, room.groups, room.hits)
            phase = phase_at(job.c.drive, begin)
            for i in range(found):
                p = room.hits[i]
                s = lanes.before
                noise = Noise(w[p] * math.sqrt(job.dt), area[p] * math.sqrt(job.dt / 12.0))
                at = Progress(0, begin, job.dt, noise, s[0, p], s[1, p], s[2, p], s[3, p])
                row = int(room.path[p]) - out.first
                met = lanes.impacts[p]
                sticking += finish_inside(EXACT, job, n, 0, p, at, phase, lanes, room, out, impacts)
                if lanes.impacts[p] > met:
                    weight = _weight(mixture, n + 1, p, done)
                    for k in range(met, min(lanes.impacts[p], impacts)):
                        out.controls[row, k, 0] = weight
                        for j in range(out.controls.shape[2] - 1):
                            out.controls[row, k, 1 + j] = done[j, p]
            n += 1
            work += live
        live = retire(every, room, impacts, live)
    return work, sticking


def sample_mixture(
    plan: block.Plan, mixture: BranchMixture, number: int
) -> tuple[Floats, Floats, int, int]:
    """Run the paths of a block.

    Returns: Impacts; weights, that is the likelihood ratio of the plain distribution to the mixture
    given the steps up to each impact, 0 of those that a path did not have; path-steps; and those in
    which a mesh stayed closed. Shapes: result (BLOCK, impacts, COLUMNS), (BLOCK, impacts).
    """
    rows, controls, steps, sticking = _sample(plan, mixture, number, 0)
    return rows, controls[:, :, 0], steps, sticking


def sample_along(
    plan: block.Plan, mixture: BranchMixture, number: int
) -> tuple[Floats, Floats, Floats]:
    """Run the paths of a block, and tell what their noise was along each unit vector.

    Returns: Impacts and weights as of `sample_mixture`, and the noise up to each impact. Shapes:
    result (BLOCK, impacts, COLUMNS), (BLOCK, impacts), (BLOCK, impacts, unit vectors).
    """
    rows, controls, _, _ = _sample(plan, mixture, number, len(mixture.unit))
    return rows, controls[:, :, 0], controls[:, :, 1:]


def _sample(
    plan: block.Plan, mixture: BranchMixture, number: int, along: int
) -> tuple[Floats, Floats, int, int]:
    """Impacts of a block, its weights and the noise along so many unit vectors, and the numbers of
    `sample_mixture`."""
    first = number * block.BLOCK
    job, every, room = block.begin_block(plan, first, block.BLOCK, carried=2 + len(mixture.unit))
    rows = np.full((1, block.BLOCK, plan.impacts, COLUMNS), np.nan)
    controls = np.zeros((block.BLOCK, plan.impacts, 1 + along))
    room.carried[:2, : block.BLOCK] = draw_targets(mixture, plan.seed, number)
    out = Output(first, rows, plan.fixed_steps, np.empty((1, 0, 0, 4)), controls)
    steps, sticking = run_weighted(job, mixture, every, room, out)
    return rows[0], controls, int(steps), int(sticking)


def run_mixture(
    plan: block.Plan, mixture: BranchMixture, number: int
) -> tuple[block.BlockResult, None]:
    """Run a block and reduce it."""
    rows, weights, steps, sticking = sample_mixture(plan, mixture, number)
    if plan.scene.stages == 1:
        rows[:, :, 4:6] = 0.0  # a single stage leaves these columns undefined
    values = rows[:, :, :6]
    centre = mixture.centre
    if plan.energy:
        values = np.concatenate([values, block.energy_losses(plan.scene.constants, rows)], axis=2)
        centre = np.column_stack([centre, np.zeros(plan.impacts)])
    pairs = np.array(block.SECTION_PAIRS)

    def weighted(weights: Floats) -> WeightedSums:
        sums = np.zeros((mixture.counts.size, *centre.shape, ORDERS))
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
    unfinished = int(np.isnan(rows[:, -1, 0]).sum())
    sums = {"weighted": weighted(weights)}
    return block.BlockResult(sums, codes, followed, steps, sticking, unfinished, followers), None
