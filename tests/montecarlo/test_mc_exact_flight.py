"""The exact flight: no step bias, the moments of plain steps, and its margin beside walls."""

import math
from dataclasses import replace

import numpy as np
import pytest
from limits import agrees
from mc_checks import TOLERANT
from scenes import FOUR, UNEQUAL, dat21
from settings import STEP_BIAS

from rattle import simulate

LEVELS = {
    "DAT21": dat21(0.05),
    "unequal": UNEQUAL.with_sigma(1.2),
    "redrawn walls": TOLERANT.with_sigma(0.5),
}


@pytest.mark.parametrize("name", LEVELS)
def test_coarse_levels_of_one_noise_differ_by_no_bias(name):
    """Means and sds at dt, 2 dt and 4 dt on the same noise; that of Euler's steps is noticed."""
    steps = {"exact-flight": math.pi / 64.0, "euler-maruyama-located": 5e-3}
    for scheme, dt in steps.items() if name == "DAT21" else [("exact-flight", math.pi / 64.0)]:
        given = {"paths": 20_000, "impacts": 4, "rng": 1, "record": STEP_BIAS}
        table = simulate(LEVELS[name], scheme=scheme, dt=dt, **given).step_bias
        seen = table[table.se_bias > 1e-9]
        assert len(seen) > 20
        assert agrees(seen.bias, 0.0, seen.se_bias) == (scheme == "exact-flight")


first, second, *others = FOUR.wheels
OF_PLAIN_STEPS = {
    "redrawn walls": (TOLERANT.with_sigma(0.2), {"epsilon": TOLERANT.epsilon - 0.03}),
    "tree": (FOUR, {"wheels": (first, replace(second, ratio=1.02 * second.ratio), *others)}),
}
"""A scene, and a planted error."""


@pytest.mark.parametrize(("scene", "error"), OF_PLAIN_STEPS.values(), ids=OF_PLAIN_STEPS)
def test_exact_flights_have_the_moments_of_plain_steps(scene, error):
    """Extrapolated from dt and 2 dt on the same noise; what that leaves is estimated from 4 dt."""
    steps = {"scheme": "euler-maruyama", "dt": 1e-3, "record": STEP_BIAS}
    plain = simulate(scene, paths=20_480, impacts=3, rng=1, **steps).step_bias
    varies = plain["se_corrected"] > 1e-6  # not the wall that nearly all paths strike
    b = plain[varies]
    for other, alike in ((scene, True), (replace(scene, **error), False)):
        a = simulate(other, paths=20_480, impacts=3, rng=2).step_bias[varies]
        se = np.hypot(a["se_corrected"], b["se_corrected"])
        assert agrees(a["corrected"], b["corrected"], se, slack=b["rest"]) == alike
