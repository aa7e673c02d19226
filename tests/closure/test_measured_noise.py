"""`Gears.sigma_from`: a measured modulation does what white noise of that sigma does."""

import math

import numpy as np
import pytest
from oracle import gearbox
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
DRIVE_HZ = WEAK_GEARS.omega / (2.0 * math.pi)  # Hz
WEAK_SCENE = Scene.from_gears(WEAK_GEARS, stages=1, start=Start(tau=0.3, x1=-0.3, y1=0.1))


def ratios(bandwidth):
    """Sds of the time and the rate of the first impact under a weak modulation, whose one-sided
    density is flat from 0 to a bandwidth in multiples of the drive's frequency, over those of white
    noise of `sigma_from`: the equation of motion linearised."""
    box = gearbox(WEAK_SCENE.constants)
    orbit = follow(WEAK_SCENE, 1)
    beta = WEAK_SCENE.beta1
    times = np.linspace(*orbit.tau, 2000)
    _, rate = orbit.before[1]
    _, acceleration = box.rates(orbit.tau[1], orbit.before[1])
    # what a unit of the modulation at each time adds to rate and place at the end
    drive = box.alpha * box.modulation(times)[0]
    decay = np.exp(-beta * (orbit.tau[1] - times))
    to_time = -drive * (1.0 - decay) / beta / rate
    to_rate = drive * decay + acceleration * to_time
    waves = np.linspace(0.0, bandwidth, 400)
    phases = np.exp(1j * np.outer(waves, times))
    transfer = np.trapezoid(phases[:, None] * [to_time, to_rate], times)
    sds = RMS * np.sqrt(np.mean(np.abs(transfer) ** 2, axis=0))
    sigma = WEAK_GEARS.sigma_from(rms=RMS, bandwidth=bandwidth * DRIVE_HZ)
    row = mean_map(WEAK_SCENE.with_sigma(sigma), impacts=1).section.loc[1]
    return sds / [row.sd_tau, row.sd_y1]


@pytest.mark.parametrize(
    ("band", "time", "speed"), [(1.0, 0.67, 0.48), (2.0, 0.87, 0.69), (5.0, 1.00, 0.92)]
)
def test_a_narrow_band_does_less_as_the_guide_says(band, time, speed):
    assert ratios(band) == pytest.approx([time, speed], abs=0.02)


def test_a_torque_that_fluctuates_is_a_noise_of_its_wheel():
    gamma = WEAK_SCENE.tree[0].gamma
    of_drive = WEAK_GEARS.sigma_from(rms=RMS, bandwidth=50.0) / WEAK_SCENE.alpha
    assert WEAK_GEARS.sigma_from(rms=RMS, bandwidth=50.0, wheel=1) == pytest.approx(
        gamma * of_drive
    )


def test_a_spectrum_counts_by_its_mean_density():
    flat = WEAK_GEARS.sigma_from(rms=0.03, bandwidth=50.0)
    level = 0.03**2 / 50.0
    for hertz in ([0.0, 20.0, 50.0], [10.0, 60.0]):
        found = WEAK_GEARS.sigma_from(spectrum=(hertz, [level] * len(hertz)))
        assert found == pytest.approx(flat, rel=1e-14)


@pytest.mark.parametrize(
    ("given", "words"),
    [
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
