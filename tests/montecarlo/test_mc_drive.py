"""Several orders and noise with a memory, against an independent sampler in plain numpy and against
exact laws."""

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest
from mc_checks import open_space
from oracle import gearbox
from scenes import ORDERS

from rattle import Record, Sampling, Scene, simulate
from rattle.scene import state_names


@pytest.mark.parametrize(
    "scheme", ["exact-flight", pytest.param("euler-maruyama", marks=pytest.mark.slow)]
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
