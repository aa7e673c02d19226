"""Where a quantity of the long run crosses a level: against known functions, against long runs, and
bad input."""

import math

import numpy as np
import pandas as pd
import pytest
from searches import LOUD

from rattle import DAT21, Scene, crossing, stationary
from rattle.compare import Crossing
from rattle.compare.judge.verdict import Verdict
from rattle.compare.parameters.crossing import (
    ABOVE_LEVEL,
    BELOW_LEVEL,
    CROSSING_PATHS,
    PATH_PERIODS_OF_LOOKS,
    SideOfLevel,
    judge_level,
)
from rattle.compare.stationary.study import LongResult


def long_result(value, se, kind="simulated", periods=64):
    columns = {"value": value, "se": se, "effective_paths": float(CROSSING_PATHS)}
    table = pd.DataFrame([columns], index=pd.Index(["rate_above"], name="quantity"))
    return LongResult(
        table, pd.DataFrame(), {"kind": kind, "paths": CROSSING_PATHS, "periods": periods}
    )


@pytest.mark.parametrize(
    ("true", "verdict", "once"),
    [
        (0.98, BELOW_LEVEL, False),
        (3.0, ABOVE_LEVEL, True),
        (1.0, Verdict.UNDECIDED, True),
    ],
)
def test_runs_are_lengthened_until_a_value_is_decided(true, verdict, once):
    seen = []

    def run(paths, periods):
        seen.append(paths * periods)
        return long_result(true, 0.02 / math.sqrt(seen[-1] / PATH_PERIODS_OF_LOOKS[0]))

    found = judge_level(1.0, "rate_above", 1.0, run)
    assert (found.verdict, found.remark == "") == (verdict, verdict != Verdict.UNDECIDED)
    assert seen == list(PATH_PERIODS_OF_LOOKS[: len(seen)])
    assert (len(seen) == 1) == once


def test_the_share_of_wrong_statements_is_the_stated_one():
    """Values at the level, 4,000 searches: hardly more than the share of all looks, both sides, are
    decided."""
    rng = np.random.default_rng(3)
    result = long_result(1.0, 0.01)

    def look(paths, periods):
        result.table["value"] = 1.0 + 0.01 * rng.standard_t(CROSSING_PATHS - 1)
        return result

    judgements = [judge_level(1.0, "rate_above", 1.0, look) for _ in range(4000)]
    wrong = sum(one.verdict != Verdict.UNDECIDED for one in judgements)
    expected = 4000 * 0.05 / 40
    # an interval that never fails is too wide
    assert 0 < wrong <= expected + 4.0 * math.sqrt(expected)


def test_no_impact_is_a_poisson_count_and_exact_values_are_exact():
    def run(paths, periods):
        return long_result(0.0, 0.0, periods=periods)

    found = judge_level(1.0, "rate_above", 1e-2, run)
    assert (found.verdict, found.estimate) == (BELOW_LEVEL, 0.0)
    assert 0.0 < found.high < 1e-2
    assert judge_level(1.0, "rate_above", 1e-9, run).verdict == Verdict.UNDECIDED
    exact = long_result(0.5000001, 0.0, "periodic")
    assert judge_level(1.0, "rate_above", 0.5, lambda *_: exact).verdict == ABOVE_LEVEL


def test_the_crossing_is_between_its_two_values(results):
    """Long runs with other random numbers agree on both sides."""
    (edge,) = results["crossing"].edges
    assert max(edge) / min(edge) <= 1.2 / 0.8 * 1.01
    for amplitude, sign in ((edge.below, -1.0), (edge.above, 1.0)):
        long = stationary(
            LOUD.with_gears(alpha=amplitude / DAT21.backlash1),
            periods=256,
            paths=64,
            rng=11,
            closures=(),
        )
        row = long.table_in("physical").loc["power"]
        assert sign * (row["value"] - 1000.0) > -4.0 * row["se"]


def test_drag_ends_the_rattle():
    """Without noise the closed teeth of a single stage lose no energy beyond its threshold of
    rattle."""
    scene = Scene(alpha=1.5, epsilon=0.4, beta1=0.3, gamma1=1.0, stages=1)
    found = crossing(
        scene, quantity="rate", level=0.1, over="gamma1", between=(0.5, 3.0), points=4, width=0.05
    )
    (edge,) = found.edges
    assert edge.above < scene.alpha * math.hypot(1.0, scene.beta1) < edge.below


def test_where_a_level_that_is_not_crossed_may_be_is_said():
    sides = [
        SideOfLevel(20.0, ABOVE_LEVEL, 64, 0.9, 0.89, 0.91, ""),
        SideOfLevel(320.0, ABOVE_LEVEL, 64, 0.5, 0.49, 0.51, ""),
    ]
    found = Crossing(LOUD, "open_share_mesh1", 0.2, "torque1", (), pd.DataFrame(sides), "N mm")
    assert found.answer[1] == "If it does, it is above 320 N mm."
