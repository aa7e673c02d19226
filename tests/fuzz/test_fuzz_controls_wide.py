"""Negative controls of the checks of simulations, files and verdicts: one wrong number each, which must be detected."""

import dataclasses
import json
import math

import fuzz_checks
import fuzz_files
import fuzz_sampled
import numpy as np
import pandas as pd
import pytest
from fuzz_flights import follows_the_flow
from fuzz_must import has_verdicts
from fuzz_plan import SIMPLE
from fuzz_wide import LEAST, Numbers, wide_scene
from fuzz_wide_plan import WIDE, job

from rattle.montecarlo import Record, simulate
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.settings.sampling import Sampling
from rattle.montecarlo.statistics.records import Histograms
from rattle.scene import DAT21, Scene

SCENE = Scene.from_dict(SIMPLE)
QUIET = Scene.from_gears(DAT21)
SETTINGS = {"paths": 8, "impacts": 3, "dt": 0.01, "scheme": "exact-flight", "rng": 1}


@pytest.fixture(scope="module")
def run():
    return simulate(SCENE, record=Record(raw=True, histogram=True, batches=True, energy=True, times=[0.2]), **SETTINGS)


def test_a_right_ensemble_passes(run):
    fuzz_sampled.of_an_ensemble(run)
    fuzz_sampled.of_its_paths(SCENE, run.raw, "exact-flight")


