"""An axis, a search and a sweep over a value of the gears; all others stay as they were typed."""

from dataclasses import replace

import pytest
from places import EXAMPLES
from refusals import refusal
from scenes import TURNING, UNGEARED, dat21

from rattle import Gears, Order, Scene, Study, Tolerance
from rattle.compare.chaos.sweep import vary
from rattle.compare.study.parameters import find_parameter, find_parameters

TURNING_SCENE = Scene.from_gears(TURNING, sigma=0.02)


def scenes(axis, scene=TURNING_SCENE):
    head = "[study]\nimpacts = 2\npaths = 4096\n"
    study = Study.from_toml(f"{head}{scene.to_toml()}[[axes]]\n{axis}\n")
    return study, [point.sample.scene for point in study.points]


CHANGED_VALUES = {
    "backlash1": 0.4,
    "speed_rpm": 1200.0,
    "amplitude": 0.25,
    "omega": 320.0,
}


@pytest.mark.parametrize("name", CHANGED_VALUES)
def test_an_axis_over_a_value_of_the_gears(name):
    value = CHANGED_VALUES[name]
    expected = Scene.from_gears(Gears.driven(**TURNING.values | {name: value}), sigma=0.02)
    study, (found,) = scenes(f"{name} = [{value}]")
    assert found == expected
    assert vary(TURNING_SCENE, name, [value])[value] == expected
    assert find_parameter(TURNING_SCENE, name).scene_at(value) == expected
    assert (study.shown_gears is None) == (name in ("omega", "backlash1"))


def test_with_other_axes_beside_it():
    _study, found = scenes("backlash1 = [0.2, 0.4]\nsigma = [0.01, 0.03]")
    assert [(s.sigma, round(s.alpha, 12)) for s in found] == [(0.01, 1.5), (0.03, 0.75)]


def test_a_study_of_a_gearbox_names_its_wheels_and_takes_the_closures_that_it_can_have():
    box = Scene.load(EXAMPLES / "gearbox5.toml")
    study, (found,) = scenes('"wheel.third.torque" = [20.0]', box)
    assert found == box.with_gears(**{"wheel.third.torque": 20.0})
    assert study.closures == ("saltation", "branching")
    assert not study.points[0].reasons


def test_a_name_that_needs_gears_says_so():
    with refusal("axes = 'backlash1': a value of gears, which this study has not"):
        scenes("backlash1 = [0.2]", UNGEARED)
    with refusal("did you mean 'backlash1' or 'backlash2'"):
        scenes("backlash = [0.2]")
    with refusal("field = 'backlash': did you mean"):
        vary(TURNING_SCENE, "backlash", [0.2])


def test_parameters_are_those_that_were_typed():
    known = find_parameters(TURNING_SCENE)
    assert {"amplitude", "speed_rpm", "driver_radius", "torque1", "backlash1"} < set(known)
    torque = known["torque2"]
    assert (torque.value, torque.unit, torque.words) == (50.0, "N mm", "drag torque on wheel 2")


DRIVEN = dat21(0.5)


def test_what_a_parameter_does_not_name_stays_while_it_changes():
    order = (Order(1), Order(2, 0.3))
    parameters = find_parameters(
        replace(DRIVEN, drive=order, correlation_time=0.5, tolerance=Tolerance(0.01, 0.02))
    )
    assert parameters["drive.2.amplitude"].words == "amplitude of order 2 of the drive"
    wider = parameters["backlash1"].scene_at(0.4)
    assert wider.gears.amplitude == pytest.approx(0.3)
    assert (wider.tolerance.c1_max, wider.sigma) == (0.005, 0.5)
    assert (wider.drive, wider.correlation_time) == (order, 0.5)


@pytest.mark.parametrize("name", ["beta1", "drive.3.phase", "start.y1"])
def test_any_number_of_a_scene_can_be_another(name):
    parameter = find_parameter(DRIVEN, name)
    assert find_parameter(parameter.scene_at(0.31), name).value == pytest.approx(0.31)
    assert parameter.scene_at(0.32) != parameter.scene_at(0.31)
