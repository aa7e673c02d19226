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
from scipy.special import fdtri, stdtrit

from rattle.montecarlo.kernel.blocks import HOUR, clock
from rattle.montecarlo.long_run.estimates import Estimates, check_quantity, estimates
from rattle.montecarlo.long_run.paths import PATH_BATCHES, STATIONARY_PERIODS, LongPaths, warm_up
from rattle.montecarlo.long_run.result import KEPT_APART, BurnIn, Contrast, LongReach, LongRun
from rattle.montecarlo.long_run.scatter import error_share
from rattle.montecarlo.long_run.sums import (
    NUMBER,
    SLOW,
    columns_of,
    new_sums,
    no_scales,
    scales_of_pilot,
)
from rattle.montecarlo.long_run.walk import Walk
from rattle.montecarlo.looks import begin_budget, grow
from rattle.montecarlo.schemes.quiet import quiet_of
from rattle.montecarlo.seed import Seed
from rattle.montecarlo.settings import check_settings
from rattle.montecarlo.statistics.section_statistics import undefined
from rattle.scene import (
    Floats,
    InputError,
    Scene,
    check_each_impact,
    count,
    duration_text,
    positive,
)
from rattle.scene.errors import non_negative
from rattle.scene.progress import ESTIMATES, ProgressBar, do

LONG_RUN_PATHS = 64
# where each path is a gear set with backlashes of its own: whole vectors of lanes, and enough sets
# for a 5 % quantile over them (`rattle.montecarlo.long_run.scatter.FEWEST_SETS`)
SET_PATHS = 80
LONG_RUN_ACCURACY = 0.01
ASKED = ("rate_above", "speed_above", "energy_per_period")
"""Quantities whose intervals an accuracy is asked for, by default."""
RESTARTS = 3  # most times that what was taken for stationary is taken for burn-in after all
PILOT_IMPACTS = 4000  # impacts of the pilot run that are not slow, at the least
MOST_PILOT = 16  # periods of the pilot run
PILOT_SHARE = 0.25  # of the budget that is left, for the pilot run
BURN_IN_SHARE = 0.5  # of the budget, for the burn-in
PERIODS_GROWTH = 4  # most by which a run grows at once
PERIODS_SPARE = 1.1  # more than what an accuracy is expected to take
FIRST_TEST = 8
FIRST_DRIFT = 32
LONGEST_BURN_IN = 2**15
"""Periods after which a run is tested for the first time, also where only one test can be made, and
the longest burn-in that is tried."""
# of a path in the last half, on average, without which there is nothing to compare
LEAST_IMPACTS = 20.0
LITTLE_ERROR = 0.1
"""Share of the variance between gear sets below which longer paths narrow no interval: it is the
sets that differ."""
FALSE_TEST = 1e-3  # probability that a run that is stationary fails a test
# ratio of variances between and within paths from which paths remember where they were a quarter of
# the last half ago: twice, if a quarter of what they did then is repeated
TOO_FAR = 2.0
MOST_WIDENED = 100.0  # times wider at the most: where nothing varies, any drift is infinite
UNSETTLED = 2.0  # times wider intervals at the least, where the start may not be forgotten
PARTS_OF_HALF = 4  # of the last half, within each path
PROBED = 16  # paths of a run that is timed before the others
PROBE_PERIODS = 2  # its periods that are timed, after as many in which the paths leave their start


def usual_paths(scene: Scene) -> int:
    """How many paths a long run follows where none are asked for."""
    return SET_PATHS if scene.differs_by_set else LONG_RUN_PATHS


class BurnInError(InputError):
    """The burn-in was not reached: the paths had not forgotten their start, or never will."""


class AtRest(InputError):
    """There is no stationary motion: every path comes to rest, as far as it was followed."""

    watched = (0, 0)  # paths, and periods of each in which a mesh was closed and no impact was seen
    left_out = 0.0  # bound of the rate of impacts that are not slow, and were not followed


def compared_names(wheels: int) -> tuple[str, ...]:
    """What the columns of `Sums.main` that are compared sum: those from `NUMBER` on."""
    meshes = [f" at mesh {mesh}" for mesh in range(1, wheels + 1)]
    sums = ("impacts", "speed", "energy", "slow impacts")
    return (
        *(what + where for where in ("", *meshes) for what in sums),
        *("contact" + where for where in meshes),
    )


def _largest(wheels: int, size: Floats, allowed: float, share: Floats | None = None) -> Contrast:
    """The largest of the differences of all columns of `Sums.main` that are compared."""
    k = int(np.argmax(np.abs(size)))
    of_mean = math.nan if share is None else float(share[k])
    return Contrast(compared_names(wheels)[k], float(size[k]), allowed, of_mean)


