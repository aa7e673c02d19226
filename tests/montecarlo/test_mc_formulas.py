"""Steps, scales and intervals of the sampler at values known beforehand."""

import numpy as np
import pytest
from scipy.stats import chi2, t

from rattle.montecarlo.ensemble.leaving import interval
from rattle.montecarlo.long_run.estimates import corrections
from rattle.montecarlo.long_run.walk import steps_per_period
from rattle.montecarlo.looks import share_of_look
from rattle.montecarlo.schemes.exact_flight import accurate_flight
from rattle.montecarlo.schemes.time_scales import time_scales
from rattle.montecarlo.settings import count_followed
from rattle.montecarlo.statistics.intervals import half_width
from rattle.scene import DAT21, Scene

QUIET = Scene.from_gears(DAT21)
NOISY = Scene.from_gears(DAT21, sigma=0.1)


def test_intervals_are_student_s_and_poisson_s():
    assert [half_width(n) for n in (1000, 10, 3)] == pytest.approx(
        t.ppf(0.975, [999, 9, 2]), rel=1e-3
    )
    assert interval(10.0, 10.0, 1.0) == pytest.approx(
        chi2.ppf([0.025, 0.975], [20, 22]) / 2.0, rel=1e-3
    )
    assert interval(0.0, 0.0, 1.0)[1] == pytest.approx(chi2.ppf(0.975, 2) / 2.0, rel=1e-3)
    assert sum(map(share_of_look, range(1, 10_000))) == pytest.approx(0.05, abs=1e-4)


def test_steps_follow_the_scales_of_the_scene():
    assert time_scales(Scene.from_gears(DAT21, sigma=0.5)) == pytest.approx(
        [7.5, 0.25, 0.998, 12.871], abs=1e-3
    )
    assert accurate_flight(QUIET) == (0.1, "a longer step cannot follow the noise's modulation")
    assert steps_per_period(NOISY) == 192
    assert [count_followed(scene, 1000) for scene in (QUIET, NOISY)] == [1, 1000]


def test_a_control_variate_is_taken_off_with_its_slope():
    chance = np.random.default_rng(1).normal(size=(64, 1))
    assert corrections(5.0 + 3.0 * chance, chance) == pytest.approx(
        np.full((64, 1, 1), 3.0), rel=0.02
    )
