"""The saltation closure between impacts: sds and rho of all paths at one time, against
simulation."""

import numpy as np
import pytest
from common_scenes import SCENES

from rattle.closure import follow, mean_map
from rattle.montecarlo import Record, simulate
from rattle.scene import state_names

LIMIT = 4.0  # standard errors; of at most 72 moments of a scene, Bonferroni at 0.5 %
# sds of the impact times that must fit between a fixed time and the impacts around it
CLEAR = 6.0
STEP = 5e-3
SHORT = 10 * STEP  # a fixed time is a whole number of steps, and lies beside the middle of a flight
SLOW = 0.2  # speed of an impact after which first order in the noise is not enough
ROUNDED = 1e-3  # of a correlation, by what is of second order: near a focus it is known to 1e-5


def middles(orbit, section):
    """Middles of the flights in which all paths follow the orbit, at a distance from impacts."""
    times = []
    for k in range(1, orbit.found + 1):
        half = 0.5 * (orbit.tau[k] - orbit.tau[k - 1])
        near = half < CLEAR * section["sd_tau"].loc[max(k - 1, 1) : k].max()
        if near or section["agreement"].loc[k] < 1.0:
            break
        if 2.0 * half > SHORT:
            times.append(orbit.tau[k] - half)
        if np.abs(orbit.before[k, 2 * orbit.mesh[k] - 1]) < SLOW:
            break
    return times


@pytest.fixture(scope="module", params=SCENES)
def sampled(request):
    """A scene, and the moments of exact flights in the middle of its flights."""
    scene = SCENES[request.param](0.002)
    orbit = follow(scene, 12)
    settings = {"paths": 30_000, "scheme": "exact-flight", "dt": STEP, "rng": 5}
    section = simulate(scene, impacts=12, **settings).section
    record = Record(times=middles(orbit, section))
    return scene, simulate(scene, impacts=1, record=record, **settings).at_times()


def excess(scene, fixed, closure, scale=1.0):
    """Standard errors by which a closure, its covariances times `scale`, is off."""
    predicted = mean_map(scene, impacts=12, closure=closure).at_times(fixed.index)
    worst = []
    for name in state_names(scene.stages):
        variance = f"cov_{name}_{name}"
        worst.append(
            (scale * predicted[variance] - fixed[variance]).abs() / fixed[f"se_{variance}"]
        )
    for name in ("rho1", "rho2")[: scene.stages]:
        off = (predicted[name] - fixed[name]).abs()
        worst.append((off - ROUNDED) / fixed[f"se_{name}"])
    last = f"x{scene.stages}"
    still = fixed[f"cov_{last}_{last}"] < 1e-15  # before what the other wheels do to it
    return np.array(worst)[:, ~still]


def test_sds_and_rho_between_impacts(sampled):
    scene, fixed = sampled
    assert len(fixed) >= 4
    assert (excess(scene, fixed, "saltation") < LIMIT).all()
    # negative control: covariances 5 % too large, and the closure whose impact times do not vary
    assert (excess(scene, fixed, "saltation", scale=1.05) > LIMIT).any()
    assert (excess(scene, fixed, "corrected") > LIMIT).mean() > 0.2
