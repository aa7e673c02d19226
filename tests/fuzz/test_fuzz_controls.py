"""Negative controls of the checks: one wrong number of each kind is detected."""

from dataclasses import replace

import fuzz_checks
import fuzz_sampled
import numpy as np
import pytest
from fuzz_checks import check
from scenes import dat21

from rattle import Record, Tolerance, simulate
from rattle.montecarlo import Ensemble

SIMPLE_SCENE = dat21(0.1, tolerance=Tolerance(0.01, 0.01))
SIMPLE = SIMPLE_SCENE.to_dict()


def backwards(orbit):
    orbit.tau[1:] = orbit.tau[:0:-1].copy()
    return orbit


def with_negative_sds(prediction):
    trace = replace(prediction.trace, sd=-prediction.trace.sd)
    return replace(prediction, trace=trace)


@pytest.mark.parametrize(
    ("entry", "name", "spoil"),
    [("orbit", "follow", backwards), ("saltation", "mean_map", with_negative_sds)],
)
def test_a_wrong_answer_is_seen(entry, name, spoil, monkeypatch):
    assert check(entry, SIMPLE, {"impacts": 3}) == ("complete", "")
    right = getattr(fuzz_checks, name)
    monkeypatch.setattr(fuzz_checks, name, lambda *given, **more: spoil(right(*given, **more)))
    with pytest.raises(AssertionError):
        check(entry, SIMPLE, {"impacts": 3})


@pytest.fixture(scope="module")
def run():
    record = Record(raw=True, energy=True)
    return simulate(SIMPLE_SCENE, paths=8, impacts=3, dt=0.01, rng=1, record=record)


COLUMNS = {
    "agreement above 1": ("agreement", 1.0 + 1e-9),
    "more paths than asked": ("paths", 9),
    "negative sd": ("sd_x2", -1e-30),
    "silent sd": ("sd_tau", np.nan),
    "infinite": ("kurt_y2", np.inf),
    "correlation": ("rho1", 1.0 + 1e-11),
    "times that fall": ("tau", [0.5, 1.5, 1.4]),
    "times apart from flights": ("flight", 0.3),
    "energy that is won": ("energy", -1e-9),
}


@pytest.mark.parametrize(("column", "value"), COLUMNS.values(), ids=COLUMNS)
def test_a_wrong_column_is_seen(column, value, run, monkeypatch):
    fuzz_sampled.of_an_ensemble(run)
    right = Ensemble.columns.func
    wrong = {column: np.broadcast_to(np.asarray(value), (3,)).copy()}
    monkeypatch.setattr(Ensemble, "columns", property(lambda ensemble: right(ensemble) | wrong))
    with pytest.raises(AssertionError):
        fuzz_sampled.of_an_ensemble(replace(run))


@pytest.mark.parametrize(("column", "value"), [(0, -1.0), (1, -1e-9), (4, -0.7), (6, 3.0)])
def test_a_wrong_path_is_seen(column, value, run):
    fuzz_sampled.of_its_paths(SIMPLE_SCENE, run.raw, "exact-flight")
    raw = run.raw.copy()
    raw[3, 1, column] = value
    with pytest.raises(AssertionError):
        fuzz_sampled.of_its_paths(SIMPLE_SCENE, raw, "exact-flight")


def test_an_exact_flight_without_noise_that_is_none_of_eq_3_is_seen():
    """A wrong speed, and an impact that was flown through: its two flights as one."""
    run = simulate(dat21(), paths=1, impacts=6, record=Record(raw=True))
    fuzz_sampled.follows_the_flow(run)
    wrong = run.raw.copy()
    wrong[0, 2, 3] += 0.3
    missed = np.delete(run.raw, 2, axis=1)
    missed[0, 2, 1] += run.raw[0, 2, 1]
    for raw in (wrong, missed):
        with pytest.raises(AssertionError):
            fuzz_sampled.follows_the_flow(replace(run, raw=raw))
