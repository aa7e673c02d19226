"""Distances of densities: at the sampling floor where they are correct, far above it where they are
not."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scenes import dat21
from scipy import stats

from rattle import Record, mean_map, simulate
from rattle.closure.edgeworth import section_density
from rattle.compare.validation.realizability import bin_masses, distances, section_distances
from rattle.montecarlo.statistics.records import Histograms


def against_normal_sample(seed, mean=0.0, sd=1.0):
    """Distances of a normal density from a standard normal sample, binned as a simulation does."""
    values = np.random.default_rng(seed).normal(size=(20_000, 1, 1)) * np.ones(6)
    histograms = Histograms.for_sample(values)
    histograms.add(values)
    edges, _ = histograms.density(1, "tau")
    return distances(
        bin_masses(lambda z: section_density(z, mean, sd, 0.0), edges, mean, sd),
        histograms.counts[0, 0],
    )


def test_right_density_stays_at_the_floor():
    found = pd.DataFrame([against_normal_sample(seed)._asdict() for seed in range(30)])
    # bins can only lower it
    above = found["kolmogorov"] > found["kolmogorov_floor"]
    assert above.sum() <= stats.binom.isf(1e-4, 30, 0.05)
    ratios = found["total_variation"] / found["total_variation_floor"]
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
    return simulate(
        dat21(0.02),
        paths=100_000,
        rng=11,
        workers=2,
        scheme="euler-maruyama-located",
        record=Record(histogram=True),
    )


def of(run, closure):
    return section_distances(mean_map(run.scene, closure=closure), run)


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
    prediction = mean_map(run.scene)
    first = section_distances(
        replace(prediction, trace=replace(prediction.trace, skew=0.0 * prediction.trace.skew)), run
    )
    assert first["kolmogorov"].max() > 2.0 * of(run, "saltation")["kolmogorov"].max()


def test_rows_only_where_something_varies_and_is_predicted(run):
    saltation = of(run, "saltation")
    struck = "x" + saltation["impact"].map(run.section["mesh"]).astype(int).astype(str)
    assert not (saltation["quantity"] == struck).any()
    assert set(of(run, "published")["quantity"]) <= {"y1", "y2"}


def test_bias_of_the_step_is_taken_out_where_it_was_measured():
    scene = dat21(0.02)
    plain, corrected = (
        section_distances(
            mean_map(scene, impacts=1),
            simulate(
                scene,
                record=Record(histogram=True, step_bias=measured),
                paths=20_000,
                impacts=1,
                rng=3,
                scheme="euler-maruyama-located",
            ),
        )
        for measured in (False, True)
    )
    assert (plain["kolmogorov"] > 5.0 * plain["kolmogorov_floor"]).any()
    assert (corrected["kolmogorov"] < 1.5 * corrected["kolmogorov_floor"]).all()


def test_without_noise_nothing_has_a_distance():
    assert of(simulate(dat21(), paths=10, record=Record(histogram=True)), "saltation").empty
