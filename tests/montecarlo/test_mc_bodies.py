"""Bodies and wheels with noise of their own, some drawn at random over orders of magnitude: exact
flights against Euler's steps, and against the energy that drive and noise supply.

A ball and an oscillator whose truths are known are in ``rattle check published``.
"""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from limits import agrees
from mc_checks import largest_z
from scenes import OSCILLATOR, tree
from settings import EULER, EXACT, LOCATED

from rattle import Scene, Start, Wheel, simulate
from rattle.montecarlo.long_run import long_run
from rattle.scene import Restitution

KINDS_OF_BODIES = ("ball", "oscillator with one wall", "oscillator with two walls", "pair")
ONE_SIDED = KINDS_OF_BODIES[:2]
NOISES = ("body", "drive", {"drive": 1.0, "body": 0.5})
"""Of the bodies of each kind."""


def draw(kind, number):
    """A body at a random place of its ranges; its noise, of the drive, its own or both, adds a
    speed of 3 to 100 % of that of its start in a unit of time."""
    rng = np.random.default_rng([7, KINDS_OF_BODIES.index(kind), number])

    def size(least, most):
        return 10.0 ** rng.uniform(math.log10(least), math.log10(most))

    alpha = size(0.1, 10.0)
    gap = size(0.1, 3.0)
    stiffness = size(0.03, 3.0)  # a stiff spring gains energy by explicit steps
    body = Wheel(
        beta=size(0.03, 3.0),
        gamma=size(0.1, 10.0) if kind == "ball" else size(1e-3, 0.3),
        stiffness=stiffness if "oscillator" in kind else 0.0,
        one_sided=kind in ONE_SIDED,
        gap=0.0 if kind in ONE_SIDED and number == 0 else gap,
        epsilon=rng.uniform(0.3, 1.0),
        name="body",
    )
    x = body.gap - rng.uniform(0.1, 1.5) * gap
    speed = alpha + gap * math.sqrt(1.0 + body.stiffness) + math.sqrt(body.gamma * gap)
    start = Start(rng.uniform(0.0, 6.0), x, rng.choice([-1.0, 1.0]) * speed)
    sigma = size(0.03, 1.0) * speed
    return Scene(alpha=alpha, sigma=sigma, noise=NOISES[number], wheels=[body], start=start)


DRAWN = {kind: [draw(kind, number) for number in range(3)] for kind in KINDS_OF_BODIES}
GROUPS = DRAWN | {
    "oscillator on a table": [OSCILLATOR.with_sigma(0.3)],
    "second of two wheels": [replace(tree((0, 1)), sigma=0.3, noise=2)],
    "wheel that drives two": [replace(tree((0, 1, 1)), sigma=0.3, noise=1)],
    "drive and both wheels": [replace(tree((0, 1)), sigma=0.2, noise={"drive": 1, 1: 0.5, 2: 2.0})],
}


def corrected_moments(scenes, scheme, seed):
    """Means and sds of flights and impact speeds of three impacts, extrapolated to steps of length
    0."""
    given = {"paths": 4096, "impacts": 3, "scheme": scheme, "rng": seed}
    table = pd.concat([simulate(scene, **given).step_bias for scene in scenes], ignore_index=True)
    return table[table["quantity"].isin(["flight", "y1"])]


@pytest.mark.parametrize("name", GROUPS)
def test_exact_flights_agree_with_fine_steps(name):
    """A fifth more noise is seen."""
    group = GROUPS[name]
    exact = corrected_moments(group, EXACT, 1)
    noisier = corrected_moments([one.with_sigma(1.2 * one.sigma) for one in group], EXACT, 1)
    for scheme in (EULER, LOCATED):
        steps = corrected_moments(group, scheme, 2)
        se = np.hypot(exact["se_corrected"], steps["se_corrected"])
        truth = steps["corrected"]
        assert agrees(exact["corrected"], truth, se, steps["rest"])
        assert not agrees(noisier["corrected"], truth, se, steps["rest"])


def shaken(parents, noise, alpha):
    """Wheels without drag, some of which have noise of their own."""
    return replace(tree(parents, gamma=0.0), alpha=alpha, sigma=0.5, noise=noise)


def bouncing(**restitution):
    """A mass whose random restitution falls with the impact speed."""
    law = Restitution(sd=0.1, **restitution)
    mass = Wheel(beta=0.1, gap=0.0, stiffness=1.0, one_sided=True, restitution=law)
    return Scene(alpha=0.0, epsilon=0.7, sigma=0.5, noise=1, wheels=[mass])


ENERGY = {
    "first of two behind it": [shaken((0, 1, 1), 2, 0.0)],
    "second of two": [shaken((0, 1), 2, 1.0)],
    "wheel that drives two": [shaken((0, 1, 1), 1, 0.5)],
    "noise of the drive": [tree((0, 1, 1, 0), alpha=1.5, sigma=1.0)],
    "two noises": [shaken((0, 1), {1: 0.5, 2: 1.0}, 1.0)],
    "restitution by a formula": [bouncing(speed=2.0)],
    "restitution by a table": [bouncing(table=[(0.1, 0.7), (0.5, 0.6), (1.0, 0.3)])],
    "bodies": [one.with_sigma(abs(one.start.y1)) for drawn in DRAWN.values() for one in drawn],
}
"""Noise of bodies is so strong that no contact stays closed."""


@pytest.mark.parametrize("name", ENERGY)
def test_impacts_lose_what_noise_and_drive_supply(name):
    """The noise of a wheel supplies ``sigma^2 / 2`` times its mass; 5 % less supply is seen.  The
    loss counts the variance of a restitution."""
    found = []
    for scene in ENERGY[name]:
        run = long_run(scene, periods=128, paths=64, rng=3)
        lost, supplied = run.energy_balance()
        se = (lost - supplied).std(ddof=1) / math.sqrt(run.paths)
        found.append((lost.mean(), supplied.mean(), se))
    lost, supplied, se = np.transpose(found)
    assert agrees(lost, supplied, se)
    assert not agrees(lost, 0.95 * supplied, se)


def test_wheels_that_are_locked_together_share_their_noises():
    """Two wheels whose mesh is pressed shut fly as one: its noise is that of both, in proportion to
    their masses."""
    first = Wheel(gamma=0.5)
    second = Wheel(gamma=2.5, gap=0.4, mass=0.6, parent=1, epsilon=0.0)
    free = {"alpha": 0.0, "epsilon": 0.8}
    pair = Scene(
        **free,
        sigma=3e-3,
        wheels=[first, second],
        noise={1: 1.0, 2: 2.0},
        start=Start(state=(-0.4, 0.0, -0.4, -0.16), mesh=2),
    )
    together = Wheel(gamma=(0.5 + 0.6 * 2.5) / 1.6)
    sigma = pair.sigma * math.hypot(1.0, 0.6 * 2.0) / 1.6
    one = Scene(**free, sigma=sigma, wheels=[together], noise=1, start=Start(state=(-0.4, 0.06)))
    found, known, wrong = (
        simulate(scene, paths=8192, impacts=1, rng=seed).section
        for seed, scene in enumerate((pair, one, one.with_sigma(1.1 * sigma)))
    )
    names = ["sd_flight", "sd_y1"]
    assert largest_z(found, known, names) < 3.5 < largest_z(found, wrong, names)


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
