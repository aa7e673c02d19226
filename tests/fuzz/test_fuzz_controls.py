"""Negative controls of the watched process and of the checks: hangs, deaths and one wrong number
each are detected."""

import copy
import dataclasses
import json
import math
from pathlib import Path

import fuzz_checks
import fuzz_files
import fuzz_sampled
import numpy as np
import pandas as pd
import pytest
from fuzz_checks import ENTRIES, check
from fuzz_must import SIMPLE, has_verdicts
from fuzz_plan import PLAN, job
from fuzz_space import LEAST, Numbers, any_scene
from fuzz_watched import Watched, ends_as_named

from rattle import Sampling
from rattle.montecarlo import Ensemble, Reach, Record, simulate
from rattle.montecarlo.diagnostics.reach import Candidate
from rattle.montecarlo.statistics.records import Histograms
from rattle.scene import DAT21, InputError, Scene

SCENE = Scene.from_dict(SIMPLE)
QUIET = Scene.from_gears(DAT21)
SETTINGS = {"paths": 8, "impacts": 3, "dt": 0.01, "scheme": "exact-flight", "rng": 1}


def test_the_watch_tells_hangs_deaths_and_warnings_and_goes_on():
    watched = Watched(ends_as_named, 0.5)
    found = {
        kind: watched.run(kind) for kind in ("waits", "fine", "loops", "dies", "warns", "well")
    }
    watched.close()
    assert {kind: o.ended for kind, o in found.items()} == {
        "waits": "hung",
        "fine": "complete",
        "loops": "hung",
        "dies": "died",
        "warns": "broken",
        "well": "complete",
    }
    assert "RuntimeWarning" in found["warns"].detail
    assert [kind for kind, o in found.items() if o.defect] == ["waits", "loops", "dies", "warns"]


def is_seen(monkeypatch, entry, settings, place, wrong, match=""):
    """A check passes, and fails once a function that it calls gives something wrong."""
    assert check(entry, SIMPLE, settings) == ("complete", "")
    module, name = place
    right = getattr(module, name)
    monkeypatch.setattr(module, name, lambda *given, **more: wrong(right, *given, **more))
    with pytest.raises(AssertionError, match=match or None):
        check(entry, SIMPLE, settings)


@pytest.mark.parametrize("fault", ["backwards", "lost", "outside"])
def test_a_wrong_orbit_is_seen(fault, monkeypatch):
    def wrong(right, *given):
        orbit = right(*given)
        if fault == "backwards":
            orbit.tau[1:] = orbit.tau[:0:-1].copy()
        elif fault == "lost":
            orbit.tau[2] = np.nan
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
        ("sd", (0,), "without a reason"),
        ("sd", (4,), "without a reason"),
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
        record=Record(raw=True, histogram=True, batches=True, energy=True, times=[0.2]),
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
    "infinite mean": ("y1", math.inf),
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


def test_wrong_tables_beside_the_section_are_seen(run, monkeypatch):
    counts = run.histograms.counts.copy()
    counts[0, 0, 5] += 1
    histograms = Histograms(run.histograms.low, run.histograms.width, counts)
    batches = copy.deepcopy(run.batches)
    batches.n[0, 0, 0] += 1.0
    for wrong in ({"histograms": histograms}, {"batches": batches}, {"paths": 9}):
        with pytest.raises(AssertionError):
            fuzz_sampled.of_an_ensemble(dataclasses.replace(run, **wrong))
    monkeypatch.setattr(Ensemble, "diagnostics", ())
    unfinished = simulate(SCENE, **SETTINGS, sampling=Sampling(horizon=0.6))
    with pytest.raises(AssertionError, match="no diagnostic"):
        fuzz_sampled.of_an_ensemble(unfinished)


@pytest.mark.parametrize(
    ("column", "value"),
    [("se_z_rho1", math.inf), ("rho1", math.nan), ("rho2", 1.0 + 1e-11), ("cov_x1_y1", math.nan)],
)
def test_a_wrong_moment_at_a_time_is_seen(column, value, run, monkeypatch):
    right = run.at_times()
    monkeypatch.setattr(Ensemble, "at_times", lambda ensemble: right.assign(**{column: value}))
    with pytest.raises(AssertionError):
        fuzz_sampled.of_an_ensemble(run)


