"""Rare branches sampled on purpose: weights, moments against plain paths, and what an accuracy does
with them."""

import math
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pandas as pd
import pytest
from random_gears import PAIR_A

from rattle.montecarlo import simulate, simulate_rare, simulate_to
from rattle.montecarlo.branches.choose import _share_out, choose_mixture
from rattle.montecarlo.branches.search import BranchSearch
from rattle.montecarlo.kernel.block import BLOCK, run, sample_mixture
from rattle.montecarlo.kernel.mixture import mixture_of, tail
from rattle.montecarlo.settings import NOISE_FREE, plan_of
from rattle.montecarlo.statistics.section_statistics import single_statistics
from rattle.montecarlo.statistics.weighted_sums import WEIGHTED_ORDERS, WeightedSums, add
from rattle.scene import DAT21, Scene, Tolerance

NOISY = Scene.from_gears(DAT21, sigma=0.1)
IMPACTS = 4
PATHS = 32 * BLOCK
STEP = math.pi / 96
CHECKED = [
    (k, p + q) for k in range(1, IMPACTS + 1) for q in ("tau", "y1", "y2") for p in ("", "sd_")
]


def limit(checks):
    """Largest |z| that so many checks allow at a level of 1e-4 in all."""
    return -NormalDist().inv_cdf(0.5e-4 / checks)


def largest_z(one, other):
    """Largest difference of two sections in standard errors."""
    found = []
    for k, name in CHECKED:
        se = math.hypot(one[f"se_{name}"][k], other[f"se_{name}"][k])
        found.append(abs(one[name][k] - other[name][k]) / se)
    return max(found)


@pytest.fixture(scope="module")
def rare():
    return simulate_rare(NOISY, paths=PATHS, impacts=IMPACTS, rng=11)


@pytest.fixture(scope="module")
def plain():
    return simulate(NOISY, paths=8 * PATHS, impacts=IMPACTS, rng=12)


def test_moments_are_those_of_plain_paths(rare, plain):
    assert rare.plan.mixture is not None
    assert largest_z(rare.section, plain.section) < limit(len(CHECKED))


def test_negative_control_without_weights_they_are_not(rare, plain):
    rows, weights, _, _ = sample_mixture(rare.plan, rare.plan.mixture, 0)
    weighted = (weights * (rows[:, :, 5] - plain.section["y2"].to_numpy()) ** 2).mean(axis=0)
    not_weighted = ((rows[:, :, 5] - plain.section["y2"].to_numpy()) ** 2).mean(axis=0)
    assert not_weighted[2] > 3.0 * weighted[2]


def test_the_row_of_the_rare_branch_is_known_far_better(rare, plain):
    equal = math.sqrt(plain.paths / rare.paths)
    assert rare.section["se_sd_y2"][3] < 0.3 * equal * plain.section["se_sd_y2"][3]
    assert (rare.section["se_sd_tau"] < 1.6 * equal * plain.section["se_sd_tau"]).all()


def test_weights_are_bounded_and_one_on_average(rare):
    mixture = rare.plan.mixture
    weights = np.concatenate([sample_mixture(rare.plan, mixture, b)[1] for b in range(8)])
    assert weights.max() <= 1.0 / mixture.plain * (1.0 + 1e-12)
    z = (weights.mean(axis=0) - 1.0) / (weights.std(axis=0) / math.sqrt(len(weights)))
    assert np.abs(z).max() < limit(IMPACTS)


