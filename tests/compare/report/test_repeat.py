"""A repeated report says whether it is the same, the same but for rounding, or different; and on
what it was made."""

import json
import math
import shutil
from functools import partial

import numpy as np
import pandas as pd
import pytest
from commands import rattle

from rattle.compare.cli.validate import EXIT_NOT_REPEATED, EXIT_ROUNDED
from rattle.compare.report import manifest, provenance
from rattle.compare.report.manifest import PREDICTED_ROUNDING, SAMPLED_ROUNDING, difference
from rattle.compare.validation import validate as work

validate = partial(rattle, "validate")
SWEPT = [
    "--paths",
    "600",
    "--impacts",
    "2",
    "--dt",
    "0.01",
    "--validity",
    "0.1:1:2",
    "--validity-paths",
    "600",
    "--closure",
    "published",
    "--closure",
    "saltation",
]


@pytest.fixture(scope="module", autouse=True)
def once():
    """The same work is done once here: that a repeat does repeat it is tested in
    ``tests/compare/cli``."""
    done = {}
    with pytest.MonkeyPatch.context() as patch:
        for function in (work.validate, work.sweep):

            def remember(*given, function=function, **settings):
                key = repr((function.__name__, given, settings))
                if key not in done:
                    done[key] = function(*given, **settings)
                return done[key]

            patch.setattr(work, function.__name__, remember)
        yield


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    out = tmp_path_factory.mktemp("reports") / "first"
    validate(*SWEPT, "--sigma", 0.1, "--out", out)
    return out


def elsewhere(first, folder, change, versions=None, file="table.csv"):
    """The report as another processor might have written it: changed rows, with new digest,
    versions and seal."""
    shutil.copytree(first, folder)
    table = change(pd.read_csv(folder / file))
    table.to_csv(folder / file, index=False)
    data = json.loads((folder / "manifest.json").read_text())
    data[file.replace(".csv", "_sha256")] = manifest.digest((folder / file).read_text())
    data["versions"] = {
        k: v for k, v in (data["versions"] | (versions or {})).items() if v is not None
    }
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
    table.loc[row, "simulated"] += table.loc[row, "unit"] / 600
    return table


@pytest.mark.usefixtures("undrawn")
def test_the_same_but_for_rounding(first, tmp_path):
    changed = {"processor": "Another Processor", "numpy": "1.0", "vectors": None}
    earlier = elsewhere(first, tmp_path / "there", rounded, changed)
    said = validate("--repeat", earlier, "--out", tmp_path / "here", code=EXIT_ROUNDED).stdout
    assert "Repeated but for rounding: the largest difference is" in said
    assert "table.csv, column simulated" in said
    here = provenance.versions()
    assert f"processor Another Processor, here {here['processor']}" in said
    assert f"numpy 1.0, here {here['numpy']}" in said
    assert f"does not record: vectors (here {here['vectors']})" in said
    assert "scipy" not in said


@pytest.mark.usefixtures("undrawn")
def test_the_same_in_json_and_in_the_same_folder(first, tmp_path):
    """What lies there is read before it is replaced."""
    earlier = elsewhere(first, tmp_path / "there", rounded)
    words = ["--repeat", earlier, "--out", earlier.parent, "--overwrite", "--json"]
    record = json.loads(validate(*words, code=EXIT_ROUNDED).stdout)
    assert record["repeated"] is False
    assert record["repeat"]["outcome"] == "but for rounding"
    assert 0.0 < record["repeat"]["largest_difference"]["sds"] < 1e-10
    assert "column simulated" in record["repeat"]["largest_difference"]["where"]
    assert record["repeat"]["changed"] == {}
    again = json.loads(validate(*words).stdout)
    assert again["repeated"] is True
    assert again["repeat"]["largest_difference"] is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            one_path,
            (
                "column simulated, sigma 0.1, closure published, kind section, moment mean,"
                " quantity y1, impact 2"
            ),
        ),
        (
            lambda t: t.assign(verdict=t["verdict"].replace("accurate", "undecided")),
            "column verdict",
        ),
        (lambda t: t.iloc[1:], "other rows or columns"),
    ],
    ids=["one path", "verdict", "rows"],
)
@pytest.mark.usefixtures("undrawn")
def test_what_is_different_is_not_called_rounding(first, tmp_path, change, said):
    earlier = elsewhere(first, tmp_path / "there", change)
    found = validate("--repeat", earlier, "--out", tmp_path / "here", code=EXIT_NOT_REPEATED).stdout
    assert "The numbers differ from the manifest's" in found
    assert said in found
    assert "All versions and the processor are those of the manifest." in found


