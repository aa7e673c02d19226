"""Every ``--json`` output and every JSON file is strict JSON, and one module writes all of them."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import commands, rattle, strict, study
from places import ROOT

from rattle.compare.checks import extremes
from rattle.compare.checks.extremes import extreme
from rattle.compare.report.json_text import json_text, plain
from rattle.compare.report.save import csv_text

BOX = ROOT / "examples/gearbox.toml"
SINGLE_STAGE = (
    "[scene]\nalpha = 1.5\nepsilon = 0.9\nbeta1 = 0.08\ngamma1 = 0.05\nstages = 1\nsigma = 0.1\n"
)
SMALL_RUNS = {
    "validate": "--paths 64 --impacts 2 --dt 0.01 --no-validity --sigma 0.1 --out out",
    "simulate": "scene.toml --paths 64 --impacts 2 --dt 0.01",
    "check order": "--impacts 1 --paths 64",
    "check speed": "",
    "study": "study.toml",
    "check published": "--result bouncing-ball",
    "check extremes": "",
    "drive": f"{BOX.parent}/measured-drive.toml --out out",
    "judge": "predicted.csv samples.csv --out out",
    "boundary": "--impacts 1 --over sigma=0.001:2:2 --width 0.9 --out out",
    "sensitivity": "scene.toml --parameter epsilon --quantity power --accuracy 1 --out out",
    "run-up": f"{BOX} --over speed_rpm=800:900:2 --seconds 1 --budget 1 --out out",
    "stationary": "scene.toml --paths 64 --periods 64 --closure saltation --out out",
}
"""A small run of each command that has ``--json``; `assess` has its own (tests/compare/assess)."""


def test_these_are_all_commands_with_json():
    with_json = {name for name, made in commands() if any("--json" in p.opts for p in made.params)}
    assert with_json == {*SMALL_RUNS, "assess"}


@pytest.mark.usefixtures("undrawn", "few_beside")
@pytest.mark.parametrize("command", SMALL_RUNS)
def test_every_command_prints_strict_json_and_writes_it(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(study("σ \\u202e\\u009b", sigma=(0.0, 0.1)))
    # without a second stage, and so without numbers for it
    (tmp_path / "scene.toml").write_text(SINGLE_STAGE)
    (tmp_path / "predicted.csv").write_text("time,x,sd_x\n0.5,1.0,2.0\n")
    (tmp_path / "samples.csv").write_text("path,time,x\n0,0.5,1.0\n1,0.5,2.0\n")
    row = extreme(
        lambda: [math.inf],
        allowed=1.0,
        **dict.fromkeys(("name", "quantity", "statement", "reference"), "β"),
    )
    monkeypatch.setattr(extremes, "EXTREMES", {"β": row})  # all of them take a minute
    speeds = pd.DataFrame({"ns": [1.5, np.nan]}, index=["a", "b"])
    monkeypatch.setattr("rattle.montecarlo.bench.bench", lambda: speeds)
    assert strict(
        rattle(
            f"{command} {SMALL_RUNS[command]} --json", code=1 if command == "check extremes" else 0
        ).stdout
    )
    for path in tmp_path.rglob("*.json"):
        strict(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "path", sorted((ROOT / "reports").rglob("*.json")), ids=lambda p: p.parent.name + "-" + p.name
)
def test_committed_files_are_strict(path):
    strict(path.read_text(encoding="utf-8"))


def test_what_is_no_number_is_null_and_what_is_numpys_is_plain():
    data = {
        "a": (np.float64("nan"), -math.inf, np.float32(0.5), np.int64(2), np.bool_(True)),
        "b": {"at": Path("x/y"), 3: np.array([[0.1 + 0.2, math.nan]]), "c": pd.Series([1, 2])},
    }
    b = {"at": "x/y", "3": [[0.1 + 0.2, None]], "c": [1, 2]}
    assert strict(json_text(data)) == {"a": [None, None, 0.5, 2, True], "b": b} == plain(data)


def test_numbers_in_csv_are_whole_and_texts_harmless():
    table = pd.DataFrame(
        {"x": [0.1 + 0.2, np.nan], "why": ["a\x1b[31m\n\u202eb", None], "n": [1, 2]}
    )
    assert (
        csv_text(table, index=False)
        == "x,why,n\n0.30000000000000004,a\\x1b[31m\\n\\u202eb,1\n,,2\n"
    )
