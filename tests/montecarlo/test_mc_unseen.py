"""What a sample cannot have seen: rare branches are found, counted, and leave a verdict open."""

import numpy as np
import pytest
from random_gears import PAIR_B
from scenes import tree

from rattle import Closure, mean_map, validate
from rattle.montecarlo.branches import search as branches
from rattle.montecarlo.branches.search import BranchSearch
from rattle.scene import DAT21, Scene

PROBABILITY = 7.9e-6
SD = 0.01528
"""Of the branch of `PAIR_B`, and sd of y2 at impact 2, from 8 million exact flights (63 paths on
the branch)."""


def test_a_rare_branch_has_the_probability_and_the_size_that_eight_million_paths_show():
    found = BranchSearch(PAIR_B, 2).until(1.0)
    (branch,) = [b for b in found.branches if b.impact == 1]
    assert abs(branch.probability - PROBABILITY) < 4.0 * PROBABILITY / np.sqrt(63.0)
    gap = branch.rows[:, 1, 5] - found.orbit[1, 5]
    share = (branch.weights * gap**2).sum() / SD**2
    assert 0.2 < share < 0.5  # 0.34 by the kurtosis


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "accurate"), (0.81, "inaccurate")])
def test_an_sd_is_judged_with_the_rare_branch_that_carries_a_third_of_its_variance(factor, verdict):
    """Negative control: the sd of all other paths."""
    closure = Closure("mine", lambda scene, impacts: {"sd_y2": [np.nan, factor * SD]})
    given = {"paths": 32_768, "impacts": 2, "scheme": "exact-flight", "rng": 0}
    table = validate(PAIR_B, closures=(closure,), **given).table
    section = table.query("kind == 'section' and impact == 2")
    (row,) = section.query("quantity == 'y2' and moment == 'sd'").to_dict("records")
    assert row["verdict"] == verdict


def test_a_branch_whose_window_lies_between_the_points_of_the_grid_is_found():
    """Below sigma = 0.07 it was lost, from one noise intensity to the next."""
    sigmas = (0.055, 0.06, 0.065, 0.07)
    found = [BranchSearch(Scene.from_gears(DAT21, sigma=s), 1).until(1.0).branches for s in sigmas]
    assert [(b.mesh, b.side) for (b,) in found] == [(2, -1)] * 4
    np.testing.assert_allclose(
        [b.beta * s for (b,), s in zip(found, sigmas, strict=True)], 0.328, rtol=5e-3
    )


@pytest.mark.parametrize(
    "scene",
    [Scene.from_gears(DAT21, sigma=1e-6), tree((0, 0, 1, 1), sigma=1e-6)],
    ids=["two wheels", "a tree of four"],
)
def test_states_respond_to_the_noise_of_steps_as_their_covariance_says(scene):
    """So paths near a branch are drawn where it lies; a buffer that was too short by a row made
    the responses whatever the memory held."""
    covariance = mean_map(scene, impacts=4, closure="saltation").trace.covariance
    search = BranchSearch(scene, 4, 800, 0.005)
    search.until(1.0)
    assert len(search.responses) == 4
    for before, response in zip(covariance[1:], search.responses, strict=True):
        by_steps = np.linalg.norm(response, axis=1)
        # the part of a step's noise that is left out, its area, only takes from it
        np.testing.assert_allclose(by_steps, np.sqrt(np.diag(before)), rtol=0.012)


def test_an_orbit_that_ends_leaves_later_impacts_unknown():
    scene = Scene(alpha=0.0, epsilon=0.5, beta1=5.0, gamma1=0.0, stages=1, sigma=1e-6)
    found = BranchSearch(scene, 3).until(1.0)
    assert found.known < 3
    assert found.why


@pytest.mark.slow
def test_the_search_is_bounded_whatever_the_number_of_impacts(monkeypatch):
    """It took 45 seconds of an answer whose budget was 2; beyond what is searched, branches count
    as unknown."""
    flights = []
    one = branches.events
    monkeypatch.setattr(branches, "events", lambda flight: flights.append(flight) or one(flight))
    scene = Scene.from_gears(DAT21, sigma=1.2).phase_reduced
    for impacts in (200, 400):
        flights.clear()
        search = BranchSearch(scene, impacts)
        for k in range(4, 20):
            found = search.until(2.0**-k)
        assert len(flights) <= branches.MOST_SEARCHED_FLIGHTS
        assert found.known == min(impacts, branches.MOST_SEARCHED_FLIGHTS)
