"""Nothing is computed twice, nothing is lost: killed, interrupted, shared, damaged and full."""

import json
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial

import pandas as pd
import pytest
from commands import rattle as command
from commands import study
from study_files import study_text, tables_of

from rattle import InputError, Study, Tolerances, load_study
from rattle.closure import mean_map
from rattle.compare.engine.run import CELLS_FOLDER, Runner, run
from rattle.compare.engine.store import Store
from rattle.compare.judge.verdict import JUDGED
from rattle.compare.study.figures import validity
from rattle.compare.study.impacts_page import answer
from rattle.scene import DAT21, Scene

rattle = partial(command, "study")
SLOW = {"sigmas": (0.01, 0.02, 0.03, 0.04, 0.05, 0.06), "paths": 40_000}


def start(file, *words):
    command = [
        sys.executable,
        "-m",
        "rattle.compare.cli.main",
        "study",
        str(file),
        "--workers",
        "1",
        *words,
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(folder, pattern, number, seconds=600.0):  # of compiling, on a busy machine
    end = time.monotonic() + seconds
    while len(list(folder.glob(pattern))) < number:
        assert time.monotonic() < end
        time.sleep(0.01)


def digests(folder):
    record = json.loads((folder / "manifest.json").read_text())
    return record["errors_sha256"], record["sections_sha256"]


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """A study that takes a few seconds, run without interruption."""
    folder = tmp_path_factory.mktemp("slow")
    file = folder / "noise.toml"
    file.write_text(study_text(**SLOW))
    rattle(file)
    return file, digests(folder / "noise")


@pytest.fixture
def small(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text(study_text())
    return file


def test_tables_load_in_one_line(slow):
    file, _ = slow
    results = load_study(file.with_suffix(""))
    assert len(results.errors) == 6 * 2 * 2 * 2 * 6  # sigma, closure, impact, moment, quantity
    assert set(results.sections["moment"]) == {"mean", "sd", "skew"}
    assert {"rate", "energy"} < set(results.sections["quantity"])
    assert set(results.errors.loc[~results.errors["judged"], "verdict"]) == {"excluded"}
    loose = results.judged(Tolerances(1e9, 1e9))
    assert set(loose["verdict"]) <= {"accurate", "excluded", "not predicted"}
    assert (loose["verdict"] == "excluded").equals(~loose["judged"])
    data = results.to_xarray()
    row = results.errors.query(
        "sigma == 0.02 and impact == 2 and quantity == 'y1' and moment == 'sd'"
    )
    row = row[row["closure"] == "saltation"].iloc[0]
    at = {"sigma": 0.02, "impact": 2, "quantity": "y1", "moment": "sd"}
    assert float(data["error"].sel(**at, closure="saltation")) == row["error"]
    assert float(data["simulated"].sel(**at)) == row["simulated"]
    assert data["quantity"].attrs["y1"] == "backlash1 omega"
    assert len(results.plot("errors").axes) == 4  # means and sds, at two impacts
    with pytest.raises(InputError, match="there is nothing to draw at"):
        results.plot("errors", gap1=3)


@pytest.mark.slow
def test_killed_and_resumed_is_the_same_to_the_last_bit(slow, tmp_path):
    _, whole = slow
    file = tmp_path / "noise.toml"
    file.write_text(study_text(**SLOW))
    out = tmp_path / "noise"
    for pattern, files in (
        (f"{CELLS_FOLDER}/*.parquet", 3),
        (f"{CELLS_FOLDER}/*.parquet", 9),
        (".page-*.part", 1),
    ):
        running = start(file)
        wait_for(out, pattern, files)
        running.send_signal(signal.SIGKILL)
        running.communicate()
        kept = {p.name: p.stat().st_mtime_ns for p in (out / CELLS_FOLDER).glob("*.parquet")}
        assert files <= len(kept) < (18 if files > 1 else 19)
    assert not (out / "manifest.json").exists()
    rattle(file)
    assert digests(out) == whole
    assert all((out / CELLS_FOLDER / name).stat().st_mtime_ns == at for name, at in kept.items())
    assert not list(out.rglob(".*"))  # nothing half written is left


@pytest.mark.slow
def test_two_processes_share_the_work(slow, tmp_path):
    _, whole = slow
    file = tmp_path / "noise.toml"
    file.write_text(study_text(**SLOW))
    first = start(file)
    wait_for(tmp_path / "noise", f"{CELLS_FOLDER}/*.parquet", 1)
    # so that the second has something to do, however late it is ready
    first.send_signal(signal.SIGSTOP)
    found = len(list((tmp_path / "noise").glob("cells/*.parquet")))
    second = start(file)
    wait_for(tmp_path / "noise", f"{CELLS_FOLDER}/*.parquet", found + 1)
    first.send_signal(signal.SIGCONT)
    for running in (first, second):
        _, err = running.communicate(timeout=600)
        assert running.returncode == 0, err
    assert digests(tmp_path / "noise") == whole
    log = (tmp_path / "noise" / "study.log").read_text()
    by = {line.split()[2] for line in log.splitlines() if " done " in line}
    assert log.count(" done ") == 18  # each cell once
    assert len(by) == 2  # and both took part


@pytest.mark.parametrize("damage", ["truncated", "foreign", "flipped", "empty"])
def test_a_damaged_file_is_computed_again(tmp_path, damage):
    study = Study.from_toml(study_text(paths=1024))
    store = Store(tmp_path / CELLS_FOLDER)
    run(study.cells, store, Runner(1))
    before = tables_of(study, store).errors
    first, second, *_ = sorted(store.folder.glob("*.parquet"))
    sound = first.read_bytes()
    flipped = bytearray(first.read_bytes())
    flipped[len(sound) // 8] ^= 1
    damaged = {
        "truncated": sound[: len(sound) // 2],
        "foreign": second.read_bytes(),
        "flipped": flipped,
        "empty": b"",
    }
    first.write_bytes(damaged[damage])
    assert run(study.cells, store, Runner(1)).computed == 1
    pd.testing.assert_frame_equal(tables_of(study, store).errors, before, check_exact=True)


@pytest.mark.usefixtures("undrawn")
def test_a_value_more_computes_its_cells_only(small):
    assert "9 results computed" in rattle(small).output
    small.write_text(study_text(sigmas=(0.01, 0.02, 0.05, 0.1)))
    assert "12 cells, 3 to compute" in rattle(small, "--explain").output
    assert "3 results computed, 12 stored" in rattle(small).output
    assert "All 12 results are stored" in rattle(small).output


def test_explain_and_status_make_nothing(small):
    for option in ("--explain", "--status"):
        assert "9" in rattle(small, option).output
        assert not small.with_suffix("").exists()


def test_explain_of_a_large_grid_makes_few_of_its_scenes(tmp_path, monkeypatch):
    """And nothing as long as the number of blocks of 10^12 paths."""
    sigmas = "{ log = [0.001, 1.0, 500] }"
    tips = "{ linear = [0.5, 0.9, 200] }"
    text = study_text(paths=10**12).replace("sigma = [0.01, 0.02, 0.05]", f"sigma = {sigmas}")
    (tmp_path / "large.toml").write_text(f"{text}\n[[axes]]\nepsilon = {tips}\n")
    made = []
    point = Study._point
    monkeypatch.setattr(Study, "_point", lambda study, at: made.append(at) or point(study, at))
    found = rattle(tmp_path / "large.toml", "--explain")
    assert "100000 points, about 300000 cells, about 300000 to compute" in found.output
    assert len(made) == 200
    assert not (tmp_path / "large").exists()


def test_an_estimate_from_some_points_is_that_of_all(tmp_path, monkeypatch):
    """Counts to the last cell; work to 1 %, four standard errors of the mean of 200 cells that vary
    by 3 %."""
    text = (
        study_text(paths=10**9)
        .replace("[0.01, 0.02, 0.05]", "{ log = [0.01, 20.0, 50] }")
        .replace("seed = 3", "")
    )
    file = tmp_path / "grid.toml"
    file.write_text(
        f"{text}\n[[axes]]\nseed = [1, 2]\n[[axes]]\nepsilon = {{ linear = [0.5, 0.9, 4] }}\n"
    )

    def explained():
        output = rattle(file, "--explain").output
        words = ("points", "cells", "to compute", "core-seconds")
        return [int(re.search(rf"([0-9]+) {word}", output)[1]) for word in words]

    sampled = explained()
    monkeypatch.setattr("rattle.compare.cli.study.LOOKED_AT", 1000)
    whole = explained()
    assert sampled[:3] == whole[:3] == [400, 800, 800]  # predictions do not know the seed
    assert sampled[3] == pytest.approx(whole[3], rel=0.01)


@pytest.mark.usefixtures("undrawn")
def test_what_a_closure_cannot_take_is_said_once_with_exit_code_1(tmp_path):
    """A closure that does not cover a start in flight, and one that does, at six points."""
    file = tmp_path / "s.toml"
    start = '[[axes]]\n"start.mesh" = [0]\n"start.x1" = [0.1]\n[[axes]]\nepsilon = [0.8, 0.9]\n'
    file.write_text(study_text(paths=512, more=start).replace('"corrected"', '"published"'))
    for words, code in (
        ((file, "--explain"), 0),
        ((file,), 1),
        ((file, "--status"), 0),
        ((file,), 1),
    ):
        found = rattle(*words, code=code)
        said = [text for text in found.output.splitlines() if "cannot be computed" in text]
        assert len(said) == 1, found.output
        assert "published cannot be computed at 6 of 6 points, first at sigma = 0.01" in said[0]
        assert "start.mesh = 0: " in said[0]
    page = (tmp_path / "s" / "study.md").read_text()
    assert page.count("start.mesh = 0: ") == 1
    assert len(load_study(tmp_path / "s").reasons) == 6


UNDECIDED = study(
    impacts=4,
    closures=("saltation", "published"),
    paths=3000,
    sigma=(0.01, 0.02),
    more='scheme = "euler-maruyama-located"\nseed = 1',
)


def test_undecided_is_not_called_wrong(tmp_path):
    """At the smallest value no row of a closure is inaccurate and some are undecided: text and
    figure say so."""
    study = Study.from_toml(UNDECIDED)
    store = Store(tmp_path / CELLS_FOLDER)
    run(study.cells, store, Runner(1))
    found = tables_of(study, store)
    first = found.errors.query("sigma == 0.01 and closure == 'saltation'")["verdict"].value_counts()
    assert "inaccurate" not in first
    assert first["accurate"] > 5
    assert first["undecided"] > 5
    headline, _, published, saltation, _ = answer(found)
    assert (
        headline
        == "Undecided: no closure is shown to be accurate over 4 impacts in every row of this"
        " study. Not shown to be wrong: `saltation` up to σ = 0.02. More paths would settle it;"
        " until then simulate."
    )
    assert saltation.startswith(
        "`saltation`: not shown wrong up to sigma = 0.02 (too few paths to decide"
    )
    assert published == "`published`: shown wrong at sigma = 0.01, the smallest."
    figure = validity(found, found.validity)
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "saltation: accurate up to" in words
    assert "not shown wrong up to" in words
    assert any(text.startswith("too few paths to decide") for text in words)
    assert "published: shown wrong at the smallest" in words
    (band,) = (
        c
        for c in figure.axes[0].collections
        if c.get_paths() and len(c.get_paths()[0].vertices) > 3
    )
    assert (
        band.get_paths()[0].vertices[:, 1].max() == 0.02
    )  # from the smallest up, though nothing is accurate


def test_results_do_not_depend_on_workers(tmp_path):
    study = Study.from_toml(study_text())
    tables = []
    for workers in (1, 3):
        store = Store(tmp_path / str(workers) / CELLS_FOLDER)
        run(study.cells, store, Runner(workers))
        tables.append(tables_of(study, store))
    pd.testing.assert_frame_equal(tables[0].errors, tables[1].errors, check_exact=True)
    pd.testing.assert_frame_equal(tables[0].paired, tables[1].paired, check_exact=True)


def test_a_folder_that_cannot_be_made_is_refused(small, tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert "cannot be made" in rattle(small, "--out", tmp_path / "file" / "deeper", code=2).output
    assert "cannot be read" in rattle(tmp_path / "absent.toml", code=2).output


def off(scene, impacts):
    """`saltation` with an sd that is a third too large."""
    return mean_map(scene, impacts=impacts).section.assign(sd_y2=lambda s: 1.33 * s["sd_y2"])


def test_paths_on_the_itinerary_are_judged_apart_where_asked_for(tmp_path):
    found = []
    for more in ("", "on_itinerary = true\n"):
        text = study_text(sigmas=(0.02, 0.1), paths=32_768).replace("paths =", f"{more}paths =", 1)
        study = replace(Study.from_toml(text), closures=("saltation", "branching", off))
        store = Store(tmp_path / CELLS_FOLDER)
        run(study.cells, store, Runner(1))
        found.append(tables_of(study, store))
    without, apart = found
    pd.testing.assert_frame_equal(apart.of_all_paths.reset_index(drop=True), without.errors)
    pd.testing.assert_frame_equal(apart.validity, without.validity)
    rows = apart.errors[
        (apart.errors["kind"] == "itinerary") & apart.errors["verdict"].isin(JUDGED)
    ]
    wrong = rows[(rows["closure"] == "off") & (rows["quantity"] == "y2") & (rows["moment"] == "sd")]
    assert set(wrong["verdict"]) == {"inaccurate"}
    assert "inaccurate" not in set(rows[rows["closure"] == "branching"]["verdict"])
    assert "Of the paths on the noise-free itinerary alone:" in answer(apart)


def test_rare_branches_are_sampled_where_asked_for(tmp_path):
    """Three in a million paths make the sd of y1 at impact 11 3.8 times that of `saltation`: plain
    paths see none."""
    found = []
    head = 'title = "rare"\nimpacts = 11\nclosures = ["saltation"]\npaths = 8192\n'
    scene = (
        Scene.from_gears(replace(DAT21, alpha=2.398)).to_toml()
        + "[[axes]]\nsigma = [0.0, 0.00225778]\n"
    )
    for more in ("", "near_branches = true\n"):
        study = Study.from_toml(f"[study]\n{head}{more}\n{scene}")
        store = Store(tmp_path / CELLS_FOLDER)
        run(study.cells, store, Runner(1))
        found.append(tables_of(study, store))
    rows = [one.errors.query("sigma > 0 and moment == 'sd'") for one in found]
    plain, near = (one.query("quantity == 'y1' and impact == 11").iloc[0] for one in rows)
    assert (plain["verdict"], near["verdict"]) == ("undecided", "inaccurate")
    assert abs(near["simulated"] - 0.0094) < 4.0 * (near["se"] + 0.0001)  # of 65,536 paths near it
    assert near["paths"] == 32_768
    still = [one.errors.query("sigma == 0").reset_index(drop=True) for one in found]
    pd.testing.assert_frame_equal(*still)
    others = [one.query("impact < 4") for one in rows]
    assert others[0]["verdict"].tolist() == others[1]["verdict"].tolist()


@pytest.mark.parametrize(
    ("given", "more", "named"),
    [
        ("accuracy = 0.01", "", "accuracy = 0.01"),
        ('paths = 64\nscheme = "euler-maruyama"', "", "scheme = euler-maruyama"),
        ("paths = 64", "[[axes]]\ncorrelation_time = [0.1, 0.2]\n", "correlation_time = 0.1"),
    ],
)
def test_what_excludes_rare_branches_is_named(given, more, named):
    text = study_text(more=more).replace("paths = 4096", f"near_branches = true\n{given}")
    with pytest.raises(InputError, match=f"near_branches.*{named}"):
        _ = Study.from_toml(text).points


def test_an_axis_may_be_named_like_a_column_of_the_tables(tmp_path):
    """The column then holds the value along the axis, once."""
    text = study_text(sigmas=(0.02,)).replace("paths = 4096", "")
    study = Study.from_toml(f"{text}\n[[axes]]\npaths = [1024, 2048]\n")
    store = Store(tmp_path / CELLS_FOLDER)
    run(study.cells, store, Runner(1))
    found = tables_of(study, store)
    for table in (found.errors, found.sections, found.cost):
        assert list(table).count("paths") == 1
        assert set(table["paths"]) == {1024, 2048}
    assert set(found.sections["followed"]) == {1024, 2048}