def test_parts_that_overlap_do_not_bias(plain):
    """A path of one part also moves along the design point of another: its weight must know."""
    near = [b.shift for b in BranchSearch(NOISY, IMPACTS, 128, STEP).until(1.0).branches][:1]
    other = near[0].copy()
    other[: near[0].size // 2] *= 1.5
    centre = np.column_stack([plain.section[q] for q in ("tau", "flight", "x1", "y1", "x2", "y2")])
    mixture = mixture_of([near[0], other], [0.2, 0.2], centre, BLOCK)
    plan = plan_of(NOISY, paths=BLOCK, impacts=IMPACTS, dt=STEP, scheme="exact-flight", rng=3)
    rows, weights = map(
        np.concatenate, zip(*(sample_mixture(plan, mixture, b)[:2] for b in range(32)), strict=True)
    )
    for values in (
        weights,
        weights * (rows[:, :, 0] - centre[:, 0]),
        weights * (rows[:, :, 3] - centre[:, 3]),
    ):
        expected = 1.0 if values is weights else 0.0
        z = (values.mean(axis=0) - expected) / (values.std(axis=0) / math.sqrt(len(values)))
        assert np.abs(z).max() < limit(3 * IMPACTS)


def test_the_same_bits_for_any_number_of_workers_and_any_cut(rare):
    again = simulate_rare(NOISY, paths=PATHS, impacts=IMPACTS, rng=11, workers=3)
    assert again.section.equals(rare.section)


def test_random_gaps():
    scene = Scene.from_gears(DAT21, sigma=0.1, tolerance=Tolerance(3e-4, 3e-4, "uniform"))
    one = simulate_rare(scene, paths=PATHS, impacts=IMPACTS, rng=1)
    other = simulate(scene, paths=8 * PATHS, impacts=IMPACTS, rng=2)
    assert one.plan.mixture is not None
    assert largest_z(one.section, other.section) < limit(len(CHECKED))
    assert one.section["se_sd_y2"][3] < 0.5 * math.sqrt(8.0) * other.section["se_sd_y2"][3]


def test_weights_of_one_give_the_statistics_of_plain_paths():
    plan = plan_of(NOISY, paths=BLOCK, impacts=2, dt=STEP, scheme="exact-flight", rng=3)._replace(
        keep=True
    )
    result, rows = run(plan, 0)
    expected = single_statistics(result.sums["section"])
    centre = expected["mean"] + 0.01 * expected["sd"]
    sums = np.zeros((1, 2, 6, WEIGHTED_ORDERS))
    add(rows[:, :, :6], np.ones((BLOCK, 2)), centre, sums[0])
    found = WeightedSums(np.array([float(BLOCK)]), centre, sums, np.zeros((2, 1))).moments()
    varies = expected["sd"] > 1e-9
    for name in ("mean", "sd", "se_mean", "se_sd", "skew", "se_skew", "kurt", "se_kurt"):
        np.testing.assert_allclose(
            found[name][varies], expected[name][varies], rtol=3e-3, atol=3e-3
        )


def test_what_varies_by_less_than_rounding_has_no_moment_that_is_infinite():
    """The displacement at a wall that all paths strike: squares of such deviations underflow."""
    sums = np.zeros((1, 1, 1, WEIGHTED_ORDERS))
    values = np.zeros((BLOCK, 1, 1))
    values[0] = 3e-80
    add(values, np.ones((BLOCK, 1)), np.zeros((1, 1)), sums[0])
    moments = WeightedSums(
        np.array([float(BLOCK)]), np.zeros((1, 1)), sums, np.zeros((1, 1))
    ).moments()
    assert not np.isinf(list(moments.values())).any()
    assert moments["lean_sd"] == moments["sd"] == 0.0


def test_a_kurtosis_that_few_paths_make_up_does_not_hide_its_branch():
    """A path or two may carry it by chance; where a hundred carry it, a branch of a sixth of it is
    not the cause."""
    kurtosis = np.array([[3.0, 12_000.0]])
    added = [np.array([[0.0, 2000.0]])]
    tails = np.array([2e-5])
    assert _share_out(kurtosis, added, tails, PATHS)[0] > 0.0
    assert _share_out(kurtosis, added, tails, 100 * PATHS)[0] == 0.0


def test_where_no_branch_matters_paths_are_plain():
    scene = Scene.from_gears(DAT21, sigma=0.01)
    assert choose_mixture(simulate(scene, paths=4 * BLOCK, impacts=3)) is None
    one = simulate_rare(scene, paths=PATHS, impacts=2, rng=5)
    other = simulate(scene, paths=PATHS, impacts=2, rng=5)
    assert one.section.equals(other.section)


def test_an_accuracy_that_waits_for_a_branch_samples_it():
    run = simulate_to(NOISY, 0.015, impacts=IMPACTS, rng=4)
    assert run.plan.mixture is not None
    assert run.reach.reached
    assert run.paths < 2_000_000  # plain paths: eighteen million
    assert "rare branch" in run.reach.expected.sentence


def test_first_order_is_enough_on_the_scenes_of_the_table():
    """No curvature is corrected for; half of a window was once lost, which a tenth shows."""
    table = pd.read_csv(Path(__file__).parents[2] / "docs/results/rare_branches.csv").dropna(
        subset="near"
    )
    assert len(table) >= 5
    off = table["first_order"] - table["near"]
    assert (off.abs() < 0.1 * table["near"]).all()


SCENES = {"two stages": (NOISY, 1, -2, 3), "a window far from symmetric": (PAIR_A, 1, -1, 2)}


@pytest.mark.parametrize("name", SCENES)
def test_probability_of_a_branch_near_its_design_point_is_that_of_plain_paths(name):
    scene, impact, code, impacts = SCENES[name]
    found = BranchSearch(scene.phase_reduced, impacts, 128, STEP).until(1.0)
    branch = next(b for b in found.branches if (b.impact, b.mesh * b.side) == (impact, code))
    plan = plan_of(scene, paths=64 * BLOCK, impacts=impacts, dt=STEP, scheme="exact-flight", rng=3)
    mixture = mixture_of([branch.shift], [0.5], np.zeros((impacts, 6)), BLOCK)
    orbit = np.array(plan.itineraries[NOISE_FREE])[:impact]
    hits = []
    for b in range(8):
        rows, weights, _, _ = sample_mixture(plan, mixture, b)
        off = (rows[:, impact - 1, 6] == code) & (rows[:, : impact - 1, 6] == orbit[:-1]).all(
            axis=1
        )
        hits.append(weights[:, impact - 1] * off)
    one = np.concatenate(hits)
    raw = simulate(scene, paths=64 * BLOCK, impacts=impacts, rng=9).result.codes[impact - 1]
    plain = raw[(1, -1, 2, -2).index(code)] / raw.sum()
    error = math.hypot(one.std() / math.sqrt(one.size), math.sqrt(plain / raw.sum()))
    assert abs(one.mean() - plain) < 4.0 * error
    assert branch.probability == pytest.approx(one.mean(), rel=0.1)
    assert tail(branch.beta) == pytest.approx(branch.probability)
