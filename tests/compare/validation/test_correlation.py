"""Validity of the correlation coefficient on both sides."""

import numpy as np
import pytest

from rattle import validate
from rattle.compare.validation.errors import SIMULATED, first_failure
from rattle.scene import DAT21, Scene


@pytest.fixture(scope="module")
def validation():
    return validate(Scene.from_gears(DAT21, sigma=1.5**0.5), impacts=6, paths=20_000, rng=3, workers=2)


def test_published_breaks_down_at_impact_2_and_nothing_else_does(validation):
    impact, _, reason = first_failure(validation.correlation, "published")
    assert impact == 2
    assert "variance" in reason
    assert first_failure(validation.correlation, "corrected") is None
    assert first_failure(validation.correlation, SIMULATED) is None


def test_every_rho_that_exists_is_tabulated(validation):
    table = validation.correlation
    assert set(table["closure"]) == {"published", "corrected", "saltation", SIMULATED}
    for closure in ("corrected", "saltation", SIMULATED):
        rows = table[table["closure"] == closure]
        assert len(rows) == 6 * 2
        assert (rows["rho"].abs() <= 1.0).all()
        assert (rows["smallest_eigenvalue"] >= -1e-12).all()


def test_first_flight_rho_is_right_and_a_wrong_one_is_caught(validation):
    """Until the first impact every closure's stage-1 moments are exact, at any noise intensity."""
    fixed = validation.table.query("kind == 'fixed time' and impact == 1 and quantity == 'rho1'").set_index("closure")
    row = fixed.loc["corrected"]
    assert row["low"] < 0.0 < row["high"]
    assert row["verdict"] == "accurate"
    # negative control: the interval is narrow enough to detect an error of 0.1
    assert row["high"] - row["low"] < 0.1


def test_no_noise_has_no_correlation_rows():
    v = validate(Scene.from_gears(DAT21), impacts=3, paths=10)
    assert set(v.table["kind"]) == {"section", "itinerary"}
    corrected = v.table.query("closure == 'corrected' and moment == 'mean'")
    assert (corrected["verdict"] != "inaccurate").all()  # nothing varies, and the step decides no better than 1e-5
    np.testing.assert_allclose(corrected["error"], 0.0, atol=1e-5)
