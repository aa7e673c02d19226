"""The parts of a long run, one after the other: burn-in, pilot run, and the stationary motion."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

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
)
from rattle.montecarlo.long_run.estimates import StationaryEstimate, estimates
from rattle.montecarlo.long_run.paths import LongPaths
from rattle.montecarlo.long_run.pilot import no_scales, scales_of_pilot
from rattle.montecarlo.long_run.result import LongReach
from rattle.montecarlo.long_run.sums import NUMBER
from rattle.montecarlo.settings.budget import HOUR, Budget, clock
from rattle.scene.errors import InputError
from rattle.scene.text import duration_text

Floats = NDArray[np.float64]

PILOT = 40_000  # impacts of the pilot run
MOST_PILOT = 64  # periods of the pilot run
PILOT_SHARE = 0.25  # of the budget that is left, for the pilot run
LEAST = 64  # periods of the stationary motion
FEWEST = 8  # where the budget ends before
IMPACT_SECONDS = 1.5e-6
"""Nominal processor time of an impact, steps included: what is refused does not depend on the machine."""
GROWTH = 4  # most by which a run grows at once
SPARE = 1.1  # more than what an accuracy is expected to take


class Parts(NamedTuple):
    """The parts of a run, one after the other."""

    ensemble: LongPaths  # the paths
    pool: ThreadPoolExecutor  # threads
    bar: tqdm[NoReturn]  # counts periods
    limit: Budget  # time that the run may take
    refuse: bool  # whether an accuracy that would take more than an hour is refused

    def settle(self, burn_in: int | None) -> BurnIn:
        """Follow the paths until two tests say that they have forgotten their start, or for a given time."""
        e, until = self.ensemble, FIRST if burn_in is None else burn_in
        e.begin(no_scales(e.slow), detail=False)
        before: Drift | None = None
        while True:
            began = clock()
            e.follow(self.pool, until, self.bar)
            if e.periods < until and (before is None or burn_in is not None):
                raise self._unaffordable(f"{until} periods of burn-in at least", until)
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
            if until >= MOST or self.limit.remaining < 2.0 * (clock() - began) or self._is_refused(until):
                raise self.refusal(moved, differ, before, impacts)
            before, until = moved, 2 * until

    def _nominal(self) -> float:
        """Nominal processor time of a period."""
        return IMPACT_SECONDS * float(self.ensemble.main[:, :, NUMBER].sum()) / self.ensemble.periods

    def _is_refused(self, periods: int) -> bool:
        """Whether so many periods more are expected to take more than an hour, and no budget is given."""
        return self.refuse and periods * self._nominal() > HOUR

    def _unaffordable(self, what: str, periods: int) -> InputError:
        """The error for a budget that ends before there is an answer."""
        e = self.ensemble
        more = duration_text((periods - e.periods + LEAST) * e.pace, 2)
        return InputError(
            "budget", self.limit.seconds, f"ends after {e.periods} of {what}; give about {more} of processor time more"
        )

    def refusal(
        self, moved: Drift, differ: Apart | None, before: Drift | None = None, impacts: float = math.inf
    ) -> BurnInError:
        """The error for a burn-in that was not reached."""
        e = self.ensemble
        done, must = e.elapsed, 4 * e.elapsed
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
        affordable = PILOT_SHARE * self.limit.remaining / max(e.pace, 1e-9)
        periods = int(max(min(max(PILOT / max(rate, 1e-9), 2.0), MOST_PILOT, affordable), 1.0))
        e.begin(no_scales(e.slow), detail=False)
        seen: list[Floats] = []
        e.follow(self.pool, periods, self.bar, seen)
        if not seen:
            raise self._unaffordable(f"{periods} periods of a pilot run", periods)
        e.begin(scales_of_pilot(np.concatenate(seen), e.slow), detail=True)

    def gather(self, goal: float | None, periods: int | None, asked: tuple[str, ...]) -> LongReach | None:
        """Follow the stationary motion for a number of periods, or until the intervals are narrow enough."""
        e = self.ensemble
        e.follow(self.pool, LEAST if periods is None else periods, self.bar)
        if e.periods < (FEWEST if periods is None else periods):
            wanted = LEAST if periods is None else periods
            raise self._unaffordable(f"{wanted} periods after the burn-in", wanted)
        while goal is not None:
            width, worst = find_widest(estimates(e.collect(), asked))
            need = math.inf if math.isinf(width) else e.periods * (width / goal) ** 2
            more = max(need - e.periods, 0.0)
            if width <= goal:
                return LongReach(goal, worst, width, 0.0)
            nominal = self._nominal()
            if self.refuse and more * nominal > HOUR:
                gives = width * math.sqrt(e.periods * nominal / HOUR)
                raise InputError(
                    "accuracy",
                    goal,
                    f"is expected to take {duration_text(more * nominal)} of processor time, and without "
                    f"a budget the limit is one hour: ask for {gives:.2g}, or give the seconds that it may take as "
                    "budget",
                )
            before = e.periods
            e.follow(self.pool, int(min(SPARE * need + 1.0, GROWTH * before)), self.bar)
            if e.periods == before:
                return LongReach(goal, worst, width, more * e.pace)
        return None

    def late(self) -> Drift:
        """First quarter of the stationary motion against its last half."""
        main = self.ensemble.main
        batches = main.shape[1]
        return drift(main, slice(0, batches // 4), slice(batches // 2, batches))


def find_widest(found: dict[str, StationaryEstimate]) -> tuple[float, str]:
    """Find the widest interval."""
    widths = {
        name: 0.0 if e.se == 0.0 else 0.5 * (e.high - e.low) / abs(e.value) if e.value != 0.0 else math.inf
        for name, e in found.items()
    }
    worst = max(widths, key=lambda name: (not math.isfinite(widths[name]), widths[name]))
    return (widths[worst] if math.isfinite(widths[worst]) else math.inf), worst
