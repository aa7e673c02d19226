"""The branching closure: a mixture over itineraries, compared with simulation far beyond one
orbit."""

import numpy as np
import pytest
from random_gears import gear_sets
from scenes import PAPER_SIGMA, dat21

from rattle import Record, mean_map, simulate

FREE_QUANTITIES = ["tau", "flight", "y1", "y2"]
FREE_SDS = [f"sd_{quantity}" for quantity in FREE_QUANTITIES]


@pytest.fixture(scope="module", params=[0.1, PAPER_SIGMA], ids=lambda s: f"sigma={s:.3g}")
def pair(request):
    scene = dat21(request.param)
    run = simulate(scene, paths=20_000, rng=3, workers=2, record=Record(raw=True))
    return mean_map(scene, impacts=12, closure="branching"), run


def test_unconditional_section_moments(pair):
    """Median errors of a few per cent of an sd over all impacts, where one orbit is wrong by its
    own size."""
    branching, run = pair
    single = mean_map(branching.scene, impacts=12).section
    sd = run.section[FREE_SDS].to_numpy()
    mean_errors, single_errors = (
        abs(found[FREE_QUANTITIES] - run.section[FREE_QUANTITIES]) / sd
        for found in (branching.section, single)
    )
    assert np.median(mean_errors) < 0.05
    assert np.median(abs(branching.section[FREE_SDS] / sd - 1.0)) < 0.05
    assert mean_errors.max(axis=None) < 0.25
    # negative control: one itinerary only
    assert np.median(single_errors) > 3.0 * np.median(mean_errors)


def test_itinerary_probabilities(pair):
    """The share of paths on the orbit's itinerary, from 95 % to 1.4 % at impact 12, within 0.03."""
    branching, run = pair
    np.testing.assert_allclose(branching.section["agreement"], run.section["agreement"], atol=0.03)


def test_probability_is_accounted_for(pair):
    branching, _ = pair
    discarded = branching.section["discarded"]
    assert (discarded >= 0.0).all()
    assert discarded.is_monotonic_increasing
    assert discarded.iloc[-1] < 0.05
    for weights, _, variances in branching.trace.parts.values():
        assert weights.sum() == pytest.approx(1.0)
        assert (variances > -1e-9 * variances.max()).all()


def test_density_is_the_mixtures_and_sees_both_branches(pair):
    """At the paper's noise the velocity before impact 12 is bimodal; probability in the wrong
    place, which one Gaussian has too much of."""
    m, run = pair
    y = np.linspace(-10.0, 10.0, 8001)
    density, single = (of.density(12, "y1", y) for of in (m, mean_map(m.scene, impacts=12)))
    assert np.trapezoid(density, y) == pytest.approx(1.0, abs=2e-3)
    edges = np.linspace(-6.0, 6.0, 25)
    sampled = np.histogram(run.raw[:, 11, 2 + 1], edges)[0] / run.paths
    masses = (np.histogram(y, edges, weights=v * (y[1] - y[0]))[0] for v in (density, single))
    misplaced, of_single = (0.5 * np.abs(mass - sampled).sum() for mass in masses)
    assert m.scene.sigma < 1.0 or (misplaced < 0.12 and of_single > 3.0 * misplaced)


def test_no_branch_is_made_by_noise_that_acts_after_it():
    """A flight passes a wall early; the noise of all of it would lead there, and makes an sd 105
    times too large."""
    scene = gear_sets(20261125, 4)[1].with_sigma(0.005)
    branching, saltation = (
        mean_map(scene, impacts=8, closure=c).section[FREE_SDS] for c in ("branching", "saltation")
    )
    assert (branching / saltation).to_numpy() == pytest.approx(1.0, abs=0.01)
