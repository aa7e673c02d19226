"""Ensembles of long paths: burn-in, pilot run, and as much of the stationary motion as an accuracy
takes.

Whether a run has forgotten its start is tested over independent paths: parts of the time so far are
compared path by path by Student's t (Geweke 1992), and the variance between paths with that within
them by an F test (Gelman and Rubin 1992), as docs/guide/stationary.md says.
"""

import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from rattle.montecarlo.kernel.blocks import HOUR, clock
from rattle.montecarlo.long_run.estimates import StationaryEstimate, all_names, estimates
from rattle.montecarlo.long_run.paths import PATH_BATCHES, STATIONARY_PERIODS, LongPaths, warm_up
from rattle.montecarlo.long_run.result import BurnIn, Contrast, LongReach, LongRun
from rattle.montecarlo.long_run.scatter import error_share
from rattle.montecarlo.long_run.sums import NUMBER, new_sums, no_scales, scales_of_pilot
from rattle.montecarlo.long_run.walk import Walk
from rattle.montecarlo.looks import begin_budget, grow
from rattle.montecarlo.settings import check_settings
from rattle.scene import Floats, InputError, Scene, choice, count, duration_text, positive
from rattle.scene.progress import ESTIMATES, ProgressBar, do

LONG_RUN_PATHS = 256
LONG_RUN_ACCURACY = 0.01
ASKED = ("rate_above", "speed_above", "energy_per_period")
"""Quantities whose intervals an accuracy is asked for, by default."""
RESTARTS = 3  # most times that what was taken for stationary is taken for burn-in after all
PILOT_IMPACTS = 40_000  # impacts of the pilot run
MOST_PILOT = 64  # periods of the pilot run
PILOT_SHARE = 0.25  # of the budget that is left, for the pilot run
FEWEST_PERIODS = 8  # periods of the stationary motion, where the budget ends before more
PERIODS_GROWTH = 4  # most by which a run grows at once
PERIODS_SPARE = 1.1  # more than what an accuracy is expected to take
FIRST_TEST = 32
LONGEST_BURN_IN = 2**15
"""Periods after which a run is tested for the first time, and the longest burn-in that is tried."""
# of a path in the last half, on average, without which there is nothing to compare
LEAST_IMPACTS = 20.0
LITTLE_ERROR = 0.1
"""Share of the variance between gear sets below which longer paths narrow no interval: it is the
sets that differ."""
FALSE_TEST = 1e-3  # probability that a run that is stationary fails a test
TOO_FAR = 4.0  # ratio of variances between and within paths from which paths count as kept apart
PARTS_OF_HALF = 4  # of the last half, within each path
COMPARED = (
    *(
        what + where
        for where in ("", " at mesh 1", " at mesh 2")
        for what in ("impacts", "speed", "energy", "slow impacts")
    ),
    "contact at mesh 1",
    "contact at mesh 2",
)
"""What the columns of `Sums.main` that are compared sum."""
PROBED = 16  # paths of a run that is timed before the others
PROBE_PERIODS = 2  # its periods that are timed, after as many in which the paths leave their start


class BurnInError(InputError):
    """The burn-in was not reached: the paths had not forgotten their start, or never will."""


class AtRest(InputError):
    """There is no stationary motion: every path comes to rest, as far as it was followed."""

    watched = (0, 0)  # paths, and periods of each in which a mesh was closed and no impact was seen


def _largest(size: Floats, allowed: float, share: Floats | None = None) -> Contrast:
    """The largest of the differences of all columns of `Sums.main` that are compared."""
    k = int(np.argmax(np.abs(size)))
    of_mean = math.nan if share is None else float(share[k])
    return Contrast(COMPARED[k], float(size[k]), allowed, of_mean)


