"""Scenes of the wide campaign (20 000, seed 0) that met defects, as they were drawn: ``found_wide.json``."""

import json
from pathlib import Path

import pytest
from fuzz_checks import check

FOUND = json.loads(Path(__file__).with_name("found_wide.json").read_text())


@pytest.mark.parametrize("case", FOUND, ids=[f"{number} {case['entry']}" for number, case in enumerate(FOUND)])
def test_what_the_wide_campaign_found_is_mended(case):
    assert check(case["entry"], case["scene"], case["settings"])[0] in ("complete", "stopped"), case["defect"]
