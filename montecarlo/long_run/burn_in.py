"""Whether a run has forgotten its start: the halves of it are compared over independent paths.

The paths start anywhere between the walls.  For each of the rates of impacts, speed, energy, slow impacts and contact,
the means over the second and the last two quarters of the time so far are compared path by path (as Geweke's diagnostic
does along one chain).  The paths are independent, so the difference over its standard error is a Student t, whatever
the memory of a path is.  Besides, paths that never meet (several attractors) differ from each other more than the parts
of each path do: an F test.

References
----------
Geweke, "Evaluating the accuracy of sampling-based approaches to the calculation of posterior moments" (1992).
Gelman and Rubin, "Inference from iterative simulation using multiple sequences" (1992).
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from rattle.montecarlo.long_run.paths import LongPaths
from rattle.montecarlo.long_run.sums import CONTACT, GROUPS, NUMBER
from rattle.montecarlo.settings.budget import clock
from rattle.scene.errors import InputError
from rattle.scene.types import Floats

FIRST, MOST = 32, 2**15
"""Periods after which a run is tested for the first time, and the longest burn-in that is tried."""
LEAST_IMPACTS = 20.0  # of a path in the last half, on average, without which there is nothing to compare
FALSE_ALARM = 1e-3  # probability that a run that is stationary fails a test
TOO_FAR = 4.0  # ratio of variances between and within paths from which paths count as kept apart
PARTS = 4  # of the last half, within each path
COMPARED = ("impacts", "speed", "energy", "slow impacts")


class BurnInError(InputError):
    """The burn-in was not reached: the paths had not forgotten their start, or never will."""


class AtRest(InputError):
    """There is no stationary motion: every path comes to rest for good."""


class Contrast(NamedTuple):
    """The largest difference between two parts of a run, or between its paths."""

    quantity: str  # where it is largest
    size: float  # in standard errors; or the variance between paths over that expected from the parts of each
    allowed: float  # the largest that is put down to chance
    share: float = math.nan  # difference between the parts over the mean

    @property
    def reached(self) -> bool:
        """Whether the parts, or the paths, agree."""
        return abs(self.size) <= self.allowed


class BurnIn(NamedTuple):
    """The burn-in of a run."""

    periods: int  # periods of the excitation that were left out
    drift: Contrast  # of the test that it passed
    # of the other test; None where paths differ for good, because each has a backlash of its own
    apart: Contrast | None

    @property
    def sentence(self) -> str:
        """What was left out, and why it suffices, as text."""
        return (
            f"Burn-in: {self.periods} periods; its second quarter and its second half agree within "
            f"{abs(self.drift.size):.1f} standard errors (allowed {self.drift.allowed:.1f})."
        )


def _names() -> list[str]:
    wheres = ("", " at mesh 1", " at mesh 2")
    return [what + where for where in wheres[:GROUPS] for what in COMPARED] + ["contact at mesh 1", "contact at mesh 2"]


def drift(main: Floats, early: slice, late: slice) -> Contrast:
    """Compare two parts of a run.

    Shapes: `main` (paths, batches, MAIN).
    """
    a, b = (main[:, part, : CONTACT + 2].mean(axis=1) for part in (early, late))
    difference, n = b - a, len(main)
    mean, se = difference.mean(axis=0), difference.std(axis=0, ddof=1) / math.sqrt(n)
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.where(se > 0.0, mean / se, np.where(mean == 0.0, 0.0, np.inf))
        share = mean / np.abs(b.mean(axis=0))
    k = int(np.argmax(np.abs(z)))
    allowed = float(stdtrit(n - 1, 1.0 - 0.5 * FALSE_ALARM / z.size))
    return Contrast(_names()[k], float(z[k]), allowed, float(share[k]))


def apart(main: Floats, late: slice) -> Contrast:
    """Compare the variance between paths with that within them.

    Shapes: `main` (paths, batches, MAIN).
    """
    own = main[:, late, : CONTACT + 2]
    parts = own.reshape(len(own), PARTS, -1, own.shape[2]).mean(axis=2)
    within, between = parts.var(axis=1, ddof=1).mean(axis=0) / PARTS, parts.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(between > 1e-24, between / within, 0.0)
    ratio = np.where(np.isnan(ratio), 0.0, ratio)
    k = int(np.argmax(ratio))
    return Contrast(_names()[k], float(ratio[k]), TOO_FAR)


def settle(paths: LongPaths, burn_in: int | None) -> BurnIn:
    """Follow the paths until two tests say that they have forgotten their start, or for a given time."""
    until = FIRST if burn_in is None else burn_in
    paths.begin()
    before: Contrast | None = None
    while True:
        began = clock()
        paths.follow(until)
        if paths.periods < until and (before is None or burn_in is not None):
            raise paths.unaffordable(f"{until} periods of burn-in at least", until)
        main = paths.main
        quarter = main.shape[1] // 4
        late = slice(main.shape[1] - 2 * quarter, main.shape[1])
        impacts = float(main[:, late, NUMBER].sum()) / len(main)
        moved = drift(main, slice(quarter, 2 * quarter), late) if quarter else Contrast("", 0.0, math.inf, 0.0)
        differ = apart(main, late) if quarter * 2 % PARTS == 0 and quarter and not paths.own_walls else None
        if burn_in is not None or (moved.reached and (differ is None or differ.reached) and impacts >= LEAST_IMPACTS):
            return BurnIn(paths.periods, moved, differ)
        if impacts == 0.0 and paths.at_rest():
            why = "comes to rest for good: a mesh stays closed and nothing moves it"
            raise AtRest("scene", paths.scene.sigma, why)
        if until >= MOST or paths.limit.remaining < 2.0 * (clock() - began) or paths.is_refused(until):
            raise refusal(paths.elapsed, moved, differ, before, impacts)
        before, until = moved, 2 * until


def refusal(
    done: int,
    moved: Contrast,
    differ: Contrast | None = None,
    before: Contrast | None = None,
    impacts: float = math.inf,
) -> BurnInError:
    """The error for a burn-in that was not reached in `done` periods."""
    must = 4 * done
    if before is not None and abs(moved.share) < 0.9 * abs(before.share) and moved.share * before.share > 0.0:
        fall = math.log(abs(before.share / moved.share))  # of an exponential decay, over half of the run
        must = min(max(math.ceil(done + 0.5 * done * math.log(abs(moved.size)) / fall), 2 * done), 64 * done)
    if impacts < LEAST_IMPACTS:
        why = f"a path had {impacts:.3g} impacts in the last half, and {LEAST_IMPACTS:g} are the least"
    elif not moved.reached:
        why = (
            f"{moved.quantity} still changes by {moved.share:+.2%}, {abs(moved.size):.1f} standard errors, over the "
            f"second half ({moved.allowed:.1f} are put down to chance)"
        )
    else:
        assert differ is not None
        why = (
            f"{differ.quantity} differs {differ.size:.3g} times more between paths (in variance) than within "
            "them: there are several attractors that the noise does not connect in this time"
        )
    return BurnInError("burn_in", done, f"periods are not enough: {why}; give at least {must:,}, and the budget for it")
