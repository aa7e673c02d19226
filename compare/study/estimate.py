"""Cost of a study before it runs: core seconds, wall time, memory, and the speed-up of more cores."""

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

CLOSURE_SECONDS = {"published": 0.005, "corrected": 0.0005, "saltation": 0.001, "branching": 1.2}
"""Seconds for twelve impacts once compiled, measured on DAT21."""
FLIGHT = 0.5  # assumed time between impacts after the noise-free orbit has ended
FINEST = 1e-100  # smallest accuracy that the estimate uses, so that its square does not underflow
BASE_MEGABYTES = 330.0  # interpreter, libraries and machine code
LEVEL_WORK = 1.75  # steps at dt, 2 dt and 4 dt (one Brownian path, Richardson extrapolation), relative to dt alone
TASK_SECONDS = 0.0035  # scheduling of an empty task, measured with scheduler, workers and client on two cores
MERGE_SECONDS = 110e-6  # measured time in which the client merges one block


class Estimate(NamedTuple):
    """Estimated cost of cells.

    Attributes
    ----------
    core_seconds, wall_seconds : float
        Seconds of one core, and seconds on the given number of threads.
    megabytes : float
        Memory of this process.
    """

    core_seconds: float
    wall_seconds: float
    megabytes: float


def core_seconds(cell: Cell) -> float:
    """Estimate the seconds of one core for a cell.

    For a cell with an accuracy the estimate assumes Gaussian tails; heavy tails can cost many times as much.

    Parameters
    ----------
    cell : Cell
        What is computed, and under which key it is kept.

    Returns
    -------
    float

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> cell = Sample(Scene.from_gears(DAT21, sigma=0.1), impacts=12, seed=0, paths=100_000)
    >>> 0.2 < core_seconds(cell) < 5.0
    True
    """
    if isinstance(cell, Prediction):
        return CLOSURE_SECONDS[cell.closure] * cell.impacts / 12.0
    if not isinstance(cell, Sample):
        return float(getattr(cell, "core_seconds", 1.0))  # the long run of a scene estimates its own cost
    kind = SCHEMES[cell.scheme]
    exact = not kind.has_step_bias
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
    """Compute the factor by which finished cells have taken longer than estimated.

    Parameters
    ----------
    expected, taken : mapping of str to float
        Estimated and measured seconds by key.

    Returns
    -------
    float
        Median ratio; 1 if no cell is finished.
    """
    ratios = [taken[key] / expected[key] for key in taken if expected.get(key, 0.0) > 0.0]
    return float(np.median(ratios)) if ratios else 1.0


def _once(cell: Cell) -> float:
    return 1.0


def estimate(cells: Sequence[Cell], workers: int, times: Callable[[Cell], float] = _once) -> Estimate:
    """Estimate the cost of cells.

    Parameters
    ----------
    cells : sequence of Cell
        All cells, or a sample of them.
    workers : int
        Threads.
    times : callable
        For each cell, how many cells of the study it represents; 1 by default.

    Returns
    -------
    Estimate
    """
    seconds = [core_seconds(c) for c in cells]
    work = sum(times(c) * s for c, s in zip(cells, seconds, strict=True))
    longest = max((s for c, s in zip(cells, seconds, strict=True) if isinstance(c, Prediction)), default=0.0)
    rows = max((BLOCK * c.impacts * COLUMNS * 8 * _copies(c) for c in cells if isinstance(c, Sample)), default=0)
    return Estimate(work, max(work / workers, longest), BASE_MEGABYTES + 4.0 * workers * rows / 1e6)


def _copies(sample: Sample) -> int:
    return 2 if not SCHEMES[sample.scheme].has_step_bias else 3


def scaling(cells: Sequence[Cell], factor: float = 1.0, times: Callable[[Cell], float] = _once) -> pd.DataFrame:
    """Estimate the wall time of cells on 1 to 10 000 cores of a cluster, and what limits it.

    Parameters
    ----------
    cells : sequence of Cell
        The cells, in order.
    factor : float
        Measured over estimated seconds, see `calibrated`.
    times : callable
        For each cell, how many cells of the study it represents; 1 by default.

    Returns
    -------
    DataFrame
        Columns ``cores``, ``wall_seconds``, ``efficiency`` (speed-up over cores) and ``limit``: ``cores``,
        ``longest task`` (work that cannot be split), ``scheduler`` (3.5 ms a task) or ``merging`` (of blocks, by the
        client).
    """
    work = tasks = blocks = longest = 0.0  # sums only: a single cell may have a million blocks
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
