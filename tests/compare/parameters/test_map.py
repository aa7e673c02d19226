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


@pytest.mark.parametrize(("near", "more"), [((0.048, 0.0525), -1), ((0.3, 0.31), 2), ((0.05,), 2)])
def test_a_guess_saves_values_and_a_wrong_one_does_no_harm(near, more):
    _, plain = search(verdicts(0.05), 8, 0.1)
    ((accurate, wrong),), judged = search(verdicts(0.05), 8, 0.1, near=near)
    assert accurate <= 0.05 < wrong <= 1.002 * 1.1 / 0.9 * accurate
    assert judged <= plain + more


@pytest.mark.slow
def test_each_value_has_its_own_boundary(results):
    """Both sides of the edge of the first and the last column, which are not alike, judged with
    other random numbers."""
    curve = results["map"].curve

    def agrees(at, edge):
        """Whether no verdict at the value of a column contradicts the edge of one."""
        scene = replace(QUIET, alpha=curve["along"].iloc[at])
        between = tuple(curve[["accurate", "wrong"]].iloc[edge])
        below, above = run(
            "boundary", scene=scene, between=between, impacts=2, points=2, width=0.9, rng=4
        ).points["verdict"]
        return below != Verdict.INACCURATE and above != Verdict.ACCURATE

    assert agrees(0, 0)
    assert agrees(-1, -1)
    # a column in the place of another is noticed
    assert not agrees(0, -1)
    assert not agrees(-1, 0)
    assert critical(2, 2, 3) > critical(2, 2)


def test_what_has_no_edge_is_said():
    right = boundary_map(
        QUIET, along="torque1", between=(0.001, 0.002), impacts=1, points=2, values=2, over="sigma"
    )
    assert right.answer[0] == "At torque1 = 50, 200 N mm: accurate throughout."
    assert set(right.points["verdict"]) == {Verdict.ACCURATE}
    assert math.isnan(right.curve["wrong"].iloc[0])


def test_the_least_edge_is_not_called_the_least_where_it_is_nowhere_accurate():
    """The headline said that the closure is accurate up to 0.0017 at least; at two values it is
    nowhere accurate."""
    curve = pd.DataFrame(
        {
            "along": [0.75, 1.5, 2.4, 3.0],
            "accurate": [0.04, math.nan, 0.0017, math.nan],
            "wrong": [0.05, 0.001, 0.0019, 0.001],
            "why": ["means", NOWHERE, "sds", NOWHERE],
        }
    )
    said = BoundaryMap(QUIET, "saltation", "sigma", "alpha", curve, curve, 0).answer
    assert said[0].endswith(
        "of the values of alpha with an edge; at alpha = 1.5, 3 nowhere accurate."
    )
    assert not any(line.startswith("At alpha") for line in said)
    every = BoundaryMap(QUIET, "saltation", "sigma", "alpha", curve[::2], curve, 0).answer
    assert every[0].endswith("0.04 at 0.75, the most.")
