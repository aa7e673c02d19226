"""Ensembles of long paths: burn-in, pilot run, and as much of the stationary motion as an accuracy takes."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from tqdm import tqdm

from rattle.montecarlo.long_run.names import all_names
from rattle.montecarlo.long_run.parts import Parts
from rattle.montecarlo.long_run.paths import BATCHES, LongPaths
from rattle.montecarlo.long_run.result import LongRun
from rattle.montecarlo.settings.budget import Budget
from rattle.montecarlo.settings.plan import check_settings
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.text import line
from rattle.scene.validate import choice, count, positive

PATHS = 256
ACCURACY = 0.01
ASKED = ("rate_above", "speed_above", "energy_per_period")
"""Quantities whose intervals an accuracy is asked for, by default."""
RESTARTS = 3  # most times that what was taken for stationary is taken for burn-in after all


def long_run(
    scene: Scene,
    *,
    accuracy: float | None = None,
    periods: int | None = None,
    quantities: Sequence[str] = ASKED,
    paths: int = PATHS,
    burn_in: int | None = None,
    slow: float = 0.1,
    budget: float | None = None,
    rng: int | np.random.SeedSequence = 0,
    workers: int = 1,
    progress: str | None = None,
) -> LongRun:
    """Follow independent paths of exact flights through the stationary motion.

    Path 0 starts where the scene says, all others anywhere between the walls.

    `accuracy`: Largest half width of the 95 % intervals of `quantities`, over their value; 0.01 by default.
    `budget`: Seconds of processor time that it may take, all threads together; compiling is not counted.  Without
    it, what is expected to take more than an hour is refused. `rng`: Seed.  The result is the same bit for bit
    for any number of workers.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> run = long_run(Scene.from_gears(DAT21, sigma=0.5), periods=64, paths=64)
    >>> run.periods, 2.1 < run.estimates["rate"].value < 2.4
    (64, True)
    """
    check_settings(
        scene, paths=paths, impacts=1, dt=None, scheme="exact-flight", rng=rng, workers=workers, step_bias=False
    )
    count("paths", paths, least=16)
    for name in (asked := tuple(quantities)):
        choice("quantities", name, all_names(scene.stages))
    if accuracy is not None and periods is not None:
        raise InputError("periods", periods, "is chosen by accuracy; leave out one of them")
    if periods is not None:
        count("periods", periods, least=BATCHES)
    if burn_in is not None:
        count("burn_in", burn_in, least=1)
    goal = None if periods is not None else float(positive("accuracy", ACCURACY if accuracy is None else accuracy))
    positive("slow", slow)
    limit = Budget(math.inf if budget is None else float(positive("budget", budget)))
    seed = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
    began = time.perf_counter()
    with limit.pause():
        LongPaths(scene, 1, seed, slow, limit).warm_up()
    ensemble = LongPaths(scene, paths, seed, slow, limit)
    bar = tqdm(unit="period", desc=progress and line(progress), disable=None if progress else True)
    with ThreadPoolExecutor(workers) as pool, bar:
        runner = Parts(ensemble, pool, bar, limit, budget is None)
        for _ in range(RESTARTS):
            found = runner.settle(burn_in)
            runner.pilot()
            reach = runner.gather(goal, periods, asked)
            late = runner.late()
            if late.reached:
                break
            if burn_in is not None:
                raise runner.refusal(late, None)
        else:
            raise runner.refusal(late, None)
    left_out = found._replace(periods=ensemble.elapsed - ensemble.periods)
    return LongRun(
        scene, ensemble.collect(), ensemble.periods, left_out, reach, late, slow, time.perf_counter() - began
    )
