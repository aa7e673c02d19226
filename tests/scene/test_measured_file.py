"""Files of measurements as other programs write them, and what is said of those that cannot be
read."""

import numpy as np
import pytest
from measurements import OMEGA, TIMES, measure, write
from refusals import refusal

from rattle import InputError, measure_drive

PLAIN_FILE = measure(OMEGA, ((1, 0.3, 0.2),), TIMES[:2000])
COLUMNS_LINE = "time [s],displacement [mm]"


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", ";").replace(".", ","),
        lambda text: text.replace(",", "\t").replace(".", ","),
        lambda text: text.replace(",", ";").replace("\n", ";;\n"),
        lambda text: text.replace(COLUMNS_LINE, '"time [s]","displacement [mm]"'),
        lambda text: (
            '"' + text[:-1].replace(",", '";"').replace(".", ",").replace("\n", '"\n"') + '"'
        ),
        lambda text: text.replace(",", " , "),
        lambda text: "# a remark\n\n" + text + "\n\n",
    ],
)
def test_what_other_programs_write_is_read_alike(change):
    plain, other = (measure_drive(text, omega=OMEGA) for text in (PLAIN_FILE, change(PLAIN_FILE)))
    for name in ("omega", "amplitude", "drive"):
        assert getattr(other, name) == getattr(plain, name)


PLAIN_LINES = PLAIN_FILE.splitlines(keepends=True)


def with_line(number, text):
    return "".join([*PLAIN_LINES[: number - 1], text, "\n", *PLAIN_LINES[number:]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            with_line(7, "0.00125,nan"),
            "line 7 = '0.00125,nan': needs two numbers; leave out a row without a value",
        ),
        (
            with_line(7, "0.00125,1,2"),
            "line 7 = '0.00125,1,2': needs two numbers, and has 3 columns",
        ),
        (
            with_line(7, "0,00125,0,2"),
            "line 7 = '0,00125,0,2': has 4 columns, not two numbers; put semicolons",
        ),
        (
            with_line(7, "12:30:01.5,0.2"),
            "line 7 = '12:30:01.5,0.2': has a time of day or a date; give seconds from",
        ),
        (with_line(7, '"' + 200_000 * "1"), "line 7 = .*has a quotation mark that is not closed"),
        (with_line(7, 200_000 * "1"), "line 7 = .*too much in one cell"),
        (
            with_line(1, '"time [s],displacement [mm]'),
            "line 1 = .*has a quotation mark that is not closed",
        ),
        (with_line(7, "0.00125,much"), "line 7 = '0.00125,much': needs two numbers, such as 0.25"),
        (
            with_line(701, "0.1745,0.2"),
            "line 701 = 'time = 0.1745': is that of line 700 again; each row needs a later",
        ),
        (
            with_line(701, "0.1,0.2"),
            "line 701 = 'time = 0.1': is another step than the others, back from 0.1745 of",
        ),
        ("".join(PLAIN_LINES[:100]), "99 samples': is too short"),
        ("".join(PLAIN_LINES[:200]), "periods': is too short"),
        ("".join(PLAIN_LINES[:50] + PLAIN_LINES[60:]), "follows a gap of 11 steps"),
        (COLUMNS_LINE + "\n", "has no rows below its header"),
        ("\n", "is empty"),
        (
            PLAIN_FILE.replace(COLUMNS_LINE, COLUMNS_LINE + ",torque [N m]"),
            "has 3 columns; keep two, as in: time",
        ),
        (PLAIN_FILE.replace(COLUMNS_LINE, "time [s]"), "has 1 column; keep two"),
        (
            PLAIN_FILE.replace(COLUMNS_LINE, "Zeit [s],Drehzahl [1/min]"),
            "'Zeit': is no such column; give time or angle",
        ),
        (
            PLAIN_FILE.replace(COLUMNS_LINE, "time [s],speed [U/min]"),
            "has an unknown unit; give rad/s, rpm",
        ),
        (
            PLAIN_FILE.replace(COLUMNS_LINE, "time [h],speed [rpm]"),
            "'time .h.': has an unknown unit; give s, ms",
        ),
        (
            PLAIN_FILE.replace(COLUMNS_LINE, "time,displacement"),
            "name two columns with their units",
        ),
    ],
)
def test_what_cannot_be_read_is_said_with_its_line(text, message):
    with pytest.raises(InputError, match=message) as raised:
        measure_drive(text, omega=OMEGA)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("unit", "turn", "low"), [("deg", 360.0, 0.0), ("rad", 2.0 * np.pi, -0.5)])
def test_wrapped_angles_of_an_encoder_are_unwrapped(unit, turn, low):
    times = TIMES[:2000]
    turns = (80.0 * times + 0.01 * np.sin(OMEGA * times)) / (2.0 * np.pi)
    text = write(times, ((turns - low) % 1.0 + low) * turn, f"time [s],displacement [{unit}]")
    found = measure_drive(text, omega=OMEGA, driver_radius=30.0)
    assert found.amplitude == pytest.approx(0.3, rel=1e-4)
    assert [one.order for one in found.drive if one.amplitude > 0.01] == [1]


def test_a_speed_against_the_angle_is_said_to_be():
    angle = np.arange(0.0, 360.0 * 12, 2.0)
    swing = 20.0 * np.sin(np.radians(angle))

    def found(angle, speed, **settings):
        text = write(angle, speed, "angle [deg],speed [rpm]")
        return measure_drive(text, driver_radius=30.0, **settings).amplitude

    assert found(-angle, -800.0 - swing) == pytest.approx(found(angle, 800.0 + swing))
    with refusal("line 2 = 'speed = -800 rpm': is negative where the angle rises; turn the"):
        found(angle, -800.0 - swing)
    with refusal("give omega, since it is no speed of rotation"):
        found(angle, swing)
    assert found(angle, swing, omega=80.0) == pytest.approx(20.0 * np.pi / 80.0)