def drift(main: Floats, wheels: int, early: slice, late: slice) -> Contrast:
    """Compare two parts of a run.

    Shapes: `main` (paths, batches, columns).
    """
    compared = main[:, :, NUMBER : columns_of(wheels).open]
    a, b = (compared[:, part].mean(axis=1) for part in (early, late))
    difference = b - a
    n = len(main)
    mean = difference.mean(axis=0)
    se = difference.std(axis=0, ddof=1) / math.sqrt(n)
    with undefined():
        z = np.where(se > 0.0, mean / se, np.where(mean == 0.0, 0.0, np.inf))
        share = mean / np.abs(b.mean(axis=0))
    allowed = float(stdtrit(n - 1, 1.0 - 0.5 * FALSE_TEST / z.size))
    return _largest(wheels, z, allowed, share)


def apart(main: Floats, wheels: int, early: slice, late: slice) -> Contrast:
    """Compare the variance between paths with that within them: over the quarters of the last half,
    and over two parts of the run, which correlate where paths remember what they did.

    The worse of both.  Two parts with the correlation r have the ratio ``(1 + r) / (1 - r)``.

    Shapes: `main` (paths, batches, columns).
    """
    n = len(main)
    compared = main[:, :, NUMBER : columns_of(wheels).open]
    columns = compared.shape[2]
    before = compared[:, early].mean(axis=1)
    after = compared[:, late].mean(axis=1)
    parts = compared[:, late].reshape(n, PARTS_OF_HALF, -1, columns).mean(axis=2)
    within = parts.var(axis=1, ddof=1).mean(axis=0) / PARTS_OF_HALF
    between = after.var(axis=0, ddof=1)
    product = ((before - before.mean(axis=0)) * (after - after.mean(axis=0))).mean(axis=0)
    with undefined():
        ratio = np.where(between > 1e-24, between / within, 0.0)
        r = np.where(between > 1e-24, product / (before.std(axis=0) * after.std(axis=0)), 0.0)
        remembered = (1.0 + r) / (1.0 - r)
    chance = 1.0 - FALSE_TEST / columns
    far = float(fdtri(n - 1, n * (PARTS_OF_HALF - 1), chance))
    t = float(stdtrit(n - 2, chance))
    most = t / math.sqrt(n - 2 + t * t)
    spread = _largest(wheels, np.nan_to_num(ratio, posinf=np.inf), max(TOO_FAR, far))
    least = (1.0 + most) / (1.0 - most)
    memory = _largest(wheels, np.nan_to_num(remembered, posinf=np.inf), least)
    return max(spread, memory, key=lambda one: one.size / one.allowed)


def settle(paths: LongPaths, burn_in: int | None) -> BurnIn:
    """Follow the paths until two tests say that they have forgotten their start, or for a given
    time; with a budget, at most for its share."""
    until = FIRST_DRIFT if paths.are_sets else FIRST_TEST
    if burn_in is not None:
        until = burn_in
    limited = math.isfinite(paths.limit.seconds)
    if limited:
        paths.reserve = (1.0 - BURN_IN_SHARE) * paths.limit.seconds
    paths.begin()
    before: Contrast | None = None
    wheels = paths.scene.stages
    while True:
        began = clock()
        paths.expect(until - paths.periods + STATIONARY_PERIODS)
        paths.follow(until)
        main = paths.main
        quarter = main.shape[1] // 4
        late = slice(main.shape[1] - 2 * quarter, main.shape[1])
        impacts = float(main[:, late, NUMBER].sum()) / len(main)
        moved = Contrast("", 0.0, math.inf, 0.0)
        differ = None
        if quarter:
            moved = drift(main, wheels, slice(quarter, 2 * quarter), late)
            if quarter * 2 % PARTS_OF_HALF == 0 and not paths.are_sets:
                differ = apart(main, wheels, slice(quarter, 2 * quarter), late)
        forgotten = moved.reached and (differ is None or differ.reached)
        if paths.periods >= until and (
            burn_in is not None or (forgotten and impacts >= LEAST_IMPACTS)
        ):
            return BurnIn(paths.periods, moved, differ, True)
        if impacts == 0.0 and paths.periods >= FIRST_DRIFT and paths.at_rest():
            raise _make_rest(paths, 2 * quarter * paths.length)
        room = paths.limit.remaining - paths.reserve
        if limited and (paths.periods < until or room < 2.0 * (clock() - began)):
            return BurnIn(paths.periods, moved, differ, False)
        if until >= LONGEST_BURN_IN or paths.is_refused(until):
            raise refuse_burn_in(paths.elapsed, moved, differ, before, impacts)
        before = moved
        until = 2 * until


def _make_rest(paths: LongPaths, periods: int) -> AtRest:
    """The error for paths that had no impact in so many periods."""
    why = "comes to rest: a mesh stays closed, and no impact was seen"
    rest = AtRest("scene", paths.scene.sigma, why)
    rest.watched = len(paths.main), periods
    rest.left_out = paths.left_out()
    return rest


