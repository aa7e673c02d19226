"""The one spelling of a range of values."""

import pytest
from refusals import refusal
from scenes import IMPACT_PAIR, dat21

from rattle.compare.cli.ranges import RangeType


def read(text):
    return RangeType().convert(text, None, None)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("torque1=20:200:4", (20.0, 80.0, 140.0, 200.0)),
        ("sigma=1e-3:1:4:log", (0.001, 0.01, 0.1, 1.0)),
        ("backlash1=0.1:0.4321:3:log", (0.1, 0.208, 0.4321)),
        ("torque1", (25.0, 100.0, 400.0)),  # a fourth of the file's value to four times it
    ],
)
def test_values_of_a_range(text, values):
    assert read(text).values(dat21(), points=3) == pytest.approx(values, rel=1e-15)


def test_a_name_alone_needs_a_value_to_go_around():
    with refusal(r"gamma1 = 0\.0: is not above 0 in this scene"):
        read("gamma1").values(IMPACT_PAIR, points=3)
