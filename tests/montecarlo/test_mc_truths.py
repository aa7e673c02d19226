"""The simulator against known truths (model.md section 8): Gaussian flight, small noise, mean exit
time, collapse."""

import math

import pytest
from mc_checks import agrees, dat21
from mc_checks import stepped as simulate
from scipy.special import gamma, hyp2f1

from rattle.montecarlo.settings import Sampling
from rattle.scene import Scene, Start
from rattle.scene.flight import noise_covariance
from rattle.scene.orbit import follow

SMALL = 1e-3


# step, and what it leaves beside sampling: Euler's relative error is of the order of dt over a
# flight of 0.5
SMALL_STEPS = {"euler-maruyama-located": (5e-4, 2e-3), "exact-flight": (math.pi / 32.0, 0.0)}


def predicted_sd_tau():
    """First order: the displacement's sd at the orbit's impact over the speed at which it meets the
    wall."""
    scene = dat21(SMALL)
    orbit = follow(scene, 1)
    q = noise_covariance(scene.constants, 0.0, orbit.tau[1])
    return math.sqrt(q[0, 0]) / abs(orbit.before[1, 1])


@pytest.mark.parametrize("scheme", ["euler-maruyama-located", "exact-flight"])
def test_small_noise_limit_of_the_first_impact_time(scheme):
    dt, slack = SMALL_STEPS[scheme]
    for sigma in (SMALL, 1.03 * SMALL):  # the second is a negative control
        row = simulate(
            dat21(sigma), paths=60_000, impacts=1, dt=dt, rng=4, scheme=scheme
        ).section.loc[1]
        assert agrees(row.sd_tau, predicted_sd_tau(), row.se_sd_tau, slack=slack * row.sd_tau) == (
            sigma == SMALL
        )


def mean_exit_time(start, gap, sigma):
    """Masoliver & Porra 1995, as in model.md section 8: x'' = sigma eta on a gap, from rest at
    distance `start`."""
    z = start / gap
    both = hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, z) + hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, 1.0 - z)
    scale = (4.0 / 3.0) ** (1.0 / 6.0) / gamma(7.0 / 3.0) * (2.0 * gap**2 / sigma**2) ** (1.0 / 3.0)
    return scale * (z * (1.0 - z)) ** (1.0 / 6.0) * both


def exit_scene(z, sigma=1.0, half=1e-3):
    """At tau = -pi/2 the modulation of undamped noise is 1, and stays so to 3e-4 over an exit time
    of 0.02."""
    start = Start(-0.5 * math.pi, half * (2.0 * z - 1.0), 0.0)
    return Scene(
        alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, gap1=half, sigma=sigma, start=start, stages=1
    )


# step, and what it leaves beside sampling: a thousandth of the exit time and the modulation for
# Euler's schemes; for the exact flight the modulation alone, at a step of half the exit time
EXITS = {
    "euler-maruyama": (1e-5, 2e-3),
    "euler-maruyama-located": (2e-5, 2e-3),
    "exact-flight": (1e-2, 3e-4),
}


def exits(scheme, z, sigma=1.0):
    dt = EXITS[scheme][0]
    row = simulate(
        exit_scene(z, sigma),
        paths=20_000,
        impacts=1,
        dt=dt,
        rng=8,
        sampling=Sampling(horizon=1.0),
        scheme=scheme,
    ).section.loc[1]
    assert row.paths == 20_000
    return row.tau + 0.5 * math.pi, row.se_tau


@pytest.mark.parametrize("z", [0.1, 0.25, 0.5])
@pytest.mark.parametrize("scheme", EXITS)
def test_mean_exit_time_of_random_acceleration(scheme, z):
    found, se = exits(scheme, z)
    truth = mean_exit_time(z * 2e-3, 2e-3, 1.0)
    assert agrees(found, truth, se, slack=EXITS[scheme][1] * truth)


@pytest.mark.parametrize("scheme", EXITS)
def test_mean_exit_time_check_sees_five_percent_of_noise(scheme):
    found, se = exits(scheme, 0.5, sigma=1.05)
    truth = mean_exit_time(1e-3, 2e-3, 1.0)
    assert not agrees(found, truth, se, slack=EXITS[scheme][1] * truth)
