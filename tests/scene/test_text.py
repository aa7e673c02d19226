"""Shares in percent, and values as Python text."""

import math

import numpy as np
import pytest

from rattle import InputError
from rattle.scene.text import as_call, percent, show


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


def test_numbers_of_numpy_are_written_as_numbers():
    assert (
        show((np.float64(0.5), [np.int64(3)], {"a": np.bool_(True)})) == "(0.5, [3], {'a': True})"
    )
    error = InputError("omega", (np.float64(1.5), np.int64(2)), "change it")
    assert str(error) == "omega = (1.5, 2): change it"
    assert as_call("simulate", {"dt": np.float64(0.01)}) == "simulate(dt=0.01)"
