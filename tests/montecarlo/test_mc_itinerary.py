"""Paths that have followed an itinerary so far, summed apart; and how the others leave it."""

import numpy as np
import pandas as pd
import pytest
from mc_checks import NOISY
from refusals import refusal
from scenes import SECTION
from settings import ON_ITINERARY

from rattle import Record, Scene, Start, follow, simulate
from rattle.montecarlo import Ensemble

IMPACTS_ON_ITINERARY = 4


def test_moments_are_those_of_the_paths_that_follow_it():
    """An itinerary may end early; nothing else changes, and nothing is there that was not asked
    for."""
    plain = simulate(
        NOISY, paths=4096, impacts=IMPACTS_ON_ITINERARY, rng=3, record=Record(raw=True)
    )
    named = {"short": (-1, 1, 0, 0), "other": (-1, 1, -1, 1)}
    record = Record(on_itinerary=True, itineraries=named)
    kept = simulate(NOISY, paths=4096, impacts=IMPACTS_ON_ITINERARY, rng=3, record=record)
    assert kept.section.equals(plain.section)
    orbit = follow(NOISY, IMPACTS_ON_ITINERARY)
    assert kept.plan.itineraries["noise-free"] == (*(orbit.mesh * orbit.side)[1:],)
    assert kept.section["agreement"].equals(kept.agreement["noise-free"].rename("agreement"))
    for name, itinerary in kept.plan.itineraries.items():
        section = kept.on_itinerary(name).section
        follows = np.logical_and.accumulate(plain.raw[:, :, 6] == np.array(itinerary), axis=1)
        assert section["paths"].tolist() == follows.sum(axis=0).tolist()
        assert kept.agreement[name].to_list() == pytest.approx(follows.mean(axis=0), rel=1e-15)
        for impact, on in enumerate(follows.T):
            rows = pd.DataFrame(plain.raw[on, impact, :6], columns=SECTION)
            found = section.iloc[impact]
            assert found[SECTION].to_list() == pytest.approx(rows.mean(), rel=1e-12, nan_ok=True)
            sds = found[["sd_" + q for q in SECTION]].to_list()
            assert sds == pytest.approx(rows.std(ddof=0), rel=1e-10, abs=1e-15, nan_ok=True)
    for ask in (Ensemble.on_itinerary, lambda run: run.leaving):
        with refusal("on_itinerary"):
            ask(plain)


def test_without_noise_nothing_leaves_and_a_resting_orbit_has_no_follower():
    assert simulate(
        NOISY.noise_free, paths=100, impacts=IMPACTS_ON_ITINERARY, record=ON_ITINERARY
    ).leaving.empty
    rest = Scene(
        alpha=0.05,
        epsilon=0.5,
        beta1=0.5,
        gamma1=0.0,
        stages=1,
        sigma=0.3,
        start=Start(0.0, 0.0, 0.1, mesh=0),
    )
    run = simulate(rest, paths=64, impacts=2, record=ON_ITINERARY)
    assert run.plan.itineraries["noise-free"] == (0, 0)
    assert run.on_itinerary().section["paths"].tolist() == [0, 0]
    assert run.leaving.empty
