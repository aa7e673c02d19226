"""The simulator against known truths (MODEL section 8): Gaussian flight, small noise, mean exit time, collapse."""

import math

import numpy as np
import pytest
from mc_checks import agrees, dat21, open_space
from scipy.special import gamma, hyp2f1
from test_mc_schemes import affine_step, by_steps

from closure.orbit import follow
from montecarlo import simulate
from scene import Scene, Start
from scene.flight import noise_covariance

STATE = ("x1", "y1", "x2", "y2")
PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]
TIMES = np.array([0.5, 1.5, 3.0])


def flights_agree(scene, dt, means, covariances, se_means, se_covariances):
    """Whether sampled means and full 4-D covariances at TIMES are those of the scheme, to sampling error."""
    exact = [by_steps(scene, t, dt) for t in TIMES]
    truth = np.concatenate([np.concatenate([m, [c[i, j] for i, j in PAIRS]]) for m, c in exact])
    found = np.concatenate([np.concatenate(pair) for pair in zip(means, covariances, strict=True)])
    se = np.concatenate([np.concatenate(pair) for pair in zip(se_means, se_covariances, strict=True)])
    return agrees(found, truth, se, slack=1e-12)


def sampled_flights(scene, dt, paths, rng):
    run = simulate(
        scene, paths=paths, impacts=1, dt=dt, rng=rng, clock=scene.start.tau + TIMES, horizon=TIMES[-1] + 1.0
    )
    table = run.clock()
    names = [f"cov_{STATE[i]}_{STATE[j]}" for i, j in PAIRS]
    return (
        table[list(STATE)].to_numpy(), table[names].to_numpy(),
        table[[f"se_{s}" for s in STATE]].to_numpy(), table[[f"se_{n}" for n in names]].to_numpy(),
    )  # fmt: skip


UNEQUAL = open_space(0.4, beta2=0.9)  # both stages feel the noise, with different modulations


def test_flight_without_walls_has_the_means_and_4d_covariance_of_the_scheme():
    assert flights_agree(UNEQUAL, 0.02, *sampled_flights(UNEQUAL, 0.02, 20_000, 11))


def test_flight_check_sees_one_percent_of_noise_too_much():
    louder = open_space(0.4 * 1.03, beta2=0.9)
    assert not flights_agree(UNEQUAL, 0.02, *sampled_flights(louder, 0.02, 20_000, 11))


@pytest.mark.parametrize("shared", [True, False])
def test_flight_check_sees_a_noise_that_the_stages_do_not_share(shared):
    """A numpy Euler-Maruyama passes the same check with one noise and fails with one per stage."""
    dt, paths, rng = 0.02, 20_000, np.random.default_rng(5)
    s = UNEQUAL.start
    state = np.tile([[s.x1], [s.y1], [s.x2], [s.y2]], (1, paths))
    kept = []
    for n in range(round(TIMES[-1] / dt)):
        matrix, shift, kick = affine_step(UNEQUAL, s.tau + n * dt, dt)
        z = rng.standard_normal((2, paths))
        noise = np.stack([z[0], z[0], *([z[0], z[0]] if shared else [z[1], z[1]])])
        state = matrix @ state + shift[:, None] + kick[:, None] * noise
        if np.isclose((n + 1) * dt, TIMES).any():
            kept.append(state)
    means = [k.mean(axis=1) for k in kept]
    centred = [k - m[:, None] for k, m in zip(kept, means, strict=True)]
    products = [np.stack([d[i] * d[j] for i, j in PAIRS]) for d in centred]
    covariances, root = [p.mean(axis=1) for p in products], np.sqrt(paths)
    se = [d.std(axis=1) / root for d in centred], [p.std(axis=1) / root for p in products]
    assert flights_agree(UNEQUAL, dt, means, covariances, *se) == shared


def test_correlation_of_gaussian_flight_has_fisher_standard_error():
    run = simulate(UNEQUAL, paths=20_000, impacts=1, dt=0.02, rng=2, clock=UNEQUAL.start.tau + TIMES, horizon=4.0)
    ratio = run.clock()[["se_z_rho1", "se_z_rho2"]].to_numpy() * math.sqrt(20_000)
    assert np.abs(ratio - 1.0).max() < 0.03  # estimated from fourth moments: about 1 % each


SMALL = 1e-3


def first_impact(sigma, paths=60_000):
    """sd of the first impact's time and its standard error."""
    row = simulate(dat21(sigma), paths=paths, impacts=1, dt=5e-4, rng=4).section.loc[1]
    return row.sd_tau, row.se_sd_tau


