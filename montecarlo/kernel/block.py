"""One block of paths: random streams, walls and initial states, run through the kernel and reduced
to sums."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np

from rattle.montecarlo.kernel.kernel import Job, Output, columns_recorded, kernel_of
from rattle.montecarlo.kernel.mixture import BranchMixture, draw_targets, no_mixture
from rattle.montecarlo.noise.backlash import backlash_of, draw_walls
from rattle.montecarlo.noise.memory import begin_memory, memory_of
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.noise.restitution import restitution_of
from rattle.montecarlo.schemes.control_variate import LinearPath, no_control
from rattle.montecarlo.schemes.lanes import Lanes, Room, lanes_of
from rattle.montecarlo.schemes.step_size import SCHEMES
from rattle.montecarlo.statistics.central_sums import VARIANCE, CentralSums, columns_of
from rattle.montecarlo.statistics.section_statistics import PAIR, Pairs
from rattle.montecarlo.statistics.weighted_sums import WeightedSums
from rattle.scene import Constants, Floats, Ints, Scene
from rattle.scene.compiled import jit, lean
from rattle.scene.impact import energy_loss, strike
from rattle.scene.wheel import flanks_of

BLOCK = 1024
"""Paths of a block: small enough for the caches, large enough that few lanes idle while the last
paths finish."""


def kept_places(wheels: int) -> tuple[int, ...]:
    """Places among the section quantities of those whose covariance is kept: all but the flight."""
    return (0, *range(2, 2 + 2 * wheels))


def section_pairs(wheels: int) -> Pairs:
    """Pairs of section quantities whose covariance is kept."""
    places = kept_places(wheels)
    return tuple((places[i], places[j]) for i in range(len(places)) for j in range(i))


def state_pairs(wheels: int) -> Pairs:
    """Pairs of states whose covariance at fixed times is kept."""
    return tuple(combinations_with_replacement(range(2 * wheels), 2))


def impact_codes(wheels: int) -> tuple[int, ...]:
    """``mesh * side`` of the impacts."""
    return tuple(side * mesh for mesh in range(1, wheels + 1) for side in (1, -1))


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

    rows: Floats  # impacts; NaN where a path did not reach one; (levels, paths, impacts, columns)
    fixed: Floats  # states at fixed times; (levels, paths, times, 2 wheels)
    # section quantities of the linearised path, or weights and noise of a mixture, see `Output`; no
    # paths where there are neither
    controls: Floats
    path_steps: int  # steps taken, over all paths
    sticking_steps: int  # those of them in which a mesh stayed closed to the end
    unfinished: int  # paths without all impacts


def start_state(scene: Scene, walls: Floats) -> Floats:
    """Initial states, after the impact at the start if there is one.

    `scene`: Its start; a coordinate on a flank is put on each path's own flank. Shapes: `walls`,
    result (2 wheels, paths).
    """
    rates = np.array(scene.start.values[: 2 * scene.stages])
    if scene.start.mesh:
        strike(scene.constants, scene.start.mesh, rates)
    state = np.empty_like(walls)
    for i, wheel in enumerate(scene.tree):
        x = scene.start.values[2 * i]
        side = wheel.side_of(x)
        state[2 * i] = x
        if side != 0:
            state[2 * i] = walls[2 * i] if side > 0 else -walls[2 * i + 1]
        state[2 * i + 1] = rates[2 * i + 1]
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
    walls = np.repeat(flanks_of(c)[:, None], paths, axis=1)
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
        restitution_of(scene),
        memory_of(scene.correlation_time, plan.dt),
    )
    linear = 2 * (2 * scene.stages + 1)  # of the linearised path and its next step
    carried = max(linear, 2 + len(mixture.unit))
    every, room = lanes_of(
        plan.levels,
        first,
        start_state(scene, walls),
        walls,
        scene.phase,
        carried,
        c.wheels["alone"].copy(),
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
    columns = columns_recorded(plan.scene.stages)
    beside = (paths if plan.control.at_step.size else 0, plan.impacts, columns)
    if mixture is not None:
        room.carried[:2, :paths] = draw_targets(mixture, plan.seed, block)
        beside = (paths, plan.impacts, 1 + len(mixture.unit))
    rows = _array("rows", (plan.levels, paths, plan.impacts, columns), np.nan, reuse)
    fixed = _array("fixed", (plan.levels, paths, plan.fixed_steps.size, columns - 3), np.nan, reuse)
    controls = _array("controls", beside, 0.0, reuse)
    out = Output(first, rows, plan.fixed_steps, fixed, controls)
    kernel = kernel_of(job.c, SCHEMES[plan.scheme])
    work, sticking = kernel(job, plan.scene.phase, plan.most_steps, every, room, out)
    unfinished = np.isnan(rows[0, :, -1, 0]).sum()
    return Raw(rows, fixed, controls, int(work), int(sticking), int(unfinished))


def _merge_each(sums: dict[str, Any], others: dict[str, Any]) -> dict[str, Any]:
    """Sums of each name over two sets of paths together."""
    return {name: own.merge(others[name]) for name, own in sums.items()}


@dataclass(frozen=True)
class Followers:
    """Sums over the paths that have followed an itinerary so far, and how the others left it."""

    sums: dict[str, Any]  # as in `BlockResult`, of these paths alone
    # weight of the paths that left at an impact by each of `impact_codes` (in plain runs their
    # number),
    # sum of its squares, and the largest weight of one; (3, impacts, codes)
    left: Floats

    def merge(self, other: "Followers") -> "Followers":
        """Both sets of paths together."""
        left = self.left + other.left
        left[2] = np.maximum(self.left[2], other.left[2])
        return Followers(_merge_each(self.sums, other.sums), left)


@dataclass(frozen=True, repr=False)
class BlockResult:
    """A block reduced to mergeable sums and counts."""

    # ``section`` over (impact, quantity); ``section_pairs`` over (impact, pair);
    # ``fixed`` over (time, pair of `state_pairs`).  With step bias also ``fine_coarse`` and
    # ``coarse_coarser`` over (impact, quantity), the same quantity at two step sizes, and
    # ``coarse_fixed`` over (time, gap), displacement with velocity at 2 dt.  With a control
    # variate ``control`` over (impact, quantity), the quantity with that of the linearised path.
    # If asked for, ``energy`` over (impact, 1), the energy loss.  Of a mixture ``weighted`` alone
    sums: dict[str, Any]
    codes: Floats  # counts of mesh and side of each impact; (impacts, codes)
    # number of paths that have followed each itinerary up to each impact; (impacts,)
    agreeing: dict[str, Floats]
    path_steps: int  # as in `Raw`, also the next two
    sticking_steps: int
    unfinished: int
    followers: dict[str, Followers] = field(default_factory=dict)  # by the names of `Plan.apart`

    def merge(self, other: "BlockResult") -> "BlockResult":
        """Both blocks together."""
        return BlockResult(
            _merge_each(self.sums, other.sums),
            self.codes + other.codes,
            {name: count + other.agreeing[name] for name, count in self.agreeing.items()},
            self.path_steps + other.path_steps,
            self.sticking_steps + other.sticking_steps,
            self.unfinished + other.unfinished,
            _merge_each(self.followers, other.followers),
        )


def _section_sums(wheels: int, impacts: int, levels: list[Floats]) -> dict[str, Any]:
    """Sums over the section quantities, shape (impacts * columns, paths) at each step size."""
    quantities = 2 + 2 * wheels
    own = [(i, i) for i in range(quantities)]
    section, pairs = CentralSums.of_groups(levels[0], impacts, quantities, section_pairs(wheels))
    sums = {"section": section, "section_pairs": pairs}
    if len(levels) > 1:
        fine, coarse, coarser = levels
        sums["fine_coarse"] = CentralSums.of_pairs(impacts, fine, own, PAIR, coarse)
        sums["coarse_coarser"] = CentralSums.of_pairs(impacts, coarse, own, ((0, 2),), coarser)
    return sums


def _plain_sums(plan: Plan, raw: Raw, rows: list[Floats]) -> dict[str, Any]:
    """Sums over the plain paths of a block, beside those over the section quantities.

    Shapes: `rows` (impacts * COLUMNS, paths) at each step size.
    """
    wheels = plan.scene.stages
    section = partial(CentralSums.of_pairs, plan.impacts)
    sums: dict[str, Any] = {}
    if plan.energy:
        losses = energy_losses(plan.scene.constants, raw.rows[0])
        sums["energy"] = section(columns_of(losses), [(0, 0)], VARIANCE)
    if plan.control.at_step.size:
        own = [(i, i) for i in range(2 + 2 * wheels)]
        sums["control"] = section(rows[0], own, PAIR, columns_of(raw.controls))
    if plan.fixed_steps.size:
        times = partial(CentralSums.of_pairs, plan.fixed_steps.size)
        sums["fixed"] = times(columns_of(raw.fixed[0]), state_pairs(wheels), PAIR)
        if plan.levels > 1:
            gaps = [(2 * i, 2 * i + 1) for i in range(wheels)]
            sums["coarse_fixed"] = times(columns_of(raw.fixed[1]), gaps, PAIR)
    return sums


def _weighted_sums(
    plan: Plan, mixture: BranchMixture, rows: Floats, weights: Floats
) -> WeightedSums:
    """Sums over the paths of a block that is drawn from a mixture, with given weights."""
    wheels = plan.scene.stages
    values = rows[:, :, : 2 + 2 * wheels]
    centre = mixture.centre
    if plan.energy:
        values = np.concatenate([values, energy_losses(plan.scene.constants, rows)], axis=2)
        centre = np.column_stack([centre, np.zeros(plan.impacts)])
    return WeightedSums.of_parts(values, weights, centre, mixture.counts, section_pairs(wheels))


def sample_mixture(
    plan: Plan, mixture: BranchMixture, block: int
) -> tuple[Floats, Floats, Floats, Raw]:
    """Run the paths of a block that is drawn from a mixture.

    Returns: Impacts; weights, that is the likelihood ratio of the plain distribution to the mixture
    given the steps up to each impact, 0 of those that a path did not have; the noise up to each
    impact along each unit vector; and the output that these are of. Shapes: result (BLOCK, impacts,
    columns), (BLOCK, impacts), (BLOCK, impacts, branches).
    """
    raw = sample(plan._replace(mixture=mixture), block)
    weights = np.ascontiguousarray(raw.controls[:, :, 0])
    return raw.rows[0], weights, raw.controls[:, :, 1:], raw


Reduced = tuple[BlockResult, Floats | None]
"""The result of a block, and its impacts if they are kept; (paths, impacts, columns)."""


def run(plan: Plan, block: int) -> Reduced:
    """Run a block and reduce it."""
    mixture = plan.mixture
    followers = {}
    if mixture is None:
        raw = sample(plan, block, reuse=True)
        weights = np.ones(raw.rows.shape[1:3])
        columns = [columns_of(level) for level in raw.rows]
        section = _section_sums(plan.scene.stages, plan.impacts, columns)
        sums = section | _plain_sums(plan, raw, columns)
    else:
        rows, weights, _, raw = sample_mixture(plan, mixture, block)
        sums = {"weighted": _weighted_sums(plan, mixture, rows, weights)}
    first = raw.rows[0]
    of_codes = np.array(impact_codes(plan.scene.stages))
    codes = np.zeros((plan.impacts, of_codes.size))
    _count_codes(first, weights, of_codes, codes)
    agreeing = {}
    for name, itinerary in plan.itineraries.items():
        agreeing[name], stays = follow_itinerary(first, weights, itinerary)
        if name not in plan.apart:
            continue
        left = np.zeros((3, *codes.shape))
        add_exits(first, weights, itinerary, stays, left)
        if mixture is None:
            apart = _follower_sums(plan, itinerary, raw.rows, columns, stays, section)
        else:
            kept = np.where(np.arange(plan.impacts) < stays[:, None], weights, 0.0)
            apart = {"weighted": _weighted_sums(plan, mixture, first, kept)}
        followers[name] = Followers(apart, left)
    if mixture is not None:
        # in paths: their weights add up to the number of paths only on average
        scale = np.isfinite(first[:, :, -1]).sum(axis=0) / np.maximum(codes.sum(axis=1), 1e-300)
        codes = codes * scale[:, None]
        agreeing = {name: count * scale for name, count in agreeing.items()}
    kept_rows = first.copy() if plan.keep else None
    counts = raw.path_steps, raw.sticking_steps, raw.unfinished
    return BlockResult(sums, codes, agreeing, *counts, followers), kept_rows


def _follower_sums(
    plan: Plan,
    itinerary: Sequence[int],
    rows: Floats,
    columns: list[Floats],
    stays: Ints,
    section: dict[str, Any],
) -> dict[str, Any]:
    """Sums over the paths of a block that follow an itinerary; those over all, `section`, where
    none leaves it."""
    ones = np.ones(rows.shape[1:3])
    stays_of = [stays, *(follow_itinerary(level, ones, itinerary)[1] for level in rows[1:])]
    if np.min(stays_of) == plan.impacts:
        return section
    kept = []
    for cells, stay in zip(columns, stays_of, strict=True):
        cells = cells.copy().reshape(plan.impacts, -1, cells.shape[1])
        cells[:, :, : stay.size].swapaxes(1, 2)[np.arange(plan.impacts)[:, None] >= stay] = np.nan
        kept.append(cells.reshape(-1, cells.shape[2]))
    return _section_sums(plan.scene.stages, plan.impacts, kept)


@jit
def energy_losses(c: Constants, rows: Floats) -> Floats:
    """Energy loss of each impact of each path, shape (paths, impacts, 1); NaN where there was
    none."""
    losses = np.full((*rows.shape[:2], 1), np.nan)
    for p in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            code = abs(rows[p, k, rows.shape[2] - 1])
            if code > 0.0:
                mesh = int(code)
                losses[p, k, 0] = energy_loss(c, mesh, rows[p, k, 2 * mesh + 1])
    return losses


@lean
def _count_codes(rows: Floats, weights: Floats, of_codes: Ints, codes: Floats) -> None:
    """Add the weight of each of `impact_codes` at each impact.

    Shapes: `rows` (paths, impacts, columns); `weights` (paths, impacts); `of_codes` (codes,);
    `codes` (impacts, codes).
    """
    paths, impacts = weights.shape
    last = rows.shape[2] - 1
    for p in range(paths):
        for k in range(impacts):
            for i in range(of_codes.size):
                codes[k, i] += weights[p, k] * (rows[p, k, last] == of_codes[i])


def follow_itinerary(
    rows: Floats, weights: Floats, itinerary: Sequence[int]
) -> tuple[Floats, Ints]:
    """The weight that has followed an itinerary up to each impact, and up to which impact each path
    has.

    Shapes: `rows` (paths, impacts, columns); `weights` (paths, impacts); result (impacts,),
    (paths,).
    """
    paths, impacts = weights.shape
    differs = np.ones((paths, impacts + 1), np.bool_)
    np.not_equal(rows[:, :, -1], np.array(itinerary), out=differs[:, :impacts])
    stays = differs.argmax(axis=1)
    follows = np.arange(impacts) < stays[:, None]
    # added one path after another, in the same order everywhere
    return np.add.accumulate(np.where(follows, weights, 0.0))[-1], stays


def add_exits(
    rows: Floats, weights: Floats, itinerary: Sequence[int], stays: Ints, left: Floats
) -> None:
    """Add to `Followers.left` what the next impact of each path was that left an itinerary.

    `stays`: See `follow_itinerary`. Shapes: `left` (3, impacts, codes).
    """
    of_codes = np.array(impact_codes((rows.shape[2] - 3) // 2))
    codes = rows[:, :, -1]
    (leaving,) = np.nonzero(np.append(itinerary, 0)[stays])
    path, code = np.nonzero(codes[leaving, stays[leaving], None] == of_codes)
    leaving = leaving[path]
    w = weights[leaving, stays[leaving]]
    exits = stays[leaving], code
    np.add.at(left[0], exits, w)
    np.add.at(left[1], exits, w * w)
    np.maximum.at(left[2], exits, w)
