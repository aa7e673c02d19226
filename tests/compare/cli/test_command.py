"""The command ``rattle validate``, as a user meets it."""

import hashlib
import json

import pandas as pd
import pytest
from commands import SMALL_VALIDATION, manifest_of, rattle
from figures import leave_undrawn, show_few_beside
from places import ROOT
from scenes import dat21

from rattle import Start

SMALL_REPORT = "validate --paths 600 --impacts 3 --dt 0.01 --no-validity"
REPORT_FILES = (
    "manifest.json report.md report.html figures table.csv correlation.csv leaving.csv validity.csv"
    " speed.csv simulation.csv schemes.csv table.parquet validity.parquet"
)


@pytest.fixture(scope="module", autouse=True)
def quick():
    """No figure is drawn here, and a scheme beside the simulation has few paths."""
    with pytest.MonkeyPatch.context() as patch:
        leave_undrawn(patch)
        show_few_beside(patch)
        yield


@pytest.fixture(scope="module")
def small_report(tmp_path_factory):
    """A small report, and what the command printed."""
    out = tmp_path_factory.mktemp("reports") / "small"
    return out, rattle(f"{SMALL_VALIDATION} --out {out}").stdout


@pytest.fixture(scope="module")
def validated(small_report):
    return small_report[0]


def test_report_folder_is_complete(validated):
    assert {path.name for path in validated.iterdir()} == set(REPORT_FILES.split())
    assert len(list((validated / "figures").glob("*.svg"))) == 2 * 3 + 2


def test_each_sentence_is_printed_once(small_report):
    openings = [line[:40] for line in small_report[1].splitlines()]
    assert len(set(openings)) == len(openings)


def test_page_begins_with_the_answer(validated):
    answer = manifest_of(validated)["answer"]
    page = (validated / "report.md").read_text()
    assert "| accurate up to impact | not shown wrong up to |" in page
    places = [answer[0], "figures/validity.svg", answer[1], answer[-1], "##"]
    assert sorted(places, key=page.index) == places


def test_show_says_what_the_report_says(validated):
    shown = rattle(f"show {validated} --width 5000").stdout
    record = manifest_of(validated)
    for sentence in (*record["answer"], record["repeat"], record["table_sha256"]):
        assert sentence.replace("`", "") in shown


def test_repeats_bit_for_bit_for_any_workers_and_says_its_rows_in_json(validated, tmp_path):
    manifest = validated / "manifest.json"
    printed = json.loads(
        rattle(f"validate --repeat {manifest} --workers 3 --json --out {tmp_path / 'again'}").stdout
    )
    assert printed["repeated"] is True
    for name in ("table.csv", "validity.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (validated / name).read_bytes()
    rows = pd.DataFrame(printed["table"])
    table = pd.read_csv(validated / "table.csv")
    assert rows["verdict"].equals(table["verdict"])
    assert list(rows) == list(table)


def test_what_is_required_is_not_met_and_a_range_of_validity_is_left_out(tmp_path):
    out = tmp_path / "report"
    rattle(f"{SMALL_REPORT} --sigma 1.0 --closure saltation --require accurate --out {out}", code=3)
    assert not {"validity.csv", "speed.csv"} & {path.name for path in out.iterdir()}
    assert "validity.svg" not in (out / "report.md").read_text()
    rattle(
        f"{SMALL_REPORT} --sigma 0 --closure corrected --require accurate --out {tmp_path / 'yes'}"
    )


def test_a_closure_that_cannot_take_the_scene_is_named_with_the_reason(tmp_path):
    file = tmp_path / "flying.toml"
    out = tmp_path / "report"
    file.write_text(dat21(0.1, start=Start(0.0, 0.1, 1.0, 0.1, -1.0)).to_toml())
    printed = rattle(f"{SMALL_REPORT} {file} --out {out}").stdout
    why = "start.mesh = 0: the published closure needs a start at mesh 1 (Eq. 10)"
    for text in (printed, (out / "report.md").read_text()):
        assert f"Left out: `published` ({why})." in text
    assert (
        "start.mesh = 0"
        in rattle(
            f"{SMALL_REPORT} {file} --closure published --out {tmp_path / 'none'}", code=2
        ).stderr
    )


def test_a_folder_with_other_things_is_not_replaced(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    assert "other things" in rattle("validate --overwrite --out", tmp_path, code=2).stderr


def test_the_committed_report_has_the_table_of_its_manifest():
    folder = ROOT / "reports/dat21"
    assert (
        hashlib.sha256((folder / "table.csv").read_bytes()).hexdigest()
        == manifest_of(folder)["table_sha256"]
    )
