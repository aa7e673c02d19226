"""The branching closure: a Gaussian mixture whose components follow different itineraries
(docs/theory/closures.md).

A component is a weight and a Gaussian of the section state after an impact, as in the saltation
closure.  The noise of the next flight is added at its start, so that the next impact is a function
of a point in 1 + 2 wheels dimensions, or in 1 + 4 wheels where flanks are random.  Components are
split
(`rattle.closure.branching.advance`), propagated to the impact
(`rattle.closure.branching.propagate`), and merged after it (`rattle.closure.branching.mixture`).
How many there may be is the closure's resolution: it is followed at two of the `RESOLUTIONS` at
least, and estimates its own error from their difference, and from how far its components and their
weights are known (`rattle.closure.moments`).
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from rattle.closure.branching.advance import Advance, Level
from rattle.closure.branching.fixed_times import FixedTimes
from rattle.closure.branching.mixture import moments
from rattle.closure.moments import (
    ERROR_PER_SLOW_SHARE,
    Trace,
    bounds,
    check_white,
    within,
)
from rattle.scene import Bools, Floats, InputError, Scene, check_each_impact
from rattle.scene.elementary import unknown
from rattle.scene.orbit import Impacts, follow
from rattle.scene.types import MOST_WHEELS

RESOLUTIONS = (
    Level(10, 18, 1e-2, 3e-3),
    Level(20, 60, 3e-3, 1e-3),
    Level(40, 180, 1e-3, 1e-4),
    Level(80, 600, 1e-4, 1e-6),
)
"""Resolutions of the closure, the coarsest first."""


MOST_WHEELS_FOLLOWED = 16
"""Most wheels: the work of a component grows with the fourth power of their number."""


def check(scene: Scene) -> None:
    """Refuse what its components do not cover: too many wheels, noise with a memory."""
    wheels = len(scene.tree)
    if wheels > MOST_WHEELS_FOLLOWED:
        why = f"branching follows at most {MOST_WHEELS_FOLLOWED} wheels; use saltation, or simulate"
        raise InputError("wheels", wheels, why)
    check_white(scene)
    check_each_impact(scene)


def trace(scene: Scene, impacts: int, order: int, tolerance: float | None = None) -> Trace:
    """Follow the branching closure, at the finest two of the `RESOLUTIONS`, or until a tolerance is
    met.

    Principal axes mix times and lengths, so the result could depend on the unit of length: the one
    used is the power of two next to the gap, whatever the scene's.

    `tolerance`: Error of the means, in sds, and half that of the sds, that the bounds need not fall
    below.  A tolerance that no level can meet stops the refinement too. Returns: With the mixtures,
    the shares of paths on the orbit's itinerary, the probability discarded and the bounds of its
    own errors.
    """
    wheels = scene.constants.wheels
    unit = 2.0 ** math.frexp(wheels[0].size)[1]
    scaled = scene.scaled(1.0 / unit)
    finest = _refine(scaled, impacts, order, tolerance)
    lengths = np.append([1.0, 1.0], np.full(2 * wheels.size, unit))
    parts = {k: (w, m * lengths, v * lengths**2) for k, (w, m, v) in (finest.parts or {}).items()}
    at = partial(_in_unit, finest.at, unit)
    # of mean, sd and skewness
    units = np.array([lengths, lengths, np.ones(lengths.size)])[:, None]
    followed = None if finest.followed is None else finest.followed * units
    return replace(
        finest,
        mean=finest.mean * unit,
        sd=finest.sd * lengths,
        parts=parts,
        at=at,
        followed=followed,
    )


def _in_unit(
    at: Callable[[float], tuple[Floats, Floats]], unit: float, time: float
) -> tuple[Floats, Floats]:
    """Mean and covariance at a local time, in another unit of length."""
    mean, covariance = at(time)
    return mean * unit, covariance * unit**2


def _refine(scene: Scene, impacts: int, order: int, tolerance: float | None) -> Trace:
    """`trace` in the scene's own unit of length: from level to level, each bounded by its change
    from the last one."""
    first = len(RESOLUTIONS) - 2 if tolerance is None else 0
    finest = _trace(scene, impacts, order, RESOLUTIONS[first])
    for level in RESOLUTIONS[first + 1 :]:
        coarse = finest
        finest = _trace(scene, impacts, order, level)
        error = bounds(coarse, finest)
        finest = replace(finest, error=error, flown=coarse.flown + finest.flown)
        if tolerance is None:
            continue
        # slow impacts alone put the bounds above the tolerance: more components would not help
        hopeless = finest.slow is not None and ERROR_PER_SLOW_SHARE * finest.slow.max() > tolerance
        if within(error, tolerance)[1 : finest.found + 1].all() or hopeless:
            break
    return finest


def _trace(scene: Scene, impacts: int, order: int, level: Level) -> Trace:
    """`trace` in the scene's own unit of length, at one level."""
    orbit = follow(scene, impacts).until_sticking
    at = FixedTimes(scene, orbit, level, impacts)
    run = at.run
    states = orbit.before.shape[1]
    records = Records(impacts + 1, states, Impacts.of(orbit).until(0))
    reached = impacts
    for k in range(1, impacts + 1):
        code = int(orbit.mesh[k] * orbit.side[k])
        at.fly()
        section = run.buffers.image.section
        flown = slice(2 * run.flown)
        struck = (section.weight[flown] != 0.0) & (section.label[flown] != 0)
        run.strike(code)
        records.add_flight(k, run)
        if run.kept == 0 or run.discarded > 0.5:
            reached = k - 1
            break
        records.add_impact(k, run, struck)
        run.merge()
    stopped = (
        ""
        if reached == impacts
        else f"more than half of the probability is discarded after impact {reached}"
    )
    known = records.known
    return Trace(
        known.tau,
        known.mesh,
        known.side,
        known.before,
        records.sd,
        records.skew,
        unknown(impacts + 1, states, states),
        unknown(impacts + 1, states // 2, order + 1, order + 1),
        at,
        reached,
        stopped,
        records.parts,
        agreement=records.agreement,
        discarded=records.discarded,
        followed=records.followed,
        flown=records.flown,
        slow=records.slow,
        carried=records.carried,
        residual=records.residual,
        doubted=records.doubted,
        bent=records.bent,
    )


class Records:
    """What is known of the mixture at each impact: the fields of `Trace` of these names."""

    def __init__(self, rows: int, states: int, known: Impacts) -> None:
        """Begin with the start alone, which all paths share."""
        self.known = known
        self.parts: dict[int, tuple[Floats, Floats, Floats]] = {}
        self.agreement, self.discarded = unknown(2, rows)
        self.agreement[0] = 1.0
        self.discarded[0] = 0.0
        self.sd, self.skew = unknown(2, rows, 2 + states)
        self.followed = unknown(3, rows, 2 + states)
        self.doubted = np.zeros((rows, 2, 2 + states))
        self.carried = np.zeros((rows, 2 + states))
        self.slow, self.residual, self.bent = np.zeros((3, rows))
        self.flown = np.zeros(rows, np.int64)

    def add_flight(self, k: int, run: Advance) -> None:
        """Record what a flight took, and what its noise and its components leave in doubt."""
        b = run.buffers
        self.flown[k] = run.flown
        self.slow[k] = b.start.weight[: run.flown] @ b.slow[: run.flown]
        self.residual[k] = b.error[: run.flown].sum()

    def add_impact(self, k: int, run: Advance, struck: Bools) -> None:
        """Record the components at an impact, before they are merged.

        `struck`: Which images of the flown components have an impact; (2 flown,).
        """
        after = run.after
        count = run.kept
        section = run.buffers.image.section
        flight = run.buffers.image.flight
        w = after.weight[:count]
        s = section.mean[:count]
        diagonal = np.diagonal(section.covariance[:count], axis1=1, axis2=2)
        states = self.known.before.shape[1]
        values = np.column_stack([s[:, 0], flight[:count, 0], s[:, 1 : 1 + states]])
        variances = np.column_stack(
            [diagonal[:, 0], flight[:count, 1], diagonal[:, 1 : 1 + states]]
        )
        self.parts[k] = w / w.sum(), values, variances
        centre, self.sd[k], self.skew[k] = moments(w, values, variances)
        self.known.tau[k] = centre[0]
        self.known.before[k] = centre[2:]
        self.doubted[k] = _doubted(w, after.doubt[:count], values - centre, variances)
        self.bent[k] = w @ after.bent[:count] / w.sum()
        slow = np.repeat(run.buffers.slow[: run.flown], 2)[struck]
        self.carried[k] = _average(w, values - centre, variances, slow)
        wheels = states // 2
        codes = [code for code in range(-wheels, wheels + 1) if code != 0]
        code = max(codes, key=lambda a: w[section.label[:count] == a].sum())
        self.known.mesh[k] = abs(code)
        self.known.side[k] = np.sign(code)
        on = after.label[:count] > MOST_WHEELS
        self.agreement[k] = min(w[on].sum(), 1.0)
        self.discarded[k] = run.discarded
        if on.any():
            self.followed[:, k] = moments(w[on], values[on], variances[on])


def _doubted(weights: Floats, doubt: Floats, off: Floats, variances: Floats) -> Floats:
    """Errors of mean and sd of each quantity, in sds, if each weight has this relative error."""
    squares = off**2 + variances
    share = (weights / weights.sum())[:, None]
    variance = (share * squares).sum(axis=0)
    far = doubt[:, None] * share
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (far * np.abs(off)).sum(axis=0) / np.sqrt(variance)
        return np.asarray(np.nan_to_num([mean, 0.5 * (far * squares).sum(axis=0) / variance]))


def _average(weights: Floats, off: Floats, variances: Floats, slow: Floats) -> Floats:
    """Mean over the variance of each quantity of a number that each component has."""
    of = weights[:, None] * (off**2 + variances)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nan_to_num(slow @ of / of.sum(axis=0)))
