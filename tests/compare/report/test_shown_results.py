"""Results show themselves in a few lines, draw and report themselves, and come in physical units
and as datasets."""

import pickle
from dataclasses import replace
from functools import partial
from importlib.metadata import version

import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pandas as pd
import pytest
from commands import manifest_of
from matplotlib.figure import Figure
from nbclient import NotebookClient
from refusals import refusal
from scenes import IMPACT_PAIR, UNGEARED, dat21

import rattle as rt
from rattle.scene import OutputError

SHOWN_SCENE = dat21(0.1)
SHOWN = ["orbit", "prediction", "run", "validation", "long run"]


@pytest.fixture(scope="module")
def results():
    shared = {"impacts": 2, "paths": 500, "rng": 7}
    return {
        "orbit": rt.follow(SHOWN_SCENE, 200),
        "prediction": rt.mean_map(SHOWN_SCENE, closure="branching"),
        "run": rt.simulate(SHOWN_SCENE, **shared, record=rt.Record(energy=True)),
        "validation": rt.validate(SHOWN_SCENE, closures=["published", "saltation"], **shared),
        "long run": rt.stationary(SHOWN_SCENE, periods=64, paths=64, closures=["saltation"]),
        "edgeworth": rt.mean_map(SHOWN_SCENE, impacts=2, closure="corrected").edgeworth(1, 1),
        "scene": SHOWN_SCENE,
        "reach": rt.simulate_to(SHOWN_SCENE, 0.1, impacts=2).reach,
        "study": rt.Study.from_toml("[study]\nimpacts = 2\npaths = 1024\n" + SHOWN_SCENE.to_toml()),
    }


def test_every_result_has_a_short_repr_and_most_a_table(results):
    # a dozen lines in a notebook
    assert not [name for name, result in results.items() if len(repr(result)) > 800]
    for name in SHOWN:
        assert "<table" in results[name]._repr_html_(), name
        assert 2 <= len(repr(results[name]).splitlines()) <= 12
    assert "seed 7" in repr(results["run"])


def test_a_result_comes_back_from_its_pickle_as_from_another_process(results):
    for name, result in results.items():
        back = pickle.loads(pickle.dumps(result))
        assert type(back) is type(result)
        assert repr(back) == repr(result) or " at 0x" in repr(result), name
    prediction = results["prediction"]
    back = pickle.loads(pickle.dumps(prediction))
    assert back.at_times([0.3, 0.9]).equals(prediction.at_times([0.3, 0.9]))


def test_sections_in_physical_units(results):
    assert "energy_mJ" in results["run"].section_in("physical")
    for made in (results["run"], results["prediction"]):
        physical = made.section_in("physical")
        plain = made.section
        np.testing.assert_allclose(physical["tau_ms"], plain["tau"] / 0.3)
        np.testing.assert_allclose(physical["sd_y1_mm_per_s"], 60.0 * plain["sd_y1"])
        np.testing.assert_allclose(physical["impacts_per_s"], 300.0 / plain["flight"])


FACTORS = {
    "x1_mm": ("x1", 0.2),
    "y2_mm_per_s": ("y2", 60.0),
    "cov_y1_x2_mm2_per_s": ("cov_y1_x2", 12.0),
    "cov_y1_y2_mm2_per_s2": ("cov_y1_y2", 3600.0),
    "rho1": ("rho1", 1.0),
}


def test_moments_at_fixed_times_in_physical_units():
    record = rt.Record(times=[0.3, 0.6])
    run = rt.simulate(
        SHOWN_SCENE, paths=256, impacts=2, rng=7, scheme="euler-maruyama-located", record=record
    )
    for made in (run, rt.mean_map(SHOWN_SCENE, impacts=2)):
        physical = made.at_times([0.3, 0.6], units="physical")
        plain = made.at_times([0.3, 0.6])
        np.testing.assert_allclose(physical.index, plain.index / 0.3)
        assert physical.index.name == "time_ms"
        for name, (own, factor) in FACTORS.items():
            np.testing.assert_allclose(physical[name], factor * plain[own])


@pytest.mark.parametrize("make", [rt.mean_map, partial(rt.simulate, paths=1)])
def test_physical_units_need_gears(make):
    with refusal("was not made from gears"):
        make(UNGEARED, impacts=1).section_in("physical")
    with refusal("did you mean 'physical'"):
        make(SHOWN_SCENE, impacts=1).at_times([], units="phsical")


def test_what_cannot_be_drawn_is_said(results):
    for result, given, message in (
        (results["validation"], ["error"], "did you mean 'errors'"),
        (rt.mean_map(IMPACT_PAIR, impacts=1), ["y2"], "quantity = 'y2'"),
        (rt.stationary(IMPACT_PAIR), [], "exact"),
        (results["long run"], ["memori"], "did you mean 'memory'"),
    ):
        with refusal(message):
            result.plot(*given)


@pytest.mark.usefixtures("undrawn")
def test_a_report_from_python(results, tmp_path):
    result = results["validation"]
    assert result.report(tmp_path / "mine").name == "report.html"
    assert manifest_of(tmp_path / "mine")["settings"]["seed"] == 7
    with pytest.raises(OutputError, match="mine"):
        result.report(tmp_path / "mine")
    result.report(tmp_path / "mine", overwrite=True)


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


@pytest.mark.parametrize("name", SHOWN)
def test_every_result_draws_itself_and_gives_a_dataset_with_units(results, name):
    figure = results[name].plot()
    assert isinstance(figure, Figure)
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert plt.get_fignums() == []  # it does not stay open
    data = results[name].to_xarray()
    units = {variable: values.attrs.get("units") for variable, values in data.items()}
    units |= data["quantity"].attrs if "quantity" in data else {}
    assert units["q50_speed_mesh1" if name == "long run" else "y1"] == "backlash1 omega"
    if name in ("prediction", "run", "long run"):
        physical = results[name].to_xarray("physical")
        assert {values.attrs["units"] for values in physical.values()} >= {"ms", "mm/s", "1"}


def test_a_dataset_holds_the_numbers_of_the_table(results):
    run = results["run"]
    assert (
        run.to_xarray("physical")["tau"].to_series().tolist()
        == run.section_in("physical")["tau_ms"].tolist()
    )
    at = {"closure": "saltation", "quantity": "y1", "moment": "sd", "impact": 2}
    table = results["validation"].table.query("kind == 'section'").set_index([*at])
    assert (
        float(results["validation"].to_xarray()["error"].sel(at))
        == table["error"][tuple(at.values())]
    )


def test_public_names_are_all_that_is_listed():
    assert rt.__version__ == version("rattle")
    assert set(dir(rt)) == {*rt.__all__, "__version__"}


def test_raw_records_have_names():
    late = replace(SHOWN_SCENE, start=rt.Start(100.0, 0.5, 2.0, 0.5, 2.0, mesh=1))
    run = rt.simulate(late, paths=16, impacts=3, record=rt.Record(raw=True))
    table = run.records
    assert list(table) == ["tau", "flight", "x1", "y1", "x2", "y2", "mesh", "side"]
    pd.testing.assert_series_equal(table["tau"].groupby("impact").mean(), run.section["tau"])
    assert table["y1"][0, 1] == run.raw[0, 0, 3]
    with refusal(r"record\.raw = False: ask for it"):
        rt.simulate(late, paths=16).records  # noqa: B018
