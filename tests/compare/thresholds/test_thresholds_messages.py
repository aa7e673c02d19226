"""What the plugin advises can be followed, and its sentences hold for one row and for many."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rattle import DAT21, InputError, Scene
from rattle.compare.stationary.page import _off_by
from rattle.compare.thresholds.claim import read_claim
from rattle.compare.thresholds.decision import predict_long
from rattle.compare.thresholds.messages import PATHS_OF_AN_HOUR, describe_undecided, remedies

SCENE = Scene.from_gears(DAT21, sigma=0.02)
CLAIM = read_claim({"scene": SCENE, "impacts": 1}, Path())


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
        assert said.startswith("saltation is undecided in 1 of 1 rows; ")
        assert "tolerance" in said
        assert "e+" not in said


def test_section_moments_among_quantities_of_the_long_run_are_sent_to_the_marker():
    for given in ("tau", ["rate", "y1"]):
        with pytest.raises(
            InputError,
            match=r"quantities = '(tau|y1)': is a moment at each impact: name it in the marker",
        ):
            predict_long("corrected", SCENE, given)
    with pytest.raises(InputError, match="quantities = 'rat': did you mean 'rate'"):
        predict_long("corrected", SCENE, "rat")
    values = predict_long(lambda scene, names: {"rate": 2.0}, SCENE, "rate").values
    assert values == {"rate": 2.0}


@pytest.mark.parametrize(
    ("autocorrelation", "said"), [(0.25, "2 times too large"), (4.0, "2 times too small")]
)
def test_an_error_is_too_large_or_too_small_by_more_than_one(autocorrelation, said):
    assert _off_by(autocorrelation) == said
    assert _off_by(1.32) == "1.1 times too small"
