"""The exact flight: its Gaussian distribution, its orbit, and no step bias, against truths and
other schemes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mc_checks import (
    DAMPED,
    TOLERANT,
    UNEQUAL_GAPS,
    agrees,
    dat21,
    orbit_of,
)

from rattle.montecarlo import Record, largest_step, simulate
from rattle.scene import Start, Tolerance, section_names

EXACT = "exact-flight"


ORBITS = {
    "DAT21": dat21(),
    "unequal gaps": UNEQUAL_GAPS,
    "damped": DAMPED,
    "single": dat21(stages=1),
    "wider": dat21(tolerance=Tolerance(0.04, 0.02, distribution="fixed")),
    "plastic": replace(UNEQUAL_GAPS, epsilon=0.05),
    "slow": replace(dat21(), alpha=0.3),
    "in flight": replace(dat21(), start=Start(0.4, 0.1, -0.3, -0.2, 0.6)),
}


def orbit_error(scene, dt, impacts=8, **changes):
    """Largest difference of impact times and states from the orbit by flight and restitution map
    alone."""
    rows = orbit_of(replace(scene, **changes), impacts)
    raw = simulate(
        scene, paths=1, impacts=impacts, dt=dt, scheme=EXACT, record=Record(raw=True)
    ).raw[0]
    if (raw[:, -1] != rows[:, -1]).any():
        return math.inf
    return np.abs(np.delete(raw, 1, axis=1) - rows).max()


@pytest.mark.parametrize("case", ORBITS)
def test_noise_free_path_is_the_orbit_at_any_step(case):
    """Impacts are placed to 1e-10 of the half gap, and orbits expand."""
    scene = ORBITS[case]
    largest = largest_step(scene, EXACT)[0]
    for dt in (largest, 0.37 * largest, math.pi / 128.0, 1e-3):
        assert orbit_error(scene, dt, impacts=5) < 1e-9
        assert orbit_error(scene, dt, impacts=8) < 1e-8


def test_orbit_check_sees_another_restitution():
    assert orbit_error(dat21(), math.pi / 32.0, epsilon=dat21().epsilon + 1e-8) > 1e-9


def moments(run, prefixes=("", "sd_"), least=1e-9):
    """Section means and sds of what varies, with standard errors, flat."""
    table = run.section
    names = [p + q for p in prefixes for q in section_names(run.scene.stages)]
    values = table[names].to_numpy().ravel()
    se = table[[f"se_{n}" for n in names]].to_numpy().ravel()
    return values, se, se > least


def same_moments(a, b, slack=0.0):
    u, se_u, varies = moments(a)
    v, se_v, _ = moments(b)
    return agrees(u[varies], v[varies], np.hypot(se_u, se_v)[varies], slack)


NOISE = (0.05, 0.5, math.sqrt(1.5))
WALLED = {"DAT21": dat21(), "unequal gaps": UNEQUAL_GAPS, "redrawn walls": TOLERANT}


def sampled(scene, dt, paths=10_000, impacts=6, rng=1, **settings):
    return simulate(scene, paths=paths, impacts=impacts, dt=dt, scheme=EXACT, rng=rng, **settings)


@pytest.mark.parametrize("sigma", NOISE)
@pytest.mark.parametrize("case", WALLED)
def test_section_does_not_depend_on_the_step(case, sigma):
    scene = replace(WALLED[case], sigma=sigma)
    assert same_moments(sampled(scene, math.pi / 32.0), sampled(scene, math.pi / 128.0, rng=2))


@pytest.mark.parametrize("change", [{"sigma": 1.1 * 0.5}, {"epsilon": 0.9 + 0.03}, {"gap1": 0.51}])
def test_comparison_of_steps_sees_another_scene(change):
    scene = dat21(0.5)
    start = replace(scene.start, x1=change.get("gap1", 0.5))
    other = sampled(replace(scene, start=start, **change), math.pi / 128.0, rng=2)
    assert not same_moments(sampled(scene, math.pi / 32.0), other)


def test_coarse_levels_of_one_noise_differ_by_no_bias():
    """Means at dt, 2 dt and 4 dt on the same noise: differences far below the spread, and within
    their errors."""
    table = sampled(dat21(0.05), math.pi / 64.0, 20_000, 4, record=Record(step_bias=True)).step_bias
    seen = table[table.se_bias > 1e-9]
    assert len(seen) > 20
    assert agrees(seen.bias, 0.0, seen.se_bias)


@pytest.mark.parametrize(
    "scene", [dat21(0.5), replace(TOLERANT, sigma=0.2)], ids=["fixed", "redrawn"]
)
def test_section_is_that_of_extrapolated_euler_steps(scene):
    """To sampling errors and what extrapolation says that it leaves; another restitution is
    seen."""
    settings = {"paths": 20_000, "impacts": 3, "rng": 5}
    record = Record(step_bias=True)
    scheme = "euler-maruyama-located"
    euler = simulate(scene, dt=2.5e-3, scheme=scheme, record=record, **settings).step_bias
    euler = euler[euler["se_corrected"] > 1e-9]
    places = [
        (impact, ("" if moment == "mean" else "sd_") + quantity)
        for impact, moment, quantity in euler[["impact", "moment", "quantity"]].to_numpy()
    ]

    def is_alike(other):
        section = simulate(other, scheme=EXACT, **settings).section
        value, se = np.array([(section.loc[k, n], section.loc[k, f"se_{n}"]) for k, n in places]).T
        se = np.hypot(se, euler["se_corrected"])
        return agrees(value, euler["corrected"], se, slack=euler["rest"])

    assert is_alike(scene)
    assert not is_alike(replace(scene, epsilon=scene.epsilon - 0.03))
