"""Gears of any number of loose wheels: the model's numbers from millimetres, newtons and seconds,
names of wheels, and what cannot be right."""

import math
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal, refusal_in_words

import rattle.scene
from rattle import Gears, Scene
from rattle.scene.changes import change, find_value, unit_of_value, words_of_value

BOX_TEXT = """\
[gears]
amplitude_rad = 0.012
driver_radius = 30.0
speed_rpm = 800.0
omega = 180.0
epsilon = 0.8

[[wheel]]
name = "shaft"
inertia = 9000.0
radius = 45.0
backlash = 0.12
torque = 80.0
damping = 0.5

[[wheel]]
name = "fifth"
parent_radius = 42.0
inertia = 1200.0
radius = 33.0
backlash = 0.1
torque_over_rpm = [[600, 20.0], [3000, 90.0]]
epsilon = 0.7

[[wheel]]
name = "first"
meshes = "shaft"
parent_radius = 20.0
inertia = 3200.0
radius = 58.0
torque = 60.0
backlash_tolerance = 0.02

[[wheel]]
meshes = 3
inertia = 700.0
radius = 25.0
parent_radius = 31.0
backlash = 0.15
damping = 0.05
torque = 10.0

[scene]
sigma = 0.1
"""
GEARBOX = Scene.from_toml(BOX_TEXT)

# of the same gears, as an engineer reads the drawing: N mm as kg mm^2/s^2, angles in rad
RADII = np.array([45.0, 33.0, 58.0, 25.0])
INERTIAS = np.array([9000.0, 1200.0, 3200.0, 700.0])
DAMPINGS = 1e3 * np.array([0.5, 0.5, 0.5, 0.05])
DRAGS = 1e3 * np.array([80.0, 20.0 + 70.0 * 200.0 / 2400.0, 60.0, 10.0])
BOX_OMEGA = 180.0
# of the mean rotation: of the driver 800/min, of each wheel by the radii along the way
SPEED_OF_DRIVER = 800.0 * 2.0 * math.pi / 60.0
SPEED_OF_SHAFT = SPEED_OF_DRIVER * 30.0 / 45.0
SPEED_OF_FIRST = SPEED_OF_SHAFT * 20.0 / 58.0
SPEEDS = np.array(
    [SPEED_OF_SHAFT, SPEED_OF_DRIVER * 42.0 / 33.0, SPEED_OF_FIRST, SPEED_OF_FIRST * 31.0 / 25.0]
)


def test_the_model_has_the_numbers_of_the_gears_in_millimetres_and_seconds():
    """Three toothings on two shafts, two radii of the driver, own restitutions, a mean speed."""
    unit = 0.12 * BOX_OMEGA**2  # mm/s^2
    c = GEARBOX.constants
    assert c.alpha == pytest.approx(0.012 * 30.0 / 0.12)
    forces = (DRAGS + DAMPINGS * SPEEDS) * RADII / INERTIAS
    expected = {
        "beta": DAMPINGS / INERTIAS / BOX_OMEGA,
        "gamma": forces / unit,
        "wall": np.array([0.12, 0.1, 0.12, 0.15]) / 2.0 / 0.12,
        "mass": INERTIAS / RADII**2 * 45.0**2 / 9000.0,
        "parent": [-1, -1, 0, 2],
        "ratio": [1.0, 42.0 / 30.0, 20.0 / 45.0, 31.0 / 58.0],
        "sign": [1.0, 1.0, -1.0, -1.0],
        "epsilon": [0.8, 0.7, 0.8, 0.8],
    }
    for name, values in expected.items():
        assert c.wheels[name] == pytest.approx(values, rel=1e-14), name


def test_what_was_typed_is_kept_by_a_file_a_repr_and_a_copy():
    for again in (Scene.from_toml(GEARBOX.to_toml()), eval(repr(GEARBOX), vars(rattle.scene))):
        assert (again, again.gears.values) == (GEARBOX, GEARBOX.gears.values)
    assert "torque_over_rpm" in GEARBOX.to_toml()
    wide = replace(GEARBOX.gears, omega=200.0)
    assert wide.wheels[0].torque == GEARBOX.gears.wheels[0].torque  # the mean speed adds to it once
    assert replace(GEARBOX, sigma=0.2).gears is GEARBOX.gears
    assert replace(GEARBOX, alpha=2.0).gears is None


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wheel.first.torque", "drag torque on wheel first"),
        ("wheel.3.torque", "drag torque on wheel 3"),
        ("torque3", "drag torque on wheel 3"),
    ],
)
def test_a_value_of_a_wheel_by_name_and_by_number(name, words):
    assert find_value(GEARBOX, name, "over") == 60.0
    shaft, fifth, first, last = GEARBOX.gears.values["wheels"]
    wheels = [shaft, fifth, replace(first, torque=90.0), last]
    assert change(GEARBOX, {name: 90.0}).gears == replace(GEARBOX.gears, wheels=wheels)
    assert unit_of_value(name) == "N mm"
    assert words_of_value(name) == words


