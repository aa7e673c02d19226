"""The command ``rattle validate``, as a user meets it."""

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import rattle as command

from rattle.compare.cli.validate import EXIT_NOT_MET, EXIT_NOT_REPEATED
from rattle.compare.judge.verdict import ACCURATE_UP_TO, NOT_WRONG
from rattle.compare.report.manifest import digest, read_settings
from rattle.compare.validation.errors import RULE
from rattle.scene import DAT21, Scene, Start

SWEPT = [
    "--paths",
    "600",
    "--impacts",
    "3",
    "--dt",
    "0.01",
    "--validity",
    "0.01:1:3",
    "--validity-paths",
    "600",
]
SMALL = [*SWEPT, "--no-validity"]
rattle = partial(command, "validate")


FILES = {
    *("manifest.json", "report.md", "report.html", "figures"),
    *("table.csv", "correlation.csv", "leaving.csv", "validity.csv", "speed.csv"),
    *("simulation.csv", "schemes.csv", "table.parquet", "validity.parquet"),
}


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    out = tmp_path_factory.mktemp("reports") / "small"
    rattle(*SWEPT, "--sigma", 0.1, "--sigma", 1.0, "--seed", 5, "--out", out)
    return out


def test_report_folder_is_complete(report):
    assert {p.name for p in report.iterdir()} == FILES
    assert len(list((report / "figures").glob("*.svg"))) == 2 * 3 + 2
    for link in re.findall(r"\]\((figures/[^)]+)\)", (report / "report.md").read_text()):
        assert (report / link).is_file()


def test_page_begins_with_the_answer_and_states_once_what_is_judged(report):
    answer = json.loads((report / "manifest.json").read_text())["answer"]
    assert len(answer) == 8
    page = (report / "report.md").read_text()
    assert page.count(RULE) == 1
    assert f"| {ACCURATE_UP_TO} impact | {NOT_WRONG} |" in page
    places = [answer[0], "figures/validity.svg", answer[1], answer[-1], "##"]
    assert sorted(places, key=page.index) == places


@pytest.mark.parametrize(
    ("name", "sigmas"), [("table", {0.1, 1.0}), ("validity", {0.01, 0.1, 1.0})]
)
def test_tables_are_the_same_in_both_forms_and_timings_stand_apart(report, name, sigmas):
    csv = pd.read_csv(report / f"{name}.csv")
    parquet = pd.read_parquet(report / f"{name}.parquet")
    csv = csv.fillna({"remark": ""})  # text that a CSV file cannot tell from a missing value
    pd.testing.assert_frame_equal(csv, parquet, check_dtype=False, rtol=1e-15)
    assert set(csv["sigma"]) == sigmas
    assert not [name for name in csv if "seconds" in name]
    assert "closure_seconds" in pd.read_csv(report / "speed.csv")


@pytest.mark.usefixtures("undrawn")
def test_without_a_range_of_validity(tmp_path):
    out = tmp_path / "o"
    rattle(*SMALL, "--sigma", 0.1, "--out", out)
    assert not {"validity.csv", "speed.csv"} & {p.name for p in out.iterdir()}
    assert "validity.svg" not in (out / "report.md").read_text()
    assert json.loads((out / "manifest.json").read_text())["validity_sha256"] is None


def test_show_says_what_the_report_says(report):
    shown = command("show", report, "--width", 5000)
    record = json.loads((report / "manifest.json").read_text())
    for sentence in (*record["answer"], record["repeat"], record["table_sha256"]):
        assert sentence.replace("`", "") in shown.stdout


@pytest.mark.usefixtures("undrawn")
def test_repeats_bit_for_bit_for_any_workers(report, tmp_path):
    out = tmp_path / "again"
    result = rattle("--repeat", report / "manifest.json", "--workers", 3, "--out", out, "--json")
    assert json.loads(result.stdout)["repeated"] is True
    for name in ("table.csv", "validity.csv"):
        assert (out / name).read_bytes() == (report / name).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("changed", ["seed", "validity"])
@pytest.mark.usefixtures("undrawn")
def test_a_repeat_that_differs_says_so(report, tmp_path, changed):
    data = json.loads((report / "manifest.json").read_text())
    del data["seal"]  # as an earlier version wrote it
    data["settings"][changed] = {"seed": 6, "validity": [0.01, 0.1, 0.9]}[changed]
    manifest = tmp_path / "manifest.json"
    manifest.write_text(json.dumps(data))
    result = rattle("--repeat", manifest, "--out", tmp_path / "again", code=EXIT_NOT_REPEATED)
    assert "differ" in result.output


@pytest.mark.usefixtures("undrawn")
def test_require_accurate(tmp_path):
    rattle(
        *SMALL, "--sigma", 1.0, "--out", tmp_path / "no", "--require", "accurate", code=EXIT_NOT_MET
    )
    assert (tmp_path / "no" / "report.md").exists()
    rattle(*SMALL, "--sigma", 0, "--closure", "corrected", "--out", tmp_path / "yes", "--dt", 1e-3)


@pytest.mark.usefixtures("undrawn")
def test_a_closure_that_cannot_take_the_scene_is_named_with_the_reason(tmp_path):
    flying = Scene.from_gears(DAT21, sigma=0.1, start=Start(0.0, 0.1, 1.0, 0.1, -1.0))
    (tmp_path / "flying.toml").write_text(flying.to_toml())
    result = rattle(tmp_path / "flying.toml", *SMALL, "--out", tmp_path / "o")
    page = (tmp_path / "o" / "report.md").read_text()
    for said in (result.stdout, page):
        assert (
            "Left out: `published` (start.mesh = 0: the published closure needs a start at mesh 1"
            " (Eq. 10))." in said
        )
    assert set(pd.read_csv(tmp_path / "o" / "table.csv")["closure"]) == {
        "corrected",
        "saltation",
        "branching",
    }
    refused = rattle(
        tmp_path / "flying.toml", *SMALL, "--closure", "published", "--out", tmp_path / "p", code=2
    )
    assert "start.mesh = 0" in refused.stderr


