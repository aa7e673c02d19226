"""What a simulation of a given accuracy costs."""

import time

import numpy as np
import pandas as pd
import pytest

from rattle.compare.validation.speed import TIMED_PATHS, best_of, path_seconds, paths_for, speed
from rattle.compare.validation.validate import validate
from rattle.montecarlo import simulate
from rattle.scene import DAT21, Scene


def rows(**columns):
    return pd.DataFrame({"unit": [1.0], "se": 1.0, **columns})


def test_half_the_error_costs_four_times_as_much():
    assert paths_for(rows(), 0.0196) == pytest.approx(10_000, abs=1)  # 1.96 standard errors
    assert paths_for(rows(), 0.0098) == pytest.approx(40_000, abs=1)


def test_the_worst_moment_decides():
    assert paths_for(rows(unit=[1.0, 0.5], se=[1.0, 1.0]), 0.01) == paths_for(rows(unit=[0.5] * 2, se=[1.0] * 2), 0.01)
    assert paths_for(rows(unit=[0.5], se=[1.0]), 0.01) < paths_for(rows(unit=[0.5] * 2, se=[1.0] * 2), 0.01)


def test_a_simulation_of_that_cost_is_that_accurate():
    """The errors of 95 % of the ensembles with the estimated number of paths are within what was asked for."""
    scene, error = Scene.from_gears(DAT21, sigma=0.1), 0.1
    settings = {"impacts": 1, "scheme": "exact-flight"}
    many = simulate(scene, paths=40_000, rng=2, **settings).section.loc[1]
    paths = paths_for(rows(unit=[many["sd_tau"]], se=many["se_tau"] * 200.0), error)
    assert paths == pytest.approx(384, abs=8)

    def beyond(paths):
        runs = (simulate(scene, paths=paths, rng=seed, **settings).section["tau"].loc[1] for seed in range(60))
        return np.mean([abs(tau - many["tau"]) > error * many["sd_tau"] for tau in runs])

    assert beyond(paths) < 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / 60)
    assert beyond(paths // 4) > 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / 60)  # the negative control: a third of them


def test_speed_up_is_the_ratio_of_the_costs():
    v = validate(
        Scene.from_gears(DAT21, sigma=0.02), impacts=2, closures=["saltation"], paths=4096, scheme="exact-flight"
    )
    found = speed(v, "saltation", 1e-6)
    assert found.impacts == 2
    assert found.simulation_seconds == pytest.approx(found.paths * 2 * 1e-6)
    assert found.speed_up == pytest.approx(found.simulation_seconds / found.closure_seconds)


def test_short_calls_are_timed_five_times_and_long_ones_once():
    calls = []
    assert best_of(lambda: calls.append(0)) > 0.0
    assert len(calls) == 5
    assert best_of(lambda: (calls.append(0), time.sleep(0.31))) >= 0.31
    assert len(calls) == 6


def test_the_time_of_an_impact_is_shared_by_all_paths_and_impacts(monkeypatch):
    v = validate(
        Scene.from_gears(DAT21, sigma=0.1), impacts=2, closures=["corrected"], paths=600, scheme="exact-flight"
    )
    monkeypatch.setattr("rattle.compare.validation.speed.best_of", lambda call: 3.0)
    assert path_seconds(v) == 3.0 / TIMED_PATHS / 2
