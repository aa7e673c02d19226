"""The commands of the sampler as a user types them."""

import json
import re
from dataclasses import replace

import pandas as pd
import pytest
from commands import rattle
from scenes import FOUR, dat21

from rattle import Tolerance, mean_map, simulate, stationary
from rattle.closure import CLOSURES
from rattle.compare.warm_up import tasks
from rattle.montecarlo import SCHEMES, simulate_rare
from rattle.scene import compiled, progress


def test_simulate_prints_moments_and_writes_the_whole_table(tmp_path):
    out = tmp_path / "section.csv"
    printed = rattle(f"simulate --sigma 0.01 --impacts 3 --accuracy 0.02 --out {out}").output
    assert "Accuracy 0.02 sd reached" in printed
    assert "*" not in printed
    assert pd.read_csv(out, index_col="impact")["sd_tau"][1] == pytest.approx(0.00016, rel=0.1)


def test_a_table_of_many_wheels_continues_below_and_says_which_wheel_is_which(
    tmp_path, monkeypatch
):
    wheels = [replace(wheel, name=name) for wheel, name in zip(FOUR.wheels, "abcd", strict=True)]
    (tmp_path / "tree.toml").write_text(replace(FOUR, wheels=wheels).to_toml())
    words = f"simulate {tmp_path / 'tree.toml'} --paths 64 --impacts 2"
    (whole,) = re.findall("(?m)^impact(.*)", rattle(words).stdout)
    monkeypatch.setattr("rattle.compare.cli.simulate.WIDEST_LINE", 100)
    parts = rattle(words).stdout
    heads = re.findall("(?m)^impact(.*)", parts)
    assert " ".join(heads).split() == whole.split()
    assert len(heads) > 1
    assert max(map(len, heads)) <= 94
    assert "Wheel 1 (a) meshes with the driver, 2 (b) with the driver, 3 (c) with 1" in parts


def test_bias_of_a_named_euler_step_stands_in_the_table_unless_it_is_switched_off():
    euler = "simulate --sigma 0.01 --impacts 2 --paths 2000 --scheme euler-maruyama"
    printed = rattle(euler).output
    assert "bias_tau" in printed
    assert "The step biases the mean of " in printed
    assert "bias_tau" not in rattle(f"{euler} --no-step-bias").output


def test_an_accuracy_beyond_an_hour_is_answered_with_the_rows_that_miss_it(monkeypatch):
    """The same bits with other threads: counted work decides where it ends."""
    monkeypatch.setattr("rattle.montecarlo.accuracy.simulate_to.INSTEAD", 0.2)
    words = "simulate --sigma 0.1 --impacts 2 --accuracy 1e-9"
    done = rattle(words, code=3)
    assert " years of processor time: exact-flight" in done.stderr
    assert "That is more than an hour: the answer is what about 0.2 s give" in done.stderr
    assert "24 of 24 means and sds miss 1e-09 sd (* in the table):" in done.stdout
    assert done.stdout.count("*") == 12 + 1
    one, two = (json.loads(rattle(f"{words} --json --workers {n}", code=3).stdout) for n in (1, 2))
    assert one["section"] == two["section"]
    assert len(one["missed"]) == 24


def test_speed_has_the_floor_and_every_scheme(monkeypatch):
    monkeypatch.setattr("rattle.montecarlo.bench.TURNS_OF_SLICES", 1)
    rows = pd.DataFrame(json.loads(rattle("check speed --json").output)).set_index("what")
    assert {
        "euler-maruyama, paths alone",
        "euler-maruyama-located",
        "exact-flight, dt = pi/96",
    } < set(rows.index)
    assert (rows[["ns", "times_floor", "gain"]] > 0.0).all(axis=None)
    assert rows["gain"]["a skilled loop in numba, without statistics"] == 1.0


def test_after_warming_up_nothing_is_compiled():
    for task in tasks().values():
        task()
    before = progress.compiler.functions
    for scene in (dat21(0.3), dat21(0.3, stages=1), dat21(0.3, tolerance=Tolerance(1e-3))):
        for name in CLOSURES:
            mean_map(scene, impacts=3, closure=name)
        for name in SCHEMES:
            simulate(scene, paths=40, impacts=3, scheme=name)
        stationary(scene, paths=16, periods=64, closures=())
    simulate_rare(dat21(0.1), paths=32_768, impacts=3)
    assert progress.compiler.functions == before


def test_warming_up_without_a_folder_says_what_to_do(monkeypatch):
    monkeypatch.setattr(compiled, "_folder", None)
    assert "NUMBA_CACHE_DIR" in rattle("warm-up", code=2).output
