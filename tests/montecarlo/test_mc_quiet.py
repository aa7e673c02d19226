"""What is left out at meshes that are pressed shut: nothing that is asked for."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mc_checks import Walk

from rattle import Scene, Wheel
from rattle.montecarlo.long_run.run import long_run
from rattle.montecarlo.long_run.sums import ENERGY, NUMBER, new_sums, no_scales
from rattle.montecarlo.schemes.quiet import quiet_of, tail_exponent
from rattle.scene.drive import PERIOD

CHATTER = Scene(
    alpha=1.6,
    epsilon=0.45,
    beta1=0.02,
    beta2=0.05,
    gamma1=0.36,
    gamma2=0.3,
    mu=0.5,
    gap2=0.4,
    sigma=0.045,
)


def test_a_tenth_of_the_impacts_gives_what_is_asked_for():
    """Rates above a speed, speeds and energy; 5 % put in are noticed.  What is left out is
    stated."""
    given = {"periods": 64, "paths": 16, "burn_in": 4}
    whole = long_run(CHATTER, resolve=0.0, rng=1, **given)
    part = long_run(CHATTER, rng=2, **given)
    assert part.impacts < 0.3 * whole.impacts
    assert whole.left_out[1:] == (0.0, 0.0)
    for name in ("rate_above", "speed_above", "power", "power_mesh1", "power_mesh2"):
        a = whole.estimates[name]
        b = part.estimates[name]
        allowed = 4.0 * math.hypot(a.se, b.se)
        assert abs(b.value - a.value) < allowed, name
        assert abs(1.05 * b.value - a.value) > allowed, name  # negative control
    time, energy, above = part.left_out
    assert 0.1 < time < 1.0
    assert 0.0 < energy < 0.01
    assert above < 1e-3 * part.estimates["rate_above"].value
    assert part.quiet == 0.0125


WHEEL = Wheel(gamma=3.0, gap=0.5, epsilon=0.5)
LIGHTER = replace(WHEEL, mass=0.7)
HEAVIER = replace(WHEEL, mass=1.3)
QUIET_TREE = Scene(
    alpha=1.0, sigma=0.05, wheels=(WHEEL, replace(LIGHTER, parent=1), replace(HEAVIER, parent=2))
)
STAR = (WHEEL, replace(LIGHTER, ratio=1.2), replace(HEAVIER, ratio=0.8))
ELASTIC = replace(WHEEL, epsilon=0.9)
LIFTED = (ELASTIC, replace(ELASTIC, parent=1, mass=1.5))
PRESSED = {
    "a chain": (QUIET_TREE, 3.0),
    "three at the driver": (replace(QUIET_TREE, wheels=STAR), 1.0 + 1.2**2 * 0.7 + 0.8**2 * 1.3),
    "two that noise lifts": (Scene(alpha=1.5, sigma=0.1, wheels=LIFTED), 2.5),
}
"""Wheels whose meshes are pressed shut, and the mass that the noise moves."""


@pytest.mark.parametrize("name", PRESSED)
def test_the_noise_that_closed_meshes_take_up_is_energy_lost(name):
    """Over what the noise supplies (docs/model.md section 10).  Nearly elastic and pressed shut by
    hardly more than the noise, two wheels lost 28 % less: they were held closed while the force in
    mesh 1 exceeded the noise of one wheel alone, not of both."""
    scene, moved = PRESSED[name]
    walk = Walk(scene, np.random.SeedSequence(3), 0, 8, quiet_of(scene, 0.1, None))
    for _ in range(2):  # the second time from what the first one has found
        sums = new_sums(8, 8, no_scales(scene.stages, 0.1), detail=False)
        walk.follow(sums, periods=8)
    lost = sums.main[:, :, ENERGY].mean(axis=1) / (0.25 * scene.sigma**2 * moved * PERIOD)
    se = lost.std(ddof=1) / math.sqrt(8.0)
    assert se < 0.03
    assert lost.mean() == pytest.approx(1.0, abs=max(1e-3, 4.0 * se))
    assert sums.main[:, :, NUMBER].any() == (name == "two that noise lifts")


def count_impacts(*wheels):
    """Impacts of some paths, every one of them followed."""
    walk = Walk(Scene(alpha=1.6, sigma=0.045, wheels=wheels), np.random.SeedSequence(1), 0, 4)
    sums = new_sums(4, 4, no_scales(len(wheels), 0.1), detail=False)
    walk.follow(sums, periods=4)
    return float(sums.main[:, :, NUMBER].sum())


def test_wheels_that_chatter_beside_each_other_have_the_impacts_of_each():
    """Where three wheels shared the impacts that one may have in a step half of them were left out,
    and 0.8 % of the fast ones with them."""
    wheel = Wheel(beta=0.02, gamma=0.36, gap=0.5, epsilon=0.45)
    other = replace(wheel, beta=0.05, gamma=0.5, gap=0.4)
    alone = 2.0 * count_impacts(wheel) + count_impacts(other)
    assert alone > 20_000
    assert count_impacts(wheel, other, wheel) > 0.95 * alone


def test_the_tail_of_impact_speeds():
    """Restitution does not matter up to a half; a nearly elastic mesh keeps its energy."""
    assert tail_exponent(0.0) == pytest.approx(1.0)
    assert tail_exponent(0.5) == pytest.approx(1.0)
    assert tail_exponent(0.99) == pytest.approx(0.03, rel=0.01)
    assert quiet_of(CHATTER, 0.1, 0.0).speed == 0.0
