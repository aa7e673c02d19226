"""Several orders and noise with a memory, against an independent sampler in plain numpy and against
exact laws."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import gearbox
from scenes import ORDERS

from rattle import DAT21, Order, Record, Sampling, Scene, Start, mean_map, simulate
from rattle.montecarlo import SCHEMES
from rattle.scene import state_names


@pytest.mark.parametrize(
    "scheme",
    [
        pytest.param(name, marks=pytest.mark.slow) if SCHEMES[name].has_step_bias else name
        for name in SCHEMES
    ],
)
@pytest.mark.parametrize("theta", [0.05, 1.0])
def test_without_walls_the_covariance_is_that_of_the_linear_system(scheme, theta):
    scene = Scene(
        alpha=1.0,
        epsilon=0.9,
        beta1=0.1,
        beta2=0.4,
        gamma1=0.05,
        mu=0.6,
        sigma=0.5,
        gap1=1e5,
        gap2=1e5,
        correlation_time=theta,
        drive=ORDERS,
        start=Start(0.0, 0.0, 1.0, 0.0, 1.0),
    )
    given = {"paths": 20_480, "impacts": 1, "dt": 5e-3, "scheme": scheme, "rng": 5}
    sampling = Sampling(horizon=1.1)
    run = simulate(scene, record=Record(times=[1.0]), sampling=sampling, **given)
    states = state_names(2)
    names = [f"cov_{a}_{b}" for i, a in enumerate(states) for b in states[i:]]
    sampled = run.at_times()[names].to_numpy()[0]
    se = run.at_times()[[f"se_{name}" for name in names]].to_numpy()[0]
    box = gearbox(scene.constants, scene.drive)
    exact, wrong = (
        box.covariance(0.0, np.zeros((4, 4)), 1.0, memory)[np.triu_indices(4)]
        for memory in (theta, 3.0 * theta)
    )
    bias = 0.0 if scheme == "exact-flight" else 0.02 * np.abs(exact)  # of the Euler step
    assert (np.abs(sampled - exact) - bias < 5.0 * se).all()
    assert (np.abs(sampled - wrong) > 5.0 * se).any()


@pytest.mark.parametrize(
    ("drive", "theta"), [(ORDERS, 0.0), ((Order(1),), 0.1), (ORDERS, 1.0), ((Order(1),), 10.0)]
)
def test_saltation_is_the_limit_of_small_noise(drive, theta):
    scene = Scene.from_gears(DAT21, sigma=3e-3, drive=drive, correlation_time=theta)
    predicted = mean_map(scene, impacts=4).section
    run = simulate(scene, paths=20_000, impacts=4, rng=2).section
    for name in ("tau", "flight", "y1", "y2"):
        assert (abs(predicted["sd_" + name] - run["sd_" + name]) < 5.0 * run["se_sd_" + name]).all()
        assert (abs(predicted[name] - run[name]) < 5.0 * run["se_" + name]).all()
        assert (
            abs(predicted["skew_" + name] - run["skew_" + name]) < 5.0 * run["se_skew_" + name]
        ).all()
    other = replace(scene, correlation_time=theta + 0.1 + 0.2 * theta)
    wrong = mean_map(other, impacts=4).section
    assert (abs(wrong["sd_tau"] - run["sd_tau"]) > 5.0 * run["se_sd_tau"]).any()


def test_at_fixed_times_saltation_with_a_memory_is_the_sample():
    scene = Scene.from_gears(DAT21, sigma=3e-3, drive=ORDERS, correlation_time=0.5)
    orbit = mean_map(scene, impacts=4)
    tau = orbit.section["tau"].to_numpy()
    times = 0.5 * (tau[1:] + tau[:-1])
    found = simulate(scene, paths=20_000, impacts=4, rng=2, record=Record(times=times)).at_times(
        times
    )
    predicted = orbit.at_times(found.index)  # whole steps
    for name in ("cov_x1_x1", "cov_y1_y1", "cov_x2_y2", "cov_y2_y2"):
        off = abs(predicted[name].to_numpy() - found[name].to_numpy())
        assert (off < 5.0 * found["se_" + name].to_numpy()).all()


def test_moments_go_to_those_of_white_noise_as_the_memory_does():
    white = mean_map(Scene.from_gears(DAT21, sigma=0.01), impacts=3).section
    thetas = np.array([0.001, 0.0005, 0.00025])
    coloured = [
        mean_map(Scene.from_gears(DAT21, sigma=0.01, correlation_time=t), impacts=3).section
        for t in thetas
    ]
    for name in ("sd_tau", "sd_y1"):
        off = np.array([abs(one[name] - white[name]).to_numpy() for one in coloured])
        slopes = np.polyfit(np.log(thetas), np.log(off), 1)[0]
        assert slopes == pytest.approx(1.0, abs=0.03)  # no sampling error


def test_the_start_of_the_memory_is_stationary_and_of_each_path_alone():
    scene = Scene.from_gears(DAT21, sigma=0.3, correlation_time=0.5)
    few, many = (
        simulate(scene, paths=n, impacts=2, rng=4, record=Record(raw=True)) for n in (100, 1500)
    )
    assert (few.raw == many.raw[:100]).all()


def test_closed_teeth_stay_closed_while_noise_with_a_memory_presses_them():
    """With white noise they open in every step; here no force pulls them apart once their chatter
    is complete."""
    scene = Scene(
        alpha=1.0, epsilon=0.3, beta1=0.1, gamma1=3.0, stages=1, sigma=0.1, correlation_time=1.0
    )
    settings = {
        "paths": 32,
        "impacts": 400,
        "rng": 1,
        "record": Record(raw=True),
        "sampling": Sampling(horizon=12.0),
    }
    tau, pulled, white = (
        simulate(replace(scene, **change), **settings).raw[:, :, 0]
        for change in ({}, {"sigma": 2.0}, {"correlation_time": 0.0})
    )
    assert np.nanmax(tau) < 1.0
    assert np.isnan(tau[:, 100:]).all()
    assert np.nanmax(pulled) > 4.0  # negative control: a force that does pull
    assert not np.isnan(white).any()
