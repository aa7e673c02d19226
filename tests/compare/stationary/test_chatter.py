"""Gears that chatter: what is fast stands first, chatter is said to be chatter, and pages of gears
are physical."""

import math

import numpy as np
import pytest
from places import ORDINARY_PAIR

import rattle as rt
from rattle import Scene
from rattle.closure.stationary import Law
from rattle.compare.report.save import save
from rattle.compare.stationary.page import answer, make_report
from rattle.compare.stationary.verdicts import values_of
from rattle.montecarlo.long_run.estimates import all_names


@pytest.fixture(scope="module")
def found():
    closures = ["published", "saltation"]
    return rt.stationary(Scene.load(ORDINARY_PAIR), periods=64, paths=32, closures=closures)


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
    n = 200_000
    zero = np.zeros(2)
    mean = np.array([0.05, 0.4])
    sd = np.array([0.08, 0.3])
    law = Law(2.0, np.array([0.7, 0.3]), np.ones(2, int), mean, sd, mean, zero, mean, zero)
    values = values_of(law, Scene(alpha=1.0, epsilon=0.5, beta1=0.0, gamma1=0.0, stages=1), 0.1)
    rng = np.random.default_rng(1)
    which = (rng.random(n) < 0.3).astype(int)
    drawn_speeds = rng.normal(mean[which], sd[which])
    fast = drawn_speeds[drawn_speeds > 0.1]
    skewness = ((fast - fast.mean()) ** 3).mean() / fast.std() ** 3
    for name, drawn, error in (
        ("rate_above", 2.0 * fast.size / n, 0.01),
        ("speed_above", fast.mean(), 0.005),
        ("sd_speed_above", fast.std(), 0.01),
        ("skew_speed_above", skewness, 0.03),
        ("q50_speed_above", np.median(fast), 0.01),
    ):
        assert values[name] == pytest.approx(drawn, rel=error), name


@pytest.mark.usefixtures("undrawn")
def test_a_page_of_gears_is_physical_throughout(found, tmp_path):
    facts = dict.fromkeys(("name", "field", "commit", "command"), "")
    facts |= {"seed": 0, "wall_seconds": 0.0, "versions": {}, "scene": found.scene.to_dict()}
    save(tmp_path / "out", make_report(found, None, facts), overwrite=False)
    text = (tmp_path / "out" / "stationary.md").read_text()
    assert "of impacts at 1.88 mm/s or faster" in text
    assert "slower than 0.1" not in text
    row = "closure == 'published' and quantity == 'rate'"
    (rate,) = found.verdicts_in("physical").query(row).to_dict("records")
    assert rate["unit"] == "1/s"
    assert rate["simulated"] == pytest.approx(found.table_in("physical").loc["rate", "value"])
    predicted = found.verdicts.query(row)["predicted"].item()
    assert rate["predicted"] == pytest.approx(157.0 * predicted)
    figures = found.figures()
    assert figures["distribution"].axes[0].get_yscale() == "log"
    for figure in figures.values():
        labels = [label for ax in figure.axes for label in (ax.get_xlabel(), ax.get_ylabel())]
        assert not any("omega" in label for label in labels)
