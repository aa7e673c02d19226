"""Shares in percent, and values as Python text."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from rattle.scene.text import as_call, percent, show

SOURCES = Path(__file__).parents[2]
EXPONENT = re.compile(r"(\.[1-5]?g|:g)\}\s?%")


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (1.0, "100 %"),
        (0.9996, "100 %"),
        (0.995, "100 %"),
        (0.0123, "1.2 %"),
        (2.5e-6, "0.00025 %"),
        (123.0, "12000 %"),
        (0.0, "0 %"),
        (-0.5, "-50 %"),
        (math.nan, "NaN %"),
    ],
)
def test_a_share_has_no_power_of_ten(share, text):
    assert percent(share) == text


def test_no_percentage_is_written_with_a_power_of_ten():
    """A number to fewer than six digits before a percent sign may turn into 1e+02: `percent` writes
    them all."""
    files = [
        p
        for name in ("scene", "closure", "montecarlo", "compare")
        for p in (SOURCES / name).rglob("*.*")
    ]
    wrong = [
        f"{path.name}: {line.strip()}"
        for path in files
        if path.suffix in {".py", ".toml", ".md"} and path.name != "text.py"
        for line in path.read_text(encoding="utf-8").splitlines()
        if EXPONENT.search(line)
    ]
    assert wrong == []


def test_numbers_of_numpy_are_written_as_numbers():
    assert (
        show((np.float64(0.5), [np.int64(3)], {"a": np.bool_(True)})) == "(0.5, [3], {'a': True})"
    )
    assert as_call("simulate", {"dt": np.float64(0.01)}) == "simulate(dt=0.01)"
