"""Distances of densities: at the sampling floor where they are correct, far above it where they are
not."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import dat21
from scipy import stats

from rattle import Record, mean_map, simulate
from rattle.closure.edgeworth import section_density
from rattle.compare.validation.realizability import bin_masses, distances, section_distances
from rattle.montecarlo.statistics.records import Histograms

DENSITY_PATHS = 20_000


def sampled(values):
    """Edges and counts of a sample, binned as a simulation does."""
    histograms = Histograms.for_sample(values[:, None, None] * np.ones(6))
    histograms.add(values[:, None, None] * np.ones(6))
    edges, _ = histograms.density(1, "tau")
    return edges, histograms.counts[0, 0]


def against_normal_sample(seed, mean=0.0, sd=1.0, paths=DENSITY_PATHS):
    edges, counts = sampled(np.random.default_rng(seed).normal(3.0, 0.01, paths))
    mean = 3.0 + 0.01 * mean
    sd = 0.01 * sd
    return distances(
        bin_masses(lambda z: section_density(z, mean, sd, 0.0), edges, mean, sd), counts
    )


def test_right_density_stays_at_the_floor():
    found = [against_normal_sample(seed) for seed in range(30)]
    above = sum(d.kolmogorov > d.kolmogorov_floor for d in found)
    assert above <= stats.binom.isf(1e-4, len(found), 0.05)  # bins can only lower it
    ratios = np.array([d.total_variation / d.total_variation_floor for d in found])
    assert ratios.mean() == pytest.approx(1.0, abs=0.05)
    assert ratios.max() < 1.5


@pytest.mark.parametrize(("mean", "sd"), [(0.2, 1.0), (0.0, 1.3)])
def test_a_negative_control_is_far_above_the_floor(mean, sd):
    found = against_normal_sample(1, mean, sd)
    assert found.kolmogorov > 5.0 * found.kolmogorov_floor
    assert found.total_variation > 2.0 * found.total_variation_floor
    z = np.linspace(-4.0, 4.0, 4001)
    exact = np.abs(stats.norm.cdf(z, mean, sd) - stats.norm.cdf(z)).max()
    assert found.kolmogorov == pytest.approx(exact, abs=found.kolmogorov_floor)


@pytest.fixture(scope="module")
def run():
    scene = dat21(0.02)
    settings = {"scheme": "euler-maruyama-located", "record": Record(histogram=True)}
    return simulate(scene, paths=100_000, impacts=12, rng=11, workers=2, **settings)


def of(run, closure, **settings):
    return section_distances(
        mean_map(run.scene, impacts=run.impacts, closure=closure, **settings), run
    )


def test_saltation_is_at_the_floor_and_corrected_is_not(run):
    saltation = of(run, "saltation")
    corrected = of(run, "corrected")
    above = saltation["kolmogorov"] / saltation["kolmogorov_floor"]
    assert above.max() < 3.0
    assert above.median() < 1.0
    assert (saltation["total_variation"] / saltation["total_variation_floor"]).max() < 1.5
    far = corrected["kolmogorov"] / corrected["kolmogorov_floor"]
    assert far.min() > 1.5
    assert far.groupby(corrected["impact"]).max().min() > 20.0  # at every impact


def test_second_order_is_what_brings_saltation_to_the_floor(run):
    """Negative control: without the skewness of the second order the distance is larger."""
    prediction = mean_map(run.scene, impacts=12, closure="saltation")
    trace = replace(prediction.trace, skew=0.0 * prediction.trace.skew)
    first = section_distances(replace(prediction, trace=trace), run)
    assert first["kolmogorov"].max() > 2.0 * of(run, "saltation")["kolmogorov"].max()


def test_rows_only_where_something_varies_and_is_predicted(run):
    saltation = of(run, "saltation")
    mesh = run.section["mesh"]
    for impact, group in saltation.groupby("impact"):
        struck = f"x{int(mesh[impact])}"
        assert struck not in set(group["quantity"])
    assert set(of(run, "published")["quantity"]) <= {"y1", "y2"}


def test_bias_of_the_step_is_taken_out_where_it_was_measured():
    scene = dat21(0.02)
    prediction = mean_map(scene, impacts=1, closure="saltation")
    settings = {"paths": 20_000, "impacts": 1, "rng": 3, "scheme": "euler-maruyama-located"}
    runs = [
        simulate(scene, record=Record(histogram=True, step_bias=b), **settings)
        for b in (False, True)
    ]
    tables = [section_distances(prediction, run) for run in runs]
    worst = [(t["kolmogorov"] / t["kolmogorov_floor"]).max() for t in tables]
    assert worst[0] > 5.0
    assert worst[1] < 1.5


def test_without_noise_nothing_has_a_distance():
    quiet = dat21()
    still = simulate(quiet, paths=10, impacts=2, record=Record(histogram=True))
    assert section_distances(mean_map(quiet, impacts=2), still).empty
