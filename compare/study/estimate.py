"""Cost of a study before it runs: counted work, memory, and what more cores would gain.

Work is counted by `rattle.montecarlo.accuracy.cost` from short runs of the study's own scenes, and
for closures by `rattle.closure.mean_map`; compiling is not part of it.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd

from rattle.compare.engine.cluster import BLOCKS_OF_A_TASK
from rattle.compare.engine.store import Cell
from rattle.compare.study.cells import Sample
from rattle.montecarlo import SCHEMES, simulate
from rattle.montecarlo.accuracy.cost import cost_of
from rattle.montecarlo.accuracy.pilots import choose_scheme
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.blocks import Budget, in_threads
from rattle.montecarlo.kernel.kernel import columns_recorded
from rattle.montecarlo.settings import count_followed

PATHS_PROBED = 64  # paths whose steps stand for those of all where the number of paths is given
PILOTS = 20  # most pilot runs for accuracies; other cells are taken to be like the one before
PILOT_SECONDS = 10.0  # budget of one of them
BASE_MEGABYTES = 330.0  # interpreter, libraries and machine code
# scheduling of an empty task, measured with scheduler, workers and client on two cores
TASK_SECONDS = 0.0035
MERGE_SECONDS = 110e-6  # measured time in which the client merges one block


class Work(NamedTuple):
    """Expected work of cells: steps of their paths, nominal seconds of one core, and memory of this
    process in MB."""

    path_steps: float
    core_seconds: float
    megabytes: float = BASE_MEGABYTES


def expect_work(cells: Sequence[Cell]) -> dict[str, Work]:
    """Expected work of cells, by key."""
    asked = sum(isinstance(cell, Sample) and cell.accuracy is not None for cell in cells)
    every = -(-asked // PILOTS)
    seen = 0
    work = {}
    last = Work(0.0, 0.0)
    for cell in cells:
        if not isinstance(cell, Sample):
            work[cell.key] = Work(0.0, cell.core_seconds)
        elif cell.accuracy is None:
            cost = cost_of(
                cell.simulate(PATHS_PROBED), count_followed(cell.scene, cell.expected_paths)
            )
            work[cell.key] = Work(cost.path_steps, cost.core_seconds)
        else:
            last = last if seen % every else _pilot(cell, cell.accuracy)
            work[cell.key] = last
            seen += 1
    return work


def _pilot(cell: Sample, accuracy: float) -> Work:
    """Work of an accuracy, as the pilot run of `rattle.montecarlo.simulate_to` lets expect."""
    scene = cell.scene.phase_reduced
    again = partial(simulate, scene, impacts=cell.impacts, rng=cell.seed)
    budget = Budget(PILOT_SECONDS)
    pilot, (expected, *_) = choose_scheme(
        scene, [cell.scheme], accuracy, again, budget.limit(in_threads(1)), budget
    )
    slow = 0.0 if pilot.whole else pilot.path_seconds * expected.paths
    return Work(expected.path_steps, max(expected.core_seconds, slow))


def estimate(
    cells: Sequence[Cell],
    work: Mapping[str, Work],
    workers: int,
    times: Callable[[Cell], float] = lambda cell: 1.0,
) -> Work:
    """Sum the expected work of cells; `times` is how many cells of the study each represents."""
    steps, seconds = (sum(times(c) * work[c.key][i] for c in cells) for i in (0, 1))
    recorded = (
        c.impacts * columns_recorded(c.scene.stages) * (3 if SCHEMES[c.scheme].has_step_bias else 2)
        for c in cells
        if isinstance(c, Sample)
    )
    rows = BLOCK * 8 * max(recorded, default=0)
    return Work(steps, seconds, BASE_MEGABYTES + 4.0 * workers * rows / 1e6)


def scaling(
    cells: Sequence[Cell],
    seconds: Mapping[str, float],
    times: Callable[[Cell], float] = lambda cell: 1.0,
) -> pd.DataFrame:
    """Estimate the wall time of cells on 1 to 10 000 cores of a cluster, and what limits it.

    `seconds`: Seconds of one core by key, expected or measured; cells without are left out.
    `times`: For each cell, how many cells of the study it represents; 1 by default. Returns:
    Columns ``cores``, ``wall_seconds``, ``efficiency`` (speed-up over cores) and ``limit``:
    ``cores``, ``longest task`` (work that cannot be split), ``scheduler`` (3.5 ms a task) or
    ``merging`` (of blocks, by the client).
    """
    number = np.array([times(cell) for cell in cells])
    taken = np.array([seconds.get(cell.key, 0.0) for cell in cells])
    # sums only: a single cell may have a million blocks
    blocks = np.array(
        [
            -(-count_followed(cell.scene, cell.expected_paths) // BLOCK)
            if isinstance(cell, Sample)
            else 0
            for cell in cells
        ]
    )
    tasks = np.maximum(-(-blocks // BLOCKS_OF_A_TASK), 1)
    cores = np.array([1, 2, 10, 100, 1000, 10_000])
    limits = pd.DataFrame(
        {
            "cores": (number * taken).sum() / cores,
            "longest task": (taken / tasks).max(initial=0.0),
            "scheduler": (number * tasks).sum() * TASK_SECONDS,
            "merging": (number * blocks).sum() * MERGE_SECONDS,
        }
    )
    wall = limits.max(axis="columns")
    return pd.DataFrame(
        {
            "cores": cores,
            "wall_seconds": wall,
            "efficiency": (limits["cores"] / wall).where(wall > 0.0, 1.0),
            "limit": limits.idxmax(axis="columns"),
        }
    )
