"""A closure of one's own in a validation: its verdicts, its page, its time, and what becomes of its
mistakes."""

import numpy as np
import pytest
from commands import manifest_of, rattle
from scenes import dat21

from rattle import Closure, mean_map, validate
from rattle.compare.validation.answer import answer
from rattle.compare.validation.comparison import measure_speeds

LITTLE_NOISE = dat21(0.01)


def copy(scene, impacts):
    """Saltation under another name."""
    return mean_map(scene, impacts=impacts).section


def shifted(scene, impacts):
    """Negative control: the mean of y1 is wrong by a fifth of its sd."""
    section = copy(scene, impacts)
    return {"tau": section["tau"], "y1": section["y1"] + 0.2 * section["sd_y1"]}


def strong(scene, impacts):
    if scene.sigma > 0.05:
        raise ValueError("the noise\nis too strong")
    return copy(scene, impacts)


def rows(v, closure):
    return v.table.query("closure == @closure").drop(columns="closure").reset_index(drop=True)


@pytest.fixture(scope="module")
def compared():
    methods = [
        "saltation",
        Closure("same", copy, lambda scene, times: mean_map(scene, impacts=3).at_times(times)),
        shifted,
    ]
    return validate(LITTLE_NOISE, impacts=3, closures=methods, paths=20_000, rng=7)


def test_it_is_judged_as_a_closure_of_the_package_is(compared):
    assert rows(compared, "same").equals(rows(compared, "saltation"))


def test_what_is_wrong_with_it_is_found(compared):
    found = rows(compared, "shifted").groupby(["quantity", "moment"])["verdict"].agg(set)
    assert found["y1", "mean"] == {"inaccurate"}
    assert found["tau", "mean"] == {"accurate"}
    assert found["tau", "sd"] == {"not predicted"}


def test_its_time_is_measured_and_decides_nothing(compared):
    speed = measure_speeds([compared]).set_index("closure")
    assert np.isnan(speed["speed_up"]["same"])
    assert speed["closure_seconds"]["same"] > 0.0
    said = " ".join(answer([compared]))
    assert "take `saltation` at σ = 0.01" in said
    assert "measured on this machine, not counted: `same`" in said


def test_an_exception_is_a_remark_on_its_rows(compared):
    v = validate(
        LITTLE_NOISE.with_sigma(0.1), impacts=2, closures=["saltation", strong], paths=2000
    )
    why = "raised ValueError: the noise is too strong"
    assert v.failed == {"strong": why}
    table = rows(v, "strong")
    assert set(table["verdict"]) <= {"not predicted", "excluded"}
    assert set(table["remark"]) == {why}
    assert "At σ = 0.1 `strong` raised ValueError" in " ".join(answer([v]))


def test_an_exception_at_fixed_times_loses_only_these():
    def fails(scene, times):
        raise ZeroDivisionError

    v = validate(LITTLE_NOISE, impacts=2, closures=[Closure("mine", copy, fails)], paths=2000)
    found = v.table.groupby("kind")[["remark", "verdict"]].agg(set)
    assert found["remark"]["fixed time"] == {"raised ZeroDivisionError: "}
    assert "not predicted" not in found["verdict"]["section"]


@pytest.mark.usefixtures("undrawn", "few_beside")
def test_the_command_imports_it_shows_it_and_says_by_its_exit_code_that_it_failed(
    tmp_path, monkeypatch
):
    (tmp_path / "own.py").write_text(
        '"""Closures."""\nfrom tests.compare.validation.test_own_closures import copy,'
        ' strong\n\ndef mine(scene, impacts):\n    """The first closure of all."""\n    return'
        " copy(scene, impacts)\n"
    )
    monkeypatch.chdir(tmp_path)
    closures = "--closure own:mine --closure own:strong"
    words = f"validate {closures} --sigma 0.1 --impacts 2 --paths 2000 --no-validity"
    assert (
        "closure strong raised ValueError: the noise is too strong"
        in rattle(f"{words} --out report", code=1).stderr
    )
    assert "The first closure of all." in (tmp_path / "report/report.html").read_text()
    assert manifest_of(tmp_path / "report")["settings"]["closures"] == ["own:mine", "own:strong"]
    assert (
        "Repeated bit for bit"
        in rattle("validate --repeat report/manifest.json --out again", code=1).stdout
    )
