"""The search for a boundary: on known functions, against simulation, with what stays undecided, and
bad input."""

import math
import time
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scenes import RARE
from searches import QUIET, run, search, verdicts

from rattle import Tolerances, boundary
from rattle.compare import Boundary
from rattle.compare.judge.verdict import Verdict
from rattle.compare.parameters.search import (
    MOST_VALUES,
    PATHS_OF_LOOKS,
    ROUGH,
    JudgedValue,
    Widths,
    judge_value,
)
from rattle.montecarlo.statistics.intervals import widest


@pytest.mark.parametrize("width", [0.02, 0.5])
@pytest.mark.parametrize("change", [0.0011, 1.9])
def test_an_edge_is_found_to_its_width(change, width):
    ((accurate, wrong),), judged = search(verdicts(change), 8, width)
    assert accurate <= change < wrong
    assert wrong / accurate <= 1.002 * (1.0 + width) / (1.0 - width)
    assert judged <= 8 + math.ceil(math.log2(math.log(2000.0) / 7.0 / math.log1p(width)))


def test_islands_are_listed():
    edges, _ = search(verdicts(0.004, 0.02, 0.3), 12, 0.1)
    assert [accurate < wrong for accurate, wrong in edges] == [True, False, True]


def test_what_is_undecided_is_approached_from_both_sides():
    ((accurate, wrong),), judged = search(verdicts(0.05, doubt=1.2), 8, 0.05)
    assert accurate <= 0.05 / 1.2 < 0.05 * 1.2 <= wrong
    assert wrong / accurate < 1.2**2 * 1.11
    assert judged < MOST_VALUES
    assert not search(verdicts(0.05, doubt=1e9), 8, 0.05)[0]


def test_the_boundary_of_saltation(results):
    """One edge; fifteen times the tolerance moves it up."""
    (edge,) = results["boundary"].edges
    assert edge.wrong / edge.accurate <= 1.3 / 0.7 * 1.01
    (looser,) = run("boundary", tolerances=(1.5, 3.0, 1.0)).edges
    assert looser.accurate > edge.wrong  # a planted error: another tolerance is noticed


def test_nowhere_accurate_is_said():
    found = boundary(QUIET, closure="published", between=(0.01, 0.1), impacts=2, points=2)
    assert found.answer[0] == "`published` is nowhere accurate from sigma = 0.01 to 0.1."


@pytest.mark.parametrize(
    ("over", "verdict", "low", "high", "said"),
    [
        ("sigma", Verdict.INACCURATE, [9.0, 2.0], [9.5, 2.5], "above 2"),
        ("alpha", Verdict.ACCURATE, [0.4, 0.1], [0.5, 0.2], "below 1"),
        ("alpha", Verdict.ACCURATE, [0.1, 0.2], [0.3, 0.4], "below 1 or above 2"),
    ],
)
def test_a_boundary_outside_is_said_with_its_side(over, verdict, low, high, said):
    ends = pd.DataFrame([JudgedValue(value, verdict) for value in (1.0, 2.0)])
    found = Boundary(QUIET, "saltation", over, (), ends.assign(low=low, high=high), 0)
    assert found.answer[1] == f"If there is one, it lies {said}."


def test_a_branch_that_plain_paths_miss_is_decided():
    """Of a million paths about four make `saltation` wrong; among the 4,096 of the first look there
    is none."""
    found = boundary(RARE, between=(0.00197122, 0.00225778), points=2, impacts=11, width=0.5)
    assert set(found.points["verdict"]) == {Verdict.INACCURATE}
    assert set(found.points["paths"]) == {ROUGH}


def test_one_row_shows_a_closure_wrong_and_all_rows_show_it_accurate(monkeypatch):
    """Rows at their tolerance: any is wrong, or some are accurate, no more often than in 2.5 %
    each."""
    monkeypatch.setattr("rattle.compare.parameters.search.PATHS_OF_LOOKS", PATHS_OF_LOOKS[:1])
    rng = np.random.default_rng(5)
    nothing = ("rest", "lean", "unseen_low", "unseen_high", "unseen_share", "unseen_paths", "still")
    row = {"moment": "sd", "quantity": "tau", "impact": 1, "remark": "", "noise": 0.1}
    row |= dict.fromkeys(nothing, 0.0) | dict.fromkeys(("predicted", "unit", "tolerance"), 1.0)

    def share(verdict, truth, z):
        def errors(*_):
            return pd.DataFrame(
                {
                    "error": truth + 0.1 * rng.standard_normal(20),
                    **row,
                    "paths": 1e9,
                    "judged": True,
                }
            )

        monkeypatch.setattr("rattle.compare.parameters.search.list_errors", errors)
        found = [
            judge_value(0.1, QUIET, None, lambda *_: None, z, Tolerances()) for _ in range(100)
        ]
        return np.mean([one.verdict == verdict for one in found])

    z = Widths(widest(1), widest(20))
    least = 0.025 + 4.0 * math.sqrt(0.025 / 100)
    at_edge = np.ones(20)
    assert share(Verdict.INACCURATE, at_edge, z) < least
    assert share(Verdict.ACCURATE, [1.0, *[0.2] * 19], z) < least
    # a planted error: rows not counted
    assert share(Verdict.INACCURATE, at_edge, Widths(z.accurate, z.accurate)) > least


def test_a_closure_that_fails_is_nowhere_accurate():
    def broken(scene, impacts):
        raise RuntimeError("no")

    found = boundary(QUIET, closure=broken, impacts=2, between=(0.01, 0.1), points=2)
    assert set(found.points["row"]) == {"nothing is predicted"}


def test_a_closure_that_takes_for_ever_ends_with_the_budget():
    def sleeps(scene, impacts):
        while True:
            with suppress(Exception):
                time.sleep(60.0)

    found = boundary(QUIET, closure=sleeps, impacts=2, points=2, budget=1.0)
    assert set(found.points["verdict"]) == {Verdict.UNDECIDED}
    assert set(found.points["remark"]) == {"the budget ended"}


def test_a_boundary_of_which_no_value_was_judged_is_drawn(results):
    points = results["boundary"].points.assign(error=np.nan, low=np.nan, high=np.nan)
    assert np.isfinite(
        replace(results["boundary"], points=points, edges=()).plot().axes[0].get_ylim()
    ).all()
