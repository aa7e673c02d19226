"""Noise that acts on a body: exact flights against Euler's steps, and the energy that it supplies.

A ball and an oscillator whose truths are known are in ``rattle check published``.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from mc_checks import agrees
from scenes import tree

from rattle import simulate
from rattle.montecarlo.long_run import long_run
from rattle.scene import Scene, Start, Wheel

MASS = Wheel(beta=0.2, gamma=0.1, gap=0.4, stiffness=2.0, name="mass")
SCENES = {
    "oscillator on a table": Scene(
        alpha=1.2,
        epsilon=0.8,
        sigma=0.3,
        noise="mass",
        wheels=[MASS],
        start=Start(0.3, -0.05, 0.5),
    ),
    "second of two wheels": replace(tree((0, 1)), sigma=0.3, noise=2),
    "wheel that drives two": replace(tree((0, 1, 1)), sigma=0.3, noise=1),
}


def moments(scene, scheme, seed):
    """Means and sds of the first three impacts, extrapolated to steps of length 0."""
    table = simulate(scene, paths=8192, impacts=3, scheme=scheme, rng=seed).step_bias
    return table[table["quantity"].isin(["flight", "y1"])]


@pytest.mark.parametrize("name", SCENES)
def test_schemes_agree(name):
    scene = SCENES[name]
    exact = moments(scene, "exact-flight", 1)
    noisier = moments(scene.with_sigma(1.2 * scene.sigma), "exact-flight", 1)  # negative control
    for scheme in ("euler-maruyama", "euler-maruyama-located"):
        steps = moments(scene, scheme, 2)
        se = np.hypot(exact["se_corrected"], steps["se_corrected"])
        truth = steps["corrected"]
        assert agrees(exact["corrected"], truth, se, steps["rest"])
        assert not agrees(noisier["corrected"], truth, se, steps["rest"])


@pytest.mark.parametrize(
    ("parents", "noisy", "alpha"), [((0, 1, 1), 2, 0.0), ((0, 1), 2, 1.0), ((0, 1, 1), 1, 0.5)]
)
def test_impacts_lose_what_noise_and_drive_supply(parents, noisy, alpha):
    """The noise of a wheel supplies ``sigma^2 / 2`` times its mass; 5 % of that is seen."""
    scene = replace(tree(parents, gamma=0.0), alpha=alpha, sigma=0.5, noise=noisy)
    run = long_run(scene, periods=128, paths=128, rng=3)
    lost, supplied = run.energy_balance()
    power = 0.5 * scene.sigma**2 * scene.tree[noisy - 1].mass

    def z(missing):
        difference = lost - supplied + missing * power
        return abs(difference.mean()) / difference.std(ddof=1) * math.sqrt(run.paths)

    assert z(0.0) < 4.0 < z(0.05)


def test_a_body_that_flies_for_long_is_not_given_up():
    """Its first flight takes 120; a path of gears is given up after 50 for each impact."""
    ball = Wheel(gamma=1.0, gap=0.0, one_sided=True, name="ball")
    start = Start(0.0, 0.0, -60.0)
    scene = Scene(alpha=0.0, epsilon=0.8, sigma=1.0, noise="ball", wheels=[ball], start=start)
    assert simulate(scene, paths=100, impacts=1).unfinished == 0


@pytest.mark.parametrize(("scheme", "off"), [("exact-flight", 0.0), ("euler-maruyama", 0.025)])
def test_default_steps_follow_a_stiff_spring(scheme, off):
    """It returns to the wall in its middle after half a period, and has lost what damping takes;
    Euler's energy grows by the share `off` in a radian, at a quarter of the longest step."""
    stiffness = 1e6
    mass = Wheel(beta=20.0, gap=0.0, stiffness=stiffness, one_sided=True)
    scene = Scene(alpha=0.0, epsilon=1.0, wheels=[mass], start=Start(0.0, 0.0, -1.0))
    row = simulate(scene, paths=1, impacts=1, scheme=scheme).section.iloc[0]
    half = math.pi / math.sqrt(stiffness - 100.0)
    assert row["flight"] == pytest.approx(half, rel=max(1e-9, off))
    grown = 0.5 * off * math.pi
    assert row["y1"] == pytest.approx(math.exp(-10.0 * half + grown), rel=max(1e-9, off))
