"""Other values of the gears of a scene: all others stay as they were typed."""

from dataclasses import replace

import pytest
from refusals import refusal
from scenes import BESIDE_ALPHA, dat21

from rattle import Gears, Order, Scene, Start, Tolerance
from rattle.scene.changes import change, find_value

IN_RAD = Gears.driven(amplitude_rad=0.01, driver_radius=30.0, speed_rpm=800.0, **BESIDE_ALPHA)
MEMORY_FIELDS = {"sigma": 0.2, "correlation_time": 0.5, "drive": (Order(1), Order(2, 0.4, 0.3))}
IN_RAD_SCENE = Scene.from_gears(IN_RAD, tolerance=Tolerance(0.02, 0.04), **MEMORY_FIELDS)


@pytest.mark.parametrize(
    ("name", "value", "alpha"),
    [
        ("backlash1", 0.4, 0.75),
        ("backlash2", 0.1, 1.5),
        ("amplitude_rad", 0.02, 3.0),
        ("amplitude", 0.15, 0.75),
        ("driver_radius", 60.0, 3.0),
        ("torque1", 150.0, 1.5),
        ("speed_rpm", 1600.0, 1.5),
    ],
)
def test_the_rest_stays_as_it_was_typed(name, value, alpha):
    changed = IN_RAD_SCENE.with_gears(**{name: value})
    assert changed.gears.values[name] == value
    assert changed.alpha == pytest.approx(alpha, rel=1e-14)
    kept = {n: v for n, v in changed.gears.values.items() if n not in (name, "amplitude_rad")}
    assert kept.items() <= IN_RAD_SCENE.gears.values.items()
    for field in MEMORY_FIELDS:
        assert getattr(changed, field) == getattr(IN_RAD_SCENE, field)
    tolerance = changed.gears.backlash1 * changed.tolerance.c1_max
    assert tolerance == pytest.approx(IN_RAD_SCENE.gears.backlash1 * 0.02, rel=1e-15)
    assert changed.start.x2 == pytest.approx(changed.gap2, rel=1e-15)


def test_a_start_on_a_flank_stays_on_it_and_any_other_where_it_is():
    mine = dat21(start=Start(1.0, 0.1, -0.3, -0.5, 0.2))
    wider = mine.with_gears(backlash2=0.4).start
    assert wider == replace(mine.start, x2=-1.0)
    assert change(mine, {"gap1": 0.6, "gap2": 0.7}).start == replace(mine.start, x2=-0.7)
    assert change(mine, {"gap2": 0.7, "start.x2": 0.1}).start == replace(mine.start, x2=0.1)


def test_an_order_in_the_units_of_a_scene_file():
    loud = change(IN_RAD_SCENE, {"drive.2.amplitude_mm": 0.06, "drive.2.phase_degrees": 90.0})
    assert loud.drive[1].amplitude == pytest.approx(0.2)
    assert find_value(loud, "drive.2.amplitude_mm", "over") == pytest.approx(0.06)
    assert find_value(loud, "drive.2.amplitude_rad", "over") == pytest.approx(0.002)
    assert find_value(loud, "drive.2.phase_degrees", "over") == pytest.approx(90.0)
    new = change(IN_RAD_SCENE, {"backlash1": 0.4, "drive.4.amplitude_rad": 0.001}).drive[2]
    assert (new.order, new.amplitude) == (4, pytest.approx(0.1))


def test_a_tolerance_in_mm_as_a_drawing_has_it():
    loose = change(IN_RAD_SCENE, {"backlash1": 0.4, "tolerance.backlash1": 0.02})
    assert loose.tolerance.c1_max == pytest.approx(0.025)
    assert find_value(loose, "tolerance.backlash1", "over") == pytest.approx(0.02)
    assert find_value(dat21(), "tolerance.backlash2", "over") == 0.0


@pytest.mark.parametrize(
    ("scene", "changes", "message"),
    [
        (IN_RAD_SCENE, {"backlash": 0.2}, "did you mean 'backlash1' or 'backlash2'"),
        (IN_RAD_SCENE, {"sigma": 0.2}, "gears = 'sigma': unknown key"),
        (IN_RAD_SCENE, {"backlash1": 0.0}, "backlash1 = 0.0: must be greater than 0"),
        (IN_RAD_SCENE, {"torque1": "much"}, "torque1 = 'much': give a number"),
        (IN_RAD_SCENE, {"alpha": 1.0, "amplitude": 0.3}, "give the drive once"),
        (dat21(), {"speed_rpm": 800.0}, "'speed_rpm': these gears were given with"),
        (replace(IN_RAD_SCENE, beta1=0.1), {"backlash1": 0.2}, "was not made from gears"),
    ],
)
def test_refusals(scene, changes, message):
    with refusal(message):
        scene.with_gears(**changes)
