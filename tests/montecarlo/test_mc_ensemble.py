"""The public entry: the tables' contract, agreement with the orbit, step bias, histograms, and what
a run costs."""

import numpy as np
import pytest
from mc_checks import stepped as simulate
from refusals import refusal
from scenes import SECTION, dat21
from scipy import stats
from settings import STEP_BIAS

from rattle import Record, Sampling, mean_map
from rattle import simulate as simulate_exactly

RECORDED_IMPACTS = 5


@pytest.fixture(scope="module")
def run():
    kept = {"raw": True, "histogram": True, "energy": True}
    record = Record(times=[0.3, 1.0, 2.0], **kept)
    return simulate(dat21(0.3), paths=3000, impacts=RECORDED_IMPACTS, dt=5e-3, rng=7, record=record)


def test_tables_have_the_columns_of_a_closure_and_their_errors(run):
    m = mean_map(run.scene, impacts=RECORDED_IMPACTS)
    errors = {f"se_{p}{q}" for p in ("", "sd_", "skew_", "kurt_") for q in SECTION}
    assert {*m.section, *errors, "paths", "agreement"} - set(run.section) == {"realizable"}
    fixed = run.at_times([2.0, 0.3])
    assert fixed.index.tolist() == pytest.approx([2.0, 0.3])
    predicted = {*m.at_times([0.3])}
    assert predicted | {f"se_{name}" for name in predicted} | {"se_z_rho2"} <= {*fixed}


def test_section_moments_are_those_of_the_kept_paths(run):
    kept = run.raw[:, :, :6]
    varies = kept.std(axis=0) > 1e-9
    for prefix, truth, close in (
        ("", kept.mean(axis=0), 1e-12),
        ("se_", kept.std(axis=0) / np.sqrt(3000), 1e-12),
        ("skew_", stats.skew(kept), 1e-8),
        ("kurt_", stats.kurtosis(kept), 1e-8),
    ):
        found = run.section[[prefix + q for q in SECTION]].to_numpy()
        np.testing.assert_allclose(found[varies], truth[varies], rtol=0.0, atol=close)


def test_what_was_not_recorded_is_refused_with_the_way_to_ask_for_it(run):
    with refusal(r"times = 1.5: was not recorded; give it to simulate: "):
        run.at_times([1.5])
    with refusal(r"ask for it: simulate\(..., record=Record"):
        _ = run.step_bias


def test_stated_error_of_the_bias_has_the_size_of_its_scatter():
    """Over 60 repeated runs; an sd from 60 values is good to 9 %, so the band is 3 of those."""
    given = {"paths": 500, "impacts": 2, "dt": 0.02, "record": STEP_BIAS}
    runs = [simulate(dat21(0.1), rng=seed, **given) for seed in range(60)]
    tables = [one.step_bias.query("quantity in ('tau', 'y1')") for one in runs]
    for value in ("bias", "corrected"):
        scatter = np.std([t[value] for t in tables], axis=0)
        stated = np.mean([t[f"se_{value}"] for t in tables], axis=0)
        assert np.abs(scatter / stated - 1.0).max() < 0.28
    uncoupled = np.sqrt(2.0) * stated  # negative control: runs with independent noise
    assert (uncoupled / np.std([t["bias"] for t in tables], axis=0)).min() > 1.28


def test_step_bias_of_noise_free_run_is_the_difference_of_three_runs():
    given = {"scene": dat21(), "paths": 1, "impacts": 3}
    one, two, four = (simulate(dt=dt, **given).section.tau for dt in (5e-3, 1e-2, 2e-2))
    table = simulate(dt=5e-3, record=STEP_BIAS, **given).step_bias
    tau = table.query("quantity == 'tau' and moment == 'mean'").set_index("impact")
    assert np.allclose(tau.bias, two - one, rtol=1e-9)
    assert np.allclose(tau["rest"], abs(2.0 * one - 3.0 * two + four) / 3.0, rtol=1e-9)


def test_histogram_counts_the_kept_paths(run):
    """But for values on an edge, which rounding may put on either side."""
    for i, quantity in enumerate(SECTION):
        for impact, kept in enumerate(run.raw[:, :, i].T, 1):
            edges, density = run.histograms.density(impact, quantity)
            expected, _ = np.histogram(kept, edges)
            assert np.abs(np.diff(edges) * density * kept.size - expected).sum() <= 4.0


def test_section_of_partly_finished_run_is_over_the_paths_that_got_there():
    given = {"paths": 700, "impacts": 2, "dt": 5e-3, "rng": 1, "record": Record(raw=True)}
    run = simulate(dat21(0.3), sampling=Sampling(horizon=0.96), **given)
    reached = np.isfinite(run.raw[:, 1, 0])
    assert 0 < reached.sum() < 700
    assert run.section.paths[2] == reached.sum() == 700 - run.unfinished
    assert run.section.tau[2] == pytest.approx(run.raw[reached, 1, 0].mean(), rel=1e-12)


def test_noise_free_run_computes_one_path_for_all():
    one, many = (simulate(dat21(), paths=n, impacts=6, dt=2e-3) for n in (1, 10_000))
    assert many.path_steps == one.path_steps
    assert many.section.paths.tolist() == [10_000] * 6
    assert many.section.drop(columns="paths").equals(one.section.drop(columns="paths"))


FEWEST = {
    "se_y1": 2,
    "se_energy": 2,
    "se_x1": 2,
    "se_sd_y1": 3,
    "se_skew_y1": 3,
    "se_kurt_y1": 4,
    "se_cov_x1_y1": 3,
    "se_z_rho1": 3,
    "se_bias": 3,
}


@pytest.mark.parametrize("paths", [1, 2, 3, 4])
def test_too_few_paths_tell_no_error(paths):
    """The spread of one path, the squared deviations of two and the kurtosis of three say nothing
    of the next path."""
    record = Record(times=[0.4], step_bias=True, energy=True)
    run = simulate(dat21(0.1), paths=paths, impacts=1, dt=0.01, rng=2, record=record)
    (bias,) = run.step_bias.query("quantity == 'y1' and moment == 'sd'").to_dict("records")
    told = {**run.at_times().iloc[0], **run.section.loc[1], **bias}
    for name, fewest in FEWEST.items():
        assert np.isnan(told[name]) == (paths < fewest), name


def test_batches_are_parts_of_the_run():
    record = Record(raw=True, batches=True)
    run = simulate_exactly(dat21(0.2), paths=34_821, impacts=3, rng=1, record=record)
    first = np.concatenate([run.raw[at : at + 1024, :, :6] for at in (0, 32 * 1024)])
    np.testing.assert_allclose(run.batches.mean[0], first.mean(axis=0), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(run.batches.sd[0], first.std(axis=0), rtol=1e-9, atol=1e-12)
    assert (run.batches.n.sum(axis=0) == run.paths).all()


def test_energy_is_what_each_impact_takes(run):
    scene = run.scene
    first = np.abs(run.raw[:, :, 6]) == 1
    square = np.where(first, run.raw[:, :, 3] ** 2, scene.mu * run.raw[:, :, 5] ** 2)
    lost = 0.5 * (1.0 - scene.epsilon**2) * square
    truth = np.array([lost.mean(axis=0), lost.std(axis=0) / np.sqrt(run.paths)])
    np.testing.assert_allclose(run.section[["energy", "se_energy"]].T, truth, rtol=1e-9)
