"""What is left out at meshes that are pressed shut: nothing that is asked for."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mc_checks import Walk

from rattle import stationary
from rattle.montecarlo.long_run.sums import ENERGY, NUMBER, PERIOD, new_sums, no_scales
from rattle.montecarlo.schemes.quiet import quiet_of, tail_exponent
from rattle.scene import Scene, Wheel

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


def follow(resolve, seed):
    settings = {"periods": 64, "paths": 16, "burn_in": 16, "closures": ()}
    return stationary(CHATTER, resolve=resolve, rng=seed, **settings).run


@pytest.fixture(scope="module")
def runs():
    return follow(0.0, 1), follow(None, 2)


def test_a_tenth_of_the_impacts_gives_what_is_asked_for(runs):
    """Rates above a speed, speeds and energy; 5 % put in are noticed."""
    whole, part = runs
    assert part.impacts < 0.3 * whole.impacts
    assert whole.left_out[1:] == (0.0, 0.0)
    for name in ("rate_above", "speed_above", "power", "power_mesh1", "power_mesh2"):
        a = whole.estimates[name]
        b = part.estimates[name]
        allowed = 4.0 * math.hypot(a.se, b.se)
        assert abs(b.value - a.value) < allowed, name
        assert abs(1.05 * b.value - a.value) > allowed, name  # negative control


def test_what_is_left_out_is_stated(runs):
    _, part = runs
    time, energy, above = part.left_out
    assert 0.1 < time < 1.0
    assert 0.0 < energy < 0.01
    assert above < 1e-3 * part.estimates["rate_above"].value
    assert part.quiet == 0.0125


PRESSED = Wheel(beta=0.0, gamma=3.0, gap=0.5)
CHAIN = (PRESSED, replace(PRESSED, parent=1, mass=0.7), replace(PRESSED, parent=2, mass=1.3))
STAR = (PRESSED, replace(PRESSED, ratio=1.2, mass=0.7), replace(PRESSED, ratio=0.8, mass=1.3))


@pytest.mark.parametrize(
    ("wheels", "moved"),
    [
        (CHAIN[:1], 1.0),
        (CHAIN[:2], 1.7),
        (CHAIN, 3.0),
        (STAR, 1.0 + 1.2**2 * 0.7 + 0.8**2 * 1.3),
    ],
    ids=["one", "two", "a chain", "three at the driver"],
)
def test_the_noise_that_closed_meshes_take_up_is_energy_lost(wheels, moved):
    """Pressed shut all the time: what the noise supplies (docs/model.md section 10)."""
    pressed = Scene(alpha=1.0, epsilon=0.5, sigma=0.05, wheels=wheels)
    scales = no_scales(len(wheels), 0.1)
    walk = Walk(pressed, np.random.SeedSequence(3), 0, 4, quiet_of(pressed, 0.1, None))
    walk.follow(new_sums(4, 16, scales, detail=False), periods=16)
    sums = new_sums(4, 16, scales, detail=False)
    walk.follow(sums, periods=16)
    assert sums.main[:, :, NUMBER].sum() == 0.0
    supplied = 0.25 * pressed.sigma**2 * moved * PERIOD
    assert sums.main[:, :, ENERGY] == pytest.approx(supplied, rel=1e-3)


def count_impacts(*wheels: Wheel) -> float:
    """Impacts of some paths, every one of them followed."""
    scene = Scene(alpha=1.6, sigma=0.045, wheels=wheels)
    walk = Walk(scene, np.random.SeedSequence(1), 0, 4)
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


def test_wheels_in_a_row_that_noise_lifts_lose_what_it_supplies():
    """Nearly elastic and pressed shut by hardly more than the noise: held closed while the force in
    mesh 1 exceeds the noise of one wheel alone, not of both, they lost 28 % less."""
    pair = (replace(PRESSED, epsilon=0.9), replace(PRESSED, epsilon=0.9, parent=1, mass=1.5))
    pressed = Scene(alpha=1.5, sigma=0.1, wheels=pair)
    scales = no_scales(2, 0.1)
    walk = Walk(pressed, np.random.SeedSequence(3), 0, 8, quiet_of(pressed, 0.1, None))
    walk.follow(new_sums(8, 4, scales, detail=False), periods=4)
    sums = new_sums(8, 8, scales, detail=False)
    walk.follow(sums, periods=8)
    lost = sums.main[:, :, ENERGY].mean(axis=1)
    supplied = 0.25 * pressed.sigma**2 * 2.5 * PERIOD
    se = lost.std(ddof=1) / math.sqrt(lost.size)
    assert se < 0.03 * supplied
    assert lost.mean() == pytest.approx(supplied, abs=4.0 * se)


def test_the_tail_of_impact_speeds():
    """Restitution does not matter up to a half; a nearly elastic mesh keeps its energy."""
    assert tail_exponent(0.0) == pytest.approx(1.0)
    assert tail_exponent(0.5) == pytest.approx(1.0)
    assert tail_exponent(0.99) == pytest.approx(0.03, rel=0.01)
    assert quiet_of(CHATTER, 0.1, 0.0).speed == 0.0
