"""Intervals of the long run hold the truth, and where few paths carry what is averaged they are wider."""

import math

import numpy as np
import pytest

from rattle.montecarlo.statistics import intervals
from rattle.montecarlo.statistics.intervals import count_effective_paths, spread

SAMPLES, PATHS = 2000, 256


def coverage(bursts):
    """Share of samples whose interval holds the mean, of paths that hold a Poisson number of exponential bursts."""
    rng, held = np.random.default_rng(1), 0
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
    """At least as often as they say; up to 3 % more often where skewness cannot be told from chance."""
    held = coverage(bursts)
    assert 0.95 - slack() < held < 0.98 + slack()


def test_intervals_that_rest_on_all_paths_do_not(monkeypatch):
    """The negative control: Student's t with one degree of freedom less than there are paths."""
    monkeypatch.setattr(intervals, "count_effective_paths", lambda rest: float(len(rest)))
    assert coverage(6) < 0.88


def test_two_bursts_are_too_few():
    """Every seventh sample has none, and no interval knows what it has not seen."""
    assert coverage(2) < 0.95 - slack()


def test_all_paths_carry_what_is_normal():
    rng = np.random.default_rng(2)
    found = [count_effective_paths(rest - rest.mean()) for rest in rng.standard_normal((SAMPLES, PATHS))]
    assert 0.7 * PATHS < np.median(found) <= PATHS
    assert np.quantile(found, 0.01) > 0.3 * PATHS  # the t of 80 paths is 2 % above that of 256
