"""Paths that have followed an itinerary so far, summed apart; and how the others leave it."""

import numpy as np
import pytest
from mc_checks import NOISY
from refusals import refusal
from scenes import SECTION
from settings import ON_ITINERARY

from rattle import Record, Scene, Start, follow, simulate
from rattle.montecarlo import Ensemble

SAMPLED = {"paths": 4096, "impacts": 4, "rng": 3}


def test_moments_are_those_of_the_paths_that_follow_it():
    """An itinerary may end early; nothing else changes, and nothing is there that was not asked
    for."""
    plain = simulate(NOISY, record=Record(raw=True), **SAMPLED)
    named = {"short": (-1, 1, 0, 0), "other": (-1, 1, -1, 1)}
    kept = simulate(NOISY, record=Record(on_itinerary=True, itineraries=named), **SAMPLED)
    assert kept.section.equals(plain.section)
    orbit = follow(NOISY, 4)
    assert kept.plan.itineraries["noise-free"] == (*(orbit.mesh * orbit.side)[1:],)
    assert kept.section["agreement"].equals(kept.agreement["noise-free"].rename("agreement"))
    for name, itinerary in kept.plan.itineraries.items():
        section = kept.on_itinerary(name).section
        follows = np.logical_and.accumulate(plain.raw[:, :, 6] == np.array(itinerary), axis=1)
        assert section["paths"].tolist() == follows.sum(axis=0).tolist()
        assert kept.agreement[name].to_list() == pytest.approx(follows.mean(axis=0), rel=1e-15)
        others = np.repeat(~follows[:, :, None], 6, axis=2)
        rows = np.ma.array(plain.raw[:, :, :6], mask=others)
        mean = rows.mean(axis=0).filled(np.nan)
        np.testing.assert_allclose(section[SECTION], mean, rtol=1e-12)
        sds = section[["sd_" + q for q in SECTION]]
        sd = rows.std(axis=0).filled(np.nan)
        np.testing.assert_allclose(sds, sd, rtol=1e-10, atol=1e-15)
    for ask in (Ensemble.on_itinerary, Ensemble.leaving.func):
        with refusal("on_itinerary"):
            ask(plain)


def test_without_noise_nothing_leaves_and_a_resting_orbit_has_no_follower():
    assert simulate(NOISY.noise_free, record=ON_ITINERARY, **SAMPLED).leaving.empty
    start = Start(0.0, 0.0, 0.1)
    damped = Scene(alpha=0.05, epsilon=0.5, beta1=0.5, gamma1=0.0, stages=1, sigma=0.3, start=start)
    run = simulate(damped, paths=64, impacts=2, record=ON_ITINERARY)
    assert run.plan.itineraries["noise-free"] == (0, 0)
    assert run.on_itinerary().section["paths"].tolist() == [0, 0]
    assert run.leaving.empty
