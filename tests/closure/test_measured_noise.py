"""`Gears.sigma_from`: a measured modulation, simulated in mm and s, does what white noise of that
sigma does."""

import math

import numpy as np
import pytest

from rattle.closure import mean_map
from rattle.scene import Gears, InputError, Scene, Start

GEARS = Gears(
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
PATHS = 4000
STEPS = 1600
START = Start(tau=0.3, x1=-0.3, y1=0.1)


def band_limited(bandwidth, times, rng):
    """Modulation whose one-sided density is flat from 0 to a bandwidth in Hz: a sum of sines, one
    row for each path."""
    record = 4.0 * times[-1]
    frequencies = (np.arange(math.ceil(bandwidth * record)) + 0.5) / record
    size = RMS / math.sqrt(len(frequencies))
    phases = np.outer(frequencies, 2.0 * np.pi * times)
    cosine, sine = rng.standard_normal((2, PATHS, len(frequencies))) * size
    return cosine @ np.cos(phases) + sine @ np.sin(phases)


def first_impacts(bandwidth, seed):
    """Time in s and relative velocity in mm/s of each path's first impact: the equation of motion
    in kg, mm and s."""
    g = GEARS
    phase = START.tau
    times = np.linspace(0.0, 1.4 * 2.0 * math.pi / g.omega, STEPS)
    step = times[1]
    damping = 1000.0 * g.damping1 / g.inertia1
    m = band_limited(bandwidth, times, np.random.default_rng(seed))
    angle = g.omega * times + phase
    drive = g.amplitude * g.omega * (damping * np.cos(angle) - g.omega * np.sin(angle))  # mm/s^2
    push = drive * (1.0 + m) + 1000.0 * g.torque1 * g.radius1 / g.inertia1
    x = np.full(PATHS, START.x1 * g.backlash1)
    v = np.full(PATHS, START.y1 * g.backlash1 * g.omega)
    at = np.zeros(PATHS)
    speed = np.zeros(PATHS)
    running = np.ones(PATHS, bool)
    for k in range(STEPS - 1):
        middle = 0.5 * (push[:, k] + push[:, k + 1])
        after = (v * (1.0 - 0.5 * damping * step) + step * middle) / (1.0 + 0.5 * damping * step)
        there = x + 0.5 * step * (v + after)
        out = running & (np.abs(there) >= 0.5 * g.backlash1)
        share = (0.5 * g.backlash1 - np.abs(x[out])) / (np.abs(there[out]) - np.abs(x[out]))
        at[out], speed[out] = times[k] + share * step, v[out] + share * (after - v)[out]
        running &= ~out
        x = there
        v = after
    assert not running.any()
    return at, speed


def ratios(bandwidth, sigma, seed=5):
    """Measured sds of time and speed at the first impact over those of white noise."""
    scene = Scene.from_gears(GEARS, sigma=sigma, stages=1, start=START)
    row = mean_map(scene, impacts=1, closure="saltation").section_in("physical").iloc[0]
    at, speed = first_impacts(bandwidth, seed)
    return np.array([1000.0 * at.std() / row["sd_tau_ms"], speed.std() / row["sd_y1_mm_per_s"]])


DRIVE = GEARS.omega / (2.0 * math.pi)  # Hz
ERROR = 1.0 / math.sqrt(2.0 * PATHS)  # standard error of a ratio
WIDE = 40.0 * DRIVE


def test_a_wide_band_acts_as_white_noise_of_its_density():
    sigma = GEARS.sigma_from(rms=RMS, bandwidth=WIDE)
    found = ratios(WIDE, sigma)
    assert np.all(np.abs(found - 1.0) < 4.0 * ERROR)
    for wrong in (
        math.sqrt(0.5),
        math.sqrt(2.0),
        2.0,
    ):  # a two-sided bandwidth; a factor 2 in density; one in sigma
        assert np.all(np.abs(found / wrong - 1.0) > 15.0 * ERROR)


@pytest.mark.parametrize(
    ("band", "time", "speed"), [(1.0, 0.67, 0.48), (2.0, 0.87, 0.69), (5.0, 1.00, 0.92)]
)
def test_a_narrow_band_does_less_as_the_guide_says(band, time, speed):
    found = ratios(band * DRIVE, GEARS.sigma_from(rms=RMS, bandwidth=band * DRIVE))
    assert np.all(np.abs(found - (time, speed)) < 4.0 * ERROR)


def test_a_spectrum_counts_by_its_mean_density():
    flat = GEARS.sigma_from(rms=0.03, bandwidth=50.0)
    level = 0.03**2 / 50.0
    assert GEARS.sigma_from(spectrum=([0.0, 20.0, 50.0], [level] * 3)) == pytest.approx(
        flat, rel=1e-14
    )
    sloped = np.linspace(0.0, 50.0, 11), np.linspace(2.0 * level, 0.0, 11)
    assert GEARS.sigma_from(spectrum=sloped) == pytest.approx(flat, rel=1e-14)
    assert GEARS.sigma_from(spectrum=([10.0, 60.0], [level, level])) == pytest.approx(
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
    with pytest.raises(InputError, match=words):
        GEARS.sigma_from(**given)
