"""The curve of a boundary over two parameters: guesses, columns, resuming, a cluster, figure and
page, bad input."""

import math
from dataclasses import replace

import pandas as pd
import pytest
from searches import QUIET, run, search, verdicts

from rattle import boundary_map
from rattle.compare import BoundaryMap
from rattle.compare.judge.verdict import Verdict
from rattle.compare.parameters.map import NOWHERE
from rattle.compare.parameters.search import critical


@pytest.mark.parametrize("near", [(0.048, 0.0525), (0.3, 0.31), (0.05,)])
def test_a_guess_saves_values_and_a_wrong_one_does_no_harm(near):
    _, plain = search(verdicts(0.05), 8, 0.1)
    ((accurate, wrong),), judged = search(verdicts(0.05), 8, 0.1, near=near)
    assert accurate <= 0.05 < wrong <= 1.002 * 1.1 / 0.9 * accurate
    right = len(near) == 2 and near[0] < 0.05 < near[1]
    assert judged == plain - 1 if right else judged <= plain + 2


@pytest.mark.slow
def test_each_value_has_its_own_boundary(results):
    """Both sides of the edge of the first and the last column, which are not alike, judged with
    other random numbers."""
    curve = results["map"].curve
    first, last = curve.iloc[[0, -1]].to_dict("records")

    def agrees(alpha, edge):
        """Whether no verdict at this value contradicts an edge."""
        settings = {"impacts": 2, "points": 2, "width": 0.9, "rng": 4}
        between = (edge["accurate"], edge["wrong"])
        again = run("boundary", scene=replace(QUIET, alpha=alpha), between=between, **settings)
        below, above = again.points["verdict"]
        return below != Verdict.INACCURATE and above != Verdict.ACCURATE

    assert agrees(first["along"], first)
    assert agrees(last["along"], last)
    # a column in the place of another is noticed
    assert not agrees(first["along"], last)
    assert not agrees(last["along"], first)
    assert critical(2, 2, 3) > critical(2, 2)


def test_what_has_no_edge_is_said():
    settings = {"impacts": 1, "points": 2, "values": 2, "over": "sigma"}
    right = boundary_map(QUIET, along="torque1", between=(0.001, 0.002), **settings)
    assert right.answer[0] == "At torque1 = 50, 200 N mm: accurate throughout."
    assert set(right.points["verdict"]) == {Verdict.ACCURATE}
    assert math.isnan(right.curve["wrong"].iloc[0])


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
    said = BoundaryMap(QUIET, "saltation", "sigma", "alpha", curve, curve, 0).answer
    assert said[0].endswith(
        "of the values of alpha with an edge; at alpha = 1.5, 3 nowhere accurate."
    )
    assert not any(line.startswith("At alpha") for line in said)
    every = BoundaryMap(QUIET, "saltation", "sigma", "alpha", curve[::2], curve, 0).answer
    assert every[0].endswith("0.04 at 0.75, the most.")
