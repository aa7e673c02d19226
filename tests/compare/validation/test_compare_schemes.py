"""On the page of a validation: Euler-Maruyama ensembles beside exact flights and closures; orders
and a memory."""

import pandas as pd
import pytest
from commands import rattle
from scenes import dat21
from settings import EULER, EXACT, LOCATED

from rattle import Order, validate

pytestmark = pytest.mark.usefixtures("undrawn")


def test_the_report_of_dat21_shows_every_scheme_and_closure_with_bias_and_time(tmp_path):
    report = tmp_path / "dat21"
    words = "validate --sigma 0.01 --impacts 2 --paths 4096 --closure saltation --no-validity --out"
    rattle(words, report)
    page = (report / "report.html").read_text()
    assert "Euler–Maruyama beside exact flights and the closures" in page
    rows = pd.read_csv(report / "schemes.csv")
    assert rows["method"].tolist() == [EXACT, EULER, LOCATED, "saltation"]
    exact, *stepped, _ = rows.to_dict("records")
    assert exact["error_mean"] < 0.1
    assert exact["bias_mean"] == 0.0
    for row in stepped:
        assert row["error_mean"] == pytest.approx(row["bias_mean"], rel=0.4)
        assert row["error_mean"] > 5.0 * exact["error_mean"]


def test_the_page_shows_the_drive_and_says_that_no_rare_branch_was_looked_for(tmp_path):
    other = dat21(0.02, drive=[Order(1), Order(3, 0.2)], correlation_time=1.0)
    for scene, is_other in ((dat21(0.02), False), (other, True)):
        page = validate(scene, impacts=2, closures=["saltation"], paths=2000).report(
            tmp_path / str(is_other)
        )
        assert (page.parent / "figures/drive.svg").exists() == is_other
        assert (
            "Rare branches are searched for with white noise only" in page.read_text()
        ) == is_other