@pytest.mark.usefixtures("undrawn")
def test_no_closure_is_left_out_for_a_random_tolerance(tmp_path):
    """The scene file of the guide, in a few paths."""
    text = (Path(__file__).parents[3] / "docs" / "guide" / "scenes.md").read_text()
    (scene,) = (
        block
        for block in re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
        if "[scene.tolerance]" in block
    )
    (tmp_path / "scene.toml").write_text(scene)
    result = rattle(tmp_path / "scene.toml", *SMALL, "--out", tmp_path / "o")
    assert "Left out" not in result.stdout
    table = pd.read_csv(tmp_path / "o" / "table.csv")
    assert set(table["closure"]) == {"published", "corrected", "saltation", "branching"}
    assert re.search(r"!\[[^\]]*Dashed", (tmp_path / "o" / "report.md").read_text())


BAD = {
    "unknown key": (
        "[scene]\nalpha = 1.0\nepsilom = 0.9\nbeta1 = 0.1\ngamma1 = 0.0\n",
        [],
        "epsilon",
    ),
    "sigma": (None, ["--sigma", "-1"], "sigma = -1.0"),
    "paths": (None, ["--paths", "0"], "paths = 0: must be at least 1"),
    "impacts": (None, ["--impacts", "0"], "impacts = 0"),
    "workers": (None, ["--workers", "0"], "workers = 0"),
    "dt": (None, ["--dt", "1"], "must be at most 0.1"),
    "dt sign": (None, ["--dt", "-1"], "dt = -1.0"),
    "dt for a later sigma": (
        None,
        ["--scheme", "euler-maruyama-located", "--sigma", "0.1", "--sigma", "1e4", "--dt", "2e-3"],
        "must be at most 8.46e-05 .* throw a path through",
    ),
    "scheme": (None, ["--scheme", "euler-mayurama"], "did you mean 'euler-maruyama'"),
    "closure": (None, ["--closure", "publishd"], "did you mean 'published'"),
    "order": (None, ["--order", "9"], "order = 9: must be at most 6"),
    "range of validity text": (
        None,
        ["--validity", "1e-3:2"],
        "validity = '1e-3:2': give LOW:HIGH:POINTS, as in",
    ),
    "range of validity order": (
        None,
        ["--validity", "2:1:5"],
        "validity HIGH = 1.0: must be greater than LOW = 2",
    ),
    "range of validity low": (
        None,
        ["--validity", "0:1:5"],
        "validity LOW = 0.0: must be greater than 0",
    ),
    "range of validity points": (
        None,
        ["--validity", "0.1:1:1"],
        "validity POINTS = 1: must be at least 2",
    ),
    "range of validity too fine": (None, ["--validity", "1:1.01:50"], "take fewer"),
    "range of validity paths": (
        None,
        ["--validity-paths", "0"],
        "validity-paths = 0: must be at least 1",
    ),
    "seed": (None, ["--seed", "-4"], "must be 0 or greater|must be at least 0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_names_value_and_remedy_and_writes_nothing(case, tmp_path):
    text, words, message = BAD[case]
    scene = []
    if text is not None:
        (tmp_path / "scene.toml").write_text(text)
        scene = [tmp_path / "scene.toml"]
    result = rattle(*scene, *words, "--out", tmp_path / "out", code=2)
    assert re.search(message, result.stderr)
    assert not (tmp_path / "out").exists()


def test_missing_and_foreign_files(tmp_path):
    assert (
        "cannot be read" in rattle(tmp_path / "none.toml", "--out", tmp_path / "o", code=2).stderr
    )
    (tmp_path / "m.json").write_text('{"a": 1}')
    assert (
        "no manifest"
        in rattle("--repeat", tmp_path / "m.json", "--out", tmp_path / "o", code=2).stderr
    )
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("")
    assert (
        "other things" in rattle(*SMALL, "--out", tmp_path / "full", "--overwrite", code=2).stderr
    )


def test_committed_report_is_of_this_code():
    """The committed default report holds the three noise intensities and its table matches its
    manifest."""
    folder = Path(__file__).resolve().parents[3] / "reports" / "dat21"
    settings, expected, *_ = read_settings(folder / "manifest.json")
    assert digest((folder / "table.csv").read_text()) == expected["table_sha256"]
    np.testing.assert_allclose([s.sigma for s in settings.scenes], [0.01, 0.1, 1.5**0.5])


@pytest.mark.usefixtures("undrawn")
def test_json_of_a_validation_has_the_rows_of_the_table(tmp_path):
    """Under the names of the file, each sigma's; null where nothing is known."""
    out = tmp_path / "report"
    sigmas = ("--sigma", 0.01, "--sigma", 0.1)
    words = (*sigmas, "--impacts", 1, "--paths", 1000, "--closure", "saltation", "--no-validity")
    said = json.loads(rattle(*words, "--out", out, "--json").stdout)
    table = pd.read_csv(out / "table.csv")
    assert list(said["table"][0]) == list(table)
    assert len(said["table"]) == len(table)
    assert [row["sigma"] for row in said["table"]] == table["sigma"].tolist()
    assert [row["verdict"] for row in said["table"]] == table["verdict"].tolist()
