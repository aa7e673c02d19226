"""What the plugin advises can be followed, and its sentences hold for one row and for many."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from refusals import refusal
from scenes import IMPACT_PAIR, dat21

from rattle.compare.thresholds.claim import read_claim
from rattle.compare.thresholds.decision import predict_long
from rattle.compare.thresholds.messages import PATHS_OF_AN_HOUR, describe_undecided, remedies

CHAOTIC = dat21(0.02)
CLAIM = read_claim({"scene": CHAOTIC, "impacts": 1}, Path())


def undecided(needed, **columns):
    return pd.DataFrame({"verdict": ["undecided"], "paths_needed": [needed], **columns})


@pytest.mark.parametrize(("columns", "kind"), [({"moment": ["mean"]}, "check"), ({}, "long check")])
def test_a_budget_is_suggested_only_where_it_can_be_waited_for(columns, kind):
    few = undecided(0.2 * PATHS_OF_AN_HOUR[kind], **columns)
    assert "give it more paths (budget=" in remedies(few, CLAIM)
    assert "paths would decide" in describe_undecided("saltation", few, lambda rows: "")
    for needed in (7e9, np.inf):
        many = undecided(needed, **columns)
        assert "budget=" not in remedies(many, CLAIM)
        said = describe_undecided("saltation", many, lambda rows: "")
        assert "tolerance" in said
        assert "e+" not in said


SECTION_MESSAGE = "is a moment at each impact: name it in the marker"


@pytest.mark.parametrize(
    ("model", "quantities", "message"),
    [
        ("saltation", [], "quantities"),
        ("saltation", "rat", "quantities = 'rat': did you mean 'rate'"),
        ("saltation", ["rate", "y1"], f"quantities = 'y1': {SECTION_MESSAGE}"),
        ("linear", ["rate"], "closure"),
        (lambda scene, names: {}, ["rate"], "missing"),
        (3, ["rate"], "model"),
        (lambda scene, names: {"rate": float("nan")}, ["rate"], "not predicted"),
    ],
)
def test_bad_claims_about_the_long_run_are_refused(model, quantities, message):
    with refusal(message):
        predict_long(model, IMPACT_PAIR.with_sigma(0.002), quantities)


def test_a_claim_about_the_long_run_is_predicted_where_it_can_be():
    with refusal("chaotic"):
        predict_long("saltation", CHAOTIC, ["rate"])
    values = predict_long(lambda scene, names: {"rate": 2.0}, CHAOTIC, "rate").values
    assert values == {"rate": 2.0}
