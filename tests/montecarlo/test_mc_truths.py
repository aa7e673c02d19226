"""The simulator against known truths (model.md section 8): Gaussian flight, small noise, mean exit
time, collapse."""

import math

import pytest
from mc_checks import agrees, dat21
from mc_checks import stepped as simulate

from rattle.closure.orbit import follow
from rattle.scene.flight import noise_covariance

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
