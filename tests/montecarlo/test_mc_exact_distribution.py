"""Exact flights have the distribution that they had before their trials were made cheaper: a committed table."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from exact_distribution import SIGMAS, averages, grouped
from mc_checks import FALSE_ALARM, dat21
from scipy import stats

REFERENCE = Path(__file__).parent / "data" / "exact_flight_distribution.csv"
"""Of the scheme at version 0.2, with its step of pi / 256: 64 groups of `exact_distribution`, 10^7 paths."""

GROUPS, PATHS = 24, 8192
FREEDOM = GROUPS - 1  # fewer than the groups of the table


def same(table, reference):
    """Whether means, sds and correlations agree to standard errors of few groups, corrected for their number.

    Skewness is left to the large samples: at sigma = 0.1 its estimate is biased in groups as small as these.
    """
    both = table.rename_axis(reference.index.names).join(reference.add_suffix("_before"), how="inner").dropna()
    both = both[~both.index.get_level_values("statistic").str.startswith("skewness")]
    both = both[(both.se > 1e-9) & (both.se_before > 1e-9)]  # the rest varies by rounding
    assert 250 < len(both) < 300
    score = (both.value - both.value_before) / np.hypot(both.se, both.se_before)
    return bool(score.abs().max() < stats.t.isf(0.5 * FALSE_ALARM / len(both), FREEDOM))


@pytest.fixture(scope="module")
def reference():
    return pd.read_csv(REFERENCE, index_col=["sigma", "impact", "statistic"], dtype={"sigma": str})


@pytest.mark.parametrize("name", SIGMAS)
def test_section_statistics_are_those_of_the_table(name, reference):
    assert same(averages(grouped(dat21(SIGMAS[name]), GROUPS, PATHS, seed=2)), reference.loc[name])


@pytest.mark.parametrize("change", [{"sigma": 0.102}, {"epsilon": 0.898}])
def test_another_scene_is_seen(change, reference):
    scene = replace(dat21(0.1), **change)
    assert not same(averages(grouped(scene, GROUPS, PATHS, seed=2)), reference.loc["0.1"])