def drift(main: Floats, early: slice, late: slice) -> Contrast:
    """Compare two parts of a run.

    Shapes: `main` (paths, batches, MAIN).
    """
    a, b = (main[:, part, : len(COMPARED)].mean(axis=1) for part in (early, late))
    difference = b - a
    n = len(main)
    mean = difference.mean(axis=0)
    se = difference.std(axis=0, ddof=1) / math.sqrt(n)
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.where(se > 0.0, mean / se, np.where(mean == 0.0, 0.0, np.inf))
        share = mean / np.abs(b.mean(axis=0))
    allowed = float(stdtrit(n - 1, 1.0 - 0.5 * FALSE_TEST / z.size))
    return _largest(z, allowed, share)


def apart(main: Floats, late: slice) -> Contrast:
    """Compare the variance between paths with that within them.

    Shapes: `main` (paths, batches, MAIN).
    """
    compared = main[:, late, : len(COMPARED)]
    parts = compared.reshape(len(main), PARTS_OF_HALF, -1, len(COMPARED)).mean(axis=2)
    within = parts.var(axis=1, ddof=1).mean(axis=0) / PARTS_OF_HALF
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(between > 1e-24, between / within, 0.0)
    return _largest(np.where(np.isnan(ratio), 0.0, ratio), TOO_FAR)


def settle(paths: LongPaths, burn_in: int | None) -> BurnIn:
    """Follow the paths until two tests say that they have forgotten their start, or for a given
    time."""
    until = FIRST_TEST if burn_in is None else burn_in
    paths.begin()
    before: Contrast | None = None
    while True:
        began = clock()
        paths.expect(until - paths.periods + STATIONARY_PERIODS)
        paths.follow(until)
        if paths.periods < until and (before is None or burn_in is not None):
            raise paths.unaffordable(f"{until} periods of burn-in at least", until)
        main = paths.main
        quarter = main.shape[1] // 4
        late = slice(main.shape[1] - 2 * quarter, main.shape[1])
        impacts = float(main[:, late, NUMBER].sum()) / len(main)
        moved = Contrast("", 0.0, math.inf, 0.0)
        differ = None
        if quarter:
            moved = drift(main, slice(quarter, 2 * quarter), late)
            if quarter * 2 % PARTS_OF_HALF == 0 and not paths.are_sets:
                differ = apart(main, late)
        if burn_in is not None or (
            moved.reached and (differ is None or differ.reached) and impacts >= LEAST_IMPACTS
        ):
            return BurnIn(paths.periods, moved, differ)
        if impacts == 0.0 and paths.at_rest():
            why = "comes to rest: a mesh stays closed, and no impact was seen"
            rest = AtRest("scene", paths.scene.sigma, why)
            rest.watched = len(main), 2 * quarter * paths.length
            raise rest
        if (
            until >= LONGEST_BURN_IN
            or paths.limit.remaining < 2.0 * (clock() - began)
            or paths.is_refused(until)
        ):
            raise refusal(paths.elapsed, moved, differ, before, impacts)
        before = moved
        until = 2 * until


def refusal(
    done: int,
    moved: Contrast,
    differ: Contrast | None = None,
    before: Contrast | None = None,
    impacts: float = math.inf,
) -> BurnInError:
    """The error for a burn-in that was not reached in `done` periods."""
    must = 4 * done
    falls = before.share / moved.share if before is not None and moved.share else 0.0
    if falls > 1.0 / 0.9:
        # of an exponential decay, over half of the run
        until = done + 0.5 * done * math.log(abs(moved.size)) / math.log(falls)
        must = math.ceil(min(max(until, 2 * done), 64 * done))
    if impacts < LEAST_IMPACTS:
        why = (
            f"a path had {impacts:.3g} impacts in the last half, and {LEAST_IMPACTS:g} are the"
            " least"
        )
    elif not moved.reached:
        why = (
            f"{moved.quantity} still changes by {moved.share:+.2%}, {abs(moved.size):.1f} standard"
            f" errors, over the second half ({moved.allowed:.1f} are put down to chance)"
        )
    else:
        assert differ is not None
        why = (
            f"{differ.quantity} differs {differ.size:.3g} times more between paths (in variance)"
            " than within them: there are several attractors that the noise does not connect in"
            " this time"
        )
    return BurnInError(
        "burn_in",
        done,
        f"periods are not enough: {why}; give at least {must:,}, and the budget for it",
    )


