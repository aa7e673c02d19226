"""``rattle validate`` answers for the file's own noise first, and its sweep over σ follows a
budget."""

import re

import pandas as pd
import pytest
from commands import manifest_of, rattle
from scenes import dat21

from rattle import validate

SWEPT = (
    "validate --sigma 0.1 --paths 600 --impacts 2 --closure saltation --over sigma=1e-3:1:5"
    " --validity-paths 600"
)


@pytest.mark.usefixtures("undrawn", "few_beside")
def test_an_interrupt_of_the_sweep_leaves_a_whole_page_that_says_what_is_missing(
    tmp_path, monkeypatch
):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("rattle.compare.validation.report_run.sweep", stop)
    out = tmp_path / "report"
    done = rattle(f"{SWEPT} --out {out}", code=130)
    assert done.stdout.startswith("For this gear pair")
    unfinished = f"the page is written, without the range of validity: {out / 'report.html'}"
    assert unfinished in done.stderr
    record = manifest_of(out)
    assert record["answer"][-1].startswith("The range of validity over σ is missing: ")
    assert record["answer"][-1] in (out / "report.md").read_text()
    again = rattle(f"validate --repeat {out / 'manifest.json'} --out {tmp_path / 'again'}")
    assert "Repeated bit for bit." in again.stdout


@pytest.mark.usefixtures("undrawn", "few_beside")
def test_a_small_budget_measures_a_part_says_so_and_is_repeated(tmp_path):
    out = tmp_path / "report"
    printed = rattle(f"{SWEPT} --budget 1e-3 --out {out}").stdout
    part = r"measured at 2 of 5 noise intensities, for a budget of 0\.001 .*`--budget \d+`"
    assert re.search(part, printed)
    assert set(pd.read_csv(out / "validity.csv")["sigma"]) == {0.001, 1.0}
    again = rattle(f"validate --repeat {out / 'manifest.json'} --out {tmp_path / 'again'}")
    assert "Repeated bit for bit." in again.stdout


def test_fixed_times_can_be_left_out():
    scene = dat21(0.1)
    settings = {"impacts": 2, "paths": 600, "closures": ["saltation"]}
    whole = validate(scene, **settings).table
    section = validate(scene, fixed_times=False, **settings).table
    expected = whole[whole["kind"] != "fixed time"].reset_index(drop=True)
    pd.testing.assert_frame_equal(section, expected)
