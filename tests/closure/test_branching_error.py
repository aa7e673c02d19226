"""The branching closure's bound of its own error, and refinement until a tolerance is met."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rattle.closure import mean_map
from rattle.closure.branching.error import advice, bounds, within
from rattle.closure.branching.trace import LEVELS
from rattle.montecarlo import simulate
from rattle.scene import DAT21, Scene
from rattle.scene.errors import InputError


@pytest.fixture(scope="module")
def quiet():
    return mean_map(Scene.from_gears(DAT21, sigma=0.01), impacts=4, closure="branching", tolerance=0.05)


def test_a_met_tolerance_stops_the_refinement(quiet):
    """A quarter of the finest level's components at most, and it says that its tolerance is met."""
    assert max(len(w) for w, _, _ in quiet.trace.parts.values()) <= LEVELS[1].cut * 2
    assert quiet.section["within"].all()
    assert "within the tolerance 0.05" in quiet.advice
    assert "own bounds of the errors" in repr(quiet)


def test_an_unmet_tolerance_says_simulate():
    """Below any resolution: the finest level is reached, and rows are marked."""
    m = mean_map(Scene.from_gears(DAT21, sigma=0.5), impacts=3, closure="branching", tolerance=1e-9)
    assert not m.section["within"].all()
    assert m.advice.endswith("on: simulate")


def test_bounds_by_quantity_are_behind_the_columns(quiet):
    errors = quiet.errors
    assert isinstance(errors, pd.DataFrame)
    worst = errors.groupby("impact").max()
    np.testing.assert_allclose(worst["mean"], quiet.section["error_mean"])
    np.testing.assert_allclose(worst["sd"], quiet.section["error_sd"])
    for impact, mesh in quiet.section["mesh"].items():
        assert f"x{mesh}" not in errors.loc[impact].index
    assert mean_map(quiet.scene, impacts=2).errors is None


@pytest.mark.parametrize("tolerance", [0.0, -0.1, float("nan"), "little"])
def test_a_tolerance_is_positive(quiet, tolerance):
    with pytest.raises(InputError, match="tolerance"):
        mean_map(quiet.scene, impacts=2, closure="branching", tolerance=tolerance)


def test_only_branching_refines(quiet):
    with pytest.raises(InputError, match="cannot refine itself; leave it out, or use branching"):
        mean_map(quiet.scene, impacts=2, tolerance=0.05)


def test_what_only_the_finer_level_reaches_is_unknown(quiet):
    short = replace(quiet.trace, found=2)
    error = bounds(short, quiet.trace)
    assert np.isinf(np.nanmax(error[3]))
    assert np.isfinite(np.nanmax(error[2]))
    assert within(error, 0.05).tolist() == [True, True, True, False, False]


def test_advice_counts_the_work(quiet):
    """What many components reach only as well as few paths is for simulation."""
    assert advice(replace(quiet.trace, work=1), 0.05).endswith("within the tolerance 0.05")
    assert advice(replace(quiet.trace, work=10**9), 0.05).endswith("are as accurate and cheaper: simulate")


def test_bounds_hold_against_exact_flights():
    """In nine of ten impacts the worst mean and the worst sd; a planted error is beyond them."""
    scene, impacts = Scene.from_gears(DAT21, sigma=0.5), 8
    fine = mean_map(scene, impacts=impacts, closure="branching")
    found = simulate(scene, paths=20_000, impacts=impacts, scheme="exact-flight", rng=11, workers=1).section

    def share_beyond(trace):
        own = replace(fine, trace=trace).section
        beyond = []
        for k in range(1, impacts + 1):
            quantities = [q for q in ("tau", "flight", "x1", "y1", "x2", "y2") if q != f"x{own['mesh'][k]}"]
            for name, prefix in (("mean", ""), ("sd", "sd_")):
                off = [abs(own[prefix + q][k] - found[prefix + q][k]) / found[f"sd_{q}"][k] for q in quantities]
                leeway = [3.0 * found[f"se_{prefix}{q}"][k] / found[f"sd_{q}"][k] for q in quantities]
                beyond.append(max(off) > fine.section[f"error_{name}"][k] + max(leeway))
        return np.mean(beyond)

    assert share_beyond(fine.trace) <= 0.1
    assert share_beyond(replace(fine.trace, sd=1.4 * fine.trace.sd)) > 0.25  # negative control: a planted error