def _pilot(paths: LongPaths) -> None:
    """Choose where distributions are counted, and begin to sum."""
    rate = float(paths.main[:, -1, NUMBER].sum()) / paths.length  # impacts of all paths in a period
    affordable = PILOT_SHARE * paths.limit.remaining / max(paths.pace, 1e-9)
    periods = int(max(min(_pilot_periods(rate), affordable), 1.0))
    paths.expect(periods + STATIONARY_PERIODS)
    paths.begin()
    seen: list[Floats] = []
    paths.follow(periods, seen)
    if not seen:
        raise paths.unaffordable(f"{periods} periods of a pilot run", periods)
    paths.begin(scales_of_pilot(np.concatenate(seen), paths.slow))


def _pilot_periods(rate: float) -> float:
    """Periods of a pilot run in which so many impacts are seen in each."""
    return min(max(PILOT_IMPACTS / max(rate, 1e-9), 2.0), MOST_PILOT)


def _gather(
    paths: LongPaths, goal: float | None, periods: int | None, asked: tuple[str, ...]
) -> LongReach | None:
    """Follow the stationary motion for a number of periods, or until the intervals are narrow
    enough."""
    wanted = STATIONARY_PERIODS if periods is None else periods
    paths.expect(wanted)
    paths.follow(wanted)
    if paths.periods < (FEWEST_PERIODS if periods is None else periods):
        raise paths.unaffordable(f"{wanted} periods after the burn-in", wanted)
    while goal is not None:
        width, worst = _find_widest(estimates(paths.collect(), asked))
        before = paths.periods
        need = math.inf if math.isinf(width) else before * (width / goal) ** 2
        if paths.are_sets:
            share = error_share(paths.collect())
            if share <= LITTLE_ERROR and width > goal:
                sets = math.ceil(len(paths.main) * (width / goal) ** 2)
                return LongReach(goal, worst, width, 0.0, sets)
            need = before * share / LITTLE_ERROR
        more = max(need - before, 0.0)
        if width <= goal:
            return LongReach(goal, worst, width, 0.0)
        if paths.is_refused(more):
            gives = width * math.sqrt(before * paths.nominal / HOUR)
            why = (
                f"is expected to take {duration_text(more * paths.nominal)} of processor time, and"
                f" without a budget the limit is one hour: ask for {gives:.2g}, or give the seconds"
                " that it may take as budget"
            )
            raise InputError("accuracy", goal, why)
        paths.expect(PERIODS_SPARE * more)
        most = PERIODS_GROWTH * before
        paths.follow(min(grow(before, min(need, most), PERIODS_SPARE), most))
        if paths.periods == before:
            return LongReach(goal, worst, width, more * paths.pace)
    return None


def _find_widest(asked: dict[str, StationaryEstimate]) -> tuple[float, str]:
    """Half width of the widest interval over its value, infinite where that is unknown; its
    quantity."""
    widths = {}
    for name, e in asked.items():
        width = math.inf if e.value == 0.0 else 0.5 * (e.high - e.low) / abs(e.value)
        widths[name] = 0.0 if e.se == 0.0 else math.inf if math.isnan(width) else width
    worst = max(widths, key=lambda name: widths[name], default="")
    return widths.get(worst, math.inf), worst


class ExpectedRun(NamedTuple):
    """What a long run is expected to take at the least."""

    periods: int  # of burn-in, pilot run and stationary motion
    core_seconds: float

    def lengthen(self, periods: int) -> float:
        """Core-seconds with so many periods more."""
        return self.core_seconds * (1.0 + periods / self.periods)