def predicted_sd_tau():
    """First order: the displacement's sd at the orbit's impact over the speed at which it meets the wall."""
    scene = dat21(SMALL)
    orbit = follow(scene, 1)
    q = noise_covariance(scene.constants, 0.0, orbit.tau[1])
    return math.sqrt(q[0, 0]) / abs(orbit.before[1, 1])


# beside sampling: Euler's relative error, of the order of dt = 5e-4 over a flight of 0.5
STEP_ERROR = 2e-3


def test_small_noise_limit_of_the_first_impact_time():
    sd, se = first_impact(SMALL)
    assert agrees(sd, predicted_sd_tau(), se, slack=STEP_ERROR * sd)


def test_small_noise_check_sees_three_percent():
    sd, se = first_impact(1.03 * SMALL)
    assert not agrees(sd, predicted_sd_tau(), se, slack=STEP_ERROR * sd)


def mean_exit_time(start, gap, sigma):
    """Masoliver & Porra 1995, as in MODEL section 8: x'' = sigma eta on a gap, from rest at distance `start`."""
    z = start / gap
    both = hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, z) + hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, 1.0 - z)
    scale = (4.0 / 3.0) ** (1.0 / 6.0) / gamma(7.0 / 3.0) * (2.0 * gap**2 / sigma**2) ** (1.0 / 3.0)
    return scale * (z * (1.0 - z)) ** (1.0 / 6.0) * both


def exit_scene(z, sigma=1.0, half=1e-3):
    """At tau = -pi/2 the modulation of undamped noise is 1, and stays so to 3e-4 over an exit time of 0.02."""
    start = Start(-0.5 * math.pi, half * (2.0 * z - 1.0), 0.0)
    return Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, gap1=half, sigma=sigma, start=start, stages=1)


def exits(z, sigma=1.0):
    row = simulate(exit_scene(z, sigma), paths=20_000, impacts=1, dt=2e-5, rng=8, horizon=1.0).section.loc[1]
    assert row.paths == 20_000
    return row.tau + 0.5 * math.pi, row.se_tau


# dt is a thousandth of the exit time; modulation and step together stay below 2e-3
EXIT_SLACK = 2e-3


@pytest.mark.parametrize("z", [0.1, 0.25, 0.5])
def test_mean_exit_time_of_random_acceleration(z):
    found, se = exits(z)
    truth = mean_exit_time(z * 2e-3, 2e-3, 1.0)
    assert agrees(found, truth, se, slack=EXIT_SLACK * truth)


def test_mean_exit_time_check_sees_five_percent_of_noise():
    found, se = exits(0.5, sigma=1.05)
    truth = mean_exit_time(1e-3, 2e-3, 1.0)
    assert not agrees(found, truth, se, slack=EXIT_SLACK * truth)


@pytest.mark.parametrize("scheme", ["euler-maruyama", "euler-maruyama-located"])
def test_collapse_onto_the_wall_is_survived(scheme):
    """Below a restitution of 0.163 a randomly accelerated particle collapses (Cornell, Swift & Bray 1998)."""
    scene = Scene(
        alpha=0.0, epsilon=0.02, beta1=0.0, gamma1=0.0, sigma=1.0, stages=1,
        start=Start(-0.5 * math.pi, 0.5, 1.0, mesh=1),
    )  # fmt: skip
    run = simulate(scene, paths=200, impacts=40, dt=2e-3, scheme=scheme, rng=1, keep_paths=True, horizon=20.0)
    reached = np.isfinite(run.raw[:, :, 0])
    assert run.unfinished + (reached[:, -1]).sum() == 200
    assert reached[:, -1].sum() > 100
    assert (np.abs(run.raw[:, :, 2][reached]) == 0.5).all()


@pytest.mark.parametrize("scheme", ["euler-maruyama", "euler-maruyama-located"])
def test_accumulating_impacts_return_and_are_counted(scheme):
    """Both stages pressed into their corners: impacts without end within a step, if they are located."""
    scene = Scene(
        alpha=0.0, epsilon=0.0, beta1=0.1, beta2=0.1, gamma1=2.0, gamma2=5.0, mu=0.5, sigma=0.01,
        start=Start(0.0, 0.5, 1.0, -0.5, -1.0, mesh=1),
    )  # fmt: skip
    run = simulate(scene, paths=20, impacts=500, dt=5e-3, scheme=scheme, rng=1)
    assert run.unfinished == 0
    assert (run.held > 0) == (scheme == "euler-maruyama-located")


@pytest.mark.parametrize("scheme", ["euler-maruyama", "euler-maruyama-located"])
def test_paths_that_never_accumulate_are_never_held(scheme):
    assert simulate(dat21(0.1), paths=500, dt=5e-3, scheme=scheme, rng=1).held == 0
