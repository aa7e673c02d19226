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
from numpy.typing import NDArray
from scipy.special import stdtrit

from rattle.montecarlo.long_run.sums import CONTACT, GROUPS
from rattle.scene.errors import InputError

Floats = NDArray[np.float64]

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


class Drift(NamedTuple):
    """The largest difference between two parts of a run."""

    quantity: str  # where it is largest
    z: float  # z, allowed: difference in standard errors, and the largest that is put down to chance
    allowed: float
    share: float  # difference over the mean

    @property
    def reached(self) -> bool:
        """Whether the parts agree."""
        return abs(self.z) <= self.allowed


class Apart(NamedTuple):
    """How much more paths differ from each other than the parts of a path do."""

    quantity: str  # where the ratio is largest
    ratio: float  # variance between paths over that expected from the parts

    @property
    def reached(self) -> bool:
        """Whether the paths visit the same motions."""
        return self.ratio <= TOO_FAR


class BurnIn(NamedTuple):
    """The burn-in of a run."""

    periods: int  # periods of the excitation that were left out
    drift: Drift  # of the test that it passed
    apart: Apart | None  # of the other test; None where paths differ for good, because each has a backlash of its own

    @property
    def sentence(self) -> str:
        """What was left out, and why it suffices, as text."""
        return (
            f"Burn-in: {self.periods} periods; its second quarter and its second half agree within "
            f"{abs(self.drift.z):.1f} standard errors (allowed {self.drift.allowed:.1f})."
        )


def _names() -> list[str]:
    wheres = ("", " at mesh 1", " at mesh 2")
    return [what + where for where in wheres[:GROUPS] for what in COMPARED] + ["contact at mesh 1", "contact at mesh 2"]


def drift(main: Floats, early: slice, late: slice) -> Drift:
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
    return Drift(_names()[k], float(z[k]), allowed, float(share[k]))


def apart(main: Floats, late: slice) -> Apart:
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
    return Apart(_names()[k], float(ratio[k]))
