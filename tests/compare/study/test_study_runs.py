"""Nothing is computed twice, nothing is lost: killed, interrupted, shared, damaged and full."""

import os
import re
import shutil
import signal
import threading
import time
from pathlib import Path

import pandas as pd
import pytest
from commands import manifest_of, rattle, study
from figures import leave_undrawn
from programs import python, start
from refusals import refusal
from scenes import RARE
from studies import CELLS_FOLDER, compute, study_text

from rattle import Study, Tolerances, load_study
from rattle.compare.study.impacts_page import answer

pytestmark = pytest.mark.usefixtures("undrawn")
SIGNALLED = Path(__file__).with_name("signalled.py")
CELLS = f"{CELLS_FOLDER}/*.parquet"


def digests(folder):
    record = manifest_of(folder)
    return record["errors_sha256"], record["sections_sha256"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of the small study, run without interruption."""
    file = tmp_path_factory.mktemp("whole") / "small.toml"
    file.write_text(study_text())
    with pytest.MonkeyPatch.context() as patch:
        leave_undrawn(patch)
        assert "9 results computed" in rattle(f"study {file}").output
    return file.with_suffix("")


@pytest.fixture
def small(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text(study_text())
    return file


def test_tables_load_in_one_line(whole):
    results = load_study(whole)
    assert len(results.errors) == 3 * 2 * 2 * 2 * 6  # sigma, closure, impact, moment, quantity
    assert {"rate", "energy"} < set(results.sections["quantity"])
    loose = results.judged(Tolerances(1e9, 1e9))
    assert (loose["verdict"] == "excluded").equals(~loose["judged"])
    assert "inaccurate" not in set(loose["verdict"])
    data = results.to_xarray()
    at = {"closure": "saltation", "sigma": 0.02, "impact": 2, "quantity": "y1", "moment": "sd"}
    assert (
        float(data["error"].sel(at)) == results.errors.set_index([*at])["error"][tuple(at.values())]
    )
    assert data["quantity"].attrs["y1"] == "backlash1 omega"
    with refusal("there is nothing to draw at"):
        results.plot("errors", gap1=3)


@pytest.mark.slow
def test_killed_and_resumed_is_the_same_to_the_last_bit(whole, small):
    """Killed before the fourth result has its name, and with a page that is half in its place."""
    out = small.with_suffix("")
    for name, number, stored in ((".parquet", 4, 3), (".page-", 3, 9)):
        python(SIGNALLED, "SIGKILL", name, number, "study", small, code=-signal.SIGKILL)
        kept = [(p, p.stat().st_mtime_ns) for p in out.glob(CELLS)]
        assert len(kept) == stored
        assert list(out.rglob(".*"))  # what is half written
    assert not (out / "manifest.json").exists()
    rattle(f"study {small}")
    assert digests(out) == digests(whole)
    assert [(p, p.stat().st_mtime_ns) for p in out.glob(CELLS)] == kept
    assert not list(out.rglob(".*"))


@pytest.mark.slow
def test_two_processes_share_the_work(whole, small):
    """The other one is suspended as it makes a file of its second result, until this one has made
    another."""
    out = small.with_suffix("")
    other = start(SIGNALLED, "SIGSTOP", ".parquet", 2, "study", "--workers", 1, small)
    ended = os.waitid(os.P_PID, other.pid, os.WEXITED | os.WSTOPPED | os.WNOWAIT)
    assert ended.si_code == os.CLD_STOPPED

    def go_on():
        end = time.monotonic() + 600.0  # of compiling, on a busy machine
        while len(list(out.glob(CELLS))) < 2 and time.monotonic() < end:
            time.sleep(0.01)
        other.send_signal(signal.SIGCONT)

    threading.Thread(target=go_on).start()
    rattle(f"study {small} --workers 1")
    _, err = other.communicate(timeout=600)
    assert other.returncode == 0, err
    assert digests(out) == digests(whole)
    done = re.findall(r" (\d+) done ", (out / "study.log").read_text())
    assert len(done) == 9  # each cell once
    assert len({*done}) == 2  # and both took part


def test_damaged_files_are_computed_again(tmp_path):
    study = Study.from_toml(study_text(paths=1024))
    before = compute(study, tmp_path).errors
    files = [*(tmp_path / CELLS_FOLDER).glob("*.parquet")]
    half, other, flipped, empty, *sound = files
    bits = bytearray(flipped.read_bytes())
    bits[400] ^= 1
    half.write_bytes(half.read_bytes()[:1000])
    other.write_bytes(sound[0].read_bytes())
    flipped.write_bytes(bits)
    empty.write_bytes(b"")
    times = [file.stat().st_mtime_ns for file in files]
    after = compute(study, tmp_path, workers=3).errors
    pd.testing.assert_frame_equal(after, before, check_exact=True)
    changed = [file.stat().st_mtime_ns != at for file, at in zip(files, times, strict=True)]
    assert changed == [True] * 4 + [False] * len(sound)


def test_a_value_more_computes_its_cells_only(whole, small):
    assert "0 of 9 results stored" in rattle(f"study {small} --status").output
    assert not small.with_suffix("").exists()
    shutil.copytree(whole, small.with_suffix(""))
    small.write_text(study_text(sigmas=(0.01, 0.02, 0.05, 0.1)))
    assert "12 cells, 3 to compute" in rattle(f"study {small} --explain").output
    assert "3 results computed, 12 stored" in rattle(f"study {small}").output
    assert "All 12 results are stored" in rattle(f"study {small}").output


def test_an_estimate_from_some_points_is_that_of_all(tmp_path, monkeypatch):
    """Counts to the last cell; work to 1.2 %, four standard errors of the mean of 100 cells that
    vary by 3 %.  Nothing is as long as the number of blocks of 10^12 paths."""
    axes = "[[axes]]\nseed = [1, 2]\n[[axes]]\nepsilon = { linear = [0.5, 0.9, 4] }\n"
    text = study_text(paths=10**12, more=axes).replace("seed = 3", "")
    file = tmp_path / "grid.toml"
    file.write_text(text.replace("[0.01, 0.02, 0.05]", "{ log = [0.01, 20.0, 15] }"))
    made = []
    point = Study._point
    monkeypatch.setattr(Study, "_point", lambda study, at: made.append(at) or point(study, at))

    def explained(looked_at):
        monkeypatch.setattr("rattle.compare.cli.study.LOOKED_AT", looked_at)
        found = re.findall(
            "([0-9]+) (points|cells|to compute|core-seconds)",
            rattle(f"study {file} --explain").output,
        )
        return {word: int(number) for number, word in reversed(found)}

    sampled = explained(100)
    assert len(made) == 100
    whole = explained(1000)
    # predictions do not know the seed
    counts = {"points": 120, "cells": 240, "to compute": 240}
    assert sampled == counts | {"core-seconds": pytest.approx(whole["core-seconds"], rel=0.012)}
    assert whole == whole | counts
    assert not file.with_suffix("").exists()


def test_what_a_closure_cannot_take_is_said_once_with_exit_code_1(tmp_path):
    """A closure that does not cover a start in flight, and one that does, at six points."""
    file = tmp_path / "s.toml"
    start = '[[axes]]\n"start.mesh" = [0]\n"start.x1" = [0.1]\n"start.x2" = [0.1]\n'
    start += "[[axes]]\nepsilon = [0.8, 0.9]\n"
    file.write_text(study_text(paths=512, more=start).replace('"corrected"', '"published"'))
    for option, code in (("--explain", 0), ("", 1), ("--status", 0)):
        said = rattle(f"study {file} {option}", code=code).output
        assert said.count("cannot be computed") == 1
        assert "published cannot be computed at 6 of 6 points, first at sigma = 0.01" in said
        assert "start.mesh = 0: " in said
    assert len(load_study(tmp_path / "s").reasons) == 6


UNDECIDED = study(
    impacts=4,
    closures=("saltation", "published"),
    paths=3000,
    sigma=(0.01, 0.02),
    more='scheme = "euler-maruyama-located"\nseed = 1',
)


def test_undecided_is_not_called_wrong(tmp_path):
    """At the smallest value no row of a closure is inaccurate and some are undecided."""
    tables = compute(Study.from_toml(UNDECIDED), tmp_path)
    verdicts = {*tables.errors.query("sigma == 0.01 and closure == 'saltation'")["verdict"]}
    assert {"accurate", "undecided"} <= verdicts
    assert "inaccurate" not in verdicts
    headline, _, published, saltation, _ = answer(tables)
    assert headline.startswith("Undecided: no closure is shown to be accurate over 4 impacts")
    assert saltation.startswith(
        "`saltation`: not shown wrong up to sigma = 0.02 (too few paths to decide"
    )
    assert published == "`published`: shown wrong at sigma = 0.01, the smallest."


def test_paths_on_the_itinerary_are_judged_apart_where_asked_for(tmp_path):
    text = study_text(sigmas=(0.02, 0.1), paths=32_768).replace('"corrected"', '"branching"')
    apart, without = (
        compute(
            Study.from_toml(text.replace("seed", f"on_itinerary = {name}\nseed")), tmp_path / name
        )
        for name in ("true", "false")
    )
    pd.testing.assert_frame_equal(apart.of_all_paths.reset_index(drop=True), without.errors)
    pd.testing.assert_frame_equal(apart.validity, without.validity)
    rows = apart.errors.query("kind == 'itinerary' and closure == 'branching'")
    assert "accurate" in set(rows["verdict"])
    assert "inaccurate" not in set(rows["verdict"])
    assert "Of the paths on the noise-free itinerary alone:" in answer(apart)


def test_rare_branches_are_sampled_where_asked_for(tmp_path):
    """Three in a million paths make the sd of y1 at impact 11 3.8 times that of `saltation`: plain
    paths see none."""
    head = 'title = "rare"\nimpacts = 11\nclosures = ["saltation"]\npaths = 8192\n'
    axis = "[[axes]]\nsigma = [0.0, 0.00225778]\n"
    plain, near = (
        compute(
            Study.from_toml(f"[study]\n{head}near_branches = {name}\n{RARE.to_toml()}{axis}"),
            tmp_path / name,
        ).errors.query("moment == 'sd'")
        for name in ("false", "true")
    )
    at = "sigma > 0 and quantity == 'y1' and impact == 11"
    assert plain.query(at)["verdict"].item() == "undecided"
    (row,) = near.query(at).to_dict("records")
    assert row["verdict"] == "inaccurate"
    assert abs(row["simulated"] - 0.0094) < 4.0 * (row["se"] + 0.0001)  # of 65,536 paths near it
    assert row["paths"] == 32_768
