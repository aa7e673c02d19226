"""Rare branches: design points, weights, and moments against exact flights."""

import math

import numpy as np
import pytest

from rattle.montecarlo import simulate, simulate_rare
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.rare.mixture import PLAIN, choose_branches, mixture_of
from rattle.montecarlo.rare.simulate_rare import run_block
from rattle.montecarlo.rare.weighted_moments import ORDERS, add, moments
from rattle.montecarlo.settings.plan import plan_of
from rattle.scene import DAT21, InputError, Scene, Start, Tolerance

NOISY = Scene.from_gears(DAT21, sigma=0.1)
PAIR = Scene(
    alpha=0.511, epsilon=0.447, beta1=0.101, beta2=0.091, gamma1=0.004, gamma2=0.098, mu=0.625, gap1=0.5, gap2=0.959,
    sigma=0.4, start=Start(tau=2.66, x1=0.15, y1=-0.37, x2=-0.58, y2=1.82, mesh=0),
)  # fmt: skip
IMPACTS, PATHS = 4, 32 * BLOCK


def limit(checks: int) -> float:
    """Largest |z| that so many checks allow at a level of 1e-4 in all."""
    from statistics import NormalDist

    return -NormalDist().inv_cdf(0.5e-4 / checks)


@pytest.fixture(scope="module")
def run():
    return simulate_rare(NOISY, paths=PATHS, impacts=IMPACTS, rng=11)


@pytest.fixture(scope="module")
def plain():
    return simulate(NOISY, paths=4 * PATHS, impacts=IMPACTS, scheme="exact-flight", rng=12).section


@pytest.fixture(scope="module")
def weighted(run):
    """Rows and weights of some blocks."""
    plan = plan_of(NOISY, paths=PATHS, impacts=IMPACTS, dt=math.pi / 96, scheme="exact-flight", rng=5)
    mixture = mixture_of(run.sampled)
    blocks = [run_block(plan, mixture, b) for b in range(16)]
    return mixture, np.concatenate([r for r, _ in blocks]), np.concatenate([w for _, w in blocks])


def scores(section, mean, se, plain):
    """z of all means and sds but those of walls that are struck."""
    z = []
    for name in ("tau", "flight", "x1", "y1", "x2", "y2"):
        for moment in (name, f"sd_{name}"):
            struck = np.where(plain["mesh"] == 1, "x1", "x2") == name
            of = (section[moment] - plain[moment]) / np.hypot(section["se_" + moment], plain["se_" + moment])
            z.extend(of[~struck])
    return np.array(z)


def test_a_design_point_is_at_a_distance_in_inverse_proportion_to_the_noise():
    """Noise enters only as sigma times the increments, so sigma times the index is the scene's alone."""
    found = {
        sigma: simulate_rare(Scene.from_gears(DAT21, sigma=sigma), paths=1, impacts=2).found[0]
        for sigma in (0.07, 0.1, 0.15)
    }
    assert {(b.impact, b.code) for b in found.values()} == {(1, -2)}
    sizes = [sigma * b.beta for sigma, b in found.items()]
    assert sizes == pytest.approx([sizes[0]] * 3, rel=2e-3)


def test_the_index_estimates_the_share_of_paths_that_take_the_branch(run, weighted):
    _, rows, weights = weighted
    took = np.where(rows[:, 0, 6] == run.found[0].code, weights[:, 0], 0.0)
    assert run.found[0].probability == pytest.approx(took.mean(), rel=0.4)  # to first order: its boundary is curved
    assert took.std() / math.sqrt(took.size) < 0.05 * took.mean()


def test_weights_average_to_one_and_are_bounded(weighted):
    mixture, _, weights = weighted
    assert mixture.plain == pytest.approx(PLAIN, abs=0.01)
    assert weights.max() <= 1.0 / mixture.plain
    z = (weights.mean(axis=0) - 1.0) / (weights.std(axis=0) / math.sqrt(len(weights)))
    assert abs(z).max() < limit(IMPACTS)


