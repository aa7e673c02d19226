"""The branching closure at fixed times: against the saltation closure at small noise, and exact
flights at larger."""

from dataclasses import replace

import numpy as np
import pytest
from limits import LEEWAY
from random_gears import gear_sets, noisy
from refusals import refusal
from scenes import dat21

from rattle import Record, Tolerance, follow, mean_map, simulate
from rattle.scene import state_names

BRANCHED_IMPACTS = 6
ONE_STAGE_SET, TWO_STAGE_SET = (
    gear_sets()[i].phase_reduced for i in (4, 5)
)  # one stage, two stages
BRANCHED = {  # and what is allowed besides sampling, in sds
    "DAT21, strong": (noisy(dat21(), 0.3), 0.05),
    "two stages": (noisy(TWO_STAGE_SET, 0.03), 0.05),
    "flanks of each contact": (
        replace(noisy(dat21(), 0.05), tolerance=Tolerance(0.02, 0.02, draw="contact")),
        0.05,
    ),
    "flanks of each path": (
        replace(noisy(TWO_STAGE_SET, 0.03), tolerance=Tolerance(0.02, 0.02, distribution="normal")),
        0.05,
    ),
}


def times_of(scene):
    """Middles of the orbit's flights, and its impacts: there a part of the paths has had the
    impact, a part not."""
    tau = follow(replace(scene, sigma=0.0), BRANCHED_IMPACTS).tau
    return np.sort(np.concatenate([0.5 * (tau[1:] + tau[:-1]), tau[1:-1]]))


def flown(name):
    """A scene, what is allowed, and its moments at fixed times."""
    scene, allowed = BRANCHED[name]
    record = Record(times=times_of(scene))
    run = simulate(
        scene, paths=40_000, impacts=1, scheme="exact-flight", rng=11, workers=1, record=record
    )
    return scene, allowed, run.at_times()


@pytest.fixture(scope="module", params=BRANCHED)
def case(request):
    return flown(request.param)


def outside(scene, allowed, sampled, closure):
    """How many means and sds are off by more than allowed, of how many."""
    m = mean_map(scene, impacts=BRANCHED_IMPACTS + 1, closure=closure)
    sampled = sampled[sampled.index < m.trace.span[1]]
    predicted = m.at_times(sampled.index)
    count = 0
    for name in state_names(scene.stages):
        variance = sampled[f"cov_{name}_{name}"]
        sd = variance**0.5
        leeway = LEEWAY * sampled[f"se_{name}"] / sd
        off = (predicted[name] - sampled[name]).abs() / sd
        count += (~(off < allowed + leeway)).sum()
        leeway = 0.5 * LEEWAY * sampled[f"se_cov_{name}_{name}"] / variance
        off = (predicted[f"cov_{name}_{name}"] ** 0.5 / sd - 1.0).abs()
        count += (~(off < 2.0 * allowed + leeway)).sum()
    return count, 4 * scene.stages * len(sampled)


def test_against_exact_flights(case):
    assert outside(*case, "branching")[0] == 0


def test_one_orbit_alone_is_wrong(case):
    """Negative control: the saltation closure, which has no paths on different flights."""
    count, rows = outside(*case, "saltation")
    assert count > 0.3 * rows


@pytest.mark.parametrize("scene", [ONE_STAGE_SET, TWO_STAGE_SET], ids=["one stage", "two stages"])
def test_in_flight_at_small_noise_it_is_the_saltation_closure(scene):
    """To first order: means differ by O(sigma) of an sd, which saltation leaves out there, sds by
    O(sigma^2)."""
    tau = follow(scene, BRANCHED_IMPACTS).tau
    times = 0.5 * (tau[1:] + tau[:-1])
    b, s = (
        mean_map(noisy(scene, 1e-5), impacts=BRANCHED_IMPACTS, closure=closure).at_times(times)
        for closure in ("branching", "saltation")
    )
    for name in state_names(scene.stages):
        sd = s[f"cov_{name}_{name}"] ** 0.5
        assert ((b[name] - s[name]).abs() / sd).max() < 5e-3
        assert (b[f"cov_{name}_{name}"] ** 0.5 / sd - 1.0).abs().max() < 1e-5
    np.testing.assert_allclose(b["rho1"], s["rho1"], atol=1e-6)


def test_as_many_flights_are_followed_as_the_time_asks_for():
    """At the mean time of the last impact some paths are beyond it, and all are counted."""
    scene, _ = BRANCHED["DAT21, strong"]
    m, further = (mean_map(scene, impacts=k, closure="branching") for k in (3, 6))
    time = m.section["tau"].loc[3]
    # the label "on the orbit" ends with the orbit that is asked for, so components merge a little
    # differently
    np.testing.assert_allclose(m.at_times([time]), further.at_times([time]), rtol=5e-3, atol=1e-3)
    with refusal("lies outside the times followed"):
        m.at_times([time + 0.1])
