"""Wheels on several shafts: samples against plain steps, small noise, and the control variate."""

from dataclasses import replace

import numpy as np
import pytest
from mc_checks import agrees

from rattle import Record, Sampling, mean_map, simulate
from rattle.scene import Scene, Start, Wheel

IMPACTS = 4
STATE = (0.05, 1.1, -0.1, -0.6, 0.12, -0.9, 0.02, 0.8)
TREE = Scene(
    alpha=1.5,
    sigma=0.3,
    start=Start(0.3, state=STATE),
    wheels=(
        Wheel(beta=0.1, gamma=0.3, gap=0.5, epsilon=0.9),
        Wheel(beta=0.25, gamma=0.1, gap=0.3, mass=0.7, parent=1, ratio=1.4, epsilon=0.8),
        Wheel(beta=0.05, gamma=0.2, gap=0.4, mass=1.3, parent=1, ratio=0.7, epsilon=0.7),
        Wheel(beta=0.4, gamma=0.4, gap=0.35, mass=0.5, parent=0, ratio=1.2, epsilon=0.85),
    ),
)
"""Two wheels on the driver, two on the first of them."""
_first, _second, *_others = TREE.wheels
WRONG = replace(TREE, wheels=(_first, replace(_second, ratio=1.02 * _second.ratio), *_others))
"""The planted error: a ratio that is 2 % off."""


@pytest.mark.parametrize("scene", [TREE, WRONG], ids=["tree", "wrong ratio"])
def test_exact_flights_have_the_moments_of_plain_steps(scene):
    """Extrapolated from dt and 2 dt on the same noise; what that leaves is estimated from 4 dt."""
    steps = {"scheme": "euler-maruyama", "dt": 5e-4, "record": Record(step_bias=True)}
    plain = simulate(TREE, paths=20_480, impacts=IMPACTS, rng=1, **steps).step_bias
    exact = simulate(scene, paths=40_960, impacts=IMPACTS, rng=2).step_bias
    assert (plain["quantity"] == exact["quantity"]).all()
    varies = plain["se_corrected"] > 1e-6  # not the wall that nearly all paths strike
    assert varies.sum() > 60
    a = exact[varies]
    b = plain[varies]
    se = np.hypot(a["se_corrected"], b["se_corrected"])
    same = agrees(a["corrected"], b["corrected"], se, slack=b["rest"])
    assert same == (scene is TREE)


@pytest.mark.parametrize("scene", [TREE, WRONG], ids=["tree", "wrong ratio"])
def test_small_noise_has_the_sds_of_the_linear_theory(scene):
    """To 0.5 %, which is 4.5 standard errors of so many paths."""
    quiet = replace(TREE, sigma=1e-3)
    run = simulate(replace(scene, sigma=1e-3), paths=409_600, impacts=IMPACTS, rng=3)
    theory = mean_map(quiet, impacts=IMPACTS, closure="saltation").section
    names = [name for name in theory if name.startswith("sd_")]
    assert len(names) == 10
    sampled = run.section[names].to_numpy()
    varies = sampled > 1e-8
    off = np.abs(sampled[varies] / theory[names].to_numpy()[varies] - 1.0).max()
    assert (off < 5e-3) == (scene is TREE)


def test_the_control_variate_lessens_the_errors():
    quiet = replace(TREE, sigma=0.03)
    plain, controlled = (
        simulate(quiet, paths=8192, impacts=IMPACTS, rng=4, sampling=Sampling(control=control))
        for control in (False, True)
    )
    moments = [name for name in plain.section if name.startswith("se_") and "k" not in name]
    before = plain.section[moments].to_numpy()
    after = controlled.section[moments].to_numpy()
    varies = before > 1e-9
    assert np.median(before[varies] / after[varies]) > 5.0
    assert (after[varies] <= 1.03 * before[varies]).all()
    other = simulate(quiet, paths=8192, impacts=IMPACTS, rng=5).section
    values = [name.removeprefix("se_") for name in moments]
    assert agrees(
        controlled.section[values].to_numpy()[varies],
        other[values].to_numpy()[varies],
        np.hypot(after, other[moments].to_numpy())[varies],
    )