@pytest.mark.usefixtures("undrawn")
def test_a_range_of_validity_that_differs(first, tmp_path):
    earlier = elsewhere(
        first,
        tmp_path / "there",
        lambda t: t.assign(accurate=t["accurate"] + 1),
        file="validity.csv",
    )
    found = validate("--repeat", earlier, "--out", tmp_path / "here", code=EXIT_NOT_REPEATED).stdout
    assert "validity.csv, column accurate, sigma 0.1, closure published" in found


@pytest.mark.parametrize("left", ["nothing", "another table"])
@pytest.mark.usefixtures("undrawn")
def test_without_the_tables_only_digests_are_compared(first, tmp_path, left):
    earlier = elsewhere(first, tmp_path / "there", rounded)
    if left == "nothing":
        (earlier.parent / "table.csv").unlink()
    else:
        shutil.copy(first / "table.csv", earlier.parent)
    found = validate("--repeat", earlier, "--out", tmp_path / "here", code=EXIT_NOT_REPEATED).stdout
    assert (
        "Only digests could be compared: no table.csv with the manifest's digest lies beside it"
        in found
    )


def test_the_codes_are_documented():
    said = " ".join(validate("--help").output.split())
    assert "4 --repeat differs; 5 --repeat is the same but for rounding" in said


def test_the_manifest_says_on_what_it_was_made(first):
    made = json.loads((first / "manifest.json").read_text())["versions"]
    assert made["processor"] not in ("", "unknown")
    assert made["compiled for"]
    assert made["vectors"] == "none" or set(made["vectors"].split())
    for page in ("report.md", "report.html"):
        assert made["compiled for"] in (first / page).read_text()


ROWS = pd.DataFrame(
    {
        "quantity": ["tau", "y1"],
        "predicted": [1.0, np.nan],
        "simulated": [2.0, -1.5],
        "unit": [1e-8, 0.5],
        "se": [0.0, 0.05],
        "agreement": [1.0, 0.9],
        "paths": [100, 100],
        "paths_needed": [1e9, np.nan],
    }
)


def found(**changed):
    return difference(ROWS, ROWS.assign(**changed), paths=100)


def test_differences_are_in_sds_and_in_standard_errors():
    assert found() == (
        0.0,
        0.0,
        pytest.approx(math.nan, nan_ok=True),
        "only digits or words differ",
    )
    assert found(simulated=[2.0, -1.75])[1:3] == pytest.approx((0.5, 5.0))
    assert found(agreement=[1.0, 0.8])[2] == pytest.approx(1.0)
    assert found(paths_needed=[2e9, np.nan]).excess == 0.0


def test_the_bound_of_what_is_sampled_is_in_standard_errors_and_else_of_the_digits():
    assert found(simulated=[2.0, -1.5 + 0.9 * SAMPLED_ROUNDING * 0.05]).excess < 1.0
    assert found(simulated=[2.0, -1.5 + 1.1 * SAMPLED_ROUNDING * 0.05]).excess > 1.0
    assert (
        found(predicted=[1.0 + 0.9 * PREDICTED_ROUNDING * 1e-3, np.nan]).excess < 1.0
    )  # relative to the value, as the sd is small
    assert found(predicted=[1.0 + 3.0 * PREDICTED_ROUNDING * 1e-3, np.nan]).excess > 1.0
    assert found(simulated=[2.0 + 4.4e-16, -1.5]).excess < 1e-3  # without a standard error
    assert found(simulated=[2.0 + 1e-10, -1.5]).excess > 1.0


@pytest.mark.parametrize(
    "changed",
    [
        {"predicted": [1.0, 2.0]},
        {"predicted": [np.nan, np.nan]},
        {"simulated": [2.0, np.inf]},
        {"simulated": [np.inf, -1.5]},
        {"paths": [100, 99]},
        {"quantity": ["tau", "y2"]},
        {"more": 1},
    ],
)
def test_what_is_no_difference_of_numbers_is_infinite(changed):
    assert found(**changed).excess == math.inf
