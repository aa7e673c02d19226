"""Intervals of the long run hold the truth where enough paths carry what is averaged, and not where few do."""

import math

import numpy as np
import pytest

from rattle.montecarlo.long_run.intervals import spread

SAMPLES, PATHS = 2000, 256


def coverage(bursts):
    """Share of samples whose interval holds the mean, of paths that hold a Poisson number of exponential bursts."""
    rng, held = np.random.default_rng(1), 0
    for _ in range(SAMPLES):
        number = rng.poisson(bursts / PATHS, PATHS)
        low, high = spread(rng.gamma(np.maximum(number, 1)) * (number > 0)).interval()
        held += low <= bursts / PATHS <= high
    return held / SAMPLES


@pytest.mark.parametrize("bursts", [100, 1000])
def test_intervals_hold_the_truth(bursts):
    """95 % within four standard errors, and 1 % for what skewness a hundred bursts leave."""
    assert abs(coverage(bursts) - 0.95) < 4.0 * math.sqrt(0.05 * 0.95 / SAMPLES) + 0.01


def test_six_bursts_are_too_few():
    assert coverage(6) < 0.88


def test_a_value_of_its_own_keeps_the_spread_of_the_parts():
    parts = np.array([1.0, 2.0, 4.0])
    assert spread(parts, 7.0).se == spread(parts).se == pytest.approx(parts.std(ddof=1) / math.sqrt(3.0))
    assert np.mean(spread(parts, 7.0).interval()) == pytest.approx(7.0)
