"""What a closure of one's own returns is in the times of the scene that the user gave, on every
road that takes one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import dat21

from rattle import Closure, Study, boundary, mean_map, validate
from rattle.compare import closure_sensitivity
from rattle.compare.thresholds.claim import read_claim
from rattle.compare.thresholds.decision import predict

PAPER = dat21(0.01)
LATE_START = replace(
    PAPER, start=replace(PAPER.start, tau=4.1)
)  # above pi: reduced to a negative phase
ORBIT_TIMES = mean_map(LATE_START, impacts=2).section["tau"].to_numpy()


def constant(scene, impacts):
    """Numbers as they were measured or read from a file, at any sigma."""
    return {"tau": ORBIT_TIMES[:impacts]}


def at_times(scene, times):
    assert np.all(times > 4.1)
    return mean_map(scene, impacts=2).at_times(times)[["rho1", "rho2"]]


MINE = Closure("mine", constant, at_times)


def test_in_a_validation():
    table = validate(LATE_START, impacts=2, closures=[MINE], paths=32_768, rng=7).table
    rows = table.query("quantity == 'tau' and moment == 'mean'")
    # of all paths, and of those on the itinerary
    assert rows["predicted"].tolist() == pytest.approx([*ORBIT_TIMES, *ORBIT_TIMES])
    assert set(rows["verdict"]) == {"accurate"}
    assert table.query("kind == 'fixed time'")["predicted"].notna().all()


def test_in_a_study_and_a_boundary():
    text = LATE_START.to_toml() + "[study]\nimpacts = 2\npaths = 4096\n[[axes]]\nsigma = [0.01]\n"
    study = replace(Study.from_toml(text), closures=(MINE,))
    assert study.points[0].predictions[0].evaluate()[0]["tau"].tolist() == pytest.approx(
        ORBIT_TIMES + LATE_START.phase - 4.1
    )
    found = boundary(LATE_START, closure=MINE, between=(0.005, 0.01), impacts=2, points=2)
    assert set(found.points["verdict"]) == {"accurate"}


def test_in_a_claim_of_pytest():
    said = predict(
        MINE,
        read_claim(
            {"scene": LATE_START, "impacts": 2, "quantities": "tau", "moments": "mean"}, Path()
        ),
    )
    assert said.section["tau"].tolist() == pytest.approx(ORBIT_TIMES + LATE_START.phase - 4.1)


def test_in_the_sensitivity_of_a_closure():
    seen = []

    def noted(scene, impacts):
        seen.append(scene.start.tau)
        return mean_map(scene, impacts=impacts).section

    closure_sensitivity(LATE_START, closure=noted, parameters=["amplitude"], impacts=1, paths=1024)
    assert set(seen) == {4.1}