def test_weights_of_a_wrong_threshold_do_not_average_to_one(run):
    """Negative control: the paths' threshold is 0.1 sds from the one that the weights know."""
    plan = plan_of(NOISY, paths=BLOCK, impacts=1, dt=math.pi / 96, scheme="exact-flight", rng=5)
    mixture = mixture_of(run.sampled)
    wrong = mixture._replace(level=mixture.level + 0.1)
    weights = np.concatenate([run_block(plan, wrong, b)[1] for b in range(16)])[:, 0]
    assert abs(weights.mean() - 1.0) / (weights.std() / math.sqrt(len(weights))) > limit(1)


def test_moments_are_those_of_exact_flights(run, plain):
    z = scores(run.section, run.mean, run.se_mean, plain)
    assert abs(z).max() < limit(z.size)


def test_moments_without_their_weights_are_others(weighted, plain):
    """Negative control."""
    _, rows, _ = weighted
    y2 = rows[:, 2, 5]
    assert abs(y2.std() - plain["sd_y2"][3]) > 20.0 * plain["se_sd_y2"][3]


def test_the_variance_of_the_row_that_a_rare_branch_carries_falls_twentyfold(run, plain):
    assert plain["kurt_y2"][3] > 1000.0
    gain = (plain["se_sd_y2"] / run.section["se_sd_y2"]) ** 2 * (4 * PATHS / run.paths)
    assert gain[3] > 20.0
    for name in ("tau", "x1", "y1", "x2", "y2"):
        assert (plain["se_" + name] ** 2 * 4 > 0.6 * run.section["se_" + name] ** 2).all()


def test_a_pair_that_starts_in_flight():
    run = simulate_rare(PAIR, paths=16 * BLOCK, impacts=2, rng=3)
    assert run.sampled[0].beta == pytest.approx(3.77, abs=0.02)
    plain = simulate(PAIR, paths=2**19, impacts=2, scheme="exact-flight", rng=4).section
    z = (run.sd[1, 5] - plain["sd_y2"][2]) / math.hypot(run.se_sd[1, 5], plain["se_sd_y2"][2])
    assert abs(z) < limit(1)
    assert run.se_sd[1, 5] < 0.02 * run.sd[1, 5]


def test_the_same_bits_for_any_number_of_workers():
    first, second = (simulate_rare(NOISY, paths=4 * BLOCK, impacts=2, rng=1, workers=n) for n in (1, 3))
    assert (first.sd == second.sd).all()
    assert (first.se_mean == second.se_mean).all()


def test_one_stage_and_no_noise():
    one = Scene(alpha=1.5, epsilon=0.7, beta1=0.08, gamma1=0.05, sigma=0.1, stages=1)
    assert list(simulate_rare(one, paths=1, impacts=2).section) == [
        prefix + name for prefix in ("", "se_", "sd_", "se_sd_") for name in ("tau", "flight", "x1", "y1")
    ]
    still = simulate_rare(Scene.from_gears(DAT21), paths=1, impacts=2)
    assert still.found == ()
    assert (still.sd < 1e-12).all()


def test_random_gaps_are_refused():
    scene = Scene.from_gears(DAT21, sigma=0.1, tolerance=Tolerance(0.01, 0.01))
    with pytest.raises(InputError, match="tolerance"):
        simulate_rare(scene, paths=1)
    with pytest.raises(InputError, match="scene"):
        simulate_rare("DAT21", paths=1)
    with pytest.raises(InputError, match="paths"):
        simulate_rare(NOISY, paths=0)


def test_sums_with_weights_of_one_are_plain_moments():
    rng = np.random.default_rng(1)
    rows, centre = rng.normal(2.0, 3.0, (500, 1, 6)), np.ones((1, 6))
    sums = np.zeros((1, 1, 6, ORDERS))
    add(rows, np.ones((500, 1)), centre, sums[0])
    mean, se_mean, sd, se_sd = moments(sums, np.array([500.0]), centre)
    assert mean[0] == pytest.approx(rows[:, 0].mean(axis=0))
    assert sd[0] ** 2 == pytest.approx(rows[:, 0].var(axis=0, ddof=1))
    assert se_mean[0] == pytest.approx(sd[0] / math.sqrt(500.0))
    assert se_sd[0] == pytest.approx(sd[0] / math.sqrt(1000.0), rel=0.15)


def test_branches_that_are_common_or_change_little_have_no_paths_of_their_own(run):
    assert all(b.probability < 0.02 and b.kurtosis > 20.0 for b in run.sampled)
    assert choose_branches([]) == []
