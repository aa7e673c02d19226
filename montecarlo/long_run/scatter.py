"""The distribution of a quantity over gear sets: each path has backlashes of its own for good.

The value of a set is known with an error, for its path is of finite length; that widens the
distribution.  The variance of this error is known from parts of each path, and taken off: values
are drawn together towards their mean until their variance is that of the sets alone.  It is exact
where both are normal or the error is small; how much it is of the variance is stated.
"""

from typing import NamedTuple

import numpy as np

from rattle.montecarlo.long_run import sums as tally
from rattle.montecarlo.long_run.sums import Sums
from rattle.montecarlo.statistics.section_statistics import ratio_or_zero
from rattle.scene import Floats
from rattle.scene.drive import PERIOD

PATH_PARTS = 4
"""Parts of each path: long, so that the motion's memory correlates them little."""
SCATTER_PERCENT = (5, 50, 95)
RESAMPLES = (400, 1000)  # least and most resamples of the sets
MOST_RESAMPLED = 1_000_000  # values of all resamples together
FEWEST_SETS = 72
"""Sets below which none may lie outside the 5 % quantile: with 0.95^n > 0.025 it has no bound."""
SCATTERED = ("rate_above", "speed_above", "energy_per_period", "power")
"""Quantities whose scatter is stated, also of each mesh."""


class SetValues(NamedTuple):
    """A quantity of every set, and the variance of its error."""

    value: Floats  # (sets,)
    error: Floats  # of each set, unbiased but rough; (sets,)

    @property
    def error_share(self) -> float:
        """Share of the variance between paths that is no scatter between sets; 1 at the most."""
        total = float(self.value.var(ddof=1))
        return min(float(self.error.mean()) / total, 1.0) if total > 0.0 else 0.0

    @property
    def corrected(self) -> Floats:
        """The values with the variance of the sets alone."""
        return np.asarray(_draw_together(self.value[None], self.error[None])[0])

    def quantiles(self, seed: np.random.SeedSequence) -> Floats:
        """The quantiles `SCATTER_PERCENT` over sets with 95 % intervals from a bootstrap over sets.

        The correction is made anew in each resample. Too few sets have no bounds, and no quantile,
        in the tails. Shapes: result (quantiles, value and low and high).
        """
        n = len(self.value)
        percent = np.array(SCATTER_PERCENT, dtype=float)
        resamples = int(np.clip(MOST_RESAMPLED / n, *RESAMPLES))
        drawn = np.random.default_rng(seed).integers(n, size=(resamples, n))
        again = _draw_together(self.value[drawn], self.error[drawn])
        resampled = np.percentile(again, percent, axis=1)
        out = np.column_stack(
            [np.percentile(self.corrected, percent), *np.percentile(resampled, [2.5, 97.5], axis=1)]
        )
        if n < FEWEST_SETS:
            out[percent != 50.0] = np.nan
        return out


def _draw_together(values: Floats, errors: Floats) -> Floats:
    """Values with the variance of their errors taken off.

    Shapes: all (resamples, sets).
    """
    mean = values.mean(axis=1, keepdims=True)
    total = values.var(axis=1, ddof=1, keepdims=True)
    alone = np.maximum(total - errors.mean(axis=1, keepdims=True), 0.0)
    factor = np.sqrt(ratio_or_zero(alone, total))
    return np.asarray(mean + factor * (values - mean))


def values_of_sets(c: Sums, quantity: str, group: int) -> SetValues | None:
    """One of `SCATTERED` of every set in a group of impacts, 0 for all; None where it is not
    there."""
    length = c.main.shape[1] // PATH_PARTS
    if length == 0:
        return None
    parts = c.main[:, : PATH_PARTS * length].reshape(c.paths, PATH_PARTS, length, -1).sum(axis=2)
    above = parts[:, :, 4 * group + tally.NUMBER] - parts[:, :, 4 * group + tally.SLOW]
    time = np.full_like(above, c.time * length / c.main.shape[1])
    energy = parts[:, :, 4 * group + tally.ENERGY]
    top, bottom = {
        "rate_above": (above, time),
        "speed_above": (parts[:, :, c.columns.above_speed + group], above),
        "energy_per_period": (PERIOD * energy, time),
        "power": (energy, time),
    }[quantity]
    rattles = bottom.sum(axis=1) > 0.0  # a set without impacts has no speed
    if rattles.sum() < 2:
        return None
    top = top[rattles]
    bottom = bottom[rattles]
    whole = bottom.sum(axis=1)
    value = top.sum(axis=1) / whole
    rest = (top - value[:, None] * bottom) / (whole[:, None] / PATH_PARTS)
    return SetValues(value, rest.var(axis=1, ddof=1) / PATH_PARTS)


def error_share(c: Sums) -> float:
    """The largest share of errors in the variance between sets, over the quantities of all
    impacts."""
    known = (values_of_sets(c, quantity, 0) for quantity in SCATTERED)
    return max((values.error_share for values in known if values is not None), default=1.0)
