"""``rattle validate`` answers for the file's own noise first, and its sweep over σ follows a
budget."""

import re

import pandas as pd
import pytest
from commands import manifest_of, rattle
from scenes import dat21

from rattle import validate

pytestmark = pytest.mark.usefixtures("undrawn", "few_beside")

SWEPT = (
    "validate --sigma 0.1 --paths 600 --impacts 2 --closure saltation --over sigma=1e-3:1:5"
    " --validity-paths 600"
)


def repeated(out, words, code=0):
    """What the command that sweeps says and writes; it is repeated."""
    done = rattle(f"{SWEPT} {words} --out {out}", code=code)
    assert (
        "Repeated bit for bit."
        in rattle(f"validate --repeat {out / 'manifest.json'} --out {out}-again").stdout
    )
    return done


def test_an_interrupt_of_the_sweep_leaves_a_whole_page_that_says_what_is_missing(
    tmp_path, monkeypatch
):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("rattle.compare.validation.report_run.sweep", stop)
    out = tmp_path / "report"
    done = repeated(out, "", code=130)
    assert done.stdout.startswith("For this gear pair")
    assert (
        f"the page is written, without the range of validity: {out / 'report.html'}" in done.stderr
    )
    missing = manifest_of(out)["answer"][-1]
    assert missing.startswith("The range of validity over σ is missing: ")
    assert missing in (out / "report.md").read_text()


def test_a_small_budget_measures_a_part_says_so_and_is_repeated(tmp_path):
    said = repeated(tmp_path / "report", "--budget 1e-3").stdout
    assert re.search(
        r"measured at 2 of 5 noise intensities, for a budget of 0\.001 .*`--budget \d+`", said
    )
    assert set(pd.read_csv(tmp_path / "report/validity.csv")["sigma"]) == {0.001, 1.0}


def test_fixed_times_can_be_left_out():
    whole, section = (
        validate(dat21(0.1), impacts=2, paths=600, closures=["saltation"], fixed_times=at).table
        for at in (True, False)
    )
    pd.testing.assert_frame_equal(
        section, whole.query("kind != 'fixed time'").reset_index(drop=True)
    )
