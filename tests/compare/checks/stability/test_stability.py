"""The map: runs with admissible steps are unbiased or carry a diagnostic, and negative controls are
rejected."""

import re
from dataclasses import replace

import pandas as pd
import pytest
from commands import manifest_of, rattle

from rattle.compare.checks import extremes
from rattle.compare.checks.extremes import extreme
from rattle.compare.checks.stability import chart as charts
from rattle.compare.checks.stability.chart import (
    BIASED,
    UNBIASED,
    UNSTABLE,
    judge,
    moderate,
    reference,
)
from rattle.montecarlo import SCHEMES, default_step, largest_step

CHART_PATHS = 8192
CORNERS = {"beta": 100.0, "gap": 1e-8, "sigma": 1e4, "epsilon": 1.0}


@pytest.fixture(scope="module")
def corner():
    return {
        axis: (
            scene := moderate(**{axis: value}),
            reference(scene, paths=4 * CHART_PATHS, seed=1),
        )
        for axis, value in CORNERS.items()
    }


def judged(scene, beside, scheme, dt, paths=CHART_PATHS):
    # of the rows of all cells below at a family error below 1 %
    return judge(scene, beside, scheme=scheme, dt=dt, paths=paths, seed=0, z=4.5)


def verdict(scene, beside, scheme, share, paths=CHART_PATHS):
    return judged(scene, beside, scheme, share * largest_step(scene, scheme)[0], paths)


@pytest.mark.parametrize("axis", CORNERS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_admissible_steps_are_unbiased_or_diagnosed(corner, axis, scheme):
    found = verdict(*corner[axis], scheme, 1.0)
    assert found.verdict != UNSTABLE, found
    assert found.verdict != BIASED or found.diagnosed, found
    if scheme == "exact-flight":
        assert found.verdict in (UNBIASED, charts.CHART_UNDECIDED), found
        assert not found.diagnosed


@pytest.mark.parametrize("axis", CORNERS)
@pytest.mark.parametrize("scheme", [name for name, kind in SCHEMES.items() if kind.has_step_bias])
def test_longer_than_admissible_steps_are_biased_or_unstable(corner, axis, scheme):
    assert verdict(*corner[axis], scheme, 4.0, 2048).verdict in (BIASED, UNSTABLE)


WRONG_FIELDS = {
    "drag": {"gamma1": 1.0, "gamma2": 0.5},
    "noise": {"sigma": 0.36},
    "restitution": {"epsilon": 0.85},
}


@pytest.mark.parametrize(("scheme", "wrong"), [*zip(SCHEMES, WRONG_FIELDS, strict=True)])
def test_negative_control_of_a_scheme_is_biased(scheme, wrong):
    middle = reference(moderate(), paths=2 * CHART_PATHS, seed=1)
    assert (
        judged(replace(moderate(), **WRONG_FIELDS[wrong]), middle, scheme, 5e-4).verdict == BIASED
    )


def run(tmp_path, words, code=0):
    small = "check stability --axis sigma --points 2 --paths 1000 --no-extremes"
    return rattle(f"{small} {words} --out", tmp_path / "map", code=code)


def test_command_writes_map_tables_and_page(tmp_path):
    run(tmp_path, "--scheme euler-maruyama --scheme exact-flight")
    folder = tmp_path / "map"
    page = (folder / "stability.md").read_text()
    opening = page[: page.index("\n## ")]
    assert "(verdicts.svg)" in opening
    assert opening.count("\n| ") == 3  # heads, and the worst cell of each scheme
    assert manifest_of(folder)["answer"][0] == (
        "Take `exact-flight`: at its default step 1 of 2 scenes, extreme ones among them, are shown"
        " to be unbiased and none to be biased (unbiased: 0 for `euler-maruyama`)."
    )
    rows = pd.read_csv(folder / "stability.csv")
    assert len(rows) == 2 * 2 * 7
    assert (rows.query("value == 0.0 and scheme == 'exact-flight'")["error"] < 1e-3).all()
    for row in rows[rows["default"]].itertuples():
        dt = default_step(moderate(**{row.axis: row.value}), row.scheme)
        assert row.dt == pytest.approx(dt, rel=1e-4)
    assert "Ensemble.diagnostics" in page


def test_an_interrupted_map_computes_what_is_missing(tmp_path):
    settings = {"points": 2, "paths": 1000, "seed": 0, "workers": 2, "folder": tmp_path}
    whole = charts.chart(["euler-maruyama"], ["epsilon"], **settings).table
    # restitution of nothing
    assert set(whole.query("value == 0.0 and diagnosed")["verdict"]) == {charts.COLLAPSING}
    stored, lost = sorted((tmp_path / "cells").glob("*.parquet"))
    lost.unlink()
    written = stored.stat().st_mtime_ns
    pd.testing.assert_frame_equal(
        charts.chart(["euler-maruyama"], ["epsilon"], **settings).table, whole, check_exact=True
    )
    assert lost.exists()
    assert stored.stat().st_mtime_ns == written


def test_an_extreme_that_does_not_hold_is_on_the_page_and_in_the_exit_code(tmp_path, monkeypatch):
    about = {"quantity": "beta", "statement": "0 to 1e3", "reference": "a limit", "unit": "each"}
    rows = {
        "E": extreme(lambda: [2e-16], name="E", allowed=4e-15, **about),
        "u": extreme(lambda: [5.0], name="u", allowed=4.5, **about),
    }
    monkeypatch.setattr(extremes, "EXTREMES", rows)
    done = run(tmp_path, "--scheme exact-flight --points 1 --extremes", code=1)
    assert "1 of 2 extremes of the formulas and samplers hold." in done.output
    assert re.findall(
        r"^\| (E|u) \|.*[✓✗]", (tmp_path / "map/stability.md").read_text(), re.MULTILINE
    ) == ["E", "u"]


def test_undiagnosed_bias_ends_with_an_exit_code(tmp_path, monkeypatch):
    monkeypatch.setattr(charts.Ensemble, "diagnostics", ())
    assert (
        "without a diagnostic: a defect." in run(tmp_path, "--scheme euler-maruyama", code=1).output
    )
