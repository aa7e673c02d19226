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
ONE_STAGE_SET, TWO_STAGE_SET = (scene.phase_reduced for scene in gear_sets()[4:6])
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


@pytest.fixture(scope="module", params=BRANCHED)
def case(request):
    """A scene, what is allowed, and its moments at fixed times."""
    scene, allowed = BRANCHED[request.param]
    record = Record(times=times_of(scene))
    run = simulate(scene, paths=40_000, impacts=1, scheme="exact-flight", rng=11, record=record)
    return scene, allowed, run.at_times()


def means_and_sds(table, scene):
    """Of the state, a row for each time."""
    names = state_names(scene.stages)
    variances = table[[f"cov_{name}_{name}" for name in names]]
    return table[[*names]].to_numpy(), variances.to_numpy() ** 0.5


def outside(scene, allowed, sampled, closure):
    """The share of means and sds that are off by more than allowed."""
    m = mean_map(scene, impacts=BRANCHED_IMPACTS + 1, closure=closure)
    sampled = sampled[sampled.index < m.trace.span[1]]
    names = state_names(scene.stages)
    mean, sd = means_and_sds(sampled, scene)
    predicted, predicted_sd = means_and_sds(m.at_times(sampled.index), scene)
    leeway = LEEWAY * sampled[[f"se_{name}" for name in names]] / sd
    sd_leeway = 0.5 * LEEWAY * sampled[[f"se_cov_{name}_{name}" for name in names]] / sd**2
    return np.mean(
        [
            ~(np.abs(predicted - mean) / sd < allowed + leeway),
            ~(np.abs(predicted_sd / sd - 1.0) < 2.0 * allowed + sd_leeway),
        ]
    )


def test_against_exact_flights(case):
    assert outside(*case, "branching") == 0.0


def test_one_orbit_alone_is_wrong(case):
    """Negative control: the saltation closure, which has no paths on different flights."""
    assert outside(*case, "saltation") > 0.3


@pytest.mark.parametrize("scene", [ONE_STAGE_SET, TWO_STAGE_SET], ids=["one stage", "two stages"])
def test_in_flight_at_small_noise_it_is_the_saltation_closure(scene):
    """To first order: means differ by O(sigma) of an sd, which saltation leaves out there, sds by
    O(sigma^2)."""
    tau = follow(scene, BRANCHED_IMPACTS).tau
    b, s = (
        mean_map(noisy(scene, 1e-5), impacts=BRANCHED_IMPACTS, closure=closure).at_times(
            0.5 * (tau[1:] + tau[:-1])
        )
        for closure in ("branching", "saltation")
    )
    (mean, sd), (exact, exact_sd) = (means_and_sds(table, scene) for table in (b, s))
    assert (np.abs(mean - exact) / exact_sd).max() < 5e-3
    assert np.abs(sd / exact_sd - 1.0).max() < 1e-5
    np.testing.assert_allclose(b["rho1"], s["rho1"], atol=1e-6)


def test_as_many_flights_are_followed_as_the_time_asks_for():
    """At the mean time of the last impact some paths are beyond it, and all are counted."""
    scene, _ = BRANCHED["DAT21, strong"]
    m, further = (mean_map(scene, impacts=k, closure="branching") for k in (3, 5))
    time = m.section["tau"].loc[3]
    # the label "on the orbit" ends with the orbit that is asked for, so components merge a little
    # differently
    np.testing.assert_allclose(m.at_times([time]), further.at_times([time]), rtol=5e-3, atol=1e-3)
    with refusal("lies outside the times followed"):
        m.at_times([time + 0.1])
