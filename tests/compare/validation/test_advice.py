"""The sentence of advice: what to take up to where, and what a simulation costs beyond it."""

import math

import pandas as pd
import pytest

from rattle.compare import validate
from rattle.compare.report.glossary import TERMS, glossary
from rattle.compare.validation.advice import advice, duration
from rattle.compare.validation.figures import error_figure
from rattle.compare.validation.speed import WANTED, simulation_cost
from rattle.montecarlo import simulate_to
from rattle.scene import DAT21, InputError, Scene

SIGMAS = (0.01, 0.1, 1.0)
COST = pd.DataFrame({"sigma": SIGMAS, "impacts": 12, "paths": [500, 9_000, 11_000], "seconds": [0.05, 1.8, 2.2]})


def table(**closures):
    """Ranges of validity over `SIGMAS`: for each closure pairs of accurate and not inaccurate."""
    rows = [(name, s, *pair) for name, pairs in closures.items() for s, pair in zip(SIGMAS, pairs, strict=True)]
    return pd.DataFrame(rows, columns=["closure", "sigma", "accurate", "not_inaccurate"])


def speeds(**closures):
    rows = [(name, s, gain) for name, gains in closures.items() for s, gain in zip(SIGMAS, gains, strict=True)]
    return pd.DataFrame(rows, columns=["closure", "sigma", "speed_up"])


WRONG, ALL, OPEN = (0, 0), (12, 12), (3, 12)
CASES = {
    "one closure, then simulate": (
        {"published": [WRONG] * 3, "saltation": [ALL, (3, 3), WRONG]}, None,
        "For this gear pair take `saltation` up to σ = 0.01; beyond it simulate: 12 impacts to 1% of an sd take about "
        "2 s.",
    ),
    "what is undecided beyond is not denied": (
        {"saltation": [ALL, WRONG, WRONG], "branching": [ALL, OPEN, WRONG]}, None,
        "For this gear pair take `saltation` up to σ = 0.01; beyond it simulate (`branching` is not shown wrong at "
        "0.1: more paths would decide): 12 impacts to 1% of an sd take about 2 s.",
    ),
    "the faster first, then the one that goes further": (
        {"branching": [ALL, ALL, WRONG], "saltation": [ALL, WRONG, WRONG]},
        {"branching": [20.0, 2.0, math.nan], "saltation": [400.0, math.nan, math.nan]},
        "For this gear pair take `saltation` up to σ = 0.01 and `branching` up to σ = 0.1; beyond it simulate: 12 "
        "impacts to 1% of an sd take about 2 s.",
    ),
    "not where a simulation is faster": (
        {"branching": [ALL, ALL, WRONG], "saltation": [ALL, WRONG, WRONG]},
        {"branching": [20.0, 0.3, math.nan], "saltation": [400.0, math.nan, math.nan]},
        "For this gear pair take `saltation` up to σ = 0.01; beyond it simulate: 12 impacts to 1% of an sd take about "
        "2 s.",
    ),
    "accurate, but slower than a simulation everywhere": (
        {"branching": [ALL, WRONG, WRONG]}, {"branching": [0.3, math.nan, math.nan]},
        "For this gear pair simulate: 12 impacts to 1% of an sd take about 50 ms to 2 s, by the noise; `branching` is "
        "accurate up to σ = 0.01, but a simulation of equal accuracy is faster.",
    ),
    "accurate throughout": (
        {"saltation": [ALL] * 3}, None,
        "For this gear pair take `saltation` up to σ = 1, the largest noise intensity compared: all means and sds at "
        "12 impacts are accurate there.",
    ),
    "luck after a gap does not count": (
        {"branching": [ALL, (3, 3), ALL]}, None,
        "For this gear pair take `branching` up to σ = 0.01; beyond it simulate: 12 impacts to 1% of an sd take about "
        "2 s.",
    ),
    "none is right": (
        {"published": [WRONG] * 3, "saltation": [(3, 3), WRONG, WRONG]}, None,
        "For this gear pair no closure is right for means and sds at 12 impacts (`saltation` is for the first 3) at "
        "σ = 0.01, the smallest compared: simulate; 12 impacts to 1% of an sd take about 50 ms to 2 s, by the noise.",
    ),
    "undecided from the start": (
        {"published": [WRONG] * 3, "saltation": [OPEN, OPEN, WRONG]}, None,
        "For this gear pair no closure is shown to be right at σ = 0.01, the smallest compared, and `saltation` is not "
        "shown wrong: take more paths to decide, or simulate: 12 impacts to 1% of an sd take about 50 ms to 2 s, by "
        "the noise.",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_advice(case):
    ranges, gains, said = CASES[case]
    speed = None if gains is None else speeds(**gains)
    assert advice(table(**ranges), 12, simulation=COST, speed=speed) == said


def test_no_time_is_stated_where_none_was_measured():
    ranges = table(saltation=[ALL, WRONG, WRONG])
    untimed = advice(ranges, 12, simulation=COST.assign(seconds=math.nan))
    assert untimed.endswith("12 impacts to 1% of an sd take about 9,000 paths to 10,000 paths, by the noise.")
    assert advice(ranges, 12).endswith("simulate: `rattle simulate` states what 12 impacts to 1% of an sd take.")


def test_a_single_noise_intensity():
    one = table(saltation=[ALL] * 3).iloc[:1]
    assert advice(one, 12).startswith("For this gear pair take `saltation` at σ = 0.01, the only noise intensity")


@pytest.mark.parametrize(
    ("seconds", "said"), [(3e-5, "0.03 ms"), (0.96, "1 s"), (94.0, "90 s"), (96.0, "2 min"), (6000.0, "2 h")]
)
def test_durations_have_one_digit(seconds, said):
    assert duration(seconds) == said


@pytest.fixture(scope="module")
def v():
    scene = Scene.from_gears(DAT21, sigma=0.02)
    return validate(scene, impacts=2, closures=["saltation"], paths=4_000, scheme="exact-flight", rng=1)


def test_the_cost_is_that_of_a_run_to_the_accuracy(v):
    scene = Scene.from_gears(DAT21, sigma=0.3)
    pilot = validate(scene, impacts=2, closures=["corrected"], paths=16_384, scheme="exact-flight", rng=1)
    cost = simulation_cost(pilot, 1e-6)
    run = simulate_to(scene, WANTED, impacts=2, scheme="exact-flight", rng=2)
    assert 0.7 < cost.paths / run.paths < 1.4
    assert cost.seconds == pytest.approx(cost.paths * 2e-6)
    assert math.isnan(simulation_cost(v).seconds)


def test_legend_names_each_colour_once_and_ticks_are_whole_impacts(v):
    figure = error_figure(v)
    labels = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert len(labels) == len(set(labels)) == 2
    assert sum("accurate" in label for label in labels) == 1
    assert all(float(tick).is_integer() for ax in figure.axes for tick in ax.get_xticks())


def test_every_term_is_explained_in_one_sentence_and_unknown_ones_are_refused():
    assert all(meaning and not meaning.endswith(".") and len(meaning) < 200 for meaning in TERMS.values())
    with pytest.raises(InputError, match="is not explained"):
        glossary("σ", "phlogiston")
