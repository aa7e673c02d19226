"""Results show themselves in a few lines, draw and report themselves, and come in physical units."""

import json
from functools import partial

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from rattle import validate
from rattle.closure import mean_map
from rattle.montecarlo import Record, simulate
from rattle.scene import DAT21, InputError, Scene

SCENE = Scene.from_gears(DAT21, sigma=0.1)
PLAIN = Scene(alpha=1.5, epsilon=0.9, beta1=0.1, gamma1=0.05, mu=0.5, sigma=0.1)


@pytest.fixture(scope="module")
def validation():
    return validate(SCENE, impacts=2, closures=["published", "saltation"], paths=2000, rng=7)


@pytest.fixture(scope="module")
def run():
    return simulate(SCENE, paths=256, impacts=3, rng=7, record=Record(energy=True))


def test_every_repr_is_a_few_lines_and_its_html_has_a_table(validation, run):
    for shown in (validation, run, mean_map(SCENE, impacts=30, closure="published"), mean_map(PLAIN, impacts=2)):
        assert 2 <= len(repr(shown).splitlines()) <= 8
        assert max(map(len, repr(shown).splitlines())) <= 300
        assert "<table" in shown._repr_html_()
    assert "seed 7" in repr(run)
    assert "saltation: " in repr(validation)


def test_sections_in_physical_units(run):
    for made in (run, mean_map(SCENE, impacts=3)):
        physical, plain = made.section_in("physical"), made.section
        assert "energy_mJ" in physical or made is not run
        np.testing.assert_allclose(physical["tau_ms"], plain["tau"] / 0.3)
        np.testing.assert_allclose(physical["sd_y1_mm_per_s"], 60.0 * plain["sd_y1"])
        np.testing.assert_allclose(physical["impacts_per_s"], 300.0 / plain["flight"])
        pd.testing.assert_frame_equal(made.section_in("dimensionless"), plain)
        assert physical.index.name == "impact"


def test_moments_at_fixed_times_in_physical_units():
    run = simulate(SCENE, paths=256, impacts=2, rng=7, scheme="euler-maruyama-located", record=Record(times=[0.3, 0.6]))
    for made in (run, mean_map(SCENE, impacts=2)):
        physical, plain = made.at_times([0.3, 0.6], units="physical"), made.at_times([0.3, 0.6])
        np.testing.assert_allclose(physical.index, plain.index / 0.3)
        assert physical.index.name == "time_ms"
        assert len(physical.columns) == len(plain.columns)
        np.testing.assert_allclose(physical["x1_mm"], 0.2 * plain["x1"])
        np.testing.assert_allclose(physical["y2_mm_per_s"], 60.0 * plain["y2"])
        np.testing.assert_allclose(physical["cov_x1_x2_mm2"], 0.04 * plain["cov_x1_x2"])
        np.testing.assert_allclose(physical["cov_y1_x2_mm2_per_s"], 12.0 * plain["cov_y1_x2"])
        np.testing.assert_allclose(physical["cov_y1_y2_mm2_per_s2"], 3600.0 * plain["cov_y1_y2"])
        pd.testing.assert_series_equal(physical["rho1"].reset_index(drop=True), plain["rho1"].reset_index(drop=True))
        pd.testing.assert_frame_equal(made.at_times([0.3, 0.6], units="dimensionless"), plain)
    np.testing.assert_allclose(run.at_times(units="physical")["se_x1_mm"], 0.2 * run.at_times()["se_x1"])


@pytest.mark.parametrize("make", [mean_map, partial(simulate, paths=1)])
def test_physical_units_need_gears(make):
    with pytest.raises(InputError, match="was not made from gears"):
        make(PLAIN, impacts=1).section_in("physical")
    with pytest.raises(InputError, match="was not made from gears"):
        make(PLAIN, impacts=1).at_times([], units="physical")
    with pytest.raises(InputError, match="did you mean 'physical'"):
        make(SCENE, impacts=1).at_times([], units="phsical")


def test_figures(validation, run):
    assert all(isinstance(validation.plot(kind), Figure) for kind in ("errors", "correlation", "section"))
    assert run.plot("y2", units="physical").axes[0].get_ylabel() == "y2 before the impact in mm/s"
    with pytest.raises(InputError, match="did you mean 'errors'"):
        validation.plot("error")
    with pytest.raises(InputError, match="quantity = 'y3'"):
        run.plot("y3")


@pytest.mark.usefixtures("undrawn")
def test_a_report_of_a_validation_says_what_repeats_it(validation, tmp_path):
    page = validation.report(tmp_path / "mine")
    assert page.name == "report.html"
    record = json.loads((tmp_path / "mine" / "manifest.json").read_text())
    assert record["settings"]["seed"] == 7
    assert record["repeat"].startswith("rattle validate --repeat")
    assert len(pd.read_csv(tmp_path / "mine" / "table.csv")) == len(validation.table)
    with pytest.raises(OSError, match="mine"):
        validation.report(tmp_path / "mine")
    validation.report(tmp_path / "mine", overwrite=True)
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="is not a folder"):
        validation.report(tmp_path / "file", overwrite=True)


@pytest.mark.parametrize("rng", [np.random.default_rng(1), np.random.PCG64(1), np.random.RandomState(1)])
def test_a_generator_is_refused_with_what_to_give(rng):
    with pytest.raises(InputError, match="give a seed") as caught:
        simulate(SCENE, paths=1, rng=rng)
    assert caught.value.field == "rng"
