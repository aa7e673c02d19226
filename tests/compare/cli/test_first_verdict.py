"""``rattle validate`` answers for the file's own noise first, and its sweep over σ follows a
budget."""

import json
import math
import re
from functools import partial

import pandas as pd
import pytest
from commands import rattle as command

from rattle import validate
from rattle.compare.report.interrupt import EXIT_INTERRUPTED
from rattle.compare.validation import report_run as module
from rattle.compare.validation.answer import UNFINISHED
from rattle.compare.validation.validate import STRIDES, count_work, sweep
from rattle.scene import DAT21, Scene

SWEPT = [
    "--paths",
    600,
    "--impacts",
    2,
    "--closure",
    "saltation",
    "--validity",
    "1e-3:1:5",
    "--validity-paths",
    600,
]
SMALL = {"impacts": 2, "paths": 600, "rng": 0, "closures": ["saltation"], "workers": 1}
rattle = partial(command, "validate", *SWEPT, "--sigma", 0.1)


def read(out):
    return json.loads((out / "manifest.json").read_text())


@pytest.fixture
def interrupted(monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "sweep", stop)


@pytest.mark.usefixtures("interrupted", "undrawn")
def test_an_interrupt_of_the_sweep_leaves_a_whole_page_that_says_what_is_missing(tmp_path):
    out = tmp_path / "o"
    said = rattle("--out", out, code=EXIT_INTERRUPTED)
    assert said.stdout.startswith("For this gear pair")
    assert (
        f"the page is written, without the range of validity: {out / 'report.html'}" in said.stderr
    )
    assert read(out)["answer"][-1] == UNFINISHED
    assert UNFINISHED in (out / "report.md").read_text()
    command("validate", "--repeat", out / "manifest.json", "--out", tmp_path / "again")
    assert read(tmp_path / "again")["table_sha256"] == read(out)["table_sha256"]


@pytest.mark.usefixtures("interrupted", "undrawn")
def test_a_sweep_that_stops_leaves_nothing_of_an_earlier_page(tmp_path):
    out = tmp_path / "o"
    command("validate", *SWEPT[:4], "--sigma", 0.5, "--no-validity", "--out", out)
    rattle("--out", out, "--overwrite", code=EXIT_INTERRUPTED)
    assert set(pd.read_csv(out / "table.csv")["sigma"]) == {0.1}


@pytest.mark.usefixtures("undrawn")
def test_a_small_budget_measures_a_part_says_so_and_is_repeated(tmp_path):
    out = tmp_path / "o"
    said = rattle("--out", out, "--budget", 1e-3).stdout
    assert re.search(
        r"measured at 2 of 5 noise intensities, for a budget of 0\.001 .*`--budget \d+`", said
    )
    assert set(pd.read_csv(out / "validity.csv")["sigma"]) == {0.001, 1.0}
    again = command(
        "validate", "--repeat", out / "manifest.json", "--out", tmp_path / "again"
    ).stdout
    assert "Repeated bit for bit." in again


@pytest.mark.usefixtures("undrawn")
def test_each_sentence_is_printed_once(tmp_path):
    lines = rattle("--out", tmp_path / "o").stdout.splitlines()
    openings = [line[:40] for line in lines]
    assert len(set(openings)) == len(openings)
    assert sum(line.startswith("Range of validity") for line in lines) == 1
    assert lines[-1] == f"Report: {tmp_path / 'o' / 'report.html'}"


@pytest.mark.usefixtures("undrawn")
def test_json_is_one_object_printed_at_the_end(tmp_path):
    found = json.loads(rattle("--out", tmp_path / "o", "--json").stdout)
    assert any(sentence.startswith("Range of validity") for sentence in found["answer"])


@pytest.mark.parametrize("budget", ["0", "-1", "nan"])
def test_a_budget_is_positive(budget, tmp_path):
    assert "budget" in rattle("--out", tmp_path / "o", "--budget", budget, code=2).stderr


def test_a_part_of_a_sweep_spans_its_range_and_is_in_order():
    sigmas = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
    scene = Scene.from_gears(DAT21)
    one = count_work(validate(scene.with_sigma(0.01), scheme="exact-flight", **SMALL))
    part = sweep(scene, sigmas, budget=2.5 * one, **SMALL)
    measured = list(part.validity["sigma"].unique())
    assert measured == sorted(sigmas[:: STRIDES[0]])
    assert part.left_out == len(sigmas) - len(measured)
    assert part.all_work == pytest.approx(len(sigmas) * one, rel=0.3)


def test_all_of_a_sweep_is_the_same_in_any_order():
    scene = Scene.from_gears(DAT21)
    whole = sweep(scene, (0.01, 0.02, 0.04), budget=math.inf, **SMALL)
    assert whole.left_out == 0
    for sigma in (0.01, 0.02, 0.04):
        alone = sweep(scene, (sigma,), **SMALL)
        rows = whole.validity[whole.validity["sigma"] == sigma].reset_index(drop=True)
        pd.testing.assert_frame_equal(rows, alone.validity)


def test_fixed_times_can_be_left_out():
    scene = Scene.from_gears(DAT21, sigma=0.1)
    plain = validate(scene, **SMALL)
    without = validate(scene, fixed_times=False, **SMALL)
    section = plain.table[plain.table["kind"] != "fixed time"].reset_index(drop=True)
    assert len(section) < len(plain.table)
    pd.testing.assert_frame_equal(without.table, section)
