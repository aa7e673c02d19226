import re

import numpy as np
import pytest
from refusals import refusal
from scenes import SECTION, dat21

from rattle import DAT21, Scene, Start, follow, mean_map
from rattle.closure import CLOSURES

SOME_NOISE = dat21(0.05)
STATES = ["x1", "y1", "x2", "y2"]
SECTION_COLUMNS = [
    "tau",
    "flight",
    "mesh",
    "side",
    *STATES,
    *(f"sd_{q}" for q in SECTION),
    "rho1",
    "rho2",
]
FIXED = [
    *STATES,
    *(f"cov_{a}_{b}" for i, a in enumerate(STATES) for b in STATES[i:]),
    "rho1",
    "rho2",
]


@pytest.fixture(params=sorted(CLOSURES))
def closure(request):
    return request.param


BRANCHING = ["agreement", "discarded", "error_mean", "error_sd", "within"]


def test_section_keeps_the_contract(closure):
    section = mean_map(SOME_NOISE, impacts=7, closure=closure).section
    others = [f"skew_{q}" for q in SECTION] + BRANCHING * (closure == "branching")
    assert [c for c in section.columns if c not in others] == [*SECTION_COLUMNS, "realizable"]
    assert set(others) <= set(section.columns)
    assert section.index.name == "impact"
    assert section.index.tolist() == [1, 2, 3, 4, 5, 6, 7]


def test_the_section_table_is_consistent(closure):
    m = mean_map(SOME_NOISE, impacts=7, closure=closure)
    tau = np.array([SOME_NOISE.start.tau, *m.section["tau"]])
    assert m.section["flight"].to_numpy() == pytest.approx(np.diff(tau), nan_ok=True)
    covariance = m.stage_covariance(1, 1)
    rho = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert m.section.loc[1, "rho1"] == pytest.approx(rho, nan_ok=True)


def test_a_single_stage_has_no_stage_2(closure):
    section = mean_map(dat21(0.02, stages=1), impacts=4, closure=closure).section
    assert not [name for name in section if name.endswith("2")]
    predicted = ["tau", "x1", "y1", "sd_y1"] + ["rho1"] * (closure != "branching")
    assert section[predicted].notna().any().all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"closure": "publishd"}, "closure = 'publishd': did you mean 'published'?"),
        ({"closure": "xyz"}, "valid are 'published', 'corrected', 'saltation'"),
        ({"closure": None}, "closure = None: "),
        ({"order": 1}, "order = 1: must be at least 2"),
        ({"order": 7}, "order = 7: must be at most 6"),
        ({"impacts": 0}, "impacts = 0: must be at least 1"),
        ({"impacts": 2.5}, "impacts = 2.5: give a whole number"),
    ],
)
def test_a_bad_request_is_refused_in_words(change, words):
    with refusal(re.escape(words)):
        mean_map(SOME_NOISE, **change)


def test_a_scene_is_needed():
    with refusal("give a Scene"):
        mean_map(DAT21)


def test_a_table_at_fixed_times_keeps_the_contract(closure):
    m = mean_map(SOME_NOISE, impacts=5, closure=closure)
    times = [0.05, 0.4, 1.0]
    table = m.at_times(times)
    assert list(table.columns) == FIXED
    assert table.index.name == "time"
    assert table.index.tolist() == times


@pytest.mark.parametrize("outside", [-1e-9, 1e9, float("nan")])
def test_fixed_times_go_no_further_than_was_followed(closure, outside):
    m = mean_map(SOME_NOISE, impacts=3, closure=closure)
    with refusal("lies outside the times followed, 0 to "):
        m.at_times([0.1, outside])


def test_a_closure_that_stops_early_says_why_and_leaves_the_other_rows_empty():
    scene = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=1.0, sigma=0.1, stages=1, start=Start())
    m = mean_map(scene, impacts=60, closure="corrected")
    assert m.stopped == f"a mesh sticks after impact {m.trace.found}"
    rest = m.section.loc[m.trace.found + 1 :]
    assert len(rest) == 60 - m.trace.found > 0
    assert rest[["tau", "x1", "sd_y1", "rho1"]].isna().all().all()
    assert not rest["realizable"].any()
    assert set(m.itinerary[m.trace.found :]) == {0}


def test_a_corrected_series_has_the_powers_of_rho_alone():
    a = mean_map(SOME_NOISE, impacts=3, closure="corrected", order=6).edgeworth(3, 1).a
    rho = a[1, 1]
    assert a == pytest.approx(np.diag([1.0, rho, rho**2 / 2, rho**3 / 6, 0, 0, 0]), abs=1e-12)


def test_no_series_without_noise():
    m = mean_map(dat21(), impacts=2)
    with refusal("impact = 1: stage 1 has no positive variance there, so no Edgeworth series"):
        m.edgeworth(1, 1)


@pytest.mark.parametrize(("impact", "stage"), [(0, 1), (4, 1), (1, 0), (1, 3), (1.0, 1)])
def test_edgeworth_asks_for_an_impact_and_a_stage_that_exist(impact, stage):
    with refusal():
        mean_map(SOME_NOISE, impacts=3).edgeworth(impact, stage)


@pytest.mark.parametrize("closure", ["corrected", "saltation", "branching", "published"])
def test_without_noise_all_but_published_are_the_orbit(closure):
    """`published` has the impact law of mesh 1 alone: its third impact is 0.16 early."""
    scene = dat21()
    off = mean_map(scene, impacts=3, closure=closure).section["tau"] - follow(scene, 3).tau[1:]
    assert (off.abs().max() < 1e-9) == (closure != "published")