def expect_run(
    scene: Scene,
    paths: int,
    periods: int | None = None,
    burn_in: int | None = None,
    slow: float = 0.1,
) -> ExpectedRun:
    """Expect what a long run takes at the least, from the time of a few of its paths once they have
    left their start.

    It takes more where paths forget their start late, or where an accuracy needs more than
    `STATIONARY_PERIODS` periods.
    """
    warm_up(scene, slow)
    walk = Walk(scene, np.random.SeedSequence(0), 0, PROBED)
    sums = new_sums(PROBED, PROBE_PERIODS, no_scales(slow), False)
    walk.follow(sums, PROBE_PERIODS)
    sums.main[:] = 0.0
    began = clock()
    walk.follow(sums, PROBE_PERIODS)
    pace = (clock() - began) / PROBE_PERIODS * paths / PROBED
    rate = float(sums.main[:, :, NUMBER].sum()) / PROBE_PERIODS * paths / PROBED
    least = FIRST_TEST if burn_in is None else burn_in
    every = math.ceil(
        least + _pilot_periods(rate) + (STATIONARY_PERIODS if periods is None else periods)
    )
    return ExpectedRun(every, every * pace)


def _state_estimate(label: str, expected: ExpectedRun, paths: int, budget: float | None) -> None:
    """State what a long run is expected to take, and whether that is beyond a budget."""
    said = f"{label}: {expected.periods} periods of {paths} paths at the least"
    said += f", about {duration_text(expected.core_seconds, 2)} of processor time"
    if budget is not None and expected.core_seconds > budget:
        said += f", more than the budget of {duration_text(budget)}"
    ESTIMATES.info("%s", said)


def check_long_run(
    scene: Scene,
    accuracy: float | None,
    periods: int | None,
    quantities: Sequence[str] = ASKED,
    paths: int = LONG_RUN_PATHS,
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
        count("periods", periods, least=PATH_BATCHES)
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
    paths: int = LONG_RUN_PATHS,
    burn_in: int | None = None,
    slow: float = 0.1,
    budget: float | None = None,
    rng: int | np.random.SeedSequence = 0,
    workers: int = 1,
    progress: str | None = None,
) -> LongRun:
    """Follow independent paths of exact flights through the stationary motion.

    Path 0 starts where the scene says, all others anywhere between the walls.

    `accuracy`: Largest half width of the 95 % intervals of `quantities`, over their value; 0.01 by
    default. `budget`: Seconds of processor time that it may take, all threads together; compiling
    is not counted.  Without it, what is expected to take more than an hour is refused. `rng`: Seed.
    The result is the same bit for bit for any number of workers.
    """
    check_long_run(scene, accuracy, periods, quantities, paths, burn_in, slow, rng, workers)
    goal = (
        None if periods is not None else LONG_RUN_ACCURACY if accuracy is None else float(accuracy)
    )
    limit = begin_budget(budget)
    seed = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
    began = time.perf_counter()
    with limit.pause():
        warm_up(scene, slow)
    if progress:
        do(f"{progress}: timing a few paths")
        _state_estimate(progress, expect_run(scene, paths, periods, burn_in, slow), paths, budget)
    bar = ProgressBar(label=progress, unit="period")
    with ThreadPoolExecutor(workers) as pool, bar:
        followed = LongPaths(scene, paths, seed, slow, limit, pool, bar)
        for _ in range(RESTARTS):
            found = settle(followed, burn_in)
            _pilot(followed)
            reach = _gather(followed, goal, periods, tuple(quantities))
            main = followed.main
            late = drift(
                main, slice(0, main.shape[1] // 4), slice(main.shape[1] // 2, main.shape[1])
            )
            if late.reached or burn_in is not None:
                break
        if not late.reached:
            raise refusal(followed.elapsed, late)
    left_out = found._replace(periods=followed.elapsed - followed.periods)
    return LongRun(
        scene, followed.collect(), left_out, reach, late, slow, time.perf_counter() - began
    )
