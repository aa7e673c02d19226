"""One block of paths: its streams, its walls and its start, run through the kernel and reduced to what is kept."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from montecarlo.accumulate import COVARIANCE, PAIR, SINGLE, CentralSums, Orders
from montecarlo.backlash import LAWS, draw_walls
from montecarlo.kernel import run_block
from montecarlo.noise import streams
from scene.impact import struck
from scene.scene import Scene, Tolerance

__all__ = ["BLOCK", "BlockResult", "Plan", "Raw", "run", "sample"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCK = 512
"""Paths of a block: their state fits the first-level cache."""

PAIRS = tuple((i, j) for i in range(5) for j in range(i))
"""Pairs among tau, x1, y1, x2, y2 whose covariance is kept."""


class Plan(NamedTuple):
    """What every block of a run has in common."""

    scene: Scene
    paths: int
    impacts: int
    dt: float
    located: bool
    seed: np.random.SeedSequence
    most_steps: int
    clock_steps: Ints
    itineraries: dict[str, tuple[int, ...]]
    levels: int

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.paths // BLOCK)


class Raw(NamedTuple):
    """What the kernel wrote: section rows, clock states, and the work it took."""

    rows: Floats
    clock: Floats
    path_steps: int
    held: int
    unfinished: int

    def section(self, level: int = 0, start_tau: float = 0.0) -> Floats:
        """``tau, flight, x1, y1, x2, y2`` of every impact, shape (paths, impacts, 6)."""
        tau = self.rows[level, :, :, 0]
        flight = np.diff(tau, axis=1, prepend=start_tau)
        return np.concatenate([tau[:, :, None], flight[:, :, None], self.rows[level, :, :, 1:5]], axis=2)


def _start(scene: Scene, walls: Floats) -> Floats:
    """State after the start, shape (4, paths): flank coordinates on each path's own flank, the start's impact done."""
    s = scene.start
    state = np.empty((4, walls.shape[1]))
    for i, (x, gap) in enumerate(((s.x1, scene.gap1), (s.x2, scene.gap2))):
        state[2 * i] = x if abs(x) != gap else (walls[2 * i] if x > 0.0 else -walls[2 * i + 1])
    state[1], state[3] = s.y1, s.y2
    if s.mesh:
        state[1], state[3] = struck(scene.constants, s.mesh, s.y1, s.y2)
    return state


def sample(plan: Plan, block: int) -> Raw:
    """Run the paths of a block."""
    scene = plan.scene
    paths = min(BLOCK, plan.paths - block * BLOCK)
    stream = streams(plan.seed, block)
    walls, fresh = draw_walls(scene, plan.impacts, stream.tolerance, paths)
    rows = np.full((plan.levels, paths, plan.impacts, 6), np.nan)
    clock = np.full((plan.levels, paths, plan.clock_steps.size, 4), np.nan)
    tolerance = scene.tolerance or Tolerance(law="fixed")
    work, held, unfinished = run_block(
        scene.constants, scene.start.tau, plan.dt, plan.most_steps, plan.located, tolerance.law != "fixed",
        stream.steps, stream.bridges, _start(scene, walls), walls, fresh,
        (scene.gap1, scene.gap2), (tolerance.c1_max, tolerance.c2_max), LAWS[tolerance.law], stream.tolerance, rows,
        plan.clock_steps, clock,
    )  # fmt: skip
    if scene.stages == 1:
        rows[:, :, :, 3:5] = np.nan
        clock[..., 2:] = np.nan
    return Raw(rows, clock, int(work), int(held), int(unfinished))


@dataclass(frozen=True)
class BlockResult:
    """What a block leaves behind: mergeable sums and counts.

    ``sums`` holds, by name: ``section`` over (impact, quantity); ``section_pairs`` over (impact, pair of `PAIRS`);
    ``clock`` over (time, pair of `CROSS`); with step bias also ``fine_coarse`` and ``coarse_coarser`` over (impact,
    quantity), the same quantity at two step sizes, and ``coarse_clock`` over (time, stage), displacement with
    velocity.  ``codes`` counts mesh and side of each impact over (impact, `CODES`); ``agreeing`` counts the paths
    that have followed each itinerary so far.
    """

    sums: dict[str, CentralSums]
    codes: Floats
    agreeing: dict[str, Floats]
    path_steps: int
    held: int
    unfinished: int

    def merged(self, other: "BlockResult") -> "BlockResult":
        """Both blocks together."""
        return BlockResult(
            {name: s.merged(other.sums[name]) for name, s in self.sums.items()},
            self.codes + other.codes,
            {name: count + other.agreeing[name] for name, count in self.agreeing.items()},
            self.path_steps + other.path_steps,
            self.held + other.held,
            self.unfinished + other.unfinished,
        )


CODES = (1, -1, 2, -2)
CROSS = tuple((i, j) for i in range(4) for j in range(i, 4))
"""Pairs of states whose clock covariance is kept."""


def _observed(values: Floats, stages: int) -> Floats:
    """Zeros in place of the stage that a single-stage scene does not have, so that NaN means unfinished only."""
    return values if stages == 2 else np.concatenate([values[..., :-2], np.zeros_like(values[..., -2:])], axis=-1)


def _pairs(values: Floats, pairs: tuple[tuple[int, int], ...], orders: Orders) -> CentralSums:
    first, second = (list(column) for column in zip(*pairs, strict=True))
    return CentralSums.of(values[..., first], values[..., second], orders)


def run(plan: Plan, block: int) -> tuple[BlockResult, Raw]:
    """Run a block and reduce it."""
    raw = sample(plan, block)
    stages, tau0 = plan.scene.stages, plan.scene.start.tau
    section = [_observed(raw.section(level, tau0), stages) for level in range(plan.levels)]
    clock = [_observed(raw.clock[level], stages) for level in range(min(plan.levels, 2))]
    xy = ((0, 1), (2, 3))
    sums = {
        "section": CentralSums.of(section[0], section[0], SINGLE),
        "section_pairs": _pairs(section[0][:, :, [0, 2, 3, 4, 5]], PAIRS, COVARIANCE),
    }
    if plan.clock_steps.size:
        sums["clock"] = _pairs(clock[0], CROSS, PAIR)
    if plan.levels > 1:
        sums["fine_coarse"] = CentralSums.of(section[0], section[1], PAIR)
        sums["coarse_coarser"] = CentralSums.of(section[1], section[2], ((0, 2),))
        if plan.clock_steps.size:
            sums["coarse_clock"] = _pairs(clock[1], xy, PAIR)
    code = raw.rows[0, :, :, 5]
    agreeing = {
        name: np.logical_and.accumulate(code == np.array(itinerary), axis=1).sum(axis=0).astype(float)
        for name, itinerary in plan.itineraries.items()
    }
    codes = np.stack([(code == c).sum(axis=0) for c in CODES], axis=1).astype(float)
    return BlockResult(sums, codes, agreeing, raw.path_steps, raw.held, raw.unfinished), raw
