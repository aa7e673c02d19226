"""The search for a boundary: on known functions, against simulation, with what stays undecided, and
bad input."""

import dataclasses
import math
import time
from contextlib import suppress

import numpy as np
import pandas as pd
import pytest

from rattle import DAT21, Scene, Tolerances, boundary, mean_map
from rattle.compare.judge.verdict import DECIDED, Verdict
from rattle.compare.parameters.boundary import Boundary
from rattle.compare.parameters.figures import boundary_figure
from rattle.compare.parameters.page import make_report
from rattle.compare.parameters.search import (
    MOST_VALUES,
    PATHS_OF_LOOKS,
    ROUGH,
    JudgedValue,
    Widths,
    critical,
    find_changes,
    judge_value,
)
from rattle.compare.report.save import save
from rattle.montecarlo.statistics.intervals import widest

DRIVEN = Scene.from_gears(DAT21)


def page_of(found, folder):
    """The page of a result as Markdown, from the folder that is written."""
    facts = {"name": "DAT21", "command": "", "commit": "", "versions": {}, "wall_seconds": 1.0}
    report = make_report(found, facts | {"scene": found.scene.to_dict()})
    save(folder / "report", report, overwrite=False)
    return next((folder / "report").glob("*.md")).read_text(encoding="utf-8")


def verdicts(*changes, doubt=1.0):
    """A judge: accurate up to the first change, wrong up to the next, and so on; undecided within a
    factor of each."""

    def judge(value):
        near = any(c / doubt < value < c * doubt for c in changes)
        verdict = Verdict.UNDECIDED if near else DECIDED[sum(value > c for c in changes) % 2]
        return JudgedValue(value, verdict, 1, 0.0, 0.0, 0.0, "", "")

    return judge


def search(judge, *scan, near=()):
    """The edges in a range, as pairs of the accurate and the wrong value, and how many values were
    judged."""
    changes, judged = find_changes(judge, *scan, first=Verdict.ACCURATE, near=near)
    return [(good.value, bad.value) for good, bad in changes], len(judged)


