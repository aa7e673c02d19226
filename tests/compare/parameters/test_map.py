"""The curve of a boundary over two parameters: guesses, columns, resuming, a cluster, figure and
page, bad input."""

import math
from dataclasses import replace

import pandas as pd
import pytest
from test_boundary import DRIVEN, page_of, search, verdicts

from rattle import boundary, boundary_map
from rattle.compare.judge.verdict import Verdict
from rattle.compare.parameters.map import NOWHERE, BoundaryMap, Found, curve_rows, expect
from rattle.compare.parameters.search import Edge, critical

SETTINGS = {
    "along": "alpha",
    "reach": (0.4, 1.5),
    "values": 3,
    "impacts": 2,
    "points": 4,
    "width": 0.3,
    "rng": 3,
}


@pytest.mark.parametrize(
    "near", [(0.048, 0.0525), (0.049, 0.051), (0.02, 0.021), (0.3, 0.31), (0.05,)]
)
def test_a_guess_saves_values_and_a_wrong_one_does_no_harm(near):
    _, plain = search(verdicts(0.05), 1e-3, 2.0, 8, 0.1)
    ((accurate, wrong),), judged = search(verdicts(0.05), 1e-3, 2.0, 8, 0.1, near=near)
    assert accurate <= 0.05 < wrong <= 1.002 * 1.1 / 0.9 * accurate
    right = len(near) == 2 and near[0] < 0.05 < near[1]
    assert judged == plain - 1 if right else judged <= plain + 2


def test_edges_are_expected_between_those_of_both_sides():
    def found(*edges):
        return Found(tuple(Edge(*edge, "") for edge in edges), None, {})

    assert expect([found((1.0, 2.0)), found((4.0, 8.0))]) == [2.0, 4.0]
    assert expect([found((1.0, 2.0)), found()]) == [1.0, 2.0]
    failed = Found((), pd.DataFrame(), {}, "the workers died")
    assert expect([found((1.0, 2.0)), failed]) == [1.0, 2.0]
    assert curve_rows(0.3, failed)[0]["why"] == "the workers died"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("map")


@pytest.fixture(scope="module")
def found(folder):
    return boundary_map(DRIVEN, **SETTINGS, folder=folder)


@pytest.mark.slow
def test_each_value_has_its_own_boundary(found):
    """Searches with other random numbers agree with every column, and not all of them with that of
    another."""
    curve = found.curve.set_index("along")
    settings = {"impacts": 2, "points": 4, "width": 0.3, "rng": 4}
    again = {
        alpha: boundary(replace(DRIVEN, alpha=alpha), **settings).edges[0] for alpha in curve.index
    }
    for alpha, row in curve.iterrows():
        assert max(row["accurate"], again[alpha].accurate) < min(row["wrong"], again[alpha].wrong)
    assert (
        curve["accurate"].max() > curve["wrong"].min()
    )  # a column in the place of another is noticed
    assert critical(2, 2, 3) > critical(2, 2)


def test_a_map_continues_where_it_ended(found, folder):
    stored = {path.name: path.stat().st_mtime_ns for path in (folder / "cells").glob("*.parquet")}
    assert len(stored) == 3
    again = boundary_map(DRIVEN, **SETTINGS, folder=folder, workers=2)
    assert again.curve.equals(found.curve)
    assert stored == {
        path.name: path.stat().st_mtime_ns for path in (folder / "cells").glob("*.parquet")
    }


def test_the_result_shows_itself(found, tmp_path):
    assert found.answer[0].startswith("`saltation` is accurate up to sigma = ")
    assert "<table" in found._repr_html_()
    assert found.plot().axes[0].get_xlabel() == "alpha"
    assert "over sigma and alpha" in page_of(found, tmp_path)
    assert found.to_dict()["curve"][0]["along"] == 0.4


def test_what_has_no_edge_is_said():
    settings = {"impacts": 2, "points": 2, "values": 2, "over": "sigma"}
    wrong = boundary_map(
        DRIVEN, closure="published", along="torque1", between=(0.01, 0.1), **settings
    )
    assert wrong.answer[0] == "At torque1 = 50, 200 N mm: nowhere accurate."
    right = boundary_map(DRIVEN, along="torque1", between=(0.001, 0.002), **settings)
    assert right.answer[0] == "At torque1 = 50, 200 N mm: accurate throughout."
    assert set(right.points["verdict"]) == {Verdict.ACCURATE}
    assert math.isnan(right.curve["wrong"].iloc[0])


@pytest.mark.slow
def test_a_cluster_finds_the_same(found):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        assert boundary_map(DRIVEN, **SETTINGS, scheduler=cluster.scheduler_address).curve.equals(
            found.curve
        )


def test_the_least_edge_is_not_called_the_least_where_it_is_nowhere_accurate():
    """The headline said that the closure is accurate up to 0.0017 at least; at two values it is
    nowhere accurate."""
    rows = [
        (0.75, 0.04, 0.05, "means"),
        (1.5, math.nan, 0.001, NOWHERE),
        (2.4, 0.0017, 0.0019, "sds"),
    ]
    curve = pd.DataFrame(
        [*rows, (3.0, math.nan, 0.001, NOWHERE)], columns=["along", "accurate", "wrong", "why"]
    )
    said = BoundaryMap(DRIVEN, "saltation", "sigma", "alpha", curve, curve, 0).answer
    assert said[0].endswith(
        "of the values of alpha with an edge; at alpha = 1.5, 3 nowhere accurate."
    )
    assert not any(line.startswith("At alpha") for line in said)
    every = BoundaryMap(DRIVEN, "saltation", "sigma", "alpha", curve[::2], curve, 0).answer
    assert every[0].endswith("0.04 at 0.75, the most.")
