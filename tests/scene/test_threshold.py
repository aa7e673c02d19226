"""The threshold of rattle: against the motion itself just below and above it, against known values, and bad input."""

from dataclasses import replace

import pytest

from rattle import DAT21, Gears, InputError, Order, Scene, rattle_threshold
from rattle.closure.long_orbit import attractor

THREE = (Order(1, 1.0), Order(2, 0.4, 0.7), Order(5, 0.08, -1.1))
SCENES = {
    "one stage": Scene(alpha=1.5, epsilon=0.4, beta1=0.3, gamma1=1.0, stages=1),
    "three orders": Scene(alpha=1.5, epsilon=0.4, beta1=0.3, gamma1=1.0, stages=1, drive=THREE),
    "two stages": replace(Scene.from_gears(DAT21), epsilon=0.3, gears=None),
    "two stages, three orders": replace(Scene.from_gears(DAT21), epsilon=0.3, gears=None, drive=THREE),
}


def dragged(scene, factor, wheel):
    """The scene with one wheel at a factor of its threshold, the other well above."""
    if scene.stages == 2:
        scene = replace(scene, gamma2=rattle_threshold(scene)[1].least * (factor if wheel == 2 else 1.1))
    return replace(scene, gamma1=rattle_threshold(scene)[0].least * (factor if wheel == 1 else 1.5))


@pytest.mark.parametrize("name", SCENES)
def test_closed_teeth_open_just_below_it_and_stay_closed_just_above(name):
    """A planted error of half a percent would be seen."""
    scene = SCENES[name]
    for wheel in range(1, scene.stages + 1):
        below, above = dragged(scene, 0.995, wheel), dragged(scene, 1.005, wheel)
        assert attractor(above).kind == "rest", wheel
        assert attractor(below).kind != "rest", wheel
        assert any(t.opens for t in rattle_threshold(below))
        assert not any(t.opens for t in rattle_threshold(above))


def test_torques_are_in_newton_millimetres():
    """Inertia times acceleration over the radius, for gears without damping."""
    gears = Gears(alpha=2.0, epsilon=0.5, omega=100.0, inertia1=500.0, radius1=40.0, backlash1=0.3, torque1=7.0)
    (wheel,) = rattle_threshold(Scene.from_gears(gears, stages=1))
    assert wheel.drag == 7.0
    assert wheel.unit == "N mm"
    assert wheel.least == pytest.approx(500.0 * (2.0 * 0.3) * 100.0**2 / 40.0 / 1000.0)


def test_a_strong_drag_of_wheel_2_holds_wheel_1():
    scene = SCENES["two stages"]
    held = replace(scene, gamma2=100.0)
    assert rattle_threshold(held)[0].least == 0.0
    assert not any(t.opens for t in rattle_threshold(held))


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="give a Scene"):
        rattle_threshold(DAT21)
