"""A notebook shows the figures of results, once, whatever pyplot does; no window is opened and none stays open."""

import matplotlib.pyplot as plt
import nbformat
import pytest
from matplotlib.figure import Figure
from nbclient import NotebookClient

import rattle as rt

SCENE = rt.Scene.from_gears(rt.DAT21, sigma=0.1)
MAKE = """import rattle as rt
m = rt.mean_map(rt.Scene.from_gears(rt.DAT21, sigma=0.1), impacts=3)"""


def pictures(cell):
    """What a cell shows: the kinds of each of its outputs that has a picture."""
    return [set(o.data) for o in cell.outputs if "image/png" in o.get("data", {})]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_shows_a_figure_once():
    plots = ("m.plot()", "import matplotlib.pyplot as plt\nm.plot()", "%matplotlib inline\nm.plot()", "m.plot();")
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(s) for s in (MAKE, *plots)])
    NotebookClient(book, timeout=300, kernel_name="python3").execute()
    assert [len(pictures(cell)) for cell in book.cells] == [0, 1, 1, 1, 0]


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
    figure, data = results[name].plot(), results[name].to_xarray()
    assert isinstance(figure, Figure)
    assert figure._repr_png_().startswith(b"\x89PNG")
    units = data["quantity"].attrs if "quantity" in data else {n: v.attrs["units"] for n, v in data.items()}
    assert units["q50_speed_mesh1" if name == "long run" else "y1"] == "backlash1 omega"
    if name in ("prediction", "run", "long run"):
        assert {v.attrs["units"] for v in results[name].to_xarray("physical").values()} >= {"ms", "mm/s", "1"}


def test_a_dataset_holds_the_numbers_of_the_table(results):
    run, orbit = results["run"], results["orbit"]
    assert run.to_xarray()["sd_y1"].values.tolist() == run.section["sd_y1"].tolist()
    assert run.to_xarray("physical")["tau"].values.tolist() == run.section_in("physical")["tau_ms"].tolist()
    assert orbit.to_xarray()["y2_after"].values.tolist() == orbit.after[:, 3].tolist()
    row = results["validation"].table.query("quantity == 'y1' and moment == 'sd' and impact == 2").iloc[0]
    at = {"closure": "saltation", "quantity": "y1", "moment": "sd", "impact": 2}
    assert float(results["validation"].to_xarray()["error"].sel(at)) == row["error"]
    rate = results["long run"].to_xarray("physical")["rate"]
    assert float(rate.sel(statistic="value")) == results["long run"].table_in("physical").loc["rate", "value"]


def test_what_cannot_be_drawn_is_said(results):
    single = rt.Scene(alpha=0.25, epsilon=0.5, beta1=0.02, gamma1=0.0, stages=1)
    with pytest.raises(rt.InputError, match="quantity = 'y2'"):
        rt.mean_map(single, impacts=1).plot("y2")
    with pytest.raises(rt.InputError, match="exact"):
        rt.stationary(single).plot()
    with pytest.raises(rt.InputError, match="did you mean 'memory'"):
        results["long run"].plot("memori")


def test_public_names_are_all_that_is_listed():
    from importlib.metadata import version

    assert rt.__version__ == version("rattle")
    assert set(dir(rt)) == {*rt.__all__, "__version__"}
