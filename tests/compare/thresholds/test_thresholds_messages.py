"""What the plugin advises can be followed, and its sentences hold for one row and for many."""

import re
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


@pytest.mark.parametrize(("columns", "kind"), [({"moment": ["mean"]}, "check"), ({}, "long check")])
def test_a_budget_is_suggested_only_where_it_can_be_waited_for(columns, kind):
    claim = read_claim({"scene": CHAOTIC, "impacts": 1}, Path())

    def said(needed):
        table = pd.DataFrame({"verdict": ["undecided"], "paths_needed": needed, **columns})
        return describe_undecided("saltation", table, lambda rows: "") + remedies(table, claim)

    few = said(0.2 * PATHS_OF_AN_HOUR[kind])
    assert "give it more paths (budget=" in few
    assert "paths would decide" in few
    for needed in (7e9, np.inf):
        assert "tolerance" in said(needed)
        assert not re.search(r"budget=|e\+", said(needed))


@pytest.mark.parametrize(
    ("model", "quantities", "message"),
    [
        ("saltation", [], "quantities"),
        ("saltation", "rat", "quantities = 'rat': did you mean 'rate'"),
        ("saltation", ["rate", "y1"], "quantities = 'y1': is a moment at each impact: name it in"),
        ("linear", ["rate"], "closure"),
        (lambda scene, names: {}, ["rate"], "missing"),
        (3, ["rate"], "model"),
        (lambda scene, names: {"rate": float("nan")}, ["rate"], "not predicted"),
    ],
)
def test_bad_claims_about_the_long_run_are_refused(model, quantities, message):
    with refusal(message):
        predict_long(model, IMPACT_PAIR.with_sigma(0.002), quantities)


def test_a_claim_about_a_long_run_that_no_closure_predicts_is_refused():
    with refusal("chaotic"):
        predict_long("saltation", CHAOTIC, ["rate"])
