"""`Gears.sigma_from`: a measured modulation does what white noise of that sigma does."""

import math

import numpy as np
import pytest
from refusals import refusal

from rattle import Gears, Scene, Start, follow, mean_map

WEAK_GEARS = Gears(
    alpha=0.5,
    epsilon=0.7,
    omega=200.0,
    inertia1=1800.0,
    radius1=45.0,
    backlash1=0.4,
    damping1=30.0,
    torque1=60.0,
)
RMS = 0.02
START = Start(tau=0.3, x1=-0.3, y1=0.1)
WEAK_SCENE = Scene.from_gears(WEAK_GEARS, stages=1, start=START)


def linear_sds(bandwidth):
    """Sds of the time (s) and the velocity (mm/s) of the first impact under a weak modulation whose
    one-sided density is flat from 0 to a bandwidth in Hz: the equation of motion in kg, mm and s,
    linearised."""
    g = WEAK_GEARS
    orbit = follow(WEAK_SCENE, 1)
    end = (orbit.tau[1] - START.tau) / g.omega
    velocity = orbit.before[1, 1] * g.backlash1 * g.omega
    damping = 1000.0 * g.damping1 / g.inertia1
    times = np.linspace(0.0, end, 2000)
    angle = g.omega * times + START.tau
    drive = g.amplitude * g.omega * (damping * np.cos(angle) - g.omega * np.sin(angle))  # mm/s^2
    acceleration = drive[-1] + 1000.0 * g.torque1 * g.radius1 / g.inertia1 - damping * velocity
    # what a unit of the modulation at each time adds to velocity and place at the end
    decay = np.exp(-damping * (end - times))
    to_time = -drive * (1.0 - decay) / damping / velocity
    to_velocity = drive * decay + acceleration * to_time
    waves = np.linspace(0.0, bandwidth, 400)
    phases = np.exp(2j * math.pi * np.outer(waves, times))
    transfer = np.trapezoid(phases[:, None] * [to_time, to_velocity], times)
    return RMS * np.sqrt(np.mean(np.abs(transfer) ** 2, axis=0))


def ratios(bandwidth):
    """Sds of time and velocity at the first impact over those of white noise of `sigma_from`."""
    sigma = WEAK_GEARS.sigma_from(rms=RMS, bandwidth=bandwidth)
    row = mean_map(WEAK_SCENE.with_sigma(sigma), impacts=1).section_in("physical").iloc[0]
    return linear_sds(bandwidth) / [row["sd_tau_ms"] / 1000.0, row["sd_y1_mm_per_s"]]


DRIVE_HZ = WEAK_GEARS.omega / (2.0 * math.pi)  # Hz


@pytest.mark.parametrize(
    ("band", "time", "speed"), [(1.0, 0.67, 0.48), (2.0, 0.87, 0.69), (5.0, 1.00, 0.92)]
)
def test_a_narrow_band_does_less_as_the_guide_says(band, time, speed):
    assert ratios(band * DRIVE_HZ) == pytest.approx([time, speed], abs=0.02)


def test_a_torque_that_fluctuates_is_a_noise_of_its_wheel():
    gamma = WEAK_SCENE.tree[0].gamma
    of_drive = WEAK_GEARS.sigma_from(rms=RMS, bandwidth=50.0) / WEAK_SCENE.alpha
    assert WEAK_GEARS.sigma_from(rms=RMS, bandwidth=50.0, wheel=1) == pytest.approx(
        gamma * of_drive
    )


def test_a_spectrum_counts_by_its_mean_density():
    flat = WEAK_GEARS.sigma_from(rms=0.03, bandwidth=50.0)
    level = 0.03**2 / 50.0
    assert WEAK_GEARS.sigma_from(spectrum=([0.0, 20.0, 50.0], [level] * 3)) == pytest.approx(
        flat, rel=1e-14
    )
    assert WEAK_GEARS.sigma_from(spectrum=([10.0, 60.0], [level, level])) == pytest.approx(
        flat, rel=1e-14
    )


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "give rms and bandwidth, or a spectrum"),
        ({"rms": 0.03}, "give rms and bandwidth"),
        (
            {"rms": 0.03, "spectrum": ([0.0, 1.0], [1.0, 1.0])},
            "give rms and bandwidth, or a spectrum",
        ),
        ({"rms": -0.03, "bandwidth": 50.0}, "rms = -0.03: must be 0 or greater"),
        ({"rms": 0.03, "bandwidth": 0.0}, "bandwidth = 0.0: must be greater than 0"),
        ({"spectrum": ([1.0], [1.0])}, "give two or more frequencies"),
        ({"spectrum": ([1.0, 1.0], [1.0, 1.0])}, "must be greater than 0"),
        ({"spectrum": ([1.0, 2.0], [1.0, -1.0])}, "must be 0 or greater"),
    ],
)
def test_what_is_no_measurement_is_refused(given, words):
    with refusal(words):
        WEAK_GEARS.sigma_from(**given)
