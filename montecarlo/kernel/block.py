"""One block of paths: random streams, walls and initial states, run through the kernel and reduced
to sums."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rattle.montecarlo.kernel.kernel import COLUMNS, Job, Output, block_kernel
from rattle.montecarlo.kernel.mixture import BranchMixture, draw_targets, no_mixture
from rattle.montecarlo.noise.backlash import backlash_of, draw_walls
from rattle.montecarlo.noise.memory import begin_memory, memory_of
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.schemes.control_variate import LinearPath, no_control
from rattle.montecarlo.schemes.lanes import Lanes, Room, lanes_of
from rattle.montecarlo.schemes.step_size import SCHEMES
from rattle.montecarlo.statistics.central_sums import VARIANCE, CentralSums, columns_of
from rattle.montecarlo.statistics.section_statistics import PAIR, Orders
from rattle.montecarlo.statistics.weighted_sums import WeightedSums
from rattle.scene import SECTION, Constants, Floats, Ints, Scene
from rattle.scene.compiled import lean
from rattle.scene.impact import energy_loss, struck

BLOCK = 1024
"""Paths of a block: small enough for the caches, large enough that few lanes idle while the last
paths finish."""

CARRIED = 5
"""Components of the linearised path."""

PAIRS = tuple((i, j) for i in range(5) for j in range(i))
"""Pairs among tau, x1, y1, x2, y2 whose covariance is kept."""

SECTION_OF = (0, 2, 3, 4, 5)
"""Their indices in `SECTION`."""

SECTION_PAIRS = tuple((SECTION_OF[i], SECTION_OF[j]) for i, j in PAIRS)
"""The pairs by indices in `SECTION`."""


class Plan(NamedTuple):
    """Settings of a run, common to all of its blocks."""

    scene: Scene  # what is simulated
    paths: int  # number of paths
    impacts: int  # of each path
    dt: float  # finest step
    scheme: str  # name in `SCHEMES`
    seed: np.random.SeedSequence  # of all random numbers
    most_steps: int  # finest steps after which a path is given up
    fixed_steps: Ints  # finest steps after which states are recorded: the fixed times
    # named sequences of ``mesh * side``, one for each impact
    itineraries: dict[str, tuple[int, ...]]
    levels: int  # number of step sizes on the same Brownian paths: dt, 2 dt,
    control: LinearPath = no_control()  # control variate; empty for none
    keep: bool = False  # whether all impacts are kept
    two_point: bool = False  # whether increments are two-point
    # whether to run the antithetic partner of each path: all noise negated, backlashes the same
    mirrored: bool = False
    energy: bool = False  # whether the energy loss of impacts is recorded
    mixture: BranchMixture | None = None  # from which paths are drawn, if not all are plain
    apart: tuple[str, ...] = ()  # names of the itineraries whose paths are summed apart too

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.paths // BLOCK)


class Raw(NamedTuple):
    """Output of the kernel for a block."""

    rows: Floats  # impacts; NaN where a path did not reach one; (levels, paths, impacts, COLUMNS)
    fixed: Floats  # states at fixed times; (levels, paths, times, 4)
    # section quantities of the linearised path, or weights and noise of a mixture, see `Output`; no
    # paths where there are neither
    controls: Floats
    path_steps: int  # steps taken, over all paths
    sticking_steps: int  # those of them in which a mesh stayed closed to the end
    unfinished: int  # paths without all impacts


def start_state(scene: Scene, walls: Floats) -> Floats:
    """Initial states, after the impact at the start if there is one.

    `scene`: Its start; a coordinate on a flank is put on each path's own flank. Shapes: `walls` (4,
    paths); result (4, paths).
    """
    s = scene.start
    state = np.empty((4, walls.shape[1]))
    for i, (x, gap) in enumerate(((s.x1, scene.gap1), (s.x2, scene.gap2))):
        state[2 * i] = x if abs(x) != gap else (walls[2 * i] if x > 0.0 else -walls[2 * i + 1])
    state[1] = s.y1
    state[3] = s.y2
    if s.mesh:
        state[1], state[3] = struck(scene.constants, s.mesh, s.y1, s.y2)
    return state


_own = threading.local()


def _array(name: str, shape: tuple[int, ...], fill: float, reuse: bool) -> Floats:
    """A filled array; with `reuse` in the same memory for all blocks of a thread (fresh pages cost
    a fifth)."""
    array: Floats | None = getattr(_own, name, None) if reuse else None
    if array is None or array.shape != shape:
        array = np.empty(shape)
        if reuse:
            setattr(_own, name, array)
    array.fill(fill)
    return array


def begin_block(plan: Plan, first: int, paths: int) -> tuple[Job, Lanes, Room]:
    """Settings, paths side by side, at their start, and buffers of a block that begins with path
    `first`."""
    scene = plan.scene
    c = scene.constants
    key = key_of(plan.seed)
    backlash = backlash_of(scene)
    walls = np.repeat([[c.wall1], [c.wall1], [c.wall2], [c.wall2]], paths, axis=1)
    if backlash.random:
        draw_walls(backlash, key, first, walls)
    if plan.mirrored:
        c = c._replace(sigma=-c.sigma)
    mixture = plan.mixture or no_mixture()
    job = Job(
        c,
        backlash,
        key,
        plan.dt,
        plan.two_point,
        plan.control,
        mixture,
        memory_of(scene.correlation_time, plan.dt),
    )
    carried = max(CARRIED, 2 + len(mixture.unit))
    every, room = lanes_of(
        plan.levels, first, start_state(scene, walls), walls, scene.phase, carried
    )
    if scene.correlation_time:
        begin_memory(scene.correlation_time, key, first, room.eta)
    return job, every, room


def sample(plan: Plan, block: int, reuse: bool = False) -> Raw:
    """Run the paths of a block; those of a mixture at one step size, and nothing beside them."""
    mixture = plan.mixture
    if mixture is not None:
        plan = plan._replace(
            control=no_control(), fixed_steps=plan.fixed_steps[:0], levels=1, two_point=False
        )
    first = block * BLOCK
    paths = BLOCK if mixture is not None else min(BLOCK, plan.paths - first)
    job, every, room = begin_block(plan, first, paths)
    beside = (paths if plan.control.at_step.size else 0, plan.impacts, COLUMNS)
    if mixture is not None:
        room.carried[:2, :paths] = draw_targets(mixture, plan.seed, block)
        beside = (paths, plan.impacts, 1 + len(mixture.unit))
    rows = _array("rows", (plan.levels, paths, plan.impacts, COLUMNS), np.nan, reuse)
    fixed = _array("fixed", (plan.levels, paths, plan.fixed_steps.size, 4), np.nan, reuse)
    controls = _array("controls", beside, 0.0, reuse)
    out = Output(first, rows, plan.fixed_steps, fixed, controls)
    kernel = block_kernel(SCHEMES[plan.scheme])
    work, sticking = kernel(job, plan.scene.phase, plan.most_steps, every, room, out)
    unfinished = np.isnan(rows[0, :, -1, 0]).sum()
    return Raw(rows, fixed, controls, int(work), int(sticking), int(unfinished))


@dataclass(frozen=True)
class Followers:
    """Sums over the paths that have followed an itinerary so far, and how the others left it."""

    sums: dict[str, Any]  # as in `BlockResult`, of these paths alone
    # weight of the paths that left at an impact by each of `CODES` (in plain runs their number),
    # sum of its squares, and the largest weight of one; (3, impacts, CODES)
    left: Floats

    def merge(self, other: "Followers") -> "Followers":
        """Both sets of paths together."""
        left = self.left + other.left
        left[2] = np.maximum(self.left[2], other.left[2])
        return Followers({name: s.merge(other.sums[name]) for name, s in self.sums.items()}, left)


@dataclass(frozen=True, repr=False)
class BlockResult:
    """A block reduced to mergeable sums and counts."""

    # ``section`` over (impact, quantity); ``section_pairs`` over (impact, pair of `PAIRS`);
    # ``fixed`` over (time, pair of `CROSS`).  With step bias also ``fine_coarse`` and
    # ``coarse_coarser`` over (impact, quantity), the same quantity at two step sizes, and
    # ``coarse_fixed`` over (time, stage), displacement with velocity at 2 dt.  With a control
    # variate ``control`` over (impact, quantity), the quantity with that of the linearised path.
    # If asked for, ``energy`` over (impact, 1), the energy loss.  Of a mixture ``weighted`` alone
    sums: dict[str, Any]
    codes: Floats  # counts of mesh and side of each impact; (impacts, CODES)
    # number of paths that have followed each itinerary up to each impact; (impacts,)
    agreeing: dict[str, Floats]
    path_steps: int  # as in `Raw`, also the next two
    sticking_steps: int
    unfinished: int
    followers: dict[str, Followers] = field(default_factory=dict)  # by the names of `Plan.apart`

    def merge(self, other: "BlockResult") -> "BlockResult":
        """Both blocks together."""
        return BlockResult(
            {name: s.merge(other.sums[name]) for name, s in self.sums.items()},
            self.codes + other.codes,
            {name: count + other.agreeing[name] for name, count in self.agreeing.items()},
            self.path_steps + other.path_steps,
            self.sticking_steps + other.sticking_steps,
            self.unfinished + other.unfinished,
            {name: f.merge(other.followers[name]) for name, f in self.followers.items()},
        )


CODES = (1, -1, 2, -2)
"""``mesh * side`` of an impact."""

CROSS = tuple((i, j) for i in range(4) for j in range(i, 4))
"""Pairs of states whose covariance at fixed times is kept."""


def _pairs(
    groups: int,
    values: Floats,
    pairs: Sequence[tuple[int, int]],
    orders: Orders,
    other: Floats | None = None,
) -> CentralSums:
    """Sums over pairs of variables of (groups * variables, paths), the second of each pair from
    `other` if given."""
    base = len(values) // groups * np.arange(groups)[:, None]
    cells = np.ascontiguousarray((base + np.array(pairs).T[:, None]).reshape(2, -1))
    return CentralSums.of_columns(
        values, values if other is None else other, cells, orders, (groups, len(pairs))
    )


JOINT = ("section", "section_pairs", "fine_coarse", "coarse_coarser")
"""Names of the sums over the section quantities."""
OWN = [(i, i) for i in range(len(SECTION))]


def _section_sums(impacts: int, levels: list[Floats]) -> dict[str, Any]:
    """Sums over the section quantities, shape (impacts * COLUMNS, paths) at each step size."""
    found = list(CentralSums.of_groups(levels[0], impacts, len(SECTION), SECTION_PAIRS))
    if len(levels) > 1:
        found.append(_pairs(impacts, levels[0], OWN, PAIR, levels[1]))
        found.append(_pairs(impacts, levels[1], OWN, ((0, 2),), levels[2]))
    return dict(zip(JOINT, found, strict=False))


def _plain_sums(plan: Plan, raw: Raw, rows: list[Floats]) -> dict[str, Any]:
    """Sums over the plain paths of a block.

    Shapes: `rows` (impacts * COLUMNS, paths) at each step size.
    """
    section = partial(_pairs, plan.impacts)
    sums = _section_sums(plan.impacts, rows)
    if plan.energy:
        losses = energy_losses(plan.scene.constants, raw.rows[0])
        sums["energy"] = section(columns_of(losses), [(0, 0)], VARIANCE)
    if plan.control.at_step.size:
        sums["control"] = section(rows[0], OWN, PAIR, columns_of(raw.controls))
    if plan.fixed_steps.size:
        times = partial(_pairs, plan.fixed_steps.size)
        sums["fixed"] = times(columns_of(raw.fixed[0]), CROSS, PAIR)
        if plan.levels > 1:
            sums["coarse_fixed"] = times(columns_of(raw.fixed[1]), ((0, 1), (2, 3)), PAIR)
    return sums


def _weighted_sums(
    plan: Plan, mixture: BranchMixture, rows: Floats, weights: Floats
) -> WeightedSums:
    """Sums over the paths of a block that is drawn from a mixture, with given weights."""
    values = rows[:, :, :6]
    centre = mixture.centre
    if plan.energy:
        values = np.concatenate([values, energy_losses(plan.scene.constants, rows)], axis=2)
        centre = np.column_stack([centre, np.zeros(plan.impacts)])
    return WeightedSums.of_parts(values, weights, centre, mixture.counts, SECTION_PAIRS)


def sample_mixture(
    plan: Plan, mixture: BranchMixture, block: int
) -> tuple[Floats, Floats, Floats, Raw]:
    """Run the paths of a block that is drawn from a mixture.

    Returns: Impacts; weights, that is the likelihood ratio of the plain distribution to the mixture
    given the steps up to each impact, 0 of those that a path did not have; the noise up to each
    impact along each unit vector; and the output that these are of. Shapes: result (BLOCK, impacts,
    COLUMNS), (BLOCK, impacts), (BLOCK, impacts, branches).
    """
    raw = sample(plan._replace(mixture=mixture), block)
    weights = np.ascontiguousarray(raw.controls[:, :, 0])
    return raw.rows[0], weights, raw.controls[:, :, 1:], raw


def run(plan: Plan, block: int) -> tuple[BlockResult, Floats | None]:
    """Run a block and reduce it.

    Shapes: `rows` (paths, impacts, COLUMNS), or None.
    """
    mixture = plan.mixture
    followers = {}
    if mixture is None:
        raw = sample(plan, block, reuse=True)
        weights = np.ones(raw.rows.shape[1:3])
        columns = [columns_of(level) for level in raw.rows]
        sums = _plain_sums(plan, raw, columns)
    else:
        rows, weights, _, raw = sample_mixture(plan, mixture, block)
        if plan.scene.stages == 1:
            rows[:, :, 4:6] = 0.0  # a single stage leaves these columns undefined
        sums = {"weighted": _weighted_sums(plan, mixture, rows, weights)}
    first = raw.rows[0]
    codes = np.zeros((plan.impacts, len(CODES)))
    _count_codes(first, weights, codes)
    agreeing = {}
    for name, itinerary in plan.itineraries.items():
        agreeing[name], stays, left = follow_itinerary(first, weights, itinerary)
        if name not in plan.apart:
            continue
        if mixture is None:
            apart = _follower_sums(plan, itinerary, raw.rows, columns, stays, sums)
        else:
            kept = np.where(np.arange(plan.impacts) < stays[:, None], weights, 0.0)
            apart = {"weighted": _weighted_sums(plan, mixture, first, kept)}
        followers[name] = Followers(apart, left)
    if mixture is not None:
        # in paths: their weights add up to the number of paths only on average
        scale = np.isfinite(first[:, :, 6]).sum(axis=0) / np.maximum(codes.sum(axis=1), 1e-300)
        codes = codes * scale[:, None]
        agreeing = {name: count * scale for name, count in agreeing.items()}
    kept_rows = first.copy() if plan.keep else None
    if kept_rows is not None and plan.scene.stages == 1:
        kept_rows[:, :, 4:6] = np.nan  # a single stage leaves these columns undefined
    counts = raw.path_steps, raw.sticking_steps, raw.unfinished
    return BlockResult(sums, codes, agreeing, *counts, followers), kept_rows


def _follower_sums(
    plan: Plan,
    itinerary: Sequence[int],
    rows: Floats,
    columns: list[Floats],
    stays: Floats,
    sums: dict[str, Any],
) -> dict[str, Any]:
    """Sums over the paths of a block that follow an itinerary; those over all, `sums`, where none
    leaves it."""
    ones = np.ones(rows.shape[1:3])
    stays_of = [stays, *(follow_itinerary(level, ones, itinerary)[1] for level in rows[1:])]
    if np.min(stays_of) == plan.impacts:
        return {name: sums[name] for name in JOINT if name in sums}
    kept = []
    for cells, stay in zip(columns, stays_of, strict=True):
        cells = cells.copy().reshape(plan.impacts, -1, cells.shape[1])
        cells[:, :, : stay.size].swapaxes(1, 2)[np.arange(plan.impacts)[:, None] >= stay] = np.nan
        kept.append(cells.reshape(-1, cells.shape[2]))
    return _section_sums(plan.impacts, kept)


def energy_losses(c: Constants, rows: Floats) -> Floats:
    """Energy loss of each impact of each path, shape (paths, impacts, 1); NaN where there was
    none."""
    y1 = rows[..., 3:4]
    y2 = rows[..., 5:6]
    first = np.abs(rows[..., 6:]) == 1.0
    return np.where(first, energy_loss(c, 1, y1, y2), energy_loss(c, 2, y1, y2))


@lean
def _count_codes(rows: Floats, weights: Floats, codes: Floats) -> None:
    """Add the weight of each of `CODES` at each impact.

    Shapes: `rows` (paths, impacts, COLUMNS); `weights` (paths, impacts); `codes` (impacts, CODES).
    """
    paths, impacts = weights.shape
    for p in range(paths):
        for k in range(impacts):
            for i, code in enumerate(CODES):
                codes[k, i] += weights[p, k] * (rows[p, k, 6] == code)


def follow_itinerary(
    rows: Floats, weights: Floats, itinerary: Sequence[int], left: Floats | None = None
) -> tuple[Floats, Floats, Floats]:
    """The weight that has followed an itinerary up to each impact, up to which impact each path
    has, and what its next impact was: `Followers.left`, added to that of other paths if given.

    Shapes: `rows` (paths, impacts, COLUMNS); `weights` (paths, impacts); result (impacts,),
    (paths,), (3, impacts, CODES).
    """
    paths, impacts = weights.shape
    agreeing = np.zeros(impacts)
    stays = np.zeros(paths)
    left = np.zeros((3, impacts, len(CODES))) if left is None else left
    _follow(rows, weights, np.array(itinerary, dtype=float), agreeing, stays, left)
    return agreeing, stays, left


@lean
def _follow(
    rows: Floats, weights: Floats, itinerary: Floats, agreeing: Floats, stays: Floats, left: Floats
) -> None:
    """Add the paths of a block to `agreeing`, `stays` and `left`, see `follow_itinerary`."""
    paths, impacts = rows.shape[:2]
    for p in range(paths):
        k = 0
        while k < impacts and rows[p, k, 6] == itinerary[k]:
            agreeing[k] += weights[p, k]
            k += 1
        stays[p] = k
        if k < impacts and itinerary[k] != 0.0:
            w = weights[p, k]
            for i, code in enumerate(CODES):
                if rows[p, k, 6] == code:
                    left[0, k, i] += w
                    left[1, k, i] += w * w
                    left[2, k, i] = max(left[2, k, i], w)
