"""Scenes of any magnitude at every entry point: answered, stopped with a reason, or refused by
name."""

import json
from pathlib import Path

import pytest
from fuzz_checks import ENTRIES, check
from fuzz_plan import PLAN, job

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
    "validate a file": 1,
    "study a file": 1,
}
FOUND = json.loads(Path(__file__).with_name("found.json").read_text())
"""Scenes that met a defect once, with the entry and the settings that showed it."""


def test_every_entry_is_tried():
    assert set(COUNT) == set(PLAN) == set(ENTRIES)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("entry", "number"), [(entry, k) for entry, count in COUNT.items() for k in range(count)]
)
def test_a_scene_of_any_magnitude_is_answered_stopped_with_a_reason_or_refused_by_name(
    entry, number
):
    check(*job(0, number, entry))


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "case", FOUND, ids=[f"{case['entry']}: {case['defect']}" for case in FOUND]
)
def test_what_was_found_is_mended(case):
    ended, why = check(case["entry"], case["scene"], case["settings"])
    assert ended != "refused", why
