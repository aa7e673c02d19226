"""Negative controls of the checks: one wrong number of each kind is detected."""

import contextlib
import dataclasses
import math

import fuzz_checks
import fuzz_sampled
import numpy as np
import pandas as pd
import pytest
from fuzz_checks import check
from fuzz_must import SIMPLE, has_verdicts
from fuzz_plan import built, job
from fuzz_space import LEAST, Numbers, any_scene

from rattle import Sampling
from rattle.montecarlo import SCHEMES, Ensemble, Record, simulate, simulate_to
from rattle.scene import DAT21, InputError, Scene

SCENE = Scene.from_dict(SIMPLE)
QUIET = Scene.from_gears(DAT21)
SETTINGS = {"paths": 8, "impacts": 3, "dt": 0.01, "scheme": "exact-flight", "rng": 1}


def is_seen(monkeypatch, entry, settings, place, wrong, match=""):
    """A check passes, and fails once a function that it calls gives something wrong."""
    assert check(entry, SIMPLE, settings) == ("complete", "")
    module, name = place
    right = getattr(module, name)
    monkeypatch.setattr(module, name, lambda *given, **more: wrong(right, *given, **more))
    with pytest.raises(AssertionError, match=match or None):
        check(entry, SIMPLE, settings)


@pytest.mark.parametrize("fault", ["backwards", "outside"])
def test_a_wrong_orbit_is_seen(fault, monkeypatch):
    def wrong(right, *given):
        orbit = right(*given)
        if fault == "backwards":
            orbit.tau[1:] = orbit.tau[:0:-1].copy()
        else:
            orbit.before[1, 0] *= 1.5
        return orbit

    is_seen(monkeypatch, "orbit", {"impacts": 3}, (fuzz_checks, "follow"), wrong)


@pytest.mark.parametrize(
    ("table", "place", "match"),
    [
        ("covariance", (), ""),
        ("sd", (), ""),
        ("tau", (), ""),
        ("skew", (0,), "without a reason"),
    ],
)
def test_a_wrong_closure_is_seen(table, place, match, monkeypatch):
    def wrong(right, *given, **settings):
        m = right(*given, **settings)
        values = getattr(m.trace, table).copy()
        values[(2, *place)] = np.nan if match or table == "tau" else -np.abs(values[2])
        return dataclasses.replace(m, trace=dataclasses.replace(m.trace, **{table: values}))

    is_seen(monkeypatch, "saltation", {"impacts": 3}, (fuzz_checks, "mean_map"), wrong, match)


def test_a_refusal_of_what_nobody_has_given_is_seen(monkeypatch):
    def wrong(right, *given, **settings):
        raise InputError("record.times", 1.0, "must lie between 0 and 0.5")

    given = {"impacts": 1, "paths": 64}
    is_seen(
        monkeypatch,
        "validate",
        given,
        (fuzz_checks, "validate"),
        wrong,
        "although the scene is valid",
    )


@pytest.fixture(scope="module")
def run():
    return simulate(
        SCENE,
        record=Record(raw=True, energy=True, times=[0.2]),
        **SETTINGS,
    )


def test_a_right_ensemble_passes_and_so_does_a_number_that_is_missing_with_a_reason(run):
    """A single random path has no standard error, a constant no skewness, and unfinished paths have
    no moments."""
    fuzz_sampled.of_an_ensemble(run)
    fuzz_sampled.of_its_paths(SCENE, run.raw, "exact-flight")
    fuzz_sampled.of_an_ensemble(simulate(SCENE, **(SETTINGS | {"paths": 1})))
    fuzz_sampled.of_an_ensemble(simulate(QUIET, **SETTINGS))
    fuzz_sampled.of_an_ensemble(simulate(SCENE, **SETTINGS, sampling=Sampling(horizon=0.6)))


COLUMNS = {
    "agreement above 1": ("agreement", 1.0 + 1e-9),
    "agreement that rises": ("agreement", [0.5, 0.6, 0.7]),
    "more paths than asked": ("paths", 9),
    "negative sd": ("sd_x2", -1e-30),
    "silent sd": ("sd_tau", math.nan),
    "infinite": ("kurt_y2", math.inf),
    "correlation": ("rho1", 1.0 + 1e-11),
    "times that fall": ("tau", [0.5, 1.5, 1.4]),
    "negative flight": ("flight", -1e-3),
    "times apart from flights": ("flight", 0.3),
    "mean beyond its wall": ("x2", 0.52),
    "energy that is won": ("energy", -1e-9),
}


@pytest.mark.parametrize(("column", "value"), COLUMNS.values(), ids=COLUMNS)
def test_a_wrong_column_is_seen(column, value, run, monkeypatch):
    right = Ensemble.columns.func
    wrong = np.broadcast_to(np.asarray(value), (3,)).copy()
    monkeypatch.setattr(
        Ensemble, "columns", property(lambda ensemble: right(ensemble) | {column: wrong})
    )
    with pytest.raises(AssertionError):
        fuzz_sampled.of_an_ensemble(dataclasses.replace(run))


