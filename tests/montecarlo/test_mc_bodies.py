"""Noise that acts on a body: exact flights against Euler's steps, and the energy that it supplies.

A ball and an oscillator whose truths are known are in ``rattle check published``.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from limits import agrees
from scenes import OSCILLATOR, tree

from rattle import simulate
from rattle.montecarlo.long_run import long_run
from rattle.scene import Scene, Start, Wheel

NOISY_SCENES = {
    "oscillator on a table": OSCILLATOR.with_sigma(0.3),
    "second of two wheels": replace(tree((0, 1)), sigma=0.3, noise=2),
    "wheel that drives two": replace(tree((0, 1, 1)), sigma=0.3, noise=1),
    "drive and both wheels": replace(tree((0, 1)), sigma=0.2, noise={"drive": 1, 1: 0.5, 2: 2.0}),
}


def moments(scene, scheme, seed):
    """Means and sds of the first three impacts, extrapolated to steps of length 0."""
    table = simulate(scene, paths=8192, impacts=3, scheme=scheme, rng=seed).step_bias
    return table[table["quantity"].isin(["flight", "y1"])]


@pytest.mark.parametrize("name", NOISY_SCENES)
def test_schemes_agree(name):
    scene = NOISY_SCENES[name]
    exact = moments(scene, "exact-flight", 1)
    noisier = moments(scene.with_sigma(1.2 * scene.sigma), "exact-flight", 1)  # negative control
    for scheme in ("euler-maruyama", "euler-maruyama-located"):
        steps = moments(scene, scheme, 2)
        se = np.hypot(exact["se_corrected"], steps["se_corrected"])
        truth = steps["corrected"]
        assert agrees(exact["corrected"], truth, se, steps["rest"])
        assert not agrees(noisier["corrected"], truth, se, steps["rest"])


@pytest.mark.parametrize(
    ("parents", "noise", "alpha"),
    [((0, 1, 1), 2, 0.0), ((0, 1), 2, 1.0), ((0, 1, 1), 1, 0.5), ((0, 1), {1: 0.5, 2: 1.0}, 1.0)],
)
def test_impacts_lose_what_noise_and_drive_supply(parents, noise, alpha):
    """The noise of a wheel supplies ``sigma^2 / 2`` times its mass; 5 % of that is seen."""
    scene = replace(tree(parents, gamma=0.0), alpha=alpha, sigma=0.5, noise=noise)
    run = long_run(scene, periods=128, paths=128, rng=3)
    lost, supplied = run.energy_balance()
    noisy, intensity = scene.noise_sources[-1]
    power = 0.5 * (intensity * scene.sigma) ** 2 * scene.tree[noisy - 1].mass

    def z(missing):
        difference = lost - supplied + missing * power
        return abs(difference.mean()) / difference.std(ddof=1) * math.sqrt(run.paths)

    assert z(0.0) < 4.0 < z(0.05)


def test_wheels_that_are_locked_together_share_their_noises():
    """Two wheels whose mesh is pressed shut fly as one: its noise is that of both, in proportion to
    their masses."""
    first = Wheel(beta=0.0, gamma=0.5, gap=0.5)
    second = Wheel(beta=0.0, gamma=2.5, gap=0.4, mass=0.6, parent=1, epsilon=0.0)
    start = Start(state=(-0.4, 0.0, -0.4, -0.16), mesh=2)
    pair = Scene(
        alpha=0.0,
        epsilon=0.8,
        sigma=3e-3,
        wheels=[first, second],
        noise={1: 1.0, 2: 2.0},
        start=start,
    )
    together = replace(first, gamma=(0.5 + 0.6 * 2.5) / 1.6)
    start = Start(state=(-0.4, 0.06))
    sigma = pair.sigma * math.hypot(1.0, 0.6 * 2.0) / 1.6
    one = Scene(alpha=0.0, epsilon=0.8, sigma=sigma, wheels=[together], noise=1, start=start)
    found = simulate(pair, paths=8192, impacts=1, rng=1).section
    for scene, planted in ((one, 1.0), (one.with_sigma(1.1 * sigma), 1.1)):
        known = simulate(scene, paths=8192, impacts=1, rng=2).section
        for name in ("flight", "y1"):
            se = math.hypot(found[f"se_sd_{name}"].iloc[0], known[f"se_sd_{name}"].iloc[0])
            off = abs(found[f"sd_{name}"].iloc[0] - known[f"sd_{name}"].iloc[0]) / se
            assert (off < 3.5) == (planted == 1.0), (name, off)


def test_a_body_that_flies_for_long_is_not_given_up():
    """Its first flight takes 120; a path of gears is given up after 50 for each impact."""
    ball = Wheel(gamma=1.0, gap=0.0, one_sided=True, name="ball")
    start = Start(0.0, 0.0, -60.0)
    scene = Scene(alpha=0.0, epsilon=0.8, sigma=1.0, noise="ball", wheels=[ball], start=start)
    assert simulate(scene, paths=100, impacts=1).unfinished == 0


@pytest.mark.parametrize(("scheme", "off"), [("exact-flight", 0.0), ("euler-maruyama", 0.004)])
def test_default_steps_follow_a_stiff_spring(scheme, off):
    """It returns to the wall in its middle after half a period, and has lost what damping takes;
    the energy of a plain Euler step would grow by 8 % meanwhile."""
    stiffness = 1e6
    mass = Wheel(beta=20.0, gap=0.0, stiffness=stiffness, one_sided=True)
    scene = Scene(alpha=0.0, epsilon=1.0, wheels=[mass], start=Start(0.0, 0.0, -1.0))
    row = simulate(scene, paths=1, impacts=1, scheme=scheme).section.iloc[0]
    half = math.pi / math.sqrt(stiffness - 100.0)
    assert row["flight"] == pytest.approx(half, rel=max(1e-9, off))
    assert row["y1"] == pytest.approx(math.exp(-10.0 * half), rel=max(1e-9, off))
