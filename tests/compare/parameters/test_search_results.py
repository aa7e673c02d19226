"""What every result of a search or a sensitivity does: it shows itself, continues where it ended
and does not depend on the workers."""

import pytest
from searches import WEAK, page_of, run

from rattle import sensitivity
from rattle.compare import closure_sensitivity

SHOWN_SEARCHES = {
    "boundary": ("`saltation` is accurate up to sigma = ", "noise intensity", "stops holding"),
    "crossing": (
        "`power` is below 1000 mW up to amplitude = ",
        "amplitude of the drive, mm",
        "crosses 1000",
    ),
    "map": (
        "`saltation` is accurate up to sigma = ",
        "excitation amplitude",
        "over sigma and alpha",
    ),
    "balance": ("noise intensity (now 1): 1 % more adds ", "change (%)", "noise intensity"),
}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", SHOWN_SEARCHES)
def test_a_result_shows_itself(results, name, tmp_path):
    result = results[name]
    text, label, title = SHOWN_SEARCHES[name]
    assert text in repr(result)
    assert "<table" in result._repr_html_()
    assert result.plot().axes[0].get_xlabel().startswith(label)
    assert title in page_of(result, tmp_path)


def test_a_result_as_a_dictionary_has_its_edges_or_effects(results):
    assert results["crossing"].to_dict()["edges"] == [results["crossing"].edges[0]._asdict()]
    assert results["map"].to_dict()["curve"][0]["along"] == 0.4


def times(folder):
    """When each file was written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.parquet")}


@pytest.mark.parametrize("name", ["boundary", "crossing"])
def test_a_search_continues_where_it_ended(results, name, tmp_path):
    ended = run(name, folder=tmp_path, budget=1e-9)
    assert set(ended.points["remark"]) == {"the budget ended"}
    assert "ndecided at " in "".join(ended.answer)
    assert run(name, folder=tmp_path, workers=2).points.equals(results[name].points)
    stored = times(tmp_path)
    assert run(name, folder=tmp_path).points.equals(results[name].points)
    assert times(tmp_path) == stored


def test_a_map_continues_where_it_ended(results, folder_of_map):
    stored = times(folder_of_map / "cells")
    assert len(stored) == 2
    assert run("map", folder=folder_of_map, workers=2).curve.equals(results["map"].curve)
    assert times(folder_of_map / "cells") == stored


@pytest.mark.parametrize(
    ("function", "settings"),
    [
        (sensitivity, {"quantities": ["power"], "accuracy": 0.5}),
        (closure_sensitivity, {"impacts": 1, "paths": 1024}),
    ],
)
def test_an_effect_does_not_depend_on_the_workers(function, settings):
    one, two = (function(WEAK, parameters=["omega"], **settings, workers=n) for n in (1, 2))
    assert one.table.equals(two.table)
