"""Gears that chatter: what is fast stands first, chatter is said to be chatter, and pages of gears
are physical."""

import math

import numpy as np
import pandas as pd
import pytest
from places import ORDINARY_PAIR
from scenes import IMPACT_PAIR

import rattle as rt
from rattle import Scene
from rattle.closure.stationary import Law
from rattle.compare.report.save import save
from rattle.compare.stationary.page import answer, make_report
from rattle.compare.stationary.verdicts import values_of
from rattle.montecarlo.long_run.estimates import all_names


@pytest.fixture(scope="module")
def found():
    return rt.stationary(
        Scene.load(ORDINARY_PAIR), periods=64, paths=32, closures=["published", "saltation"]
    )


def test_impacts_above_the_threshold_stand_first(found):
    """Nine of ten impacts are slower than 1.9 mm/s; an orbit of 15 others a period is what is
    heard."""
    assert all_names(1)[:2] == ("rate_above", "speed_above")
    table = found.table["value"]
    assert table["rate_above"] == pytest.approx(15.0 / (2.0 * math.pi), rel=1e-3)
    assert table["q50_speed"] < 1e-3 < found.slow < table["q50_speed_above"]
    first, second, *_ = answer(found)
    assert "374.8" in first
    assert "impacts a second faster than 1.88 mm/s, half of them faster than 20" in first
    assert second.startswith("The others are chatter: 1,")
    assert "mesh 1 for 31 % of the time" in second


def test_a_law_above_the_threshold_is_that_of_a_sample():
    """A mixture of normal speeds, cut at the threshold, against its own random numbers."""
    zero = np.zeros(2)
    mean = np.array([0.05, 0.4])
    sd = np.array([0.08, 0.3])
    law = Law(2.0, np.array([0.7, 0.3]), np.ones(2, int), mean, sd, mean, zero, mean, zero)
    values = values_of(law, IMPACT_PAIR, 0.1)
    speeds = np.random.default_rng(1).normal(
        np.repeat(mean, [140_000, 60_000]), np.repeat(sd, [140_000, 60_000])
    )
    fast = pd.Series(speeds[speeds > 0.1])
    for name, drawn, error in (
        ("rate_above", 2.0 * fast.size / 200_000, 0.01),
        ("speed_above", fast.mean(), 0.005),
        ("sd_speed_above", fast.std(), 0.01),
        ("skew_speed_above", fast.skew(), 0.03),
        ("q50_speed_above", fast.median(), 0.01),
    ):
        assert values[name] == pytest.approx(drawn, rel=error), name


@pytest.mark.usefixtures("undrawn")
def test_a_page_of_gears_is_physical_throughout(found, tmp_path):
    facts = dict.fromkeys(("name", "field", "commit", "command"), "")
    facts |= {"seed": 0, "wall_seconds": 0.0, "versions": {}, "scene": found.scene.to_dict()}
    save(tmp_path / "out", make_report(found, None, facts), overwrite=False)
    text = (tmp_path / "out/stationary.md").read_text()
    assert "of impacts at 1.88 mm/s or faster" in text
    assert "slower than 0.1" not in text
    row = "closure == 'published' and quantity == 'rate'"
    (rate,) = found.verdicts_in("physical").query(row).to_dict("records")
    assert rate["unit"] == "1/s"
    assert rate["simulated"] == pytest.approx(found.table_in("physical")["value"]["rate"])
    assert rate["predicted"] == pytest.approx(157.0 * found.verdicts.query(row)["predicted"].item())
    figures = found.figures()
    assert figures["distribution"].axes[0].get_yscale() == "log"
    axes = [ax for figure in figures.values() for ax in figure.axes]
    assert not [ax for ax in axes if "omega" in ax.get_xlabel() + ax.get_ylabel()]