def refuse_burn_in(
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
    remedy = f"give at least {must:,}, and the budget for it"
    if differ is not None and differ.size > KEPT_APART:
        times = f"{differ.size:.3g}" if differ.size < math.inf else "infinitely many"
        why = (
            f"the variance of {differ.quantity} between paths is {times} times that within them:"
            " there are several attractors that the noise does not connect in this time"
        )
        remedy += ", or noise that connects them"
    elif impacts < LEAST_IMPACTS:
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
            " than within them: each path remembers where it was for longer than this"
        )
    return BurnInError("burn_in", done, f"periods are not enough: {why}; {remedy}")


def _pilot(paths: LongPaths) -> None:
    """Choose where distributions are counted, and begin to sum."""
    last = paths.main[:, -1]
    above = last[:, NUMBER].sum() - last[:, SLOW].sum()
    rate = float(above if above > 0.0 else last[:, NUMBER].sum()) / paths.length  # in a period
    paths.reserve = 0.0
    affordable = PILOT_SHARE * paths.limit.remaining / max(paths.pace, 1e-9)
    periods = int(max(min(_pilot_periods(rate), affordable), 1.0))
    paths.expect(periods + STATIONARY_PERIODS)
    paths.begin()
    seen: list[Floats] = []
    paths.follow(periods, seen)
    paths.begin(scales_of_pilot(paths.scene.stages, np.concatenate(seen), paths.slow))


def _pilot_periods(rate: float) -> float:
    """Periods of a pilot run, of which each shows so many impacts that are not slow."""
    return min(max(PILOT_IMPACTS / max(rate, 1e-9), 2.0), MOST_PILOT)


def _gather(
    paths: LongPaths, goal: float | None, periods: int | None, asked: tuple[str, ...]
) -> LongReach | None:
    """Follow the stationary motion for a number of periods, or until the intervals are narrow
    enough."""
    wanted = STATIONARY_PERIODS if periods is None else periods
    paths.expect(wanted)
    paths.follow(wanted)
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
            if math.isinf(width):
                why = f"too few paths say anything of {worst}: give more paths, or a budget"
            raise InputError("accuracy", goal, why)
        most = PERIODS_GROWTH * before
        # none can be expected where no impact was seen
        paths.expect(PERIODS_SPARE * more if math.isfinite(more) else most)
        paths.follow(min(grow(before, min(need, most), PERIODS_SPARE), most))
        if paths.periods == before:
            return LongReach(goal, worst, width, more * paths.pace)
    return None


def _find_widest(asked: Estimates) -> tuple[float, str]:
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


def expect_run(
    scene: Scene,
    paths: int,
    periods: int | None = None,
    burn_in: int | None = None,
    slow: float = 0.1,
    resolve: float | None = None,
) -> ExpectedRun:
    """Expect what a long run takes at the least, from the time of a few of its paths once they have
    left their start.

    It takes more where paths forget their start late, or where an accuracy needs more than
    `STATIONARY_PERIODS` periods.
    """
    warm_up(scene, slow)
    walk = Walk(scene, np.random.SeedSequence(0), 0, PROBED, quiet_of(scene, slow, resolve))
    sums = new_sums(PROBED, PROBE_PERIODS, no_scales(scene.stages, slow), False)
    walk.follow(sums, PROBE_PERIODS)
    sums.main[:] = 0.0
    began = clock()
    walk.follow(sums, PROBE_PERIODS)
    pace = (clock() - began) / PROBE_PERIODS * paths / PROBED
    above = sums.main[:, :, NUMBER].sum() - sums.main[:, :, SLOW].sum()
    rate = float(above) / PROBE_PERIODS * paths / PROBED
    least = FIRST_TEST if burn_in is None else burn_in
    every = math.ceil(
        least + _pilot_periods(rate) + (STATIONARY_PERIODS if periods is None else periods)
    )
    return ExpectedRun(every, every * pace)


def _state_estimate(label: str, expected: ExpectedRun, paths: int, budget: float | None) -> None:
    """State what a long run is expected to take, and whether that is beyond a budget."""
    sentence = f"{label}: {expected.periods} periods of {paths} paths at the least"
    sentence += f", about {duration_text(expected.core_seconds, 2)} of processor time"
    if budget is not None and expected.core_seconds > budget:
        sentence += f", more than the budget of {duration_text(budget)}"
    ESTIMATES.info("%s", sentence)


