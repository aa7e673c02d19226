"""Paths that have followed an itinerary so far, summed apart; and how the others leave it."""

import math

import numpy as np
import pytest

from rattle import InputError
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.ensemble.simulate_rare import begin_rare
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.scene import DAT21, Scene, Start, section_names

SECTION = list(section_names(2))


NOISY = Scene.from_gears(DAT21, sigma=0.1)
IMPACTS = 4
NOISE_FREE = "noise-free"
APART = Record(on_itinerary=True)


@pytest.fixture(scope="module")
def run():
    return simulate(NOISY, paths=40_000, impacts=IMPACTS, rng=3, record=APART)


def test_moments_are_those_of_the_paths_that_follow_it(run):
    named = {"short": (*run.plan.itineraries[NOISE_FREE][:2], 0, 0), "other": (-1, 1, -1, 1)}
    record = Record(on_itinerary=True, raw=True, itineraries=named)
    kept = simulate(NOISY, paths=4096, impacts=IMPACTS, rng=3, record=record)
    for name, itinerary in kept.plan.itineraries.items():
        section = kept.on_itinerary(name).section
        follow = np.logical_and.accumulate(kept.raw[:, :, 6] == np.array(itinerary), axis=1)
        assert section["paths"].tolist() == follow.sum(axis=0).tolist()
        rows = np.where(follow[:, :, None], kept.raw[:, :, :6], np.nan)
        seen = follow.any(axis=0)
        assert section[SECTION][~seen].isna().all(axis=None)
        means = np.nanmean(rows[:, seen], axis=0)
        sds = np.nanstd(rows[:, seen], axis=0)
        np.testing.assert_allclose(section[SECTION][seen], means, rtol=1e-12)
        columns = ["sd_" + q for q in SECTION]
        np.testing.assert_allclose(section[columns][seen], sds, rtol=1e-10, atol=1e-15)


def test_nothing_else_changes_and_nothing_is_there_that_was_not_asked_for(run):
    plain = simulate(NOISY, paths=40_000, impacts=IMPACTS, rng=3)
    assert (plain.section == run.section).sum().sum() == run.section.notna().sum().sum()
    assert not plain.result.followers
    with pytest.raises(InputError, match="on_itinerary"):
        plain.on_itinerary()
    with pytest.raises(InputError, match="on_itinerary"):
        _ = plain.leaving


def test_paths_drawn_near_branches_have_the_same_moments_on_the_itinerary(run):
    rare = begin_rare(run, 32_768, in_threads(1)).on_itinerary().section
    plain = run.on_itinerary().section
    names = [p + q for q in ("tau", "y1", "y2") for p in ("", "sd_")]
    z = [(rare[n] - plain[n]) / np.hypot(rare[f"se_{n}"], plain[f"se_{n}"]) for n in names]
    assert np.abs(z).max() < 4.5
    all_paths = (rare["sd_y2"][3] - run.section["sd_y2"][3]) / run.section["se_sd_y2"][3]
    assert abs(all_paths) > 6.0, "negative control: all paths together differ"
    np.testing.assert_allclose(rare["agreement"], plain["agreement"], atol=5e-3)


def test_a_rare_way_to_leave_is_as_probable_as_many_plain_paths_find_it():
    quiet = Scene.from_gears(DAT21, sigma=0.09)
    found = simulate(quiet, paths=2048, impacts=1, rng=1, record=APART).leaving.iloc[0]
    assert (found["impact"], found["mesh"], found["side"], found["near"]) == (1, 2, -1, True)
    left = 1e6 * (1.0 - simulate(quiet, paths=1_000_000, impacts=1, rng=2).section["agreement"][1])
    error = math.hypot(math.sqrt(left), 1e6 * found["probability"] / math.sqrt(found["paths"]))
    assert abs(1e6 * found["probability"] - left) < 4.0 * error
    assert left > 8.0 * error, "so that twice the probability would be seen"
    assert found["low"] < found["probability"] < found["high"] < 1.5 * found["low"]


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
    assert run.plan.itineraries[NOISE_FREE] == (0, 0)
    assert run.on_itinerary().section["paths"].tolist() == [0, 0]
    assert run.leaving.empty
