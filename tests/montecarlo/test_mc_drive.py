"""Several orders and noise with a memory, against an independent sampler in plain numpy and against
exact laws."""

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest
from mc_checks import open_space
from oracle import gearbox
from scenes import FOUR, ORDERS, OSCILLATOR, dat21

from rattle import Record, Sampling, Scene, mean_map, simulate
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
    """Another correlation time is noticed."""
    scene = open_space(0.5, drive=ORDERS, correlation_time=theta)
    given = {"paths": 20_480, "impacts": 1, "dt": 5e-3, "scheme": scheme, "rng": 5}
    sampling = Sampling(horizon=1.1)
    run = simulate(scene, record=Record(times=[1.3]), sampling=sampling, **given)
    names = [f"cov_{a}_{b}" for a, b in combinations_with_replacement(state_names(2), 2)]
    table = run.at_times()
    sampled, se = (table[[start + n for n in names]].to_numpy()[0] for start in ("", "se_"))
    box = gearbox(scene.constants, scene.drive)
    exact, wrong = (
        box.covariance(0.3, np.zeros((4, 4)), 1.0, memory)[np.triu_indices(4)]
        for memory in (theta, 3.0 * theta)
    )
    bias = 0.0 if scheme == "exact-flight" else 0.02 * np.abs(exact)  # of the Euler step
    assert (np.abs(sampled - exact) - bias < 5.0 * se).all()
    assert (np.abs(sampled - wrong) > 5.0 * se).any()


SMALL_NOISE = {
    "orders": dat21(drive=ORDERS),
    "short memory": dat21(correlation_time=0.1),
    "orders and memory": dat21(drive=ORDERS, correlation_time=1.0),
    "long memory": dat21(correlation_time=10.0),
    "tree": FOUR,
    "a body's own memory": replace(OSCILLATOR, correlation_time=0.5),
}


@pytest.mark.parametrize("name", SMALL_NOISE)
def test_saltation_is_the_limit_of_small_noise(name):
    """At impacts and between them; another correlation time is noticed."""
    scene = SMALL_NOISE[name].with_sigma(3e-3)
    tau = mean_map(scene, impacts=4).section["tau"].to_numpy()
    record = Record(times=0.5 * (tau[1:3] + tau[:2]))
    run = simulate(scene, paths=20_000, impacts=4, rng=2, record=record)
    sections = [f"{moment}{q}" for moment in ("", "sd_", "skew_") for q in ("tau", "flight", "y1")]
    fixed = run.at_times()
    places = fixed.columns.intersection(["cov_x1_x1", "cov_y1_y1", "cov_x2_y2", "cov_y2_y2"])
    other = replace(scene, correlation_time=0.1 + 1.2 * scene.correlation_time)
    for right, alike in ((scene, True), (other, False)):
        m = mean_map(right, impacts=4)
        at_impacts = scores(m.section, run.section, sections)
        between = scores(m.at_times(fixed.index), fixed, places)
        assert [(z < 5.0).all() for z in (at_impacts, between)] == [alike, alike]


def scores(predicted, sampled, names):
    """Differences in standard errors."""
    se = sampled[[f"se_{name}" for name in names]].to_numpy()
    return (predicted[names] - sampled[names]).abs().to_numpy() / se


@pytest.mark.parametrize("noise", ["drive", 1])
def test_closed_teeth_stay_closed_while_noise_with_a_memory_presses_them(noise):
    """With white noise they open in every step; here no force pulls them apart once their chatter
    is complete."""
    scene = Scene(
        alpha=1.0,
        epsilon=0.3,
        beta1=0.1,
        gamma1=3.0,
        stages=1,
        sigma=0.1,
        correlation_time=1.0,
        noise=noise,
    )
    given = {"paths": 32, "impacts": 400, "rng": 1, "record": Record(raw=True)}
    tau, pulled, white = (
        simulate(replace(scene, **change), sampling=Sampling(horizon=12.0), **given).raw[:, :, 0]
        for change in ({}, {"sigma": 2.0}, {"correlation_time": 0.0})
    )
    assert np.nanmax(tau) < 1.0
    assert np.isnan(tau[:, 100:]).all()
    assert np.nanmax(pulled) > 4.0  # negative control: a force that does pull
    assert not np.isnan(white).any()