@pytest.mark.parametrize("width", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("change", np.geomspace(0.0011, 1.9, 7))
def test_an_edge_is_found_to_its_width(change, width):
    ((accurate, wrong),), judged = search(verdicts(change), 1e-3, 2.0, 8, width)
    assert accurate <= change < wrong
    assert wrong / accurate <= 1.002 * (1.0 + width) / (1.0 - width)
    assert judged <= 8 + math.ceil(math.log2(math.log(2000.0) / 7.0 / math.log1p(width)))


def test_islands_are_listed():
    edges, _ = search(verdicts(0.004, 0.02, 0.3), 1e-3, 2.0, 12, 0.1)
    assert [accurate < wrong for accurate, wrong in edges] == [True, False, True]


def test_what_is_undecided_is_approached_from_both_sides():
    ((accurate, wrong),), judged = search(verdicts(0.05, doubt=1.2), 1e-3, 2.0, 8, 0.05)
    assert accurate <= 0.05 / 1.2 < 0.05 * 1.2 <= wrong
    assert wrong / accurate < 1.2**2 * 1.11
    assert judged < MOST_VALUES
    assert not search(verdicts(0.05, doubt=1e9), 1e-3, 2.0, 8, 0.05)[0]


@pytest.fixture(scope="module")
def found():
    return boundary(DRIVEN, impacts=3, points=4, width=0.3, rng=3)


def test_the_boundary_of_saltation(found):
    """One edge; a search with other random numbers agrees with it, and thirty times the tolerance
    moves it up."""
    (edge,) = found.edges
    assert edge.wrong / edge.accurate <= 1.3 / 0.7 * 1.01
    (again,) = boundary(DRIVEN, impacts=3, points=4, width=0.3, rng=4).edges
    assert max(edge.accurate, again.accurate) < min(edge.wrong, again.wrong)
    (looser,) = boundary(
        DRIVEN, impacts=3, points=4, width=0.3, rng=3, tolerances=(1.5, 3.0, 1.0)
    ).edges
    assert looser.accurate > edge.wrong  # a planted error: another tolerance is noticed


def test_the_result_shows_itself(found, tmp_path):
    assert "`saltation` is accurate up to sigma = " in repr(found)
    assert "<table" in found._repr_html_()
    assert found.plot().axes[0].get_xlabel() == "sigma"
    assert "stops holding" in page_of(found, tmp_path)
    assert found.to_dict()["edges"][0]["accurate"] == found.edges[0].accurate


def test_a_search_continues_where_it_ended(found, tmp_path):
    settings = {"impacts": 3, "points": 4, "width": 0.3, "rng": 3, "folder": tmp_path}
    first = boundary(DRIVEN, budget=1e-9, **settings)
    assert set(first.points["remark"]) == {"the budget ended"}
    second = boundary(DRIVEN, **settings, workers=2)
    stored = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.parquet")}
    assert second.points.equals(found.points)
    assert boundary(DRIVEN, **settings).points.equals(found.points)
    assert stored == {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.parquet")}


def test_nowhere_accurate_is_said():
    found = boundary(DRIVEN, closure="published", between=(0.01, 0.1), impacts=2, points=2)
    assert found.answer[0] == "`published` is nowhere accurate from sigma = 0.01 to 0.1."


@pytest.mark.parametrize(
    ("over", "first", "last", "accurate", "said"),
    [
        ("sigma", (0.1, 0.2), (0.1, 0.2), True, "above 2"),
        ("sigma", (9.0, 9.5), (2.0, 2.5), False, "above 2"),
        ("alpha", (0.1, 0.2), (0.4, 0.5), True, "above 2"),
        ("alpha", (0.4, 0.5), (0.1, 0.2), True, "below 1"),
        ("alpha", (2.0, 2.5), (9.0, 9.5), False, "below 1"),
        ("alpha", (0.1, 0.3), (0.2, 0.4), True, "below 1 or above 2"),
    ],
)
def test_a_boundary_outside_is_said_with_its_side(over, first, last, accurate, said):
    verdict = Verdict.ACCURATE if accurate else Verdict.INACCURATE
    ends = [
        JudgedValue(value, verdict, low=low, high=high)
        for value, (low, high) in ((1.0, first), (2.0, last))
    ]
    found = Boundary(DRIVEN, "saltation", over, (), pd.DataFrame(ends), 0)
    assert found.answer[1] == f"If there is one, it lies {said}."


def test_gears_are_searched_in_their_units():
    scene = DRIVEN.with_sigma(0.01)
    found = boundary(scene, over="torque1", between=(90.0, 110.0), impacts=1, points=2)
    assert found.unit == "N mm"
    assert "torque1 = 90 to 110 N mm" in found.answer[0]


@pytest.mark.parametrize(("could_change", "looks"), [(1e-6, (False, False)), (0.5, (False, True))])
def test_a_branch_that_matters_is_sampled_on_purpose(could_change, looks, monkeypatch):
    """One that hardly matters does not end the looks: more paths decide, however many would show
    it."""
    row = {
        "moment": "sd",
        "quantity": "tau",
        "impact": 1,
        "tolerance": 1.0,
        "error": 0.5,
        "low": -0.3,
        "high": 1.3,
    }
    row |= {
        "noise": 0.8,
        "unseen_low": 0.0,
        "unseen_high": could_change,
        "paths_needed": 1e9,
        "remark": "",
    }

    def errors(paths, z):
        narrow = (
            {"verdict": "accurate", "high": 0.9}
            if paths > PATHS_OF_LOOKS[0]
            else {"verdict": "undecided"}
        )
        return pd.DataFrame([row | narrow])

    def simulate(scene, paths, near_branches):
        seen.append(near_branches)
        return paths

    monkeypatch.setattr("rattle.compare.parameters.search.list_errors", lambda _, run, __: run)
    monkeypatch.setattr("rattle.compare.parameters.search.judge_errors", errors)
    seen = []
    assert (
        judge_value(0.1, DRIVEN, None, simulate, Widths(4.0, 4.0), Tolerances()).verdict
        == Verdict.ACCURATE
    )
    assert tuple(seen) == looks


def test_a_branch_that_plain_paths_miss_is_decided():
    """Of a million paths about four make `saltation` wrong; among the 4,096 of the first look there
    is none."""
    scene = Scene.from_gears(dataclasses.replace(DAT21, alpha=2.398))
    found = boundary(scene, between=(0.00197122, 0.00225778), points=2, impacts=11, width=0.5)
    assert set(found.points["verdict"]) == {Verdict.INACCURATE}
    assert set(found.points["paths"]) == {ROUGH}


def test_all_looks_and_values_are_counted():
    looks = (len(PATHS_OF_LOOKS) + 1) * MOST_VALUES
    assert critical(12, 2) == (widest(looks), widest(12 * 12 * looks))


def test_one_row_shows_a_closure_wrong_and_all_rows_show_it_accurate(monkeypatch):
    """Rows at their tolerance: any is wrong, or some are accurate, no more often than in 2.5 %
    each."""
    monkeypatch.setattr("rattle.compare.parameters.search.PATHS_OF_LOOKS", PATHS_OF_LOOKS[:1])
    rng = np.random.default_rng(5)
    values = 100
    rows = 20

    def errors(seen, z):
        low = seen - 0.1 * z
        high = seen + 0.1 * z
        verdict = np.select([high <= 1.0, low > 1.0], ["accurate", "inaccurate"], "undecided")
        table = pd.DataFrame(
            {"verdict": verdict, "error": seen, "low": low, "high": high, "tolerance": 1.0}
        )
        named = {
            "noise": 0.1 * z,
            "moment": "sd",
            "quantity": "tau",
            "impact": 1,
            "remark": "",
            "paths_needed": 1e9,
        }
        return table.assign(**named, unseen_low=0.0, unseen_high=0.0)

    def share(verdict, truth, z):
        def simulate(scene, paths, near_branches):
            return truth + 0.1 * rng.standard_normal(rows)

        found = [
            judge_value(0.1, DRIVEN, None, simulate, z, Tolerances()).verdict for _ in range(values)
        ]
        return np.mean([one == verdict for one in found])

    monkeypatch.setattr("rattle.compare.parameters.search.list_errors", lambda _, run, __: run)
    monkeypatch.setattr("rattle.compare.parameters.search.judge_errors", errors)
    z = Widths(widest(1), widest(rows))
    least = 0.025 + 4.0 * math.sqrt(0.025 / values)
    at_edge = np.ones(rows)
    one_beyond = np.where(np.arange(rows) == 7, 1.0, 0.2)
    assert share(Verdict.INACCURATE, at_edge, z) < least
    assert share(Verdict.ACCURATE, one_beyond, z) < least
    assert (
        share(Verdict.ACCURATE, np.full(rows, 0.6), z) > 0.5
    )  # rows are not counted here: 0.03 if they were
    assert (
        share(Verdict.INACCURATE, at_edge, Widths(z.accurate, z.accurate)) > least
    )  # a planted error: rows not counted


def test_a_closure_of_ones_own_has_a_boundary():
    """One that repeats saltation has its boundary; one that fails is nowhere accurate."""

    def mine(scene, impacts):
        return mean_map(scene, impacts=impacts, closure="saltation").section[["tau", "sd_tau"]]

    def broken(scene, impacts):
        raise RuntimeError("no")

    settings = {"impacts": 2, "between": (0.01, 0.1), "points": 2}
    assert boundary(DRIVEN, closure=mine, **settings).points["verdict"].iloc[0] == Verdict.ACCURATE
    assert set(boundary(DRIVEN, closure=broken, **settings).points["row"]) == {
        "nothing is predicted"
    }


def test_a_closure_that_takes_for_ever_ends_with_the_budget():
    def sleeps(scene, impacts):
        while True:
            with suppress(Exception):
                time.sleep(60.0)

    found = boundary(DRIVEN, closure=sleeps, impacts=2, points=2, budget=1.0)
    assert set(found.points["verdict"]) == {Verdict.UNDECIDED}
    assert set(found.points["remark"]) == {"the budget ended"}


def test_a_boundary_of_which_no_value_was_judged_is_drawn(found):
    points = found.points.assign(error=np.nan, low=np.nan, high=np.nan)
    figure = boundary_figure(dataclasses.replace(found, edges=(), points=points))
    assert np.isfinite(figure.axes[0].get_ylim()).all()
