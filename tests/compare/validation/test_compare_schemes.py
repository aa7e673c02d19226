"""Euler-Maruyama ensembles on the page of a validation, beside exact flights and the closures."""

import pandas as pd
import pytest
from commands import rattle


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reports") / "dat21"
    words = "validate --sigma 0.01 --impacts 2 --paths 4096 --closure saltation --no-validity --out"
    rattle(*words.split(), folder)
    return folder


def test_the_report_of_dat21_shows_every_scheme_and_closure_with_bias_and_time(report):
    assert "Euler–Maruyama beside exact flights and the closures" in (report / "report.html").read_text("utf-8")
    rows = pd.read_csv(report / "schemes.csv").set_index("method")
    assert list(rows.index) == ["exact-flight", "euler-maruyama", "euler-maruyama-located", "saltation"]
    assert (rows["core_seconds"] > 0.0).all()
    assert rows.loc["exact-flight", "error_mean"] < 0.1
    assert rows.loc["exact-flight", "bias_mean"] == 0.0
    for scheme in ("euler-maruyama", "euler-maruyama-located"):
        assert rows.loc[scheme, "error_mean"] == pytest.approx(rows.loc[scheme, "bias_mean"], rel=0.4)
        assert rows.loc[scheme, "error_mean"] > 5.0 * rows.loc["exact-flight", "error_mean"]
