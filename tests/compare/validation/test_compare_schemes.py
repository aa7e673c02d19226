"""On the page of a validation: Euler-Maruyama ensembles beside exact flights and closures; orders
and a memory."""

import pandas as pd
import pytest
from commands import rattle
from scenes import dat21

from rattle import Order, validate


@pytest.mark.usefixtures("undrawn")
def test_the_report_of_dat21_shows_every_scheme_and_closure_with_bias_and_time(tmp_path):
    report = tmp_path / "dat21"
    words = "validate --sigma 0.01 --impacts 2 --paths 4096 --closure saltation --no-validity --out"
    rattle(words, report)
    assert "Euler–Maruyama beside exact flights and the closures" in (
        report / "report.html"
    ).read_text("utf-8")
    rows = pd.read_csv(report / "schemes.csv").set_index("method")
    assert list(rows.index) == [
        "exact-flight",
        "euler-maruyama",
        "euler-maruyama-located",
        "saltation",
    ]
    assert rows.loc["exact-flight", "error_mean"] < 0.1
    assert rows.loc["exact-flight", "bias_mean"] == 0.0
    for scheme in ("euler-maruyama", "euler-maruyama-located"):
        error, bias = rows.loc[scheme, ["error_mean", "bias_mean"]]
        assert error == pytest.approx(bias, rel=0.4)
        assert error > 5.0 * rows.loc["exact-flight", "error_mean"]


FEW_PATHS = {"impacts": 2, "closures": ["saltation"], "paths": 2000}


@pytest.mark.usefixtures("undrawn")
def test_the_page_shows_the_drive_and_says_that_no_rare_branch_was_looked_for(tmp_path):
    plain = dat21(0.02)
    other = dat21(0.02, drive=[Order(1), Order(3, 0.2)], correlation_time=1.0)
    unsearched = "Rare branches are searched for with white noise only"
    for scene, has_orders in ((plain, False), (other, True)):
        page = validate(scene, **FEW_PATHS).report(tmp_path / str(has_orders))
        assert (page.parent / "figures" / "drive.svg").exists() == has_orders
        assert (unsearched in page.read_text()) == has_orders
