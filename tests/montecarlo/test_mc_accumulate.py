"""Mergeable sums: against numpy and scipy on the whole sample, and standard errors against
replicated samples."""

import math

import numpy as np
import pytest
from scipy import stats

from rattle.montecarlo.statistics import intervals
from rattle.montecarlo.statistics.central_sums import CentralSums, columns_of
from rattle.montecarlo.statistics.intervals import spread
from rattle.montecarlo.statistics.section_statistics import (
    PAIR,
    SINGLE,
    pair_statistics,
    single_statistics,
)


def central_sums(a, b, orders):
    """Sums of one block of paths; `a` and `b` have the shape (paths, ...)."""
    cells = np.tile(np.arange(a[0].size), (2, 1))
    return CentralSums.of_columns(columns_of(a), columns_of(b), cells, orders, a.shape[1:])


REPLICAS = 1500
SIZE = 4000


@pytest.fixture(scope="module")
def z_scores():
    """(value - truth) / se over replicated samples of a Beta(1, 8): skew 1.4, excess kurtosis
    2.3."""
    distribution = stats.beta(1.0, 8.0)
    a = distribution.rvs((SIZE, REPLICAS), random_state=4)
    s = single_statistics(central_sums(a, a, SINGLE))
    mean, variance, skew, kurt = distribution.stats("mvsk")
    truth = {"mean": mean, "sd": math.sqrt(variance), "skew": skew, "kurt": kurt}
    return {name: (s[name] - t) / s["se_" + name] for name, t in truth.items()}


# 1500 replicas give the sd of z to 2 %; the errors are estimated too, from up to the eighth moment:
# O(1 / n) more
BAND = {"mean": 0.07, "sd": 0.07, "skew": 0.1, "kurt": 0.15}


@pytest.mark.parametrize("name", BAND)
def test_standard_errors_of_a_skewed_variable_have_the_size_they_claim(z_scores, name):
    z = z_scores[name]
    assert abs(z.std() - 1.0) < BAND[name]


def test_gaussian_formula_for_the_error_of_an_sd_would_fail_that_band(z_scores):
    """Negative control: sd / sqrt(2 n) is a third too small for an excess kurtosis of 2.3."""
    gaussian = z_scores["sd"] * math.sqrt((stats.beta(1.0, 8.0).stats("k") + 2.0) / 2.0)
    assert abs(gaussian.std() - 1.0) > BAND["sd"]


def pair(kind, shape, seed):
    """A pair with correlation 0.6, Gaussian or with the heavy tails of a t with 10 degrees of
    freedom."""
    rng = np.random.default_rng(seed)
    u, v = rng.standard_normal((2, *shape))
    v = 0.6 * u + 0.8 * v
    tail = np.sqrt(rng.chisquare(10.0, shape) / 10.0) if kind == "heavy" else 1.0
    return u / tail, v / tail


@pytest.mark.parametrize("kind", ["gaussian", "heavy"])
def test_standard_error_of_fisher_z_has_the_size_it_claims(kind):
    a, b = pair(kind, (2000, REPLICAS), 6)
    s = pair_statistics(central_sums(a, b, PAIR))
    np.testing.assert_allclose(s["rho"][0], np.corrcoef(a[:, 0], b[:, 0])[0, 1], rtol=1e-12)
    z = (np.arctanh(s["rho"]) - math.atanh(0.6)) / s["se_z"]
    assert abs(z.std() - 1.0) < 0.08
    naive = (np.arctanh(s["rho"]) - math.atanh(0.6)) * math.sqrt(2000)
    assert (abs(naive.std() - 1.0) < 0.08) == (
        kind == "gaussian"
    )  # 1 / sqrt(n) is for Gaussian pairs alone


SAMPLES = 2000
PATHS = 256


def coverage(bursts):
    """Share of samples whose interval holds the mean, of paths that hold a Poisson number of
    exponential bursts."""
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(SAMPLES):
        number = rng.poisson(bursts / PATHS, PATHS)
        low, high = spread(rng.gamma(np.maximum(number, 1)) * (number > 0)).interval()
        held += low <= bursts / PATHS <= high
    return held / SAMPLES


def slack():
    """Four standard errors of a coverage of 95 %."""
    return 4.0 * math.sqrt(0.05 * 0.95 / SAMPLES)


@pytest.mark.parametrize("bursts", [6, 20, 100, 1000])
def test_intervals_hold_the_truth_even_where_few_paths_carry_the_error(bursts):
    """At least as often as they say; up to 3 % more often where skewness cannot be told from
    chance."""
    held = coverage(bursts)
    assert 0.95 - slack() < held < 0.98 + slack()


def test_intervals_that_rest_on_all_paths_do_not(monkeypatch):
    """The negative control: Student's t with one degree of freedom less than there are paths."""
    monkeypatch.setattr(intervals, "count_effective_paths", lambda rest: float(len(rest)))
    assert coverage(6) < 0.88