def check_long_run(
    scene: Scene,
    accuracy: float | None,
    periods: int | None,
    quantities: Sequence[str] = ASKED,
    paths: int = LONG_RUN_PATHS,
    burn_in: int | None = None,
    slow: float = 0.1,
    resolve: float | None = None,
    rng: Seed = 0,
    workers: int = 1,
) -> None:
    """Refuse settings of `long_run` that cannot be run."""
    check_settings(scene, paths, 1, None, "exact-flight", rng, workers)
    count("paths", paths, least=16)
    for name in quantities:
        check_quantity("quantities", name, scene.stages)
    if accuracy is not None and periods is not None:
        raise InputError("periods", periods, "is chosen by accuracy; leave out one of them")
    if periods is not None:
        count("periods", periods, least=PATH_BATCHES)
    if burn_in is not None:
        count("burn_in", burn_in, least=1)
    if accuracy is not None:
        positive("accuracy", accuracy)
    positive("slow", slow)
    check_each_impact(scene)
    if resolve is not None:
        non_negative("resolve", resolve)


def long_run(
    scene: Scene,
    *,
    accuracy: float | None = None,
    periods: int | None = None,
    quantities: Sequence[str] = ASKED,
    paths: int = LONG_RUN_PATHS,
    burn_in: int | None = None,
    slow: float = 0.1,
    resolve: float | None = None,
    budget: float | None = None,
    rng: Seed = 0,
    workers: int = 1,
    progress: str | None = None,
) -> LongRun:
    """Follow independent paths of exact flights through the stationary motion.

    Path 0 starts where the scene says, all others anywhere between the walls.

    `accuracy`: Largest half width of the 95 % intervals of `quantities`, over their value; 0.01 by
    default. `resolve`: Speed down to which impacts at closed meshes are followed one by one; 0 for
    all of them, by default an eighth of `slow` (`rattle.montecarlo.schemes.quiet`). `budget`:
    Seconds of processor time that it may take, all threads together; compiling is not counted.
    When it ends, what there is is returned.  Without it, what is expected to take more than an hour
    is refused. `rng`: Seed. The result is the same bit for bit for any number of workers.
    """
    check_long_run(
        scene, accuracy, periods, quantities, paths, burn_in, slow, resolve, rng, workers
    )
    goal = (
        None if periods is not None else LONG_RUN_ACCURACY if accuracy is None else float(accuracy)
    )
    quiet = quiet_of(scene, slow, resolve)
    limit = begin_budget(budget)
    seed = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
    began = time.perf_counter()
    with limit.pause():
        warm_up(scene, slow)
    if progress:
        do(f"{progress}: timing a few paths")
        expected = expect_run(scene, paths, periods, burn_in, slow, resolve)
        _state_estimate(progress, expected, paths, budget)
    bar = ProgressBar(label=progress, unit="period")
    with ThreadPoolExecutor(workers) as pool, bar:
        followed = LongPaths(scene, paths, seed, slow, quiet, limit, pool, bar)
        settled, reach, late = _settle_and_gather(
            followed, burn_in, goal, periods, tuple(quantities)
        )
    widened = 1.0 if settled.reached else max(UNSETTLED, min(abs(late.size), MOST_WIDENED))
    return LongRun(
        scene=scene,
        sums=followed.collect(),
        burn_in=settled,
        reach=reach,
        late=late,
        slow=slow,
        quiet=quiet.speed,
        widened=widened,
        asked_periods=periods,
        wall_seconds=time.perf_counter() - began,
    )


def _settle_and_gather(
    followed: LongPaths,
    burn_in: int | None,
    goal: float | None,
    periods: int | None,
    quantities: tuple[str, ...],
) -> tuple[BurnIn, LongReach | None, Contrast]:
    """Follow paths through burn-in, pilot run and stationary motion, again while that still
    drifts."""
    limit = followed.limit
    for _ in range(RESTARTS):
        settled = settle(followed, burn_in)
        _pilot(followed)
        reach = _gather(followed, goal, periods, quantities)
        # a budget may end before the burn-in could tell
        if not followed.main[:, :, NUMBER].any() and followed.at_rest():
            raise _make_rest(followed, followed.periods)
        late = _late_drift(followed)
        ended = limit.remaining < BURN_IN_SHARE * limit.seconds
        if late.reached or burn_in is not None or not settled.reached or ended:
            break
    if not late.reached and math.isinf(limit.seconds):
        raise refuse_burn_in(followed.elapsed, late)
    left_out = followed.elapsed - followed.periods
    settled = settled._replace(periods=left_out, reached=settled.reached and late.reached)
    return settled, reach, late


def _late_drift(paths: LongPaths) -> Contrast:
    """Compare the first quarter of the stationary motion with its last half, where it has four
    parts."""
    main = paths.main
    batches = main.shape[1]
    if batches < 4:
        return Contrast("", 0.0, math.inf)
    halves = slice(0, batches // 4), slice(batches // 2, batches)
    return drift(main, paths.scene.stages, *halves)
