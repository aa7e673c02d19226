"""What a simulation of a given accuracy costs."""

import numpy as np
import pandas as pd
import pytest

from rattle.closure import mean_map
from rattle.closure.mean_map import CLOSURES, closure_seconds
from rattle.compare.validation.comparison import measure_speed, paths_for
from rattle.compare.validation.validate import validate
from rattle.montecarlo import simulate
from rattle.montecarlo.accuracy.cost import cost_of
from rattle.scene import DAT21, Scene


def rows(**columns):
    return pd.DataFrame({"unit": [1.0], "se": 1.0, **columns})


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


def test_speed_up_is_the_ratio_of_the_work():
    v = validate(
        Scene.from_gears(DAT21, sigma=0.02), impacts=2, closures=["saltation"], paths=4096, scheme="exact-flight"
    )
    found = measure_speed(v, "saltation")
    assert found.impacts == 2
    assert found.closure_seconds == pytest.approx(2 * 250e-6)
    assert found.simulation_seconds == pytest.approx(cost_of(v.run, found.paths).core_seconds)
    assert found.speed_up == pytest.approx(found.simulation_seconds / found.closure_seconds)


def test_work_of_a_mixture_grows_with_its_components():
    few, many = (mean_map(Scene.from_gears(DAT21, sigma=s), impacts=2, closure="branching") for s in (1e-3, 0.5))
    assert many.trace.work > 10 * few.trace.work
    assert closure_seconds(few) < closure_seconds(many) < CLOSURES["branching"].most_seconds(2)
    assert closure_seconds(many) - closure_seconds(few) == pytest.approx(60e-6 * (many.trace.work - few.trace.work))
