"""What a simulation of a given accuracy costs."""

import numpy as np
import pandas as pd
import pytest

from compare.speed import best_of, monte_carlo_cost, path_step_seconds
from compare.validate import validate
from montecarlo import simulate
from scene import DAT21, Scene


def rows(**columns):
    return pd.DataFrame({"unit": [1.0], "se": 1.0, "se_corrected": 1.0, "bias": 0.1, "rest": 1.0, **columns})


def cost(table, error, **settings):
    return monte_carlo_cost(table, error, **{"dt": 1e-3, "flight": 7.0, "longest": 0.1, "step": 1e-8, **settings})


def test_plain_cost_is_paths_times_steps():
    """A hundredth of an sd takes 10^4 paths, and a tenth of the step whose bias is a tenth of an sd."""
    found = cost(rows(), 0.01)
    assert (found.paths, found.extrapolated) == (10_000, False)
    assert found.dt == pytest.approx(1e-4)
    assert found.seconds == pytest.approx(10_000 * 7.0 / 1e-4 * 1e-8)


def test_extrapolation_is_chosen_where_it_is_cheaper():
    found = cost(rows(rest=1e-4), 0.01)
    assert found.extrapolated
    assert found.dt == pytest.approx(1e-2)
    assert found.seconds == pytest.approx(1.5 * 10_000 * 7.0 / 1e-2 * 1e-8)


def test_half_the_error_costs_eight_times_as_much_plainly():
    assert cost(rows(), 0.01).seconds == pytest.approx(cost(rows(), 0.02).seconds * 8.0)


def test_the_worst_moment_decides():
    two = rows(unit=[1.0, 0.5], se=[1.0, 1.0], bias=[0.1, 0.2], rest=100.0)
    assert cost(two, 0.01).paths == 40_000
    assert cost(two, 0.01).dt == pytest.approx(1e-3 * 0.01 * 0.5 / 0.2)


def test_no_step_is_longer_than_the_simulator_allows():
    assert cost(rows(bias=0.0), 0.01).dt == 0.1
    assert cost(rows(bias=1e-9), 0.01).dt == 0.1


def test_a_simulation_of_that_cost_is_that_accurate():
    """Ensembles with the paths and the plain step that the estimate asks for err by about what it was asked for."""
    scene, error = Scene.from_gears(DAT21, sigma=0.1), 0.1
    v = validate(scene, impacts=1, readings=["saltation"], paths=40_000, rng=2, workers=2)
    step = v.run.step_bias.query("quantity == 'tau' and moment == 'mean'").iloc[0]
    sd, se = (float(v.run.section[name].loc[1]) for name in ("sd_tau", "se_tau"))
    table = rows(unit=[sd], se=se * np.sqrt(v.run.paths), bias=step["bias"], rest=1.0)
    found = cost(table, error, dt=v.run.dt, flight=0.56)
    assert found.paths == pytest.approx(100, abs=2)
    errors = [
        (simulate(scene, paths=found.paths, impacts=1, dt=found.dt, rng=seed).section["tau"].loc[1] - step["corrected"])
        / sd
        for seed in range(60)
    ]
    assert np.std(errors) == pytest.approx(error, rel=0.4)  # four standard errors of an sd of 60
    assert abs(np.mean(errors)) == pytest.approx(error, rel=0.6)  # its standard error is 0.013


def test_times_are_those_of_the_fastest_call_after_the_first():
    calls = []
    assert best_of(lambda: calls.append(0)) < 0.1
    assert len(calls) == 6


def test_a_path_step_takes_nanoseconds():
    v = validate(Scene.from_gears(DAT21, sigma=0.1), impacts=2, readings=["mended"], paths=600)
    assert 1e-9 < path_step_seconds(v) < 1e-6
