"""Scatter between gear sets: a planted distribution, and that of a backlash, are found again."""

from dataclasses import replace

import numpy as np
import pytest

from rattle import Scene, Tolerance, stationary
from rattle.compare.stationary.page import answer
from rattle.montecarlo.long_run.scatter import FEWEST_SETS, SetValues

SD_OF_SETS = 10.0  # of the planted sets, about 100
ERROR_OF_SETS = 8.0  # sd of the planted errors: two fifths of the variance
TAIL = 1.6448536  # standard deviations from the median to the 95 % quantile


def planted(seed, sets=256):
    """Normal sets with normal errors, whose variance is known from four parts of each."""
    rng = np.random.default_rng(seed)
    value = rng.normal(100.0, SD_OF_SETS, sets) + rng.normal(0.0, ERROR_OF_SETS, sets)
    return SetValues(value, ERROR_OF_SETS**2 * rng.chisquare(3, sets) / 3.0)


def coverage(values):
    """Share of the 95 % intervals that hold the true quantiles."""
    truth = 100.0 + SD_OF_SETS * np.array([-TAIL, 0.0, TAIL])
    rows = np.array([v.quantiles(np.random.SeedSequence(1)) for v in values])
    return ((rows[:, :, 1] <= truth) & (truth <= rows[:, :, 2])).mean(axis=0)


def test_a_planted_scatter_is_found_and_errors_that_are_left_in_are_not():
    """95 % within 4 standard errors of 60 seeds, 0.84 at the least; the negative control leaves the
    errors in."""
    values = [planted(seed) for seed in range(60)]
    assert (coverage(values) > 0.84).all()
    assert np.mean([v.error_share for v in values]) == pytest.approx(64.0 / 164.0, abs=0.01)
    assert coverage([v._replace(error=0.0 * v.error) for v in values])[[0, 2]].max() < 0.6
    few = planted(0, FEWEST_SETS - 1).quantiles(np.random.SeedSequence(1))
    assert np.isnan(few[[0, 2]]).all()


WIDE_TOLERANCE = Scene(
    alpha=1.25,
    epsilon=0.8,
    beta1=0.01,
    gamma1=0.2,
    stages=1,
    sigma=0.5,
    tolerance=Tolerance(0.1),
)


def test_the_scatter_of_a_backlash_is_that_of_gears_at_its_quantiles():
    """The half gap is uniform, and the rate falls with it: its 5 % quantile is the rate at a gap
    that 5 % of the sets exceed.  Within 4 standard errors of both; the mean is elsewhere."""
    found = stationary(WIDE_TOLERANCE, periods=256, paths=256, closures=(), rng=3)
    rates = found.scatter.query("quantity == 'rate_above'").set_index("percent")
    for percent, gap in ((5, 0.59), (95, 0.41)):
        exact = replace(WIDE_TOLERANCE, tolerance=None, gap1=gap, start=None)
        long = stationary(exact, periods=256, paths=64, closures=(), rng=4)
        at_gap = long.table.loc["rate_above"]
        row = rates.loc[percent]
        se = np.hypot((row["high"] - row["low"]) / 3.92, at_gap["se"])
        assert abs(row["value"] - at_gap["value"]) < 4.0 * se
        assert se < 0.02 * at_gap["value"]
    assert not rates["low"][95] < found.table["value"]["rate_above"] < rates["high"][95]


def test_it_is_said_that_sets_differ_and_not_that_the_run_is_too_short(tmp_path):
    found = stationary(WIDE_TOLERANCE, accuracy=0.002, paths=96, closures=(), rng=3)
    assert found.run.periods < 2000  # it does not go on for an hour
    words = " ".join(answer(found))
    assert "5 % of the sets have more than" in words
    assert "more periods would fix this" not in words
    assert "scatter" in found.figures()
    assert len(found.to_dict()["scatter"]) == 3 * 4
    few = " ".join(answer(stationary(WIDE_TOLERANCE, periods=64, paths=32, closures=(), rng=3)))
    assert "needs 72 sets or more" in few
