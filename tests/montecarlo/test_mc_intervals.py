"""Intervals from independent paths hold the truth where few paths carry what is averaged."""

import math

import numpy as np
import pytest

from rattle.montecarlo.long_run.intervals import half_width, spread, student_quantiles

SAMPLES, PATHS = 2000, 256


def coverage(bursts, skewed):
    """Share of samples whose interval holds the mean, of paths that hold a Poisson number of exponential bursts."""
    rng, held = np.random.default_rng(1), 0
    for _ in range(SAMPLES):
        number = rng.poisson(bursts / PATHS, PATHS)
        found = spread(rng.gamma(np.maximum(number, 1)) * (number > 0))
        half = half_width(PATHS) * found.se
        low, high = found.interval() if skewed else (found.value - half, found.value + half)
        held += low <= bursts / PATHS <= high
    return held / SAMPLES


@pytest.mark.parametrize("bursts", [6, 25, 400])
def test_intervals_hold_the_truth_though_few_paths_carry_it(bursts):
    """95 % within four standard errors, and 2 % for what a skewness from six bursts leaves."""
    assert abs(coverage(bursts, True) - 0.95) < 4.0 * math.sqrt(0.05 * 0.95 / SAMPLES) + 0.02


def test_negative_control_symmetric_intervals_do_not():
    assert coverage(6, False) < 0.88


def test_without_skewness_they_are_students():
    t = half_width(PATHS)
    assert student_quantiles(0.0, PATHS) == (-t, t)
    assert student_quantiles(1e-5, PATHS) == pytest.approx((-t, t), abs=1e-4)


def test_a_mirrored_sample_has_the_mirrored_interval():
    parts = np.random.default_rng(0).gamma(0.5, size=64)
    low, high = spread(parts).interval()
    assert spread(-parts).interval() == pytest.approx((-high, -low))
    assert high - spread(parts).value > spread(parts).value - low
