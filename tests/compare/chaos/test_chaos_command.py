"""The folder of ``rattle chaos``, and what it says is missing."""

from functools import partial

import pandas as pd
import pytest
from commands import manifest_of, rattle
from places import ORDINARY_PAIR

from rattle.compare.chaos import measure
from rattle.compare.chaos.exponents import DELTAS

CHAOS_FILES = (
    "manifest.json chaos.md chaos.html"
    " section.svg spectra.svg sweep.svg bifurcation.svg finite_size.svg sqrt_law.svg"
    " exponents.csv mean_maps.csv lines.csv spectra_summary.csv fsle.csv crossings.csv sqrt_law.csv"
    " sweep.csv sections.parquet spectra.parquet bifurcation.parquet"
)
SMALL_CHAOS = "chaos --points 500 --impacts 20000 --events 128 --width 0.5"


@pytest.mark.slow
def test_a_folder_of_chaos_is_whole_and_said_in_a_few_lines(tmp_path):
    out = tmp_path / "chaos"
    done = rattle(f"{SMALL_CHAOS} --over alpha=0.3:1.5:3 --out {out}")
    assert {path.name for path in out.iterdir()} == set(CHAOS_FILES.split())
    assert all(path.stat().st_size < 300_000 for path in out.glob("*.svg"))
    assert sorted(pd.read_csv(out / "sweep.csv")["alpha"].unique()) == [0.3, 0.9, 1.5]
    answer = manifest_of(out)["answer"]
    assert answer == done.stdout.splitlines()[:-1]
    assert len(answer) < 10
    largest = pd.read_csv(out / "exponents.csv").query("of == 'orbit'")["value"].max()
    assert f"per unit of τ, {300.0 * largest:.3g} per second)" in answer[0]


@pytest.mark.usefixtures("undrawn")
def test_one_stage_and_weak_noise_say_what_is_missing(tmp_path):
    scene = tmp_path / "one.toml"
    scene.write_text(
        "[scene]\nalpha = 1.5\nepsilon = 0.9\nbeta1 = 0.083\ngamma1 = 0.057\nsigma = 0.01\n"
        "stages = 1"
    )
    out = tmp_path / "out"
    assert "too weak" in rattle(f"{SMALL_CHAOS} {scene} --no-sweep --out {out}").output
    # it was not made from gears
    assert "per second" not in (out / "chaos.md").read_text()
    assert not (out / "sweep.csv").exists()
    assert pd.read_csv(out / "exponents.csv")["exponent"].max() == 2


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_what_gears_that_stick_do_not_have_is_left_out_with_its_reason(tmp_path, monkeypatch):
    # all of them take most of the time
    largest = partial(measure.finite_size, deltas=DELTAS[-2:])
    monkeypatch.setattr(measure, "finite_size", largest)
    out = tmp_path / "out"
    printed = rattle(f"{SMALL_CHAOS} {ORDINARY_PAIR} --no-sweep --out {out}").output
    for text in (printed, (out / "chaos.md").read_text()):
        assert "the spectra of the orbit (the orbit sticks often)" in text
        assert "give " not in text
    drawn = {path.stem for path in out.glob("*.svg")}
    assert drawn == {"section", "spectra", "sqrt_law", "finite_size"}
    # the noisy path goes on where it sticks
    assert pd.read_csv(out / "exponents.csv").set_index("of")["value"]["orbit"].isna().all()
