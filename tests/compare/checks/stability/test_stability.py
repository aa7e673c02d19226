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
    AXES,
    BIASED,
    UNBIASED,
    UNSTABLE,
    judge,
    moderate,
    reference,
)
from rattle.compare.checks.stability.page import answer
from rattle.montecarlo import SCHEMES, default_step, largest_step

CHART_PATHS = 8192
Z_OF_CHART = 4.5  # of the rows of all cells below at a family error below 1 %
CORNERS = {"beta": 100.0, "gap": 1e-8, "sigma": 1e4, "epsilon": 1.0}
STEPPED_SCHEMES = [name for name, kind in SCHEMES.items() if kind.has_step_bias]


@pytest.fixture(scope="module")
def corner():
    return {
        axis: (
            scene := moderate(**{axis: value}),
            reference(scene, paths=4 * CHART_PATHS, seed=1),
        )
        for axis, value in CORNERS.items()
    }


def verdict(scene, beside, scheme, share, paths=CHART_PATHS):
    dt = share * largest_step(scene, scheme)[0]
    return judge(scene, beside, scheme=scheme, dt=dt, paths=paths, seed=0, z=Z_OF_CHART)


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
@pytest.mark.parametrize("scheme", STEPPED_SCHEMES)
def test_longer_than_admissible_steps_are_biased_or_unstable(corner, axis, scheme):
    assert verdict(*corner[axis], scheme, 4.0, 2048).verdict in (BIASED, UNSTABLE)


WRONG_FIELDS = {
    "drag": {"gamma1": 1.0, "gamma2": 0.5},
    "noise": {"sigma": 0.36},
    "restitution": {"epsilon": 0.85},
}


@pytest.fixture(scope="module")
def middle():
    return reference(moderate(), paths=2 * CHART_PATHS, seed=1)


@pytest.mark.parametrize(("scheme", "wrong"), [*zip(SCHEMES, WRONG_FIELDS, strict=True)])
def test_negative_control_of_a_scheme_is_biased(middle, scheme, wrong):
    control = replace(moderate(), **WRONG_FIELDS[wrong])
    found = judge(control, middle, scheme=scheme, dt=5e-4, paths=CHART_PATHS, seed=0, z=Z_OF_CHART)
    assert found.verdict == BIASED


@pytest.mark.parametrize("gap", [AXES["gap"][1][0], AXES["gap"][1][-1]])
def test_exact_flights_without_noise_are_the_orbit(gap):
    scene = replace(moderate(gap=gap), sigma=0.0)
    found = verdict(scene, reference(scene, paths=1, seed=1), "exact-flight", 1.0, 1)
    assert found.verdict == UNBIASED
    assert found.error < 1e-3


def test_restitution_of_nothing_has_no_limit():
    scene = moderate(epsilon=0.0)
    # any: it is not what decides
    beside = reference(moderate(epsilon=0.5), paths=1024, seed=1)
    found = judge(scene, beside, scheme="euler-maruyama", dt=0.01, paths=1024, seed=0, z=Z_OF_CHART)
    assert found.verdict == charts.COLLAPSING
    assert found.diagnosed


def run(tmp_path, words, code=0):
    small = "check stability --axis sigma --points 2 --paths 1000 --no-extremes"
    return rattle(f"{small} {words} --out", tmp_path / "map", code=code)


def test_command_writes_map_tables_and_page(tmp_path):
    run(tmp_path, "--scheme euler-maruyama --scheme exact-flight")
    folder = tmp_path / "map"
    page = (folder / "stability.md").read_text(encoding="utf-8")
    opening = page[: page.index("\n## ")]
    assert "(verdicts.svg)" in opening
    assert opening.count("\n| ") == 3  # heads, and the worst cell of each scheme
    answer = manifest_of(folder)["answer"]
    assert answer[0].startswith("Take `exact-flight`: at its default step ")
    rows = pd.read_csv(folder / "stability.csv")
    assert len(rows) == 2 * 2 * 7
    for row in rows[rows["default"]].itertuples():
        dt = default_step(moderate(**{row.axis: row.value}), row.scheme)
        assert row.dt == pytest.approx(dt, rel=1e-4)
    assert "Ensemble.diagnostics" in page


def test_an_interrupted_map_computes_what_is_missing(tmp_path, monkeypatch):
    settings = {"points": 2, "paths": 1000, "seed": 0, "workers": 2, "folder": tmp_path}
    whole = charts.chart(["exact-flight"], ["epsilon"], **settings).table
    next((tmp_path / "cells").glob("*.parquet")).unlink()
    begun = []
    own = charts.reference
    monkeypatch.setattr(
        charts, "reference", lambda scene, **how: begun.append(scene) or own(scene, **how)
    )
    pd.testing.assert_frame_equal(
        charts.chart(["exact-flight"], ["epsilon"], **settings).table, whole, check_exact=True
    )
    assert len(begun) == 1


def test_an_extreme_that_does_not_hold_is_on_the_page_and_in_the_exit_code(tmp_path, monkeypatch):
    about = {"quantity": "beta", "statement": "0 to 1e3", "reference": "a limit", "unit": "each"}
    rows = {
        "E": extreme(lambda: [2e-16], name="E", allowed=4e-15, **about),
        "u": extreme(lambda: [5.0], name="u", allowed=4.5, **about),
    }
    monkeypatch.setattr(extremes, "EXTREMES", rows)
    done = run(tmp_path, "--scheme exact-flight --points 1 --extremes", code=1)
    assert "1 of 2 extremes of the formulas and samplers hold." in done.output
    page = (tmp_path / "map" / "stability.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.) \|.*[✓✗]", page[page.index("## Extreme") :], re.MULTILINE)
    assert rows == ["E", "u"]


def test_undiagnosed_bias_ends_with_an_exit_code(tmp_path, monkeypatch):
    monkeypatch.setattr(charts.Ensemble, "diagnostics", ())
    done = run(tmp_path, "--scheme euler-maruyama", code=1)
    assert "without a diagnostic: a defect." in done.output


def test_the_advice_and_the_key_figure_count_the_cells():
    row = {
        "scheme": "exact-flight",
        "axis": "beta",
        "default": True,
        "share": 0.1,
        "verdict": UNBIASED,
    }
    cells = [
        row,
        row,
        row | {"scheme": "euler-maruyama"},
        row | {"scheme": "euler-maruyama", "verdict": BIASED},
    ]
    # refused: counts nowhere
    longer = [row | {"default": False, "share": 4.0, "verdict": UNSTABLE}]
    table = pd.DataFrame(cells + longer).assign(diagnosed=True)
    said = answer(charts.Chart(table, 4.5))
    assert (
        said[0]
        == "Take `exact-flight`: at its default step 2 of 2 scenes, extreme ones among them, are"
        " shown to be unbiased and none to be biased (unbiased: 1 for `euler-maruyama`)."
    )
