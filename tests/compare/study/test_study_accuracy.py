"""A study that asks for an accuracy: a point without noise goes all the way to the page, and no cell runs for ever."""

import pandas as pd
from click.testing import CliRunner
from study_files import study_text

from rattle.compare.cli.main import main
from rattle.compare.study.cells import Sample
from rattle.compare.study.estimate import core_seconds, scaling
from rattle.montecarlo.kernel.block import BLOCK
from rattle.scene import DAT21, Scene


def asked(folder, accuracy, sigmas):
    text = study_text(sigmas=sigmas).replace("paths = 4096", f"accuracy = {accuracy}")
    (folder / "study.toml").write_text(text)
    return CliRunner().invoke(main, ["study", str(folder / "study.toml")])


def test_a_point_without_noise_comes_to_the_page(tmp_path):
    found = asked(tmp_path, 0.1, (0.0, 0.1, 0.2))
    assert found.exit_code == 0, found.output
    sections = pd.read_parquet(tmp_path / "study" / "sections.parquet")
    assert sections["agreement"].between(0.0, 1.0).all()
    assert set(sections[sections["sigma"] == 0.0]["paths"]) == {1}
    assert (sections[sections["sigma"] > 0.0]["paths"] >= 32 * BLOCK).all()
    assert (tmp_path / "study" / "study.html").exists()


def test_a_cell_that_would_take_more_than_an_hour_is_told_and_not_kept(tmp_path):
    found = asked(tmp_path, 1e-9, (0.1,))
    assert found.exit_code == 2  # it is the only point
    assert "accuracy = 1e-09: is expected to take" in found.output
    assert not [p for p in (tmp_path / "study" / "cells").glob("*.parquet") if "se_tau" in pd.read_parquet(p)]


def test_what_is_not_random_is_expected_to_take_one_path():
    noisy, still = (
        Sample(Scene.from_gears(DAT21, sigma=sigma), impacts=2, seed=0, accuracy=0.01) for sigma in (0.1, 0.0)
    )
    assert core_seconds(noisy) / core_seconds(still) >= 32 * BLOCK - 1
    assert scaling([still])["limit"].notna().all()
    assert core_seconds(Sample(noisy.scene, impacts=2, seed=0, accuracy=1e-300)) > 1e100
