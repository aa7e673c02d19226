"""A repeated report says whether it is the same, the same but for rounding, or different; and on
what it was made."""

import json
import math
import shutil
from functools import partial

import numpy as np
import pandas as pd
import pytest
from commands import manifest_of, rattle
from figures import leave_undrawn

from rattle.compare.report import manifest, provenance
from rattle.compare.report.manifest import PREDICTED_ROUNDING, SAMPLED_ROUNDING, difference
from rattle.compare.validation import report_run

DIFFERENT = 4
ROUNDED = 5  # exit codes


def validate(words, **settings):
    return rattle(f"validate {words}", **settings).stdout


@pytest.fixture(scope="module", autouse=True)
def once():
    """The same work is done once here: that a repeat does repeat it is tested in
    ``tests/compare/cli``."""
    done = {}

    def remember(function, *given, **settings):
        key = repr((function, given, settings))
        if key not in done:
            done[key] = function(*given, **settings)
        return done[key]

    with pytest.MonkeyPatch.context() as patch:
        leave_undrawn(patch)
        for name in ("validate", "sweep", "compare_schemes"):
            patch.setattr(report_run, name, partial(remember, getattr(report_run, name)))
        yield


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    out = tmp_path_factory.mktemp("reports") / "first"
    words = "--sigma 0.1 --closure published --closure saltation --paths 600 --impacts 2 --dt 0.01"
    validate(f"{words} --over sigma=0.1:1:2 --validity-paths 600 --out {out}")
    return out


def elsewhere(report, folder, change, versions=None, file="table.csv"):
    """The report as another processor might have written it: changed rows, with new digest,
    versions and seal."""
    shutil.copytree(report, folder)
    change(pd.read_csv(folder / file)).to_csv(folder / file, index=False)
    data = manifest_of(folder)
    data[file.replace(".csv", "_sha256")] = manifest.digest((folder / file).read_text())
    data["versions"] = versions or data["versions"]
    del data["seal"]
    (folder / "manifest.json").write_text(json.dumps(manifest.seal(data)))
    return folder / "manifest.json"


def rounded(table):
    return table.assign(
        simulated=table["simulated"] * (1.0 + 3e-14), paths_needed=table["paths_needed"] * 1.001
    )


def one_path(table):
    """One of the paths on another itinerary: a mean moves by about 1/paths of its sd, 0.04 standard
    errors here."""
    row = table.index[(table["quantity"] == "y1") & (table["moment"] == "mean")][1]
    table.loc[row, "simulated"] += table["unit"][row] / 600
    return table


def test_the_same_but_for_rounding(first, tmp_path):
    here = provenance.versions()
    changed = here | {"processor": "Another Processor", "numpy": "1.0"}
    del changed["vectors"]
    earlier = elsewhere(first, tmp_path / "there", rounded, changed)
    said = validate(f"--repeat {earlier} --out {tmp_path / 'here'}", code=ROUNDED)
    assert "Repeated but for rounding: the largest difference is" in said
    assert "table.csv, column simulated" in said
    assert f"processor Another Processor, here {here['processor']}" in said
    assert f"does not record: vectors (here {here['vectors']})" in said
    assert "scipy" not in said


def test_the_same_in_json_and_in_the_same_folder(first, tmp_path):
    """What lies there is read before it is replaced."""
    earlier = elsewhere(first, tmp_path / "there", rounded)
    words = f"--repeat {earlier} --out {earlier.parent} --overwrite --json"
    repeat = json.loads(validate(words, code=ROUNDED))["repeat"]
    assert repeat["outcome"] == "but for rounding"
    assert 0.0 < repeat["largest_difference"]["sds"] < 1e-10
    assert repeat["changed"] == {}
    assert json.loads(validate(words))["repeated"] is True


def another_range(table):
    return table.assign(accurate=table["accurate"] + 1)


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        (
            "table.csv",
            one_path,
            "column simulated, sigma 0.1, closure published, kind section, moment mean,"
            " quantity y1, impact 2",
        ),
        (
            "validity.csv",
            another_range,
            "validity.csv, column accurate, sigma 0.1, closure published",
        ),
    ],
)
def test_what_is_different_is_not_called_rounding(first, tmp_path, file, change, said):
    earlier = elsewhere(first, tmp_path / "there", change, file=file)
    printed = validate(f"--repeat {earlier} --out {tmp_path / 'here'}", code=DIFFERENT)
    assert "The numbers differ from the manifest's" in printed
    assert said in printed
    assert "All versions and the processor are those of the manifest." in printed


def test_without_the_tables_only_digests_are_compared(first, tmp_path):
    earlier = elsewhere(first, tmp_path / "there", rounded)
    shutil.copy(first / "table.csv", earlier.parent)
    printed = validate(f"--repeat {earlier} --out {tmp_path / 'here'}", code=DIFFERENT)
    assert (
        "Only digests could be compared: no table.csv with the manifest's digest lies beside it"
        in printed
    )


TAU_ROW = {
    "quantity": "tau",
    "predicted": 1.0,
    "simulated": 2.0,
    "unit": 1e-8,
    "se": 0.0,
    "agreement": 1.0,
    "paths": 100,
    "paths_needed": 1e9,
}
Y1 = TAU_ROW | {
    "quantity": "y1",
    "predicted": np.nan,
    "simulated": -1.5,
    "unit": 0.5,
    "se": 0.05,
    "agreement": 0.9,
}


def compared(tau=TAU_ROW, y1=Y1):
    return difference(pd.DataFrame([TAU_ROW, Y1]), pd.DataFrame([tau, y1]), paths=100)


def test_differences_are_in_sds_and_in_standard_errors():
    assert compared()[:2] == (0.0, 0.0)
    assert compared()[3] == "only digits or words differ"
    assert compared(y1=Y1 | {"simulated": -1.75})[1:3] == pytest.approx((0.5, 5.0))
    assert compared(y1=Y1 | {"agreement": 0.8})[2] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "value", "is_rounding"),
    [
        ("paths_needed", 2e9, True),
        # relative to the value, as the sd is small
        ("predicted", 1.0 + 0.9 * PREDICTED_ROUNDING * 1e-3, True),
        ("predicted", 1.0 + 3.0 * PREDICTED_ROUNDING * 1e-3, False),
        # without a standard error
        ("simulated", 2.0 + 4.4e-16, True),
        ("simulated", 2.0 + 1e-10, False),
    ],
)
def test_the_bound_of_what_is_sampled_is_in_standard_errors_and_else_of_the_digits(
    name, value, is_rounding
):
    assert (compared(TAU_ROW | {name: value}).excess < 1.0) == is_rounding
    inside, outside = (-1.5 + of * SAMPLED_ROUNDING * 0.05 for of in (0.9, 1.1))
    assert compared(y1=Y1 | {"simulated": inside}).excess < 1.0
    assert compared(y1=Y1 | {"simulated": outside}).excess >= 1.0


@pytest.mark.parametrize(
    "changed",
    [{"predicted": 2.0}, {"simulated": np.inf}, {"paths": 99}, {"quantity": "y2"}, {"more": 1}],
)
def test_what_is_no_difference_of_numbers_is_infinite(changed):
    assert compared(y1=Y1 | changed).excess == math.inf
