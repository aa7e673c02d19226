"""How far a reading can be believed, and the words for it."""

import pytest

from compare import validate
from compare.answer import answer, correlation_claim
from compare.frontier import CAUSES, frontier, frontiers
from scene import DAT21, Scene


@pytest.fixture(scope="module")
def validations():
    scenes = [Scene.from_gears(DAT21, sigma=s) for s in (0.01, 0.5)]
    return [validate(s, impacts=6, paths=60_000, rng=2, workers=2) for s in scenes]


def test_right_readings_reach_the_end_at_small_noise(validations):
    table = frontiers(validations).set_index(["sigma", "reading"])
    for reading in ("saltation", "branching"):
        assert table.loc[(0.01, reading), "accurate"] == 6
        assert "holds" in table.loc[(0.01, reading), "why"]
    for reading in ("printed", "mended"):
        assert table.loc[(0.01, reading), "not_refuted"] == 0
    assert (table["accurate"] <= table["not_refuted"]).all()
    assert set(table["cause"]) <= set(CAUSES)


def test_causes_are_told_apart(validations):
    quiet, loud = validations
    assert "impact time does not vary" in frontier(quiet, "mended").why
    assert frontier(quiet, "mended").cause == "fixed instant"
    assert "have left its itinerary" in frontier(loud, "saltation").why
    assert frontier(loud, "saltation").cause == "parted"


def test_together_is_how_far_the_paths_share_an_itinerary(validations):
    quiet, loud = validations
    assert frontier(quiet, "saltation").together == 6
    assert loud.run.agreement["saltation"].loc[1] < 0.99
    assert frontier(loud, "saltation").together == 0


def test_an_end_that_more_paths_would_decide_is_called_undecided():
    v = validate(Scene.from_gears(DAT21, sigma=0.01), impacts=4, readings=["saltation"], paths=1200, rng=1)
    found = frontier(v, "saltation")
    assert found.not_refuted == 4
    assert found.accurate < 4
    assert found.cause == "undecided"
    assert "undecided from impact" in found.why


def test_answer_is_three_sentences_with_the_counts(validations):
    sentences = answer(validations)
    assert len(sentences) == 3
    rows = validations[0].table.query("reading == 'saltation' and kind == 'section'")
    right, predicted = (rows["verdict"] == "accurate").sum(), (rows["verdict"] != "not predicted").sum()
    assert f"saltation {right} of {predicted}" in sentences[0]
    assert "printed reading stops being realizable at impact 2" in sentences[1]


def test_claim_about_rho_names_rule_and_impact(validations):
    claim = correlation_claim(validations)
    assert "Eq. 15" in claim
    assert "the first being 2" in claim
    assert (
        correlation_claim([validate(Scene.from_gears(DAT21, sigma=0.01), impacts=1, readings=["mended"], paths=600)])
        == ""
    )