def test_workers_that_differ_are_seen(monkeypatch):
    def wrong(right, *given, workers=1, **chosen):
        return right(*given, workers=workers, **(chosen | {"rng": workers}))

    settings = {"paths": 1030, "impacts": 1, "dt": 0.01}
    is_seen(
        monkeypatch, "exact-flight", settings, (fuzz_sampled, "simulate"), wrong, "workers change"
    )


@pytest.mark.parametrize(
    ("column", "value"),
    [("se_z_rho1", math.inf), ("rho2", 1.0 + 1e-11), ("cov_x1_y1", math.nan)],
)
def test_a_wrong_moment_at_a_time_is_seen(column, value, run, monkeypatch):
    right = run.at_times()
    monkeypatch.setattr(Ensemble, "at_times", lambda ensemble: right.assign(**{column: value}))
    with pytest.raises(AssertionError):
        fuzz_sampled.of_an_ensemble(run)


@pytest.mark.parametrize(
    ("column", "value"),
    [(0, -1.0), (1, -1e-9), (4, -0.7), (3, np.nan), (6, 3.0)],
)
def test_a_wrong_path_is_seen(column, value, run):
    raw = run.raw.copy()
    raw[3, 1, column] = value
    with pytest.raises(AssertionError):
        fuzz_sampled.of_its_paths(SCENE, raw, "exact-flight")


ROW = {
    "verdict": "accurate",
    "predicted": 1.0,
    "simulated": 1.0,
    "se": 0.1,
    "error": 0.0,
    "low": -0.1,
    "high": 0.1,
    "tolerance": 0.5,
    "agreement": 1.0,
    "remark": "",
}


@pytest.mark.parametrize(
    "wrong",
    [
        {"verdict": "right"},
        {"error": math.nan},
        {"verdict": "undecided", "high": math.nan},
        {"low": 0.2},
        {"agreement": 1.5},
        {"tolerance": math.inf},
        {"verdict": "not predicted"},
    ],
)
def test_a_wrong_verdict_is_seen(wrong):
    has_verdicts(
        pd.DataFrame(
            [ROW, ROW | {"verdict": "not predicted", "predicted": math.nan, "agreement": math.nan}]
        )
    )
    with pytest.raises(AssertionError):
        has_verdicts(pd.DataFrame([ROW, ROW | wrong]))


def test_wrong_tables_beside_the_section_are_seen(run, monkeypatch):
    with pytest.raises(AssertionError):
        fuzz_sampled.of_an_ensemble(dataclasses.replace(run, paths=9))
    monkeypatch.setattr(Ensemble, "diagnostics", ())
    unfinished = simulate(SCENE, **SETTINGS, sampling=Sampling(horizon=0.6))
    with pytest.raises(AssertionError, match="no diagnostic"):
        fuzz_sampled.of_an_ensemble(unfinished)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_flight_without_noise_that_is_none_of_eq_3_is_seen(scheme):
    given = SETTINGS | {"scheme": scheme, "dt": 0.002, "paths": 1, "impacts": 6}
    run = simulate(QUIET, record=Record(raw=True), **given)
    fuzz_sampled.follows_the_flow(run)
    wrong = run.raw.copy()
    wrong[0, 2, 3] += 0.3
    # an impact that was flown through: its two flights as one
    missed = np.delete(run.raw, 2, axis=1)
    missed[0, 2, 1] += run.raw[0, 2, 1]
    for raw in (wrong, missed):
        with pytest.raises(AssertionError):
            fuzz_sampled.follows_the_flow(dataclasses.replace(run, raw=raw))


def test_a_reach_that_is_no_number_is_seen(monkeypatch):
    run = simulate_to(SCENE, 0.5, impacts=1)
    wrong = dataclasses.replace(run, reach=run.reach._replace(sampling=math.nan))
    for answer, passes in ((run, True), (wrong, False)):
        monkeypatch.setattr(fuzz_sampled, "simulate_to", lambda *given, answer=answer, **_: answer)
        with contextlib.nullcontext() if passes else pytest.raises(AssertionError, match="reach"):
            fuzz_sampled.accuracy(SCENE, {})


def test_jobs_are_a_function_of_seed_and_number_and_reach_the_ends():
    assert job(3, 7) == job(3, 7) != job(3, 8)
    drawn = [any_scene(Numbers(0, k)) for k in range(2000)]
    assert sum(built(data) is not None for data in drawn) > 0.9 * len(drawn)
    scenes = [data["scene"] for data in drawn if "gears" not in data]
    for name, least, most in (("beta1", LEAST, 1e4), ("sigma", 1e-30, 1e6), ("epsilon", LEAST, 1)):
        assert {0.0, least, most} <= {s[name] for s in scenes}
    meshes = {(s["stages"], s["start"]["mesh"]) for s in scenes if "start" in s}
    assert meshes == {(1, 0), (1, 1), (2, 0), (2, 1), (2, 2)}
