"""Scenes of every magnitude by every entry, always the same: each answers, stops with a reason or refuses by name."""

import json
from pathlib import Path

import pytest
from fuzz_checks import ENTRIES, check
from fuzz_plan import PLAN, job
from fuzz_watched import Watched

COUNT = {
    "scene": 100, "orbit": 100, "long orbit": 60, "published": 50, "corrected": 50, "saltation": 70, "branching": 16,
    "euler-maruyama": 60, "euler-maruyama-located": 60, "exact-flight": 80, "accuracy": 6, "validate": 8,
    "simulate a file": 10, "validate a file": 1, "study a file": 1,
}  # fmt: skip
FOUND = json.loads(Path(__file__).with_name("found.json").read_text())
"""Scenes that met a defect once, with the entry and the settings that showed it."""


@pytest.fixture(scope="module")
def watched():
    process = Watched(check)
    yield process
    process.close()


@pytest.mark.slow
@pytest.mark.parametrize("entry", COUNT)
def test_a_scene_of_any_magnitude_is_answered_stopped_with_a_reason_or_refused_by_name(entry, watched):
    ended = []
    for number in range(COUNT[entry]):
        found = watched.run(*job(0, number, entry))
        assert not found.defect, f"{found.ended}: check(*job(0, {number}, {entry!r}))\n{found.detail}"
        ended.append(found.ended)
    assert ended.count("refused") < 0.6 * len(ended)  # the space is not one that is refused throughout


def test_every_entry_is_tried():
    assert set(COUNT) == set(PLAN) == set(ENTRIES)


@pytest.mark.parametrize("case", FOUND, ids=[f"{case['entry']}: {case['defect']}" for case in FOUND])
def test_what_was_found_is_mended(case):
    assert check(case["entry"], case["scene"], case["settings"])[0] in ("complete", "stopped"), case["defect"]
