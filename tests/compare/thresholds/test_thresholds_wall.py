"""Which rows of a claim are judged."""

from pathlib import Path

import pytest

from rattle.compare.thresholds.claim import read_claim
from rattle.compare.thresholds.decision import errors_of, judge_errors, predict
from rattle.montecarlo import simulate
from rattle.montecarlo.settings.plan import Sampling
from rattle.scene import DAT21, InputError, Scene

SCENE = Scene.from_gears(DAT21, sigma=0.02)


@pytest.fixture(scope="module")
def drawn():
    return simulate(SCENE, paths=2048, impacts=2, scheme="exact-flight", sampling=Sampling(control=True))


def test_the_wall_is_no_row_of_a_claim(drawn):
    claim = read_claim({"scene": SCENE, "impacts": 2, "quantities": ["x1", "x2"]}, Path())
    rows = judge_errors(errors_of(predict("saltation", claim), drawn, claim), 3.0)
    struck = {(k, f"x{mesh}") for k, mesh in drawn.section["mesh"].items()}
    assert {(r.impact, r.quantity) for r in rows.itertuples()} == {
        (k, q) for k in (1, 2) for q in ("x1", "x2")
    } - struck
    assert len(rows) == 4


def test_a_claim_of_the_wall_alone_is_refused(drawn):
    quantity = f"x{drawn.section.loc[1, 'mesh']}"
    claim = read_claim({"scene": SCENE, "impacts": [1], "quantities": quantity}, Path())
    with pytest.raises(InputError, match="none of these rows has a verdict"):
        errors_of(predict("saltation", claim), drawn, claim)
