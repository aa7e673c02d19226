"""Paths that have followed an itinerary so far, summed apart; and how the others leave it."""

import numpy as np
import pytest

from rattle import InputError
from rattle.montecarlo import Record, simulate
from rattle.scene import DAT21, Scene, Start, section_names

SECTION = list(section_names(2))


NOISY = Scene.from_gears(DAT21, sigma=0.1)
IMPACTS = 4
APART = Record(on_itinerary=True)


def test_moments_are_those_of_the_paths_that_follow_it():
    """An itinerary may end early; nothing else changes."""
    plain = simulate(NOISY, paths=4096, impacts=IMPACTS, rng=3, record=Record(raw=True))
    named = {"short": (-1, 1, 0, 0), "other": (-1, 1, -1, 1)}
    record = Record(on_itinerary=True, itineraries=named)
    kept = simulate(NOISY, paths=4096, impacts=IMPACTS, rng=3, record=record)
    assert kept.section.equals(plain.section)
    for name, itinerary in kept.plan.itineraries.items():
        section = kept.on_itinerary(name).section
        follow = np.logical_and.accumulate(plain.raw[:, :, 6] == np.array(itinerary), axis=1)
        assert section["paths"].tolist() == follow.sum(axis=0).tolist()
        for impact in np.flatnonzero(follow.any(axis=0)):
            rows = plain.raw[follow[:, impact], impact, :6]
            found = section.loc[impact + 1]
            np.testing.assert_allclose(found[SECTION].astype(float), rows.mean(axis=0), rtol=1e-12)
            sds = found[["sd_" + q for q in SECTION]].astype(float)
            np.testing.assert_allclose(sds, rows.std(axis=0), rtol=1e-10, atol=1e-15)
        assert section.loc[~follow.any(axis=0), SECTION].isna().all(axis=None)


def test_nothing_is_there_that_was_not_asked_for():
    plain = simulate(NOISY, paths=100, impacts=IMPACTS)
    with pytest.raises(InputError, match="on_itinerary"):
        plain.on_itinerary()
    with pytest.raises(InputError, match="on_itinerary"):
        _ = plain.leaving


def test_without_noise_nothing_leaves_and_a_resting_orbit_has_no_follower():
    assert simulate(NOISY.noise_free, paths=100, impacts=IMPACTS, record=APART).leaving.empty
    rest = Scene(
        alpha=0.05,
        epsilon=0.5,
        beta1=0.5,
        gamma1=0.0,
        stages=1,
        sigma=0.3,
        start=Start(0.0, 0.0, 0.1, mesh=0),
    )
    run = simulate(rest, paths=64, impacts=2, record=APART)
    assert run.plan.itineraries["noise-free"] == (0, 0)
    assert run.on_itinerary().section["paths"].tolist() == [0, 0]
    assert run.leaving.empty
