"""Curves over the speed: what the ramp's paths do around each speed, and constant speeds averaged
alike.

Around each speed there is a hat, 1 there and falling linearly to 0 at its neighbours.  What the
ramp does under a hat is compared with the mean of constant speeds under the same hat.  Between two
of these what is straight is the dimensionless quantity; how far a cubic spline is from that is an
allowance for what is not known there.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from rattle.compare.ramp.plan import RAMP_BURN_IN
from rattle.compare.ramp.speed import TURN, SpeedRamp
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.long_run.ramp import RampPaths, RampStretch
from rattle.montecarlo.statistics.intervals import Spread, spread
from rattle.scene import Floats
from rattle.scene.progress import ProgressBar

COUNTED_POWERS = (1, 2, 3)
"""Powers of the speed that number, speed and energy a second are proportional to where the motion
is the same."""


class RampSums(NamedTuple):
    """What the paths did under each hat, and last in the whole ramp, in 1, mm/s and mJ."""

    counted: Floats  # (hats, paths, groups, number and speed above and energy)
    time: Floats  # seconds under each hat; (hats,)
    knots: Floats  # the speeds, 1/min
    rpm: Floats  # of each stretch; (stretches,)
    weights: Floats  # of each stretch in the mean under each hat; (hats, stretches)

    def spreads(self, kind: int, group: int) -> list[Spread]:
        """Counts (0) or energy (2) a second under each hat, or the mean speed (1) of impacts that
        are not slow."""
        counted = self.counted[:, :, group]
        if kind == 1:
            return [mean_of(under[:, 1], under[:, 0]) for under in counted]
        per_time = counted[:, :, kind] / self.time[:, None]
        return [spread(under) for under in per_time]

    def average(self, power: int, curved: bool = False) -> Floats:
        """The mean under each hat of a quantity that is known at the speeds: a matrix.

        `power`: of the speed, that makes the quantity dimensionless. `curved`: whether it is a
        spline between the speeds, or straight.
        """
        ones = np.eye(len(self.knots))
        if curved:
            basis = CubicSpline(self.knots, ones)(self.rpm)
        else:
            basis = np.array([np.interp(self.rpm, self.knots, one) for one in ones]).T
        scale = self.rpm[:, None] / self.knots
        return self.weights @ (basis * scale**power)

    def differences(self, kind: int, group: int, steady: Floats) -> list[Spread]:
        """What the same gear sets do more in the ramp than at constant speeds, under each hat: in
        counts (0) or energy (2) a second, or in the mean speed (1).

        `steady`: at constant speeds, a second; (speeds, sets, groups, number and speed and energy).
        """
        sets = min(steady.shape[1], self.counted.shape[1])
        of_group = steady[:, :sets, group]
        number, speed, energy = (
            self.average(power) @ of_group[..., i] for i, power in enumerate(COUNTED_POWERS)
        )
        constant = np.stack([number, speed, energy], axis=2)
        ramp = self.counted[:, :sets, group] / self.time[:, None, None]
        if kind == 1:
            parts = [
                parts_of_ratio(a[:, 1], a[:, 0]) - parts_of_ratio(b[:, 1], b[:, 0])
                for a, b in zip(ramp, constant, strict=True)
            ]
        else:
            parts = list(ramp[..., kind] - constant[..., kind])
        return [spread(part) for part in parts]


def parts_of_ratio(total: Floats, number: Floats) -> Floats:
    """What each path puts into a ratio of sums over paths, to first order; NaN where there is
    nothing.

    Shapes: all (paths,).
    """
    if number.sum() == 0.0:
        return np.full_like(total, np.nan)
    value = total.sum() / number.sum()
    return np.asarray((total - value * number) / number.mean() + value)


def mean_of(total: Floats, number: Floats) -> Spread:
    """A ratio of sums over paths with its spread; NaN where there is nothing.

    Shapes: `total`, `number` (paths,).
    """
    if number.sum() == 0.0:
        return Spread(np.nan, np.nan, np.nan)
    return spread(parts_of_ratio(total, number), float(total.sum() / number.sum()))


def follow_ramp(
    ramp: SpeedRamp,
    knots: Sequence[float],
    stretch: int,
    paths: RampPaths,
    pool: ThreadPoolExecutor,
    limit: Budget,
    bar: ProgressBar,
) -> RampSums | None:
    """Follow paths through the ramp in stretches of so many periods, after a burn-in at its first
    speed; None where the budget ends on the way.

    `knots`: the speeds, in rising order, around which the ramp is averaged.
    """
    stretches, rpm = ramp.stretches(stretch)
    begin = ramp.scene_at(ramp.first).constants
    before = RampStretch(begin, ramp.slow_at(ramp.first), 1)
    for _ in paths.follow([before] * RAMP_BURN_IN, pool):
        bar.update()
        if limit.remaining < 0.0:
            return None
    hats = np.array([np.interp(rpm, knots, one) for one in np.eye(len(knots))])
    hats = np.vstack([hats, np.ones_like(rpm)])
    seconds = stretch * TURN / ramp.omega_at(rpm)
    units = ramp.gears.units
    faster = rpm / ramp.file_rpm
    ones = np.ones_like(rpm)
    factors = np.stack([ones, units.speed * faster, units.energy * faster**2], axis=1)
    counted = 0.0
    for hat, factor, sums in zip(hats.T, factors, paths.follow(stretches, pool), strict=True):
        counted = counted + hat[:, None, None, None] * (factor * sums)
        bar.update(stretch)
        if limit.remaining < 0.0:
            return None
    time = hats @ seconds
    weights = hats * seconds / time[:, None]
    return RampSums(np.asarray(counted), time, np.asarray(knots), rpm, weights)


Curve = tuple[Floats, Floats]
"""Values at the constant speeds, or means under the hats, with their standard errors."""


def average_steady(sums: RampSums, power: int, known: Curve) -> tuple[Floats, Floats, Floats]:
    """Means of constant speeds under each hat, their standard errors, and the allowance for what is
    not known between the speeds."""
    values, errors = known
    straight = sums.average(power)
    mean = straight @ values
    allowance = np.abs(sums.average(power, curved=True) @ values - mean)
    return mean, np.sqrt(straight**2 @ errors**2), allowance


def average_speeds(sums: RampSums, rate: Curve, speed: Curve) -> tuple[Floats, Floats, Floats]:
    """The same of the mean speed of impacts, weighted by their number."""
    rates, rate_errors = rate
    speeds, speed_errors = speed
    straight = sums.average(1)
    with np.errstate(invalid="ignore", divide="ignore"):
        number = straight @ rates
        mean = sums.average(2) @ (rates * speeds) / number
        curved = sums.average(2, curved=True) @ (rates * speeds)
        curved /= sums.average(1, curved=True) @ rates
        by_speed = sums.average(2) * rates / number[:, None]
        by_rate = straight * (speeds - mean[:, None]) / number[:, None]
    variance = by_speed**2 @ speed_errors**2 + by_rate**2 @ rate_errors**2
    return mean, np.sqrt(variance), np.abs(curved - mean)
