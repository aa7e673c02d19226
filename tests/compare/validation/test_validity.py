"""How far a closure can be believed, and the words for it."""

from dataclasses import replace

import pytest
from scenes import dat21

from rattle import validate
from rattle.compare.judge.verdict import Verdict
from rattle.compare.validation.answer import answer, correlation_claim
from rattle.compare.validation.comparison import find_validities, find_validity
from rattle.compare.validation.errors import SIMULATED
from rattle.compare.validation.tables import count_verdicts


@pytest.fixture(scope="module")
def validations():
    scenes = [dat21(s) for s in (0.01, 0.5)]
    return [validate(s, impacts=6, paths=60_000, rng=2, workers=2) for s in scenes]


def test_right_closures_reach_the_end_at_small_noise(validations):
    table = find_validities(validations).set_index(["sigma", "closure"])
    for closure in ("saltation", "branching"):
        assert table.loc[(0.01, closure), ["accurate", "cause"]].tolist() == [6, "holds"]
    for closure in ("published", "corrected"):
        assert table["not_inaccurate"][0.01, closure] == 0


def test_causes_are_distinguished(validations):
    """Off its itinerary counts from the last impact that most paths reach on it."""
    quiet, loud = validations
    fixed = find_validity(quiet, "corrected")
    assert fixed.cause == "fixed time"
    assert "ignores that impact times vary" in fixed.why
    assert find_validity(quiet, "saltation").on_itinerary == 6
    off = find_validity(loud, "saltation")
    assert off.cause == "off itinerary"
    assert "have left its itinerary" in off.why
    assert off.on_itinerary == 0


def test_an_end_that_more_paths_would_decide_is_called_undecided():
    found = find_validity(
        validate(
            dat21(0.01),
            closures=["saltation"],
            impacts=4,
            paths=1200,
            scheme="euler-maruyama-located",
            rng=1,
        ),
        "saltation",
    )
    assert found.accurate < 4 == found.not_inaccurate
    assert found.cause == "undecided"
    assert found.why.startswith("too few paths to decide")
    assert f"from impact {found.accurate + 1} on" in found.why


def test_answer_is_advice_both_questions_cost_motion_and_three_sentences_with_the_counts(
    validations,
):
    first, both, cost, motion, counts, impossible, _ = answer(validations)
    assert first.startswith("For this gear pair take `saltation` at σ = 0.01 (all means")
    assert both.startswith(
        "On the itinerary, which all but fewer than one in a billion paths follow, `saltation` is "
    )
    assert cost.startswith("Nominal time on one core")
    assert motion.startswith("In the units of these gears: at σ = ")
    assert "`saltation` 60 of 60" in counts  # all but the displacement at the struck mesh
    assert "moments of `published` are impossible from impact 2 on" in impossible


def test_claim_about_rho_names_rule_and_impact(validations):
    claim = correlation_claim(validations)
    assert "Eq. 17, λ_np − κ m_np, which makes variances of stage 1 negative, and Eq. 15" in claim
    assert "the first being 2" in claim


def test_counts_range_of_validity_answer_and_requirement_follow_one_rule():
    """The sd of the displacement at the struck mesh is due to off-itinerary paths alone: no
    statement depends on it."""
    v = validate(dat21(0.1), impacts=3, closures=["saltation"], paths=60_000, rng=2)
    wall = v.table["quantity"] == v.table["impact"].map("x" + v.run.section["mesh"].astype(str))
    assert (wall == (v.table["verdict"] == Verdict.EXCLUDED)).all()
    # by its interval alone one of them is wrong
    assert not v.table[wall].query("low > tolerance or high < -tolerance").empty
    v = replace(v, table=v.table.assign(verdict=v.table["verdict"].where(wall, "accurate")))
    assert v.accurate
    found = find_validity(v, "saltation")
    assert (found.accurate, found.not_inaccurate) == (3, 3)
    counts = count_verdicts(v)
    assert not counts[["inaccurate", "undecided"]].any(axis=None)
    # means, sds, rho; those of the paths on its itinerary
    assert counts["excluded"].tolist() == [3, 3, 0, 3, 3]
    assert "`saltation` 30 of 30" in " ".join(answer([v]))


def test_every_rho_that_exists_is_tabulated(validations):
    table = validations[1].correlation
    assert set(table["closure"]) == {"published", "corrected", "saltation", SIMULATED}
    rows = table.query("closure != 'published'")
    assert len(rows) == 3 * 6 * 2
    assert (rows["rho"].abs() <= 1.0).all()


def test_first_flight_rho_is_right_and_a_wrong_one_is_caught(validations):
    """Until the first impact every closure's stage-1 moments are exact, at any noise intensity."""
    table = validations[1].table.query(
        "kind == 'fixed time' and impact == 1 and quantity == 'rho1'"
    )
    row = table.set_index("closure").loc["corrected"]
    assert row["low"] < 0.0 < row["high"]
    assert row["verdict"] == "accurate"
    # negative control: the interval is narrow enough to detect an error of 0.1
    assert row["high"] - row["low"] < 0.1