COLUMNS = {
    "agreement above 1": ("agreement", 1.0 + 1e-9),
    "agreement below 0": ("agreement", -1e-9),
    "agreement that rises": ("agreement", [0.5, 0.6, 0.7]),
    "more paths than asked": ("paths", 9),
    "paths that come back": ("paths", [7, 8, 8]),
    "negative sd": ("sd_x2", -1e-30),
    "negative error": ("se_sd_tau", -1e-30),
    "silent sd": ("sd_tau", math.nan),
    "silent error": ("se_y1", math.nan),
    "silent skewness": ("skew_y1", math.nan),
    "silent correlation": ("rho2", math.nan),
    "silent energy": ("energy", math.nan),
    "silent agreement": ("agreement", math.nan),
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
    monkeypatch.setattr(Ensemble, "columns", property(lambda ensemble: right(ensemble) | {column: wrong}))
    with pytest.raises(AssertionError):
        fuzz_sampled.of_an_ensemble(dataclasses.replace(run))


def test_a_missing_number_with_a_reason_is_none():
    """A single random path has no standard error, a constant no skewness, and unfinished paths have no moments."""
    fuzz_sampled.of_an_ensemble(simulate(SCENE, **(SETTINGS | {"paths": 1})))
    fuzz_sampled.of_an_ensemble(simulate(QUIET, **SETTINGS))
    fuzz_sampled.of_an_ensemble(simulate(SCENE, **SETTINGS, sampling=Sampling(horizon=0.6)))


def test_wrong_tables_beside_the_section_are_seen(run, monkeypatch):
    counts = run.histograms.counts.copy()
    counts[0, 0, 5] += 1
    histograms = Histograms(run.histograms.low, run.histograms.width, counts)
    batches = run.batches.copy()
    batches.n[0, 0, 0] += 1.0
    for wrong in ({"histograms": histograms}, {"batches": batches}, {"paths": 9}):
        with pytest.raises(AssertionError):
            fuzz_sampled.of_an_ensemble(dataclasses.replace(run, **wrong))
    monkeypatch.setattr(Ensemble, "diagnostics", ())
    unfinished = simulate(SCENE, **SETTINGS, sampling=Sampling(horizon=0.6))
    assert unfinished.unfinished
    with pytest.raises(AssertionError, match="no diagnostic"):
        fuzz_sampled.of_an_ensemble(unfinished)


@pytest.mark.parametrize(
    ("column", "value"), [("se_z_rho1", math.inf), ("rho1", math.nan), ("rho2", 1.0 + 1e-11), ("cov_x1_y1", math.nan)]
)
def test_a_wrong_moment_at_a_time_is_seen(column, value, run, monkeypatch):
    right = run.at_times()
    monkeypatch.setattr(Ensemble, "at_times", lambda ensemble: right.assign(**{column: value}))
    with pytest.raises(AssertionError):
        fuzz_sampled.of_an_ensemble(run)


@pytest.mark.parametrize(
    ("column", "value"), [(0, -1.0), (1, -1e-9), (2, 0.7), (4, -0.7), (3, np.nan), (6, 3.0), (6, 0.0)]
)
def test_a_wrong_path_is_seen(column, value, run):
    raw = run.raw.copy()
    raw[3, 1, column] = value
    with pytest.raises(AssertionError):
        fuzz_sampled.of_its_paths(SCENE, raw, "exact-flight")


@pytest.mark.parametrize("scheme", ["exact-flight", "euler-maruyama", "euler-maruyama-located"])
def test_a_flight_without_noise_that_is_none_of_eq_3_is_seen(scheme):
    given = SETTINGS | {"scheme": scheme, "dt": 0.002, "paths": 1, "impacts": 6}
    run = simulate(QUIET, record=Record(raw=True), **given)
    follows_the_flow(run)

    def wrong(k, column, value):
        raw = run.raw.copy()
        raw[0, k, column] += value
        return dataclasses.replace(run, raw=raw)

    for k, column, value in ((2, 3, 0.3), (3, 1, 0.05), (0, 5, -0.3)):
        with pytest.raises(AssertionError, match="leaves the flow"):
            follows_the_flow(wrong(k, column, value))
    missed = np.delete(run.raw, 2, axis=1)  # an impact that was flown through: its two flights as one
    missed[0, 2, 1] += run.raw[0, 2, 1]
    with pytest.raises(AssertionError):
        follows_the_flow(dataclasses.replace(run, raw=missed))


def test_identical_paths_behind_an_accuracy_and_what_is_not_said_of_it_are_seen(monkeypatch):
    reached = simulate(SCENE, paths=2048, impacts=1, scheme="exact-flight")
    from rattle.montecarlo.diagnostics.reach import Candidate, Reach

    candidates = [Candidate("exact-flight", 0.01, 2048, 1e5, 1.0)]
    right = Reach(0.5, 0.1, 0.0, 0.2, "mean of tau at impact 1", candidates, 0.0)
    cases = {
        "": (reached, right), "reach": (reached, right._replace(sampling=math.nan)),
        "identical": (simulate(QUIET, paths=1, impacts=1, scheme="exact-flight"), right),
    }  # fmt: skip
    for match, (found, reach) in cases.items():
        paths = 2048 if match == "identical" else 1
        plan = found.plan._replace(paths=paths) if match == "identical" else found.plan
        answer = dataclasses.replace(found, plan=plan, reach=reach)
        monkeypatch.setattr(fuzz_sampled, "simulate_to", lambda *given, answer=answer, **settings: answer)
        if match:
            with pytest.raises(AssertionError, match=match):
                fuzz_sampled.accuracy(answer.scene, {})
        else:
            assert fuzz_sampled.accuracy(answer.scene, {}) == ("complete", "")


@pytest.mark.parametrize("text", ['{"a": NaN}', "[Infinity]", '{"a": -Infinity}', "{'a': 1}", ""])
def test_what_is_no_json_is_seen(text):
    with pytest.raises((AssertionError, json.JSONDecodeError)):
        fuzz_files.strict(text)
    assert fuzz_files.strict('{"a": null}') == {"a": None}


def test_a_file_that_says_something_else_is_seen(monkeypatch):
    settings = {"paths": 3, "impacts": 1, "scheme": "exact-flight", "seed": 0}
    assert fuzz_checks.check("simulate a file", SIMPLE, settings) == ("complete", "")
    with monkeypatch.context() as patched:
        patched.setattr(fuzz_files.pd, "read_csv", lambda *given, **more: pd.DataFrame({"tau": [1.0]}))
        with pytest.raises(AssertionError, match="columns"):
            fuzz_checks.check("simulate a file", SIMPLE, settings)
    other = simulate(SCENE, paths=3, impacts=1, scheme="exact-flight", rng=1)
    monkeypatch.setattr(fuzz_files, "simulate", lambda *given, **more: other)
    with pytest.raises(AssertionError, match="Python"):
        fuzz_checks.check("simulate a file", SIMPLE, settings)


ROW = {
    "verdict": "accurate", "predicted": 1.0, "simulated": 1.0, "se": 0.1, "error": 0.0, "low": -0.1, "high": 0.1,
    "tolerance": 0.5, "agreement": 1.0, "remark": "",
}  # fmt: skip


@pytest.mark.parametrize(
    "wrong",
    [
        {"verdict": "right"}, {"error": math.nan}, {"verdict": "undecided", "high": math.nan}, {"low": 0.2},
        {"se": -1.0}, {"agreement": 1.5}, {"tolerance": math.inf}, {"verdict": "not predicted"},
    ],
)  # fmt: skip
def test_a_wrong_verdict_is_seen(wrong):
    has_verdicts(pd.DataFrame([ROW, ROW | {"verdict": "not predicted", "predicted": math.nan, "agreement": math.nan}]))
    with pytest.raises(AssertionError):
        has_verdicts(pd.DataFrame([ROW, ROW | wrong]))


@pytest.mark.parametrize(("table", "place"), [("skew", 0), ("sd", 0), ("sd", 4)])
def test_a_number_that_a_closure_keeps_back_is_seen(table, place, monkeypatch):
    right = fuzz_checks.mean_map

    def wrong(*given, **settings):
        m = right(*given, **settings)
        values = getattr(m.trace, table).copy()
        values[2, place] = np.nan
        return dataclasses.replace(m, trace=dataclasses.replace(m.trace, **{table: values}))

    monkeypatch.setattr(fuzz_checks, "mean_map", wrong)
    with pytest.raises(AssertionError, match="without a reason"):
        fuzz_checks.check("saltation", SIMPLE, {"impacts": 3})


def test_a_refusal_of_what_nobody_has_given_is_seen(monkeypatch):
    def refusing(*given, **settings):
        raise fuzz_checks.fuzz_bad_input.InputError("record.times", 1.0, "must lie between 0 and 0.5")

    monkeypatch.setattr(fuzz_checks, "validate", refusing)
    with pytest.raises(AssertionError, match="although the scene is valid"):
        fuzz_checks.check("validate", SIMPLE, {"impacts": 1})


def test_jobs_are_a_function_of_seed_and_number_and_reach_the_ends():
    assert job(3, 7) == job(3, 7) != job(3, 8)
    drawn = [wide_scene(Numbers(0, k)) for k in range(2000)]
    scenes = [d["scene"] for d in drawn if "gears" not in d]
    for name, ends in {"alpha": (0.0, 1e-30, 1e6), "beta1": (0.0, LEAST, 1e4), "gap1": (1e-9, 1e6),
                       "sigma": (0.0, 1e-30, 1e6), "epsilon": (0.0, LEAST, 1.0)}.items():  # fmt: skip
        values = np.array([s[name] for s in scenes])
        assert set(ends) <= set(values.tolist())
        assert (values >= ends[0]).all()
        assert (values <= ends[-1]).all()
        decades = np.unique(np.floor(np.log10(values[values > 1e-30])))
        assert len(decades) >= math.log10(ends[-1]) - math.log10(max(ends[0], 1e-30)) - 1
    just_under = [s for s in scenes if s.get("tolerance", {}).get("c1_max") == math.nextafter(s["gap1"], 0.0)]
    late = [s for s in scenes if abs(s.get("start", {"tau": 0.0})["tau"]) > 1e9]
    meshes = {(s["stages"], s["start"]["mesh"]) for s in scenes if "start" in s}
    assert just_under
    assert late
    assert meshes == {(1, 0), (1, 1), (2, 0), (2, 1), (2, 2)}
    settings = [s for e, d, s in (job(0, k) for k in range(3000)) if "horizon" in s]
    assert {s["paths"] for s in settings} == {1, 2, 3, 31, 33, 1000, 1030}
    assert {s["dt"] is None for s in settings} == {True, False}
    assert {s["impacts"] for s in settings} >= {1, 64}
    assert {e for e, _, _ in (job(0, k) for k in range(3000))} == set(WIDE)
