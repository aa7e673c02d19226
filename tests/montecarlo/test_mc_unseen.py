"""What a sample cannot have seen: rare branches are found, counted, and leave a verdict open."""

from unittest.mock import Mock

import numpy as np
import pytest
from random_gears import PAIR_B
from scenes import dat21, tree

from rattle import Closure, Scene, mean_map, validate
from rattle.montecarlo.branches import search as branches
from rattle.montecarlo.branches.search import search_of

TRUE_SD = 0.01528
"""Of y2 at impact 2 of `PAIR_B`, from 8 million exact flights (63 paths on the branch)."""


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "accurate"), (0.81, "inaccurate")])
def test_an_sd_is_judged_with_the_rare_branch_that_carries_a_third_of_its_variance(factor, verdict):
    """Negative control: the sd of all other paths."""
    closure = Closure("mine", lambda scene, impacts: {"sd_y2": [np.nan, factor * TRUE_SD]})
    given = {"paths": 32_768, "impacts": 2, "scheme": "exact-flight", "rng": 0}
    table = validate(PAIR_B, closures=(closure,), **given).table
    section = table.query("kind == 'section' and impact == 2")
    (row,) = section.query("quantity == 'y2' and moment == 'sd'").to_dict("records")
    assert row["verdict"] == verdict


@pytest.mark.parametrize("sigma", [0.055, 0.06, 0.065, 0.07])
def test_a_branch_whose_window_lies_between_the_points_of_the_grid_is_found(sigma):
    """Below sigma = 0.07 it was lost, from one noise intensity to the next."""
    (found,) = search_of(dat21(sigma), 1).until(1.0).branches
    assert (found.mesh, found.side) == (2, -1)
    assert found.beta * sigma == pytest.approx(0.328, rel=5e-3)


def test_states_respond_to_the_noise_of_steps_as_their_covariance_says():
    """So paths near a branch are drawn where it lies; a buffer that was too short by a row made
    the responses of four wheels whatever the memory held."""
    scene = tree((0, 0, 1, 1), sigma=1e-6)
    covariance = mean_map(scene, impacts=4, closure="saltation").trace.covariance
    search = search_of(scene, 4, 0.005)
    search.until(1.0)
    assert len(search.responses) == 4
    for before, response in zip(covariance[1:], search.responses, strict=True):
        by_steps = np.linalg.norm(response, axis=1)
        # the part of a step's noise that is left out, its area, only takes from it
        np.testing.assert_allclose(by_steps, np.sqrt(np.diag(before)), rtol=0.012)


def test_an_orbit_that_ends_leaves_later_impacts_unknown():
    scene = Scene(alpha=0.0, epsilon=0.5, beta1=5.0, gamma1=0.0, stages=1, sigma=1e-6)
    found = search_of(scene, 3).until(1.0)
    assert found.known < 3
    assert found.why


@pytest.mark.slow
def test_the_search_is_bounded_whatever_the_number_of_impacts(monkeypatch):
    """It took 45 seconds of an answer whose budget was 2; beyond what is searched, branches count
    as unknown."""
    watched = Mock(wraps=branches.events)
    monkeypatch.setattr(branches, "events", watched)
    search = search_of(dat21(1.2).phase_reduced, 400)
    for k in (4, 8, 12, 16, 19):
        found = search.until(2.0**-k)
    assert watched.call_count <= branches.MOST_SEARCHED_FLIGHTS == found.known
