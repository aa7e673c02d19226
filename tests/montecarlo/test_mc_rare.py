"""Rare branches sampled on purpose: weights, moments against plain paths, and what an accuracy does
with them."""

import numpy as np
import pytest
from limits import limit
from mc_checks import NOISY, in_threads, largest_z
from scenes import dat21
from settings import ON_ITINERARY

from rattle import Tolerance, simulate, simulate_to
from rattle.montecarlo import simulate_rare
from rattle.montecarlo.branches.choose import FARTHEST_POINT, by_influence
from rattle.montecarlo.branches.search import search_of
from rattle.montecarlo.ensemble.simulate_rare import begin_rare

RARE_IMPACTS = 4
RARE_PATHS = 32 * 1024
MOST = limit(6 * RARE_IMPACTS)
CHECKED = [p + q for q in ("tau", "y1", "y2") for p in ("", "sd_")]


@pytest.fixture(scope="module")
def rare():
    chosen_by = simulate(NOISY, paths=RARE_PATHS, impacts=RARE_IMPACTS, rng=11, record=ON_ITINERARY)
    return begin_rare(chosen_by, RARE_PATHS, in_threads(1))


def test_moments_are_those_of_plain_paths(rare):
    """Of all paths, and of those that follow the itinerary, which differ from all together."""
    given = {"paths": 8 * RARE_PATHS, "impacts": RARE_IMPACTS, "rng": 12}
    plain = simulate(NOISY, record=ON_ITINERARY, **given)
    followers = plain.on_itinerary().section
    assert rare.plan.mixture is not None
    assert largest_z(rare.section, plain.section, CHECKED) < MOST
    assert largest_z(rare.on_itinerary().section, followers, CHECKED) < MOST
    assert largest_z(rare.section, followers, CHECKED) > 6.0
    np.testing.assert_allclose(rare.section["agreement"], followers["agreement"], atol=5e-3)


def test_the_same_bits_for_any_number_of_workers_and_any_cut(rare):
    again = simulate_rare(NOISY, paths=RARE_PATHS, impacts=RARE_IMPACTS, rng=11, workers=3)
    assert again.section.equals(rare.section)


def test_random_gaps():
    scene = dat21(0.1, tolerance=Tolerance(3e-4, 3e-4, "uniform"))
    one = simulate_rare(scene, paths=RARE_PATHS, impacts=RARE_IMPACTS, rng=1)
    other = simulate(scene, paths=4 * RARE_PATHS, impacts=RARE_IMPACTS, rng=2)
    assert one.plan.mixture is not None
    assert largest_z(one.section, other.section, CHECKED) < MOST


def test_where_no_branch_matters_paths_are_plain():
    settings = {"paths": RARE_PATHS, "impacts": 2, "rng": 5}
    one = simulate_rare(dat21(0.01), **settings)
    assert one.plan.mixture is None
    assert one.section.equals(simulate(dat21(0.01), **settings).section)


def test_a_point_that_no_path_reaches_is_not_aimed_at():
    """Where first order fails a design point may be hundreds of sds away: paths cannot be drawn."""
    search = search_of(NOISY, RARE_IMPACTS).until(1e-9)
    sd = np.full((RARE_IMPACTS, 6), 1e-3)
    near = by_influence(search.branches, sd)
    assert near
    for distance in (1.01 * FARTHEST_POINT, 1e200):
        far = [b._replace(shift=distance / np.linalg.norm(b.shift) * b.shift) for b in near]
        assert by_influence(far, sd) == []


def test_an_accuracy_that_waits_for_a_branch_samples_it():
    run = simulate_to(NOISY, 0.015, impacts=RARE_IMPACTS, rng=4)
    assert run.plan.mixture is not None
    assert run.reach.reached
    assert run.paths < 2_000_000  # plain paths: eighteen million
    assert "rare branch" in run.reach.expected.sentence
