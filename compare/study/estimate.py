"""What a study will take, before anything runs: seconds and memory, and how far more cores would carry."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.closure import follow
from rattle.compare.study.cells import Cell, Prediction, Sample
from rattle.compare.study.executors import SHARE
from rattle.montecarlo import SCHEMES, default_step
from rattle.montecarlo.accuracy import LEAST
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.kernel import COLUMNS
from rattle.montecarlo.settings import computed
from rattle.scene.scene import Scene

__all__ = ["Estimate", "calibrated", "core_seconds", "estimate", "scaling"]

CLOSURE_SECONDS = {"published": 0.005, "corrected": 0.0005, "saltation": 0.001, "branching": 0.9}
"""Of twelve impacts, compiled; measured on DAT21."""
FLIGHT = 0.5  # time between impacts where the orbit does not tell
FINEST = 1e-100  # accuracy that is told from finer ones
BASE_MEGABYTES = 330.0  # interpreter, libraries and machine code
LEVEL_WORK = 1.75  # steps of dt, 2 dt and 4 dt together, in units of those of dt
TASK_SECONDS = 0.0035  # of an empty task, measured with scheduler, workers and client on two cores: an upper bound
MERGE_SECONDS = 110e-6  # that the client takes to merge a block, measured


class Estimate(NamedTuple):
    """What the cells that are missing will take."""

    core_seconds: float
    wall_seconds: float
    megabytes: float


def core_seconds(cell: Cell) -> float:
    """Nominal seconds of one core for a cell; heavy tails can make an accuracy cost many times as much.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> cell = Sample(Scene.from_gears(DAT21, sigma=0.1), impacts=12, seed=0, paths=100_000)
    >>> 1.0 < core_seconds(cell) < 5.0
    True
    """
    if isinstance(cell, Prediction):
        return CLOSURE_SECONDS[cell.closure] * cell.impacts / 12.0
    assert isinstance(cell, Sample)
    kind = SCHEMES[cell.scheme]
    exact = kind.weak_order is None
    dt = cell.settings["dt"] or default_step(cell.scene, cell.scheme, not exact)
    paths = computed(cell.scene, _paths(cell))
    steps = _duration(cell.scene, cell.impacts) / dt * (1.0 if exact else LEVEL_WORK)
    return 1e-9 * paths * (steps * kind.step_ns + cell.impacts * kind.impact_ns * (1.0 if exact else 3.0))


def _paths(cell: Sample) -> int:
    return cell.paths or max(LEAST, math.ceil(max(cell.accuracy or 1.0, FINEST) ** -2))


def _duration(scene: Scene, impacts: int) -> float:
    orbit = follow(scene, impacts)
    followed = float(orbit.tau[orbit.found] - scene.phase)
    return followed + FLIGHT * (impacts - orbit.found)


def calibrated(expected: Mapping[str, float], taken: Mapping[str, float]) -> float:
    """How many times longer than expected the finished cells have taken (median); 1 where there are none."""
    ratios = [taken[key] / expected[key] for key in taken if expected.get(key, 0.0) > 0.0]
    return float(np.median(ratios)) if ratios else 1.0


def _once(cell: Cell) -> float:
    return 1.0


def estimate(cells: Sequence[Cell], workers: int, times: Callable[[Cell], float] = _once) -> Estimate:
    """What cells will take on so many threads; each stands for so many like it."""
    seconds = [core_seconds(c) for c in cells]
    work = sum(times(c) * s for c, s in zip(cells, seconds, strict=True))
    longest = max((s for c, s in zip(cells, seconds, strict=True) if isinstance(c, Prediction)), default=0.0)
    rows = max((BLOCK * c.impacts * COLUMNS * 8 * _copies(c) for c in cells if isinstance(c, Sample)), default=0)
    return Estimate(work, max(work / workers, longest), BASE_MEGABYTES + 4.0 * workers * rows / 1e6)


def _copies(sample: Sample) -> int:
    return 2 if SCHEMES[sample.scheme].weak_order is None else 3


def scaling(cells: Sequence[Cell], factor: float = 1.0, times: Callable[[Cell], float] = _once) -> pd.DataFrame:
    """What more cores would do for these cells, at `factor` times the nominal time, and what would limit them.

    Columns: ``cores``, ``wall_seconds``, ``efficiency`` and ``limit``: the cores themselves, the longest piece of work
    that cannot be split, the scheduler (3.5 ms a task) or the client that merges blocks.
    """
    work = tasks = blocks = longest = 0.0  # added up: a single cell may have a million blocks
    for cell in cells:
        seconds, pieces = factor * core_seconds(cell), 1
        if isinstance(cell, Sample):
            count = -(-computed(cell.scene, cell.paths or LEAST) // BLOCK)
            pieces = -(-count // SHARE)
            blocks += times(cell) * count
        work += times(cell) * seconds
        tasks += times(cell) * pieces
        longest = max(longest, seconds / pieces)
    rows: list[dict[str, Any]] = []
    for cores in (1, 2, 10, 100, 1000, 10_000):
        limits = {
            "cores": work / cores, "longest task": longest, "scheduler": tasks * TASK_SECONDS,
            "merging": blocks * MERGE_SECONDS,
        }  # fmt: skip
        limit = max(limits, key=lambda name: limits[name])
        wall = limits[limit]
        rows.append({
            "cores": cores, "wall_seconds": wall, "efficiency": work / cores / wall if wall else 1.0, "limit": limit,
        })  # fmt: skip
    return pd.DataFrame(rows)
