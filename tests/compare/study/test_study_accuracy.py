"""A study that asks for an accuracy: a point without noise goes all the way to the page, and no
cell runs for ever."""

import pandas as pd
import pytest
from commands import rattle
from places import EXAMPLES, ORDINARY_PAIR
from scenes import dat21
from studies import Sample, study_text

from rattle import Scene, simulate_to, validate
from rattle.compare.study.estimate import expect_work, scaling
from rattle.montecarlo.kernel.block import BLOCK


def asked(folder, accuracy, sigmas, code=0):
    (folder / "study.toml").write_text(
        study_text(sigmas=sigmas).replace("paths = 4096", f"accuracy = {accuracy}")
    )
    return rattle(f"study {folder / 'study.toml'}", code=code)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_point_without_noise_comes_to_the_page(tmp_path):
    asked(tmp_path, 0.1, (0.0, 0.1))
    sections = pd.read_parquet(tmp_path / "study/sections.parquet")
    assert sections["agreement"].between(0.0, 1.0).all()
    assert set(sections.query("sigma == 0.0")["paths"]) == {1}
    assert set(sections.query("paths >= 32 * @BLOCK")["sigma"]) == {0.1}
    assert (tmp_path / "study/study.html").exists()


def test_a_cell_that_would_take_more_than_an_hour_is_told_and_not_kept(tmp_path):
    found = asked(tmp_path, 1e-9, (0.1,), code=2)  # it is the only point
    assert "accuracy = 1e-09: is expected to take" in found.output
    cells = (tmp_path / "study/cells").glob("*.parquet")
    assert not [cell for cell in cells if "se_tau" in pd.read_parquet(cell)]


def test_what_is_not_random_is_expected_to_take_one_path():
    noisy, still = (Sample(dat21(sigma), impacts=2, seed=0, accuracy=0.01) for sigma in (0.1, 0.0))
    work = expect_work([noisy, still])
    assert work[noisy.key].path_steps / work[still.key].path_steps >= 32 * BLOCK - 1
    assert scaling([still], {still.key: 1.0})["limit"].notna().all()


ASKED_SCENES = {
    "rare branches": (dat21(0.1), 0.04, 12),  # 30 times as many plain paths
    "tolerances": (Scene.load(EXAMPLES / "drawing-tolerances.toml"), 0.03, 12),
    "single stage": (Scene.load(EXAMPLES / "single-stage.toml"), 0.02, 12),
    "chatter": (Scene.load(ORDINARY_PAIR), 0.05, 6),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ASKED_SCENES)
def test_every_estimate_is_within_a_factor_of_two_of_what_is_taken(name):
    """Path-steps, as `rattle simulate`, a page and a study expect them; for one stage it was 7e10
    times too many."""
    scene, accuracy, impacts = ASKED_SCENES[name]
    run = simulate_to(scene, accuracy, impacts=impacts, scheme="exact-flight", rng=1)
    cell = Sample(scene, impacts, seed=2, accuracy=accuracy)
    fixed = Sample(scene, impacts, seed=2, paths=8192)
    work = expect_work([cell, fixed])
    page = validate(scene, impacts=impacts, closures=["corrected"], paths=8192, rng=3)
    assert run.reach.reached
    for one in (run.reach.expected, work[cell.key], page.foresee(accuracy).at(accuracy)):
        assert 0.5 < one.path_steps / run.path_steps < 2.0
    assert 0.9 < work[fixed.key].path_steps / fixed.compute().facts["path_steps"] < 1.1
