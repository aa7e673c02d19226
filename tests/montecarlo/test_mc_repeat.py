"""A run is a function of its seed: the same bit for bit for any workers and blocks, and whatever
runs beside it."""

import numpy as np
import pandas as pd
import pytest
from mc_checks import BLOCK, TOLERANT
from scenes import dat21
from settings import recorded

from rattle import simulate
from rattle.montecarlo import SCHEMES

COARSE_STEP = {"euler-maruyama": 1e-2, "euler-maruyama-located": 1e-2, "exact-flight": 0.05}
MORE_THAN_A_BLOCK = BLOCK + 117
REDRAWN = TOLERANT.with_sigma(0.2)
WITH_MEMORY = dat21(0.5, correlation_time=0.5)


def run_with(scheme="euler-maruyama-located", scene=None, **changes):
    settings = {
        "paths": MORE_THAN_A_BLOCK,
        "impacts": 4,
        "dt": COARSE_STEP[scheme],
        "rng": 3,
        "raw": True,
    } | changes
    return simulate(scene or dat21(0.3), scheme=scheme, **recorded(settings))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_result_is_the_same_bit_for_bit_for_any_number_of_workers(scheme):
    settings = {"scheme": scheme, "times": [0.6, 1.0], "histogram": True}
    alone = run_with(**settings)
    many = run_with(**settings, workers=3)
    assert np.array_equal(alone.raw, many.raw)
    assert alone.section.equals(many.section)
    assert alone.at_times().equals(many.at_times())
    assert np.array_equal(alone.covariance, many.covariance)
    assert np.array_equal(alone.histograms.counts, many.histograms.counts)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("scene", [WITH_MEMORY, REDRAWN], ids=["memory", "redrawn walls"])
def test_paths_are_the_same_bit_for_bit_for_any_size_of_a_block(scheme, scene, monkeypatch):
    """Other neighbours, other lanes, other times at which lanes change hands; merged sums differ by
    rounding alone."""
    settings = {"scheme": scheme, "scene": scene, "paths": 300, "impacts": 12, "times": [2.0]}
    whole = run_with(**settings)
    monkeypatch.setattr("rattle.montecarlo.kernel.block.BLOCK", 64)
    monkeypatch.setattr("rattle.montecarlo.ensemble.simulate.BLOCK", 64)
    cut = run_with(**settings)
    assert np.array_equal(whole.raw, cut.raw)
    for a, b in ((whole.section, cut.section), (whole.at_times(), cut.at_times())):
        pd.testing.assert_frame_equal(a, b, rtol=1e-9, atol=1e-9)


BESIDE = {
    "more paths": {"paths": 2 * MORE_THAN_A_BLOCK},
    "fewer paths": {"paths": 7},
    "itineraries": {"itineraries": {"mine": [1, -1, 1, -1]}},
    "horizon": {"horizon": 77.7},
    "more impacts": {"impacts": 9},
    "what is recorded": {"step_bias": True, "times": [0.6, 5.0], "histogram": True}
    | {"batches": True, "energy": True, "workers": 3},
}


@pytest.mark.parametrize("scheme", SCHEMES)
def test_paths_are_the_same_bit_for_bit_whatever_runs_beside_them(scheme):
    plain = run_with(scheme).raw
    for change, settings in BESIDE.items():
        other = run_with(scheme, **settings).raw
        common = min(len(plain), len(other))
        assert np.array_equal(plain[:common], other[:common, :4]), change


def test_a_spawned_seed_is_another_and_is_not_used_up():
    """First-impact times are continuous: none occurs twice, of one seed or of two."""
    seed = np.random.SeedSequence(3)
    runs = [run_with(rng=rng, impacts=1).raw[:, 0, 0] for rng in (seed, 4, seed.spawn(1)[0])]
    assert np.array_equal(runs[0], run_with(rng=3, impacts=1).raw[:, 0, 0])
    assert np.unique(runs).size == 3 * MORE_THAN_A_BLOCK