@pytest.mark.parametrize(
    ("column", "value"),
    [(0, -1.0), (1, -1e-9), (2, 0.7), (4, -0.7), (3, np.nan), (6, 3.0), (6, 0.0)],
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
    fuzz_sampled.follows_the_flow(run)
    for k, column, value in ((2, 3, 0.3), (3, 1, 0.05), (0, 5, -0.3)):
        raw = run.raw.copy()
        raw[0, k, column] += value
        with pytest.raises(AssertionError, match="leaves the flow"):
            fuzz_sampled.follows_the_flow(dataclasses.replace(run, raw=raw))
    # an impact that was flown through: its two flights as one
    missed = np.delete(run.raw, 2, axis=1)
    missed[0, 2, 1] += run.raw[0, 2, 1]
    with pytest.raises(AssertionError):
        fuzz_sampled.follows_the_flow(dataclasses.replace(run, raw=missed))


def test_identical_paths_behind_an_accuracy_and_what_is_not_said_of_it_are_seen(monkeypatch):
    reached = simulate(SCENE, paths=64, impacts=1, scheme="exact-flight")
    right = Reach(
        0.5, 0.1, 0.0, 0.2, "tau at impact 1", [Candidate("exact-flight", 0.01, 64, 1e5, 1.0)], 0.0
    )
    quiet = simulate(QUIET, paths=1, impacts=1, scheme="exact-flight")
    cases = {
        "": dataclasses.replace(reached, reach=right),
        "reach": dataclasses.replace(reached, reach=right._replace(sampling=math.nan)),
        "identical": dataclasses.replace(quiet, plan=quiet.plan._replace(paths=64), reach=right),
    }
    for match, answer in cases.items():
        monkeypatch.setattr(
            fuzz_sampled, "simulate_to", lambda *given, answer=answer, **settings: answer
        )
        if match:
            with pytest.raises(AssertionError, match=match):
                fuzz_sampled.accuracy(answer.scene, {})
        else:
            assert fuzz_sampled.accuracy(answer.scene, {}) == ("complete", "")


FILE = {"paths": 3, "impacts": 1, "scheme": "exact-flight"}


@pytest.mark.parametrize(
    ("place", "wrong", "match"),
    [
        (
            (fuzz_files.pd, "read_csv"),
            lambda right, *given, **more: pd.DataFrame({"tau": [1.0]}),
            "columns",
        ),
        (
            (fuzz_files, "simulate"),
            lambda right, *given, **more: simulate(SCENE, **FILE, rng=1),
            "Python",
        ),
    ],
    ids=["columns", "Python"],
)
def test_a_file_that_says_something_else_is_seen(place, wrong, match, monkeypatch):
    is_seen(monkeypatch, "simulate a file", FILE | {"seed": 0}, place, wrong, match)


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
        {"se": -1.0},
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


def test_jobs_are_a_function_of_seed_and_number_and_reach_the_ends():
    assert job(3, 7) == job(3, 7) != job(3, 8)
    scenes = [
        d["scene"] for d in (any_scene(Numbers(0, k)) for k in range(2000)) if "gears" not in d
    ]
    for name, ends in {
        "alpha": (0.0, 1e-30, 1e6),
        "beta1": (0.0, LEAST, 1e4),
        "gap1": (1e-9, 1e6),
        "sigma": (0.0, 1e-30, 1e6),
        "epsilon": (0.0, LEAST, 1.0),
    }.items():
        values = {s[name] for s in scenes}
        assert set(ends) <= values
        assert (min(values), max(values)) == (ends[0], ends[-1])
    assert [
        s for s in scenes if s.get("tolerance", {}).get("c1_max") == math.nextafter(s["gap1"], 0.0)
    ]
    assert [s for s in scenes if abs(s.get("start", {"tau": 0.0})["tau"]) > 1e9]
    meshes = {(s["stages"], s["start"]["mesh"]) for s in scenes if "start" in s}
    assert meshes == {(1, 0), (1, 1), (2, 0), (2, 1), (2, 2)}
    assert {job(0, k)[0] for k in range(2000)} == set(PLAN)


COUNT = {
    "scene": 100,
    "orbit": 100,
    "long orbit": 60,
    "published": 50,
    "corrected": 50,
    "saltation": 70,
    "branching": 16,
    "euler-maruyama": 60,
    "euler-maruyama-located": 60,
    "exact-flight": 80,
    "accuracy": 6,
    "validate": 8,
    "simulate a file": 10,
    "validate a file": 1,
    "study a file": 1,
}
FOUND = json.loads(Path(__file__).with_name("found.json").read_text())
"""Scenes that met a defect once, with the entry and the settings that showed it."""


@pytest.fixture(scope="module")
def watched():
    process = Watched(check)
    yield process
    process.close()


@pytest.mark.slow
@pytest.mark.parametrize("entry", COUNT)
def test_a_scene_of_any_magnitude_is_answered_stopped_with_a_reason_or_refused_by_name(
    entry, watched
):
    ended = []
    for number in range(COUNT[entry]):
        found = watched.run(*job(0, number, entry))
        assert not found.defect, (
            f"{found.ended}: check(*job(0, {number}, {entry!r}))\n{found.detail}"
        )
        ended.append(found.ended)
    assert ended.count("refused") < 0.6 * len(
        ended
    )  # the space is not one that is refused throughout


def test_every_entry_is_tried():
    assert set(COUNT) == set(PLAN) == set(ENTRIES)


@pytest.mark.parametrize(
    "case", FOUND, ids=[f"{case['entry']}: {case['defect']}" for case in FOUND]
)
def test_what_was_found_is_mended(case):
    assert check(case["entry"], case["scene"], case["settings"])[0] in (
        "complete",
        "stopped",
    ), case["defect"]
