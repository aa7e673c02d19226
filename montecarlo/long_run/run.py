"""Ensembles of long paths: burn-in, pilot run, and as much of the stationary motion as an accuracy takes."""

import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from tqdm import tqdm

from rattle.montecarlo.long_run.burn_in import drift, refusal, settle
from rattle.montecarlo.long_run.estimates import StationaryEstimate, all_names, estimates
from rattle.montecarlo.long_run.paths import BATCHES, LEAST, LongPaths, warm_up
from rattle.montecarlo.long_run.result import LongReach, LongRun
from rattle.montecarlo.long_run.sums import NUMBER, scales_of_pilot
from rattle.montecarlo.settings.budget import HOUR, Budget
from rattle.montecarlo.settings.plan import check_settings
from rattle.scene.errors import InputError, choice, count, positive
from rattle.scene.scene import Scene
from rattle.scene.text import duration_text, line
from rattle.scene.types import Floats

PATHS = 256
ACCURACY = 0.01
ASKED = ("rate_above", "speed_above", "energy_per_period")
"""Quantities whose intervals an accuracy is asked for, by default."""
RESTARTS = 3  # most times that what was taken for stationary is taken for burn-in after all
PILOT = 40_000  # impacts of the pilot run
MOST_PILOT = 64  # periods of the pilot run
PILOT_SHARE = 0.25  # of the budget that is left, for the pilot run
FEWEST = 8  # periods of the stationary motion, where the budget ends before more
GROWTH = 4  # most by which a run grows at once
SPARE = 1.1  # more than what an accuracy is expected to take


def _pilot(paths: LongPaths) -> None:
    """Choose where distributions are counted, and begin to sum."""
    rate = float(paths.main[:, -1, NUMBER].sum()) / paths.length  # impacts of all paths in a period
    affordable = PILOT_SHARE * paths.limit.remaining / max(paths.pace, 1e-9)
    periods = int(max(min(max(PILOT / max(rate, 1e-9), 2.0), MOST_PILOT, affordable), 1.0))
    paths.begin()
    seen: list[Floats] = []
    paths.follow(periods, seen)
    if not seen:
        raise paths.unaffordable(f"{periods} periods of a pilot run", periods)
    paths.begin(scales_of_pilot(np.concatenate(seen), paths.slow))


def _gather(paths: LongPaths, goal: float | None, periods: int | None, asked: tuple[str, ...]) -> LongReach | None:
    """Follow the stationary motion for a number of periods, or until the intervals are narrow enough."""
    wanted = LEAST if periods is None else periods
    paths.follow(wanted)
    if paths.periods < (FEWEST if periods is None else periods):
        raise paths.unaffordable(f"{wanted} periods after the burn-in", wanted)
    while goal is not None:
        width, worst = _find_widest(estimates(paths.collect(), asked))
        before = paths.periods
        need = math.inf if math.isinf(width) else before * (width / goal) ** 2
        more = max(need - before, 0.0)
        if width <= goal:
            return LongReach(goal, worst, width, 0.0)
        if paths.is_refused(more):
            gives = width * math.sqrt(before * paths.nominal / HOUR)
            why = f"is expected to take {duration_text(more * paths.nominal)} of processor time, and without a budget "
            why += f"the limit is one hour: ask for {gives:.2g}, or give the seconds that it may take as budget"
            raise InputError("accuracy", goal, why)
        paths.follow(int(min(SPARE * need + 1.0, GROWTH * before)))
        if paths.periods == before:
            return LongReach(goal, worst, width, more * paths.pace)
    return None


def _find_widest(found: dict[str, StationaryEstimate]) -> tuple[float, str]:
    """Find the widest interval."""
    widths = {
        name: 0.0 if e.se == 0.0 else 0.5 * (e.high - e.low) / abs(e.value) if e.value != 0.0 else math.inf
        for name, e in found.items()
    }
    worst = max(widths, key=lambda name: (not math.isfinite(widths[name]), widths[name]))
    return (widths[worst] if math.isfinite(widths[worst]) else math.inf), worst


def check_long_run(
    scene: Scene,
    accuracy: float | None,
    periods: int | None,
    quantities: Sequence[str] = ASKED,
    paths: int = PATHS,
    burn_in: int | None = None,
    slow: float = 0.1,
    rng: int | np.random.SeedSequence = 0,
    workers: int = 1,
) -> None:
    """Refuse settings of `long_run` that cannot be run."""
    check_settings(scene, paths, 1, None, "exact-flight", rng, workers)
    count("paths", paths, least=16)
    for name in quantities:
        choice("quantities", name, all_names(scene.stages))
    if accuracy is not None and periods is not None:
        raise InputError("periods", periods, "is chosen by accuracy; leave out one of them")
    if periods is not None:
        count("periods", periods, least=BATCHES)
    if burn_in is not None:
        count("burn_in", burn_in, least=1)
    if accuracy is not None:
        positive("accuracy", accuracy)
    positive("slow", slow)


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
    check_long_run(scene, accuracy, periods, quantities, paths, burn_in, slow, rng, workers)
    goal = None if periods is not None else ACCURACY if accuracy is None else float(accuracy)
    limit = Budget(math.inf if budget is None else float(positive("budget", budget)))
    seed = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
    began = time.perf_counter()
    with limit.pause():
        warm_up(scene, slow)
    bar = tqdm(unit="period", desc=progress and line(progress), disable=None if progress else True)
    with ThreadPoolExecutor(workers) as pool, bar:
        followed = LongPaths(scene, paths, seed, slow, limit, pool, bar)
        for _ in range(RESTARTS):
            found = settle(followed, burn_in)
            _pilot(followed)
            reach = _gather(followed, goal, periods, tuple(quantities))
            main = followed.main
            late = drift(main, slice(0, main.shape[1] // 4), slice(main.shape[1] // 2, main.shape[1]))
            if late.reached or burn_in is not None:
                break
        if not late.reached:
            raise refusal(followed.elapsed, late)
    left_out = found._replace(periods=followed.elapsed - followed.periods)
    return LongRun(scene, followed.collect(), left_out, reach, late, slow, time.perf_counter() - began)
