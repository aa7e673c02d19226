"""Standard errors against replicated samples, and intervals where few paths carry the error."""

import math

import numpy as np
import pytest
from scipy import stats

from rattle import judge
from rattle.montecarlo.statistics import intervals

REPLICAS = 1500


def judged(samples, truth):
    """The table of replicated samples with (value - truth) / se as z; shape of `samples`: (paths,
    replicas)."""
    claim = {column: np.full(REPLICAS, value) for column, value in truth.items()}
    table = judge(claim, samples, checks=1).table
    return table.assign(z=table["error"] / table["se"])


# 1500 replicas give the sd of z to 2 %; the errors are estimated too, from up to the eighth moment:
# O(1 / n) more
BAND = {"mean": 0.07, "sd": 0.07, "skew": 0.1, "kurt": 0.15}


def test_standard_errors_of_a_skewed_variable_have_the_size_they_claim():
    """Of a Beta(1, 8): skew 1.4, excess kurtosis 2.3.  A Gaussian formula for the error of the sd,
    sd / sqrt(2 n), is a third too small there."""
    distribution = stats.beta(1.0, 8.0)
    draws = distribution.rvs((4000, REPLICAS), random_state=4)
    mean, variance, skew, kurt = distribution.stats("mvsk")
    truth = {"x": mean, "sd_x": math.sqrt(variance), "skew_x": skew, "kurt_x": kurt}
    spread = judged({"x": draws}, truth).groupby("moment")["z"].std()
    for name, band in BAND.items():
        assert abs(spread[name] - 1.0) < band
    assert abs(math.sqrt(0.5 * kurt + 1.0) * spread["sd"] - 1.0) > BAND["sd"]


def test_standard_error_of_a_correlation_has_the_size_it_claims():
    """Of a t with 10 degrees of freedom; 1 / sqrt(n) for Fisher's z is for Gaussian pairs alone."""
    rng = np.random.default_rng(6)
    tail = np.sqrt(rng.chisquare(10.0, (2000, REPLICAS)) / 10.0)
    u, other = rng.standard_normal((2, *tail.shape)) / tail
    samples = {"x": u, "v": 0.6 * u + 0.8 * other}
    rho = judged(samples, {"x": 0.0, "v": 0.0, "rho_x_v": 0.6}).query("moment == 'rho'")
    assert abs(rho["z"].std() - 1.0) < 0.08
    assert abs(np.arctanh(rho["simulated"]).std() * math.sqrt(2000) - 1.0) > 0.08


SAMPLES = 2000
BURST_PATHS = 256


def coverage(bursts):
    """Share of samples whose interval holds the mean, of paths that hold a Poisson number of
    exponential bursts."""
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(SAMPLES):
        number = rng.poisson(bursts / BURST_PATHS, BURST_PATHS)
        parts = rng.gamma(np.maximum(number, 1)) * (number > 0)
        low, high = intervals.spread(parts).interval()
        held += low <= bursts / BURST_PATHS <= high
    return held / SAMPLES


COVERAGE_SLACK = 4.0 * math.sqrt(0.05 * 0.95 / SAMPLES)
"""Four standard errors of a coverage of 95 %."""


@pytest.mark.parametrize("bursts", [6, 100])
def test_intervals_hold_the_truth_even_where_few_paths_carry_the_error(bursts):
    """At least as often as they say; up to 3 % more often where skewness cannot be told from
    chance."""
    assert 0.95 - COVERAGE_SLACK < coverage(bursts) < 0.98 + COVERAGE_SLACK


def test_intervals_that_rest_on_all_paths_do_not(monkeypatch):
    """The negative control: Student's t with one degree of freedom less than there are paths."""
    monkeypatch.setattr(intervals, "count_effective_paths", lambda rest: float(len(rest)))
    assert coverage(6) < 0.88
