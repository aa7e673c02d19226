import json
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import rattle

FILES = {
    "manifest.json",
    "chaos.md",
    "chaos.html",
    *(
        f"{name}.svg"
        for name in ("section", "spectra", "sweep", "bifurcation", "finite_size", "sqrt_law")
    ),
    *(
        f"{name}.csv"
        for name in (
            "exponents",
            "mean_maps",
            "lines",
            "spectra_summary",
            "fsle",
            "crossings",
            "sqrt_law",
            "sweep",
        )
    ),
    *(f"{name}.parquet" for name in ("sections", "spectra", "bifurcation")),
}

SMALL = ["--points", "2000", "--impacts", "40000", "--events", "300", "--width", "0.2"]


run = partial(rattle, "chaos")


@pytest.mark.slow
def test_a_folder_of_chaos_is_whole_and_said_in_a_few_lines(tmp_path):
    out = tmp_path / "chaos"
    done = run(*SMALL, "--over", "0.3:1.5:3", "--out", str(out))
    assert {p.name for p in out.iterdir()} == FILES
    assert all(p.stat().st_size < 300_000 for p in out.glob("*.svg"))
    assert not (out / "section.svg").read_text().count("<path") > 2000  # densities are images
    exponents = pd.read_csv(out / "exponents.csv")
    assert exponents.groupby("of")["exponent"].count().tolist() == [4, 4]
    assert (exponents["sum_error"].abs() < 1e-10).all()
    sweep = pd.read_csv(out / "sweep.csv")
    assert sorted(sweep["alpha"].unique()) == [0.3, 0.9, 1.5]
    assert np.isfinite(sweep[sweep["of"] == "orbit"]["largest"]).all()
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["answer"] == done.stdout.splitlines()[:-1]
    assert len(manifest["answer"]) < 10
    largest = exponents.query("of == 'orbit'")["value"].max()
    assert f"per unit of τ, {300.0 * largest:.3g} per second)" in manifest["answer"][0]
    assert "--overwrite" in run(*SMALL, "--out", out, code=2).output


@pytest.mark.usefixtures("undrawn")
def test_one_stage_and_weak_noise_say_what_is_missing(tmp_path):
    scene = tmp_path / "one.toml"
    scene.write_text(
        "[scene]\nalpha = 1.5\nepsilon = 0.9\nbeta1 = 0.083\ngamma1 = 0.057\nsigma = 0.01\nstages"
        " = 1\n"
    )
    out = tmp_path / "out"
    done = run(str(scene), *SMALL, "--no-sweep", "--out", str(out))
    assert "too weak" in done.output
    assert "per second" not in (out / "chaos.md").read_text(
        encoding="utf-8"
    )  # it was not made from gears
    assert not (out / "sweep.csv").exists()
    assert pd.read_csv(out / "exponents.csv")["exponent"].max() == 2


PAIR = Path(__file__).parents[1] / "cli" / "pair.toml"


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_what_gears_that_stick_do_not_have_is_left_out_with_its_reason(tmp_path):
    out = tmp_path / "out"
    done = run(str(PAIR), *SMALL, "--no-sweep", "--out", str(out))
    page = (out / "chaos.md").read_text(encoding="utf-8")
    for text in (done.output, page):
        assert "the spectra of the orbit (the orbit sticks often)" in text
        assert (
            "the square-root law and the finite-size exponents (the noisy path sticks often)."
            in text
        )
        assert "give " not in text
    assert {p.stem for p in out.glob("*.svg")} == {"section", "spectra"}
    assert not (out / "fsle.csv").exists()
    assert pd.read_csv(out / "exponents.csv")["value"].isna().all()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--over", "1:2"], "LOW:HIGH:POINTS"),
        (["--over", "1:0:5"], "LOW below HIGH"),
        (["--field", "alpa"], "did you mean 'alpha'"),
        (["--field", "epsilon", "--over", "0.5:1.5:3"], "between 0 and 1"),
        (["--width", "0"], "width"),
        (["--points", "3"], "at least 100"),
    ],
)
def test_bad_input_is_refused_before_any_work(tmp_path, words, said):
    assert said in run(*words, "--out", tmp_path / "no", code=2).output
    assert not (tmp_path / "no").exists()