def test_lengths_of_other_wheels_stay_when_the_unit_changes():
    wide = GEARBOX.with_gears(**{"wheel.shaft.backlash": 0.24, "speed_rpm": 1500.0})
    assert wide.gears.amplitude == GEARBOX.gears.amplitude
    last = wide.tree[3]
    assert last.gap == pytest.approx(0.5 * GEARBOX.tree[3].gap)
    assert wide.start.values[6] == last.gap  # on its flank
    assert wide.gears.tree[1].torque > GEARBOX.gears.tree[1].torque  # its table is read again
    assert change(GEARBOX, {"wheel.4.gap": 0.7, "start.y4": 1.0}).start.values[6:] == (0.7, 1.0)
    names = ("shaft", "fifth", "first", "4")
    assert (GEARBOX.wheel_names, GEARBOX.gears.wheel_names) == (names, names)


def written(old, new, text=BOX_TEXT):
    assert old in text
    return text.replace(old, new)


LONE_WHEEL = "\n[[wheel]]\ninertia = 700.0\nradius = 25.0\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            written('meshes = "shaft"', 'meshes = "shft"'),
            "first.meshes = 'shft': no wheel has…did you mean 'shaft'?",
        ),
        (written("meshes = 3", "meshes = 9"), "wheel.4.meshes = 9: there are 4 wheels"),
        (written("meshes = 3", "meshes = 4"), "line 35: wheel.4.meshes = 4: wheel 4 must stand"),
        (written('"fifth"', '"shaft"'), "wheel.2.name = 'shaft': two wheels have this name"),
        (written('"fifth"', '"2"'), "wheel.2.name = '2': write a letter"),
        (written('"fifth"', '"driver"'), "is the name of the driver"),
        (written("inertia = 3200.0", "inertia = -1.0"), "line 29: wheel.first.inertia = -1.0"),
        (written("radius = 25.0\n", ""), "wheel.4 = ['radius']: these keys are missing"),
        (written("torque = 10.0", "tork = 10.0"), "line 41: wheel.4 = 'tork': unknown key"),
        (written("0.05\ntorque = 10.0", "0.0\ntorque = 0.01"), "if 0.01 is in N m, write 10"),
        (written("parent_radius = 31.0", "parent_radius = 0.031"), "is in m, write 31"),
        (written("torque = 60.0", "torque = 1e11"), "model would have wheel.first.gamma"),
        (written("backlash_tolerance = 0.02", "backlash_tolerance = 0.2"), "a gap could close"),
        (written("epsilon = 0.7", "epsilon = 1.7"), "wheel.fifth.epsilon = 1.7: must lie"),
        (written("epsilon = 0.8\n", ""), "epsilon = None: give it, or wheel shaft one of its own"),
        (written("speed_rpm = 800.0\n", ""), "speed_rpm = None: give it, and driver_radius"),
        (written("speed_rpm = 800.0", "speed_rpm = 80.0"), "the table ends at 600 and 3000"),
        (
            written("epsilon = 0.8", "epsilon = 0.8\ninertia2 = 5.0"),
            "gears.inertia2 = 5.0: belongs",
        ),
        (written("sigma = 0.1", "stages = 4"), "scene.stages = 4: leave it out"),
        (BOX_TEXT + "[gears.tolerance]\nbacklash1 = 0.01\n", "give it as backlash_tolerance"),
        (BOX_TEXT + 29 * LONE_WHEEL, "wheels = 33: at most 32 wheels"),
        (f"[scene]\nalpha = 1.0{LONE_WHEEL}", "needs [gears]"),
    ],
)
def test_a_gearbox_that_cannot_be_is_refused_by_wheel_value_and_remedy(tmp_path, text, words):
    path = tmp_path / "box.toml"
    path.write_text(text)
    with refusal_in_words(str(path), words):
        Scene.load(path)


def test_a_second_radius_of_the_driver_needs_the_first():
    wheel = {"inertia": 900.0, "radius": 30.0, "backlash": 0.1}
    first, second = (wheel | {"parent_radius": radius} for radius in (32.0, 40.0))

    def driven(*wheels, **driver):
        return Gears.driven(amplitude=0.3, omega=180.0, epsilon=0.5, wheels=wheels, **driver)

    with refusal(r"wheel\.2\.parent_radius = 40\.0: give the driver's radius"):
        driven(wheel, second)
    assert [w.ratio for w in Scene.from_gears(driven(first, second)).wheels] == [1.0, 1.25]
    behind = wheel | {"meshes": 1, "radius": 20.0}  # both on the pitch circle of the first
    assert Scene.from_gears(driven(wheel, behind)).wheels[1].ratio == 1.0
    with refusal(r"driver_radius = 30\.0: wheel 1 has parent_radius too"):
        driven(first, second, driver_radius=30.0)
