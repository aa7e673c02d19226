"""Ensembles of long paths: burn-in, pilot run, and as much of the stationary motion as an accuracy takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rattle.montecarlo.budget import HOUR, Budget, clock, in_words
from rattle.montecarlo.long_run.burn_in import (
    FIRST,
    LEAST_IMPACTS,
    MOST,
    PARTS,
    Apart,
    AtRest,
    BurnIn,
    BurnInError,
    Drift,
    apart,
    drift,
)  # fmt: skip
from rattle.montecarlo.long_run.density import SectionDensity
from rattle.montecarlo.long_run.estimates import (
    Collected,
    Estimate,
    all_names,
    collected,
    estimates,
    section_densities,
    time_averages,
    velocity_density,
)  # fmt: skip
from rattle.montecarlo.long_run.pilot import no_scales, scales_of_pilot
from rattle.montecarlo.long_run.sums import CONTACT, NUMBER, Scales, new_sums
from rattle.montecarlo.long_run.walk import LANES, PERIOD, SAMPLES, Walk
from rattle.montecarlo.settings import check_settings
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.text import line
from rattle.scene.validate import choice, count, positive

__all__ = ["ACCURACY", "ASKED", "BATCHES", "PATHS", "LongReach", "LongRun", "long_run"]

Floats = NDArray[np.float64]

PATHS = 256
ACCURACY = 0.01
ASKED = ("rate", "speed", "energy_per_period")
"""Quantities whose intervals an accuracy is asked for, by default."""
BATCHES = 64  # of each path; when they are full, each two become one
PILOT = 40_000  # impacts of the pilot run
MOST_PILOT = 64  # periods of the pilot run
LEAST = 64  # periods of the stationary motion
GROWTH = 4  # most by which a run grows at once
SPARE = 1.1  # more than what an accuracy is expected to take


class LongReach(NamedTuple):
    """The accuracy that a long run reached, compared with the accuracy asked for.

    Attributes
    ----------
    asked : float
        Largest half width of the 95 % intervals over their value.
    worst : str
        The quantity whose interval is widest.
    width : float
        Half width of its interval over its value.
    more_seconds : float
        Estimated time that is missing; 0 where the accuracy was reached.
    """

    asked: float
    worst: str
    width: float
    more_seconds: float

    @property
    def reached(self) -> bool:
        """Whether all intervals that were asked for are within the accuracy."""
        return self.width <= self.asked

    @property
    def sentence(self) -> str:
        """What was reached, as text."""
        found = f"the widest interval is ± {self.width:.2g} of its value ({self.worst})"
        if self.reached:
            return f"Accuracy {self.asked:g} reached: {found}."
        more = in_words(self.more_seconds)
        return f"Accuracy {self.asked:g} NOT reached within the budget: {found}; about {more} more would do."


@dataclass(frozen=True)
class LongRun:
    """Stationary quantities of an ensemble, from `long_run`.

    Attributes
    ----------
    scene : Scene
    sums : Collected
        The sums of all paths.
    periods : int
        Periods of each path after the burn-in.
    burn_in : BurnIn
    reach : LongReach or None
        None where a number of periods was given.
    late : Drift
        First quarter against last half of the stationary motion.
    slow : float
        Speed below which an impact is slow.
    wall_seconds : float
    """

    scene: Scene
    sums: Collected
    periods: int
    burn_in: BurnIn
    reach: LongReach | None
    late: Drift
    slow: float
    wall_seconds: float

    @property
    def paths(self) -> int:
        """Number of paths."""
        return self.sums.paths

    @property
    def impacts(self) -> int:
        """Impacts of all paths after the burn-in."""
        return int(self.sums.main[:, :, NUMBER].sum())

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """All quantities by name, in the order of the table."""
        found = estimates(self.sums)
        return {name: found[name] for name in all_names(self.scene.stages) if name in found}

    @cached_property
    def densities(self) -> tuple[SectionDensity, ...]:
        """Density of the section at each mesh."""
        return section_densities(self.sums)

    def velocity_density(self, mesh: int) -> tuple[Floats, Floats]:
        """Density of the velocity before an impact at a mesh, and its standard error, in the cells of the section.

        Parameters
        ----------
        mesh : int
            1 or 2.

        Returns
        -------
        density, se : ndarray, shape (velocities,)
        """
        return velocity_density(self.sums, mesh)

    @property
    def averages(self) -> Floats:
        """Averages over time on each path, see `time_averages`."""
        return time_averages(self.sums)


class _Ensemble:
    """All blocks of paths, and the batches that they are filling."""

    def __init__(self, scene: Scene, paths: int, seed: np.random.SeedSequence, slow: float) -> None:
        starts = range(0, paths, LANES)
        self.walks = [Walk(scene, seed, first, min(LANES, paths - first)) for first in starts]
        self.scene, self.slow = scene, slow
        self.begin(no_scales(slow), detail=False)

    def begin(self, scales: Scales, detail: bool) -> None:
        """Begin to sum anew from here."""
        self.detail = detail
        self.sums = [new_sums(walk.paths, BATCHES, scales, detail) for walk in self.walks]
        self.length, self.periods = 1, 0  # periods of a batch, and in all batches

    def follow(
        self, pool: ThreadPoolExecutor, until: int, bar: tqdm[NoReturn], seen: list[Floats] | None = None
    ) -> None:
        """Follow all paths for at least `until` periods since the sums began, to the end of a batch."""
        while self.periods < until:
            if self.periods == BATCHES * self.length:
                self._merge()
            self._advance(pool, self.length, bar, seen)

    def _advance(self, pool: ThreadPoolExecutor, periods: int, bar: tqdm[NoReturn], seen: list[Floats] | None) -> None:
        """One batch."""
        batch = self.periods // self.length

        def one(i: int) -> list[Floats]:
            walk, sums = self.walks[i], self.sums[i]
            sums.batch[0] = batch
            own: list[Floats] = []
            for _ in range(periods):
                walk.follow(sums, self.detail, own if seen is not None else None)
            return own

        for own in pool.map(one, range(len(self.walks))):
            if seen is not None:
                seen += own
        self.periods += periods
        bar.update(periods)

    def _merge(self) -> None:
        for sums in self.sums:
            half = sums.main[:, 0::2] + sums.main[:, 1::2]
            sums.main[:, : BATCHES // 2] = half
            sums.main[:, BATCHES // 2 :] = 0.0
        self.length *= 2

    def warm_up(self) -> None:
        """Compile everything."""
        seen: list[Floats] = []
        self.walks[0].follow(self.sums[0], False, seen)
        self.begin(no_scales(self.slow), detail=True)
        self.walks[0].follow(self.sums[0], True)

    def at_rest(self) -> bool:
        """Whether a mesh of every path is closed at all instants of the last half."""
        main = self.main
        half = main[:, main.shape[1] // 2 :, CONTACT : CONTACT + 2].sum(axis=1).max(axis=1)
        return bool((half >= 0.5 * SAMPLES * self.periods - 0.5).all())

    @property
    def followed(self) -> int:
        """Periods since the start."""
        return self.walks[0].periods

    @property
    def own_walls(self) -> bool:
        """Whether each path has a backlash of its own for good."""
        t = self.scene.tolerance
        return t is not None and t.distribution != "fixed" and t.draw != "contact"

    @property
    def main(self) -> Floats:
        """Main sums of all paths over the batches that are full."""
        full = self.periods // self.length
        return np.concatenate([sums.main[:, :full] for sums in self.sums])

    def collected(self) -> Collected:
        """Everything that was summed."""
        full = self.periods // self.length
        return collected(
            self.sums, full, PERIOD * self.periods, float(SAMPLES * self.periods), self.scene.stages
        )  # fmt: skip


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

    Parameters
    ----------
    scene : Scene
        What is modelled.
    accuracy : float, optional
        Largest half width of the 95 % intervals of `quantities`, over their value; 0.01 by default.
    periods : int, optional
        Periods of each path after the burn-in, in place of an accuracy.
    quantities : sequence of str
        Those that the accuracy is for, names of `all_names`.
    paths : int
        Independent paths, 16 or more.
    burn_in : int, optional
        Periods to leave out before; found by tests by default.
    slow : float
        Speed below which an impact counts as slow.
    budget : float, optional
        Seconds that it may take; an hour by default, and what is expected to take longer is refused.
    rng : int or SeedSequence
        Seed.  The result is the same bit for bit for any number of workers.
    workers : int
        Threads.
    progress : str, optional
        Label of a progress bar on a terminal.

    Returns
    -------
    LongRun

    Raises
    ------
    InputError
        For a setting that cannot be run, or an accuracy that would take more than an hour where no budget is given.
    BurnInError
        If the paths do not forget their start; says how long the burn-in must be.

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
    limit = Budget(HOUR if budget is None else float(positive("budget", budget)))
    seed = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
    began = clock()
    with limit.uncounted():
        _Ensemble(scene, 1, seed, slow).warm_up()
    ensemble = _Ensemble(scene, paths, seed, slow)
    bar = tqdm(unit="period", desc=progress and line(progress), disable=None if progress else True)
    with ThreadPoolExecutor(workers) as pool, bar:
        runner = _Runner(ensemble, pool, bar, limit, budget is None)
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
    left_out = found._replace(periods=ensemble.followed - ensemble.periods)
    return LongRun(scene, ensemble.collected(), ensemble.periods, left_out, reach, late, slow, clock() - began)


RESTARTS = 3  # most times that what was taken for stationary is taken for burn-in after all


class _Runner(NamedTuple):
    """The parts of a run, one after the other."""

    ensemble: _Ensemble
    pool: ThreadPoolExecutor
    bar: tqdm[NoReturn]
    limit: Budget
    refuse: bool

    def settle(self, burn_in: int | None) -> BurnIn:
        """Follow the paths until two tests say that they have forgotten their start, or for a given time."""
        e, until = self.ensemble, FIRST if burn_in is None else burn_in
        e.begin(no_scales(e.slow), detail=False)
        before: Drift | None = None
        while True:
            began = clock()
            e.follow(self.pool, until, self.bar)
            main = e.main
            quarter = main.shape[1] // 4
            late = slice(main.shape[1] - 2 * quarter, main.shape[1])
            impacts = float(main[:, late, NUMBER].sum()) / len(main)
            moved = drift(main, slice(quarter, 2 * quarter), late) if quarter else Drift("", 0.0, math.inf, 0.0)
            differ = apart(main, late) if quarter * 2 % PARTS == 0 and quarter and not e.own_walls else None
            if burn_in is not None or (
                moved.reached and (differ is None or differ.reached) and impacts >= LEAST_IMPACTS
            ):
                return BurnIn(e.periods, moved, differ)
            if impacts == 0.0 and until >= 4 * FIRST and e.at_rest():
                raise AtRest("scene", e.scene.sigma, "comes to rest for good: a mesh stays closed and nothing moves it")
            if until >= MOST or self.limit.left < 2.0 * (clock() - began):
                raise self.refusal(moved, differ, before, impacts)
            before, until = moved, 2 * until

    def refusal(
        self, moved: Drift, differ: Apart | None, before: Drift | None = None, impacts: float = math.inf
    ) -> BurnInError:
        """The error for a burn-in that was not reached."""
        e = self.ensemble
        done, must = e.followed, 4 * e.followed
        if before is not None and abs(moved.share) < 0.9 * abs(before.share) and moved.share * before.share > 0.0:
            fall = math.log(abs(before.share / moved.share))  # of an exponential decay, over half of the run
            must = min(max(math.ceil(done + 0.5 * done * math.log(abs(moved.z)) / fall), 2 * done), 64 * done)
        if impacts < LEAST_IMPACTS:
            why = f"a path had {impacts:.3g} impacts in the last half, and {LEAST_IMPACTS:g} are the least"
        elif not moved.reached:
            why = (
                f"{moved.quantity} still changes by {moved.share:+.2%}, {abs(moved.z):.1f} standard errors, over the "
                f"second half ({moved.allowed:.1f} are put down to chance)"
            )
        else:
            assert differ is not None
            why = (
                f"{differ.quantity} differs {differ.ratio:.3g} times more between paths (in variance) than within "
                "them: there are several attractors that the noise does not connect in this time"
            )
        return BurnInError(
            "burn_in", done, f"periods are not enough: {why}; give at least {must:,}, and the budget for it"
        )

    def pilot(self) -> None:
        """Choose where distributions are counted, and begin to sum."""
        e = self.ensemble
        rate = float(e.main[:, -1, NUMBER].sum()) / e.length  # impacts of all paths in a period
        periods = int(min(max(PILOT / max(rate, 1e-9), 2.0), MOST_PILOT))
        e.begin(no_scales(e.slow), detail=False)
        seen: list[Floats] = []
        e.follow(self.pool, periods, self.bar, seen)
        e.begin(scales_of_pilot(np.concatenate(seen), e.slow), detail=True)

    def gather(self, goal: float | None, periods: int | None, asked: tuple[str, ...]) -> LongReach | None:
        """Follow the stationary motion for a number of periods, or until the intervals are narrow enough."""
        e, began = self.ensemble, clock()
        e.follow(self.pool, LEAST if periods is None else periods, self.bar)
        while goal is not None:
            width, worst = _widest(estimates(e.collected(), asked))
            each = (clock() - began) / e.periods
            need = math.inf if math.isinf(width) else e.periods * (width / goal) ** 2
            missing = max(need - e.periods, 0.0) * each
            if width <= goal:
                return LongReach(goal, worst, width, 0.0)
            if self.refuse and missing > HOUR:
                gives = width * math.sqrt(e.periods / (HOUR / each))
                raise InputError(
                    "accuracy", goal, f"is expected to take {in_words(missing)}, and where no budget is given an hour "
                    f"is the most: ask for {gives:.2g}, or give the seconds that it may take as budget",
                )  # fmt: skip
            affordable = e.periods + int(max(self.limit.left, 0.0) / each)
            target = int(min(SPARE * need + 1.0, GROWTH * e.periods, affordable))
            if target < e.periods + e.length:
                return LongReach(goal, worst, width, missing)
            e.follow(self.pool, target, self.bar)
        return None

    def late(self) -> Drift:
        """First quarter of the stationary motion against its last half."""
        main = self.ensemble.main
        batches = main.shape[1]
        return drift(main, slice(0, batches // 4), slice(batches // 2, batches))


def _widest(found: dict[str, Estimate]) -> tuple[float, str]:
    """Largest half width over the value, and of which quantity."""
    widths = {
        name: 0.0 if e.se == 0.0 else 0.5 * (e.high - e.low) / abs(e.value) if e.value != 0.0 else math.inf
        for name, e in found.items()
    }
    worst = max(widths, key=lambda name: (not math.isfinite(widths[name]), widths[name]))
    return (widths[worst] if math.isfinite(widths[worst]) else math.inf), worst
