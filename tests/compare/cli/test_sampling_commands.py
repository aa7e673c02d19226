"""The commands of the sampler as a user types them."""

import json

import pandas as pd
import pytest
from commands import rattle

from rattle.closure import CLOSURES, mean_map
from rattle.compare.warm_up import tasks
from rattle.montecarlo import SCHEMES, simulate, simulate_rare
from rattle.montecarlo.long_run import long_run
from rattle.scene import DAT21, Scene, Tolerance, compiled, progress


def test_simulate_prints_moments_and_writes_the_whole_table(tmp_path):
    out = tmp_path / "section.csv"
    result = rattle(
        "simulate", "--sigma", "0.01", "--impacts", "3", "--accuracy", "0.02", "--out", str(out)
    )
    assert "Accuracy 0.02 sd reached" in result.output
    assert "*" not in result.output
    assert "exact-flight" in result.output
    table = pd.read_csv(out, index_col="impact")
    assert list(table.index) == [1, 2, 3]
    assert table["sd_tau"].iloc[0] == pytest.approx(0.00016, rel=0.1)


@pytest.mark.parametrize("scheme", ["euler-maruyama", "euler-maruyama-located"])
def test_bias_of_a_named_euler_step_stands_in_the_table_unless_it_is_switched_off(scheme):
    words = ("simulate", "--sigma", "0.01", "--impacts", "2", "--paths", "2000", "--scheme", scheme)
    table = rattle(*words).output
    rows = json.loads(rattle(*words, "--json").stdout)["section"]
    assert "bias_tau" in table
    assert "The step biases the mean of " in table
    exact = json.loads(rattle(*words[:-2], "--json").stdout)["section"]
    for biased, right in zip(rows, exact, strict=True):
        assert abs(biased["tau"] - right["tau"]) > 10.0 * biased["se_tau"]
        assert biased["tau"] - right["tau"] == pytest.approx(
            biased["bias_tau"], rel=0.3, abs=4.0 * biased["se_tau"]
        )
    assert "bias_tau" not in rattle(*words, "--no-step-bias").output


def test_an_accuracy_beyond_an_hour_is_answered_with_the_rows_that_miss_it(monkeypatch):
    """The same bits with other threads: counted work decides where it ends."""
    monkeypatch.setattr("rattle.montecarlo.accuracy.simulate_to.INSTEAD", 0.2)
    words = ("simulate", "--sigma", "0.1", "--impacts", "2", "--accuracy", "1e-9")
    result = rattle(*words, code=3)
    assert " years of processor time: exact-flight" in result.stderr
    assert "That is more than an hour: the answer is what about 0.2 s give" in result.stderr
    assert "24 of 24 means and sds miss 1e-09 sd (* in the table):" in result.stdout
    assert "  and 16 more" in result.stdout
    assert result.stdout.count("*") == 12 + 1
    one, two = (json.loads(rattle(*words, "--json", "--workers", n, code=3).stdout) for n in "12")
    assert (one["paths"], one["section"], one["missed"]) == (
        two["paths"],
        two["section"],
        two["missed"],
    )
    assert len(one["missed"]) == 24


@pytest.mark.parametrize("units", ["dimensionless", "physical"])
def test_stars_stand_at_what_misses_in_either_units(units):
    words = (
        "simulate",
        "--sigma",
        "0.1",
        "--impacts",
        "3",
        "--accuracy",
        "1e-4",
        "--budget",
        "0.3",
        "--units",
        units,
    )
    said = rattle(*words, code=3)
    assert "*" in said.stdout
    assert said.output.count("NOT reached") == 1
    record = json.loads(rattle(*words, "--json", code=3).stdout)
    assert record["missed"]
    assert "NOT reached:" in record["reach"]


def test_speed_has_the_floor_and_every_scheme(monkeypatch):
    monkeypatch.setattr("rattle.montecarlo.bench.TURNS_OF_SLICES", 1)
    result = rattle("check", "speed", "--json")
    rows = {row["what"]: row for row in json.loads(result.output)}
    assert rows["one standard normal"]["ns"] > 0.1
    for name in (
        "euler-maruyama, paths alone",
        "euler-maruyama-located",
        "exact-flight, dt = pi/96",
    ):
        assert rows[name]["ns"] > rows["one standard normal"]["ns"]
    assert all(row["times_floor"] > 0.0 and row["gain"] > 0.0 for row in rows.values())
    assert rows["a skilled loop in numba, without statistics"]["gain"] == 1.0


def test_after_warming_up_nothing_is_compiled():
    found = tasks()
    assert {f"closure {name}" for name in CLOSURES} | {f"scheme {name}" for name in SCHEMES} < set(
        found
    )
    for task in found.values():
        task()
    before = progress.compiler.functions
    for scene in (
        Scene.from_gears(DAT21, sigma=0.3),
        Scene.from_gears(DAT21, sigma=0.3, stages=1),
        Scene.from_gears(DAT21, sigma=0.02, tolerance=Tolerance(1e-3, 2e-3)),
    ):
        for name in CLOSURES:
            mean_map(scene, impacts=3, closure=name)
        for name in SCHEMES:
            assert simulate(scene, paths=40, impacts=3, scheme=name).diagnostics is not None
        long_run(scene, paths=16, periods=64)
    simulate_rare(Scene.from_gears(DAT21, sigma=0.1), paths=32_768, impacts=3)
    assert progress.compiler.functions == before


def test_warming_up_without_a_folder_says_what_to_do(monkeypatch):
    monkeypatch.setattr(compiled, "_folder", None)
    assert "NUMBA_CACHE_DIR" in rattle("warm-up", code=2).output
