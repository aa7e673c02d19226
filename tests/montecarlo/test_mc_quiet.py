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


@pytest.fixture(scope="module")
def runs():
    given = {"periods": 64, "paths": 16, "burn_in": 4}
    return long_run(CHATTER, resolve=0.0, rng=1, **given), long_run(CHATTER, rng=2, **given)


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


PRESSED_WHEEL = Wheel(beta=0.0, gamma=3.0, gap=0.5)
CHAIN = (
    PRESSED_WHEEL,
    replace(PRESSED_WHEEL, parent=1, mass=0.7),
    replace(PRESSED_WHEEL, parent=2, mass=1.3),
)
STAR = (
    PRESSED_WHEEL,
    replace(PRESSED_WHEEL, ratio=1.2, mass=0.7),
    replace(PRESSED_WHEEL, ratio=0.8, mass=1.3),
)


def lose(scene, moved, paths, periods):
    """Number of impacts, and mean and standard error of the energy that meshes pressed shut lose,
    over what the noise supplies (docs/model.md section 10) to so much mass."""
    scales = no_scales(scene.stages, 0.1)
    walk = Walk(scene, np.random.SeedSequence(3), 0, paths, quiet_of(scene, 0.1, None))
    walk.follow(new_sums(paths, periods, scales, detail=False), periods=periods)
    sums = new_sums(paths, periods, scales, detail=False)
    walk.follow(sums, periods=periods)
    share = sums.main[:, :, ENERGY].mean(axis=1) / (0.25 * scene.sigma**2 * moved * PERIOD)
    return sums.main[:, :, NUMBER].sum(), share.mean(), share.std(ddof=1) / math.sqrt(paths)


@pytest.mark.parametrize(
    ("wheels", "moved"),
    [(CHAIN, 3.0), (STAR, 1.0 + 1.2**2 * 0.7 + 0.8**2 * 1.3)],
    ids=["a chain", "three at the driver"],
)
def test_the_noise_that_closed_meshes_take_up_is_energy_lost(wheels, moved):
    pressed = Scene(alpha=1.0, epsilon=0.5, sigma=0.05, wheels=wheels)
    impacts, lost, _ = lose(pressed, moved, paths=4, periods=4)
    assert impacts == 0.0
    assert lost == pytest.approx(1.0, rel=1e-3)


def test_wheels_in_a_row_that_noise_lifts_lose_what_it_supplies():
    """Nearly elastic and pressed shut by hardly more than the noise: held closed while the force in
    mesh 1 exceeds the noise of one wheel alone, not of both, they lost 28 % less."""
    pair = (
        replace(PRESSED_WHEEL, epsilon=0.9),
        replace(PRESSED_WHEEL, epsilon=0.9, parent=1, mass=1.5),
    )
    pressed = Scene(alpha=1.5, sigma=0.1, wheels=pair)
    _, lost, se = lose(pressed, 2.5, paths=8, periods=8)
    assert se < 0.03
    assert lost == pytest.approx(1.0, abs=4.0 * se)


def count_impacts(*wheels):
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


def test_the_tail_of_impact_speeds():
    """Restitution does not matter up to a half; a nearly elastic mesh keeps its energy."""
    assert tail_exponent(0.0) == pytest.approx(1.0)
    assert tail_exponent(0.5) == pytest.approx(1.0)
    assert tail_exponent(0.99) == pytest.approx(0.03, rel=0.01)
    assert quiet_of(CHATTER, 0.1, 0.0).speed == 0.0
