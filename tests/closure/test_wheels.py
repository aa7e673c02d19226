"""Closures of chains and trees of wheels, against the covariance of the linear system written
apart."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import follow_covariance, gearbox
from refusals import refusal
from scenes import FOUR, TREES, dat21, tree

from rattle import Closure, Start, Tolerance, follow, mean_map
from rattle.closure import closures_for
from rattle.closure.section_map import (
    MOST_COMBINATIONS,
    section_derivatives,
    start_pieces,
)
from rattle.scene import state_names
from rattle.scene.flight import jacobian
from rattle.scene.orbit import Impacts

FOLLOWED = 12
FORK = tree((0, 1, 1), sigma=1e-3)


def section_sds(scene, orbit, ends):
    """Sds of tau and the state of each path at its own impact, from covariances of all paths at
    one time; the struck displacement is on its wall."""
    box = gearbox(scene.constants)
    found = []
    for k, covariance in enumerate(ends, 1):
        rate = box.rates(orbit.tau[k], orbit.before[k])
        i = 2 * orbit.mesh[k] - 2
        late = np.zeros(len(rate))
        late[i] = -1.0 / rate[i]
        reach = np.vstack([late, np.eye(len(rate)) + np.outer(rate, late)])
        found.append(np.sqrt(np.diagonal(reach @ covariance @ reach.T)))
    return np.array(found)


LINEAR = {
    "DAT21": dat21(0.1),
    "tree of 4": FOUR,
    "tree of 7": TREES["tree of 7"],
}


@pytest.mark.parametrize("scene", LINEAR.values(), ids=LINEAR.keys())
def test_saltation_is_the_linear_system_of_all_wheels(scene):
    """Sds by their own differential equation, to the digits that its integrator holds."""
    orbit = follow(scene, FOLLOWED).until_sticking
    assert orbit.found >= 6
    assert set(orbit.mesh[1 : orbit.found + 1]) >= set(range(1, min(scene.stages, 3) + 1))
    middles, ends = follow_covariance(scene, orbit)
    m = mean_map(scene, impacts=orbit.found, order=2)
    names = state_names(len(scene.tree))
    found = m.section[[f"sd_{name}" for name in ("tau", *names)]].to_numpy()
    assert found == pytest.approx(section_sds(scene, orbit, ends), rel=1e-9, abs=1e-11)
    tau = orbit.tau[: orbit.found + 1]
    times = scene.to_absolute_time(0.5 * (tau[1:] + tau[:-1]))
    at = m.at_times(times)[[f"cov_{name}_{name}" for name in names]]
    exact = np.diagonal(middles, axis1=1, axis2=2)
    assert at.to_numpy() == pytest.approx(exact, rel=1e-9, abs=1e-14)


def test_second_derivatives_of_the_section_map_are_differences_of_the_first():
    """By the start of four wheels; what noise adds at the end of the flight does what the start
    that leads there does."""
    c = FOUR.constants

    def derivatives(change):
        moved = Start(FOUR.start.tau + change[0], state=[*(FOUR.start.values + change[1:])])
        orbit = follow(replace(FOUR, start=moved), 1)
        first, second, bent = section_derivatives(c, Impacts.of(orbit, slice(2)), 9)
        return first[0, bent], second[0]

    _, second = derivatives(np.zeros(9))
    for j, step in enumerate(1e-5 * np.eye(9)):
        ahead, behind = (derivatives(sign * step)[0] for sign in (1.0, -1.0))
        change = (ahead - behind)[:, :9] / 2e-5
        assert second[:, j, :9] == pytest.approx(change, rel=1e-4, abs=1e-4)
    flown = jacobian(c, follow(FOUR, 1).flight[1])
    assert second[:, :9, 1:9] == pytest.approx(second[:, :9, 9:] @ flown, abs=1e-9)
    assert second[:, 1:9, 9:] == pytest.approx(flown.T @ second[:, 9:, 9:], abs=1e-9)


def test_branching_is_saltation_where_noise_is_small_and_has_other_itineraries_where_not():
    small, single = (
        mean_map(FORK, impacts=5, closure=closure).section for closure in ("branching", "saltation")
    )
    spread = [f"sd_{name}" for name in ("tau", "y1", "y2", "y3")]
    assert small[spread].to_numpy() == pytest.approx(single[spread].to_numpy(), rel=1e-3)
    assert small["agreement"].to_numpy() == pytest.approx(1.0)
    large = mean_map(FORK.with_sigma(0.5), impacts=3, closure="branching")
    assert large.section["agreement"].iloc[-1] < 0.99
    assert large.section["discarded"].iloc[-1] < 0.05
    assert large.at_times([large.section["tau"].loc[2]]).notna().all(axis=None)


def test_closures_of_the_paper_are_for_its_own_gears_and_branching_for_few_wheels():
    assert closures_for(FORK) == ("saltation", "branching")
    for closure in ("published", "corrected"):
        with refusal(f"wheels = 3: {closure} is the paper's closure"):
            mean_map(FORK, closure=closure)
    crowd = tree((0,) * 17)
    assert closures_for(crowd) == ("saltation",)


def test_a_closure_of_ones_own_predicts_every_wheel():
    own = Closure("mine", lambda scene, impacts: {"sd_y3": [0.1] * impacts}, stages=3)
    assert mean_map(FORK, impacts=2, closure=own).section["sd_y3"].tolist() == [0.1, 0.1]
    more = Closure("more", lambda scene, impacts: {"y4": [0.1] * impacts})
    with refusal("columns of more = 'y4': valid are 'tau'"):
        mean_map(FORK, impacts=2, closure=more)


def test_random_flanks_of_many_wheels_are_few_components():
    wheels = [replace(wheel, tolerance=0.01) for wheel in FOUR.wheels]
    scene = replace(FOUR, wheels=wheels, tolerance=Tolerance())
    assert len(start_pieces(scene).weight) <= MOST_COMBINATIONS
