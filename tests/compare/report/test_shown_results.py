"""Results show themselves in a few lines, draw and report themselves, and come in physical
units."""

import json
from functools import partial
from importlib.metadata import version

import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from nbclient import NotebookClient

import rattle as rt
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
    for shown in (
        validation,
        run,
        mean_map(SCENE, impacts=30, closure="published"),
        mean_map(PLAIN, impacts=2),
    ):
        assert 2 <= len(repr(shown).splitlines()) <= 8
        assert max(map(len, repr(shown).splitlines())) <= 300
        assert "<table" in shown._repr_html_()
    assert "seed 7" in repr(run)
    assert "saltation: " in repr(validation)


def test_sections_in_physical_units(run):
    for made in (run, mean_map(SCENE, impacts=3)):
        physical = made.section_in("physical")
        plain = made.section
        assert "energy_mJ" in physical or made is not run
        np.testing.assert_allclose(physical["tau_ms"], plain["tau"] / 0.3)
        np.testing.assert_allclose(physical["sd_y1_mm_per_s"], 60.0 * plain["sd_y1"])
        np.testing.assert_allclose(physical["impacts_per_s"], 300.0 / plain["flight"])
        pd.testing.assert_frame_equal(made.section_in("dimensionless"), plain)
        assert physical.index.name == "impact"


def test_moments_at_fixed_times_in_physical_units():
    run = simulate(
        SCENE,
        paths=256,
        impacts=2,
        rng=7,
        scheme="euler-maruyama-located",
        record=Record(times=[0.3, 0.6]),
    )
    for made in (run, mean_map(SCENE, impacts=2)):
        physical = made.at_times([0.3, 0.6], units="physical")
        plain = made.at_times([0.3, 0.6])
        np.testing.assert_allclose(physical.index, plain.index / 0.3)
        assert physical.index.name == "time_ms"
        assert len(physical.columns) == len(plain.columns)
        np.testing.assert_allclose(physical["x1_mm"], 0.2 * plain["x1"])
        np.testing.assert_allclose(physical["y2_mm_per_s"], 60.0 * plain["y2"])
        np.testing.assert_allclose(physical["cov_x1_x2_mm2"], 0.04 * plain["cov_x1_x2"])
        np.testing.assert_allclose(physical["cov_y1_x2_mm2_per_s"], 12.0 * plain["cov_y1_x2"])
        np.testing.assert_allclose(physical["cov_y1_y2_mm2_per_s2"], 3600.0 * plain["cov_y1_y2"])
        pd.testing.assert_series_equal(
            physical["rho1"].reset_index(drop=True), plain["rho1"].reset_index(drop=True)
        )
        pd.testing.assert_frame_equal(made.at_times([0.3, 0.6], units="dimensionless"), plain)
    np.testing.assert_allclose(
        run.at_times(units="physical")["se_x1_mm"], 0.2 * run.at_times()["se_x1"]
    )


@pytest.mark.parametrize("make", [mean_map, partial(simulate, paths=1)])
def test_physical_units_need_gears(make):
    with pytest.raises(InputError, match="was not made from gears"):
        make(PLAIN, impacts=1).section_in("physical")
    with pytest.raises(InputError, match="was not made from gears"):
        make(PLAIN, impacts=1).at_times([], units="physical")
    with pytest.raises(InputError, match="did you mean 'physical'"):
        make(SCENE, impacts=1).at_times([], units="phsical")


def test_figures(validation, run):
    assert all(
        isinstance(validation.plot(kind), Figure) for kind in ("errors", "correlation", "section")
    )
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


MAKE = """import rattle as rt
m = rt.mean_map(rt.Scene.from_gears(rt.DAT21, sigma=0.1), impacts=3)"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_shows_a_figure_once():
    plots = (
        "m.plot()",
        "import matplotlib.pyplot as plt\nm.plot()",
        "%matplotlib inline\nm.plot()",
        "m.plot();",
    )
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(s) for s in (MAKE, *plots)])
    NotebookClient(book, timeout=300, kernel_name="python3").execute()
    pictures = [sum("image/png" in o.get("data", {}) for o in cell.outputs) for cell in book.cells]
    assert pictures == [0, 1, 1, 1, 0]


def test_figures_do_not_stay_open():
    m = rt.mean_map(SCENE, impacts=3)
    for _ in range(plt.rcParams["figure.max_open_warning"] + 2):
        m.plot()
    assert plt.get_fignums() == []


@pytest.fixture(scope="module")
def results():
    common = {"impacts": 2, "paths": 500, "scheme": "exact-flight", "rng": 7}
    return {
        "orbit": rt.follow(SCENE, 12),
        "prediction": rt.mean_map(SCENE, impacts=2, closure="branching"),
        "run": rt.simulate(SCENE, **common),
        "validation": rt.validate(SCENE, closures=["saltation"], **common),
        "long run": rt.stationary(SCENE, periods=64, paths=64, closures=["saltation"]),
    }


@pytest.mark.parametrize("name", ["orbit", "prediction", "run", "validation", "long run"])
def test_every_result_draws_itself_and_gives_a_dataset_with_units(results, name):
    figure = results[name].plot()
    data = results[name].to_xarray()
    assert isinstance(figure, Figure)
    assert figure._repr_png_().startswith(b"\x89PNG")
    units = (
        data["quantity"].attrs
        if "quantity" in data
        else {n: v.attrs["units"] for n, v in data.items()}
    )
    assert units["q50_speed_mesh1" if name == "long run" else "y1"] == "backlash1 omega"
    if name in ("prediction", "run", "long run"):
        assert {v.attrs["units"] for v in results[name].to_xarray("physical").values()} >= {
            "ms",
            "mm/s",
            "1",
        }


def test_a_dataset_holds_the_numbers_of_the_table(results):
    run = results["run"]
    orbit = results["orbit"]
    assert run.to_xarray()["sd_y1"].values.tolist() == run.section["sd_y1"].tolist()
    assert (
        run.to_xarray("physical")["tau"].values.tolist()
        == run.section_in("physical")["tau_ms"].tolist()
    )
    assert orbit.to_xarray()["y2_after"].values.tolist() == orbit.after[:, 3].tolist()
    row = (
        results["validation"]
        .table.query("quantity == 'y1' and moment == 'sd' and impact == 2")
        .iloc[0]
    )
    at = {"closure": "saltation", "quantity": "y1", "moment": "sd", "impact": 2}
    assert float(results["validation"].to_xarray()["error"].sel(at)) == row["error"]
    rate = results["long run"].to_xarray("physical")["rate"]
    assert (
        float(rate.sel(statistic="value"))
        == results["long run"].table_in("physical").loc["rate", "value"]
    )


def test_what_cannot_be_drawn_is_said(results):
    single = rt.Scene(alpha=0.25, epsilon=0.5, beta1=0.02, gamma1=0.0, stages=1)
    with pytest.raises(rt.InputError, match="quantity = 'y2'"):
        rt.mean_map(single, impacts=1).plot("y2")
    with pytest.raises(rt.InputError, match="exact"):
        rt.stationary(single).plot()
    with pytest.raises(rt.InputError, match="did you mean 'memory'"):
        results["long run"].plot("memori")


def test_public_names_are_all_that_is_listed():
    assert rt.__version__ == version("rattle")
    assert set(dir(rt)) == {*rt.__all__, "__version__"}
