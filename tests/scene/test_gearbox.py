"""Gears of any number of loose wheels: the model's numbers from millimetres, newtons and seconds,
names of wheels, and what cannot be right."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from rattle.scene import DAT21, Gears, InputError, Scene, Start
from rattle.scene.changes import change, find_value, unit_of_value, words_of_value
from rattle.scene.orbit import follow
from rattle.scene.threshold import rattle_threshold

TEXT = """\
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
SCENE = Scene.from_toml(TEXT)
WHEELS = SCENE.gears.values["wheels"]

# of the same gears, as an engineer reads the drawing: N mm as kg mm^2/s^2, angles in rad
PARENTS = (0, 0, 1, 3)
RADII = np.array([45.0, 33.0, 58.0, 25.0])
PARENT_RADII = np.array([30.0, 42.0, 20.0, 31.0])
INERTIAS = np.array([9000.0, 1200.0, 3200.0, 700.0])
DAMPINGS = 1e3 * np.array([0.5, 0.5, 0.5, 0.05])
BACKLASHES = np.array([0.12, 0.1, 0.12, 0.15])
RESTITUTIONS = (0.8, 0.7, 0.8, 0.8)
DRAGS = 1e3 * np.array([80.0, 20.0 + 70.0 * 200.0 / 2400.0, 60.0, 10.0])
OMEGA = 180.0
AMPLITUDE = 0.012
# of the mean rotation: of the driver 800/min, of each wheel by the radii along the way
DRIVER = 800.0 * 2.0 * math.pi / 60.0
SHAFT = DRIVER * 30.0 / 45.0
FIRST = SHAFT * 20.0 / 58.0
SPEEDS = np.array([SHAFT, DRIVER * 42.0 / 33.0, FIRST, FIRST * 31.0 / 25.0])


def fly(angles, rates, t):
    """Angles and rates after flights of times t: I phi'' + d phi' = -T - d Omega of each wheel."""
    t = np.expand_dims(t, -1)
    slowing = DAMPINGS / INERTIAS
    end = -(DRAGS + DAMPINGS * SPEEDS) / DAMPINGS  # rate that a wheel would end at
    moved = angles + end * t + (rates - end) * -np.expm1(-slowing * t) / slowing
    return moved, end + (rates - end) * np.exp(-slowing * t)


def find_gaps(t, angles, rates):
    """How far each wheel is behind its parent at their mesh, in mm, and the rates in mm/s."""
    driver = AMPLITUDE * np.sin(OMEGA * t)
    driven = AMPLITUDE * OMEGA * np.cos(OMEGA * t)
    all_angles = np.concatenate([np.expand_dims(driver, -1), angles], -1)
    all_rates = np.concatenate([np.expand_dims(driven, -1), rates], -1)
    at = PARENT_RADII * all_angles[..., PARENTS] - RADII * angles
    return at, PARENT_RADII * all_rates[..., PARENTS] - RADII * rates


def strike(rates, i, approach):
    """Rates after a push between wheel i and its parent, by their angular momenta."""
    after = rates.copy()
    p = PARENTS[i] - 1
    mobility = RADII[i] ** 2 / INERTIAS[i]
    if p >= 0:
        mobility += PARENT_RADII[i] ** 2 / INERTIAS[p]
    push = (1.0 + RESTITUTIONS[i]) * approach / mobility
    after[i] += push * RADII[i] / INERTIAS[i]
    if p >= 0:
        after[p] -= push * PARENT_RADII[i] / INERTIAS[p]
    return after


def follow_gears(angles, rates, impacts):
    """Times in s, wheels, and rates of their gaps in mm/s of the impacts after a start in
    flight."""
    now = 0.0
    rows = []
    grid = np.linspace(0.0, 0.04, 4001)
    while len(rows) < impacts:

        def beyond(t, now=now, angles=angles, rates=rates):
            return np.abs(find_gaps(now + t, *fly(angles, rates, t))[0]) - BACKLASHES / 2.0

        outside = beyond(grid)
        # a gap that was just struck is at its wall at first
        first = 2 + (outside[2:] > 0.0).any(axis=1).argmax()
        flights = {
            i: brentq(lambda t, i=i: beyond(t)[i], grid[first - 1], grid[first], xtol=1e-15)
            for i in np.flatnonzero(outside[first] > 0.0)
        }
        i = min(flights, key=flights.get)
        angles, rates = fly(angles, rates, flights[i])
        now += flights[i]
        approach = find_gaps(now, angles, rates)[1][i]
        rows.append((now, i, approach))
        rates = strike(rates, i, approach)
    return rows


def test_the_model_follows_the_gears_in_millimetres_and_seconds():
    """Three toothings on two shafts, two radii of the driver, own restitutions, a mean speed."""
    state = [0.1, -0.2, 0.3, 0.1, -0.25, 0.3, 0.4, -0.4]
    scene = Scene.from_gears(SCENE.gears, start=Start(0.0, state=state))
    unit = scene.gears.units
    sign = np.where(np.array(PARENTS) == 0, 1.0, -1.0)  # x1 = driver less wheel, x3 the reverse
    behind = sign * unit.length * np.array(state[::2])
    slower = sign * unit.speed * np.array(state[1::2])
    angles = np.zeros(4)
    rates = np.zeros(4)
    for i, p in enumerate(PARENTS):
        parent = angles[p - 1] if p else 0.0
        turning = rates[p - 1] if p else AMPLITUDE * OMEGA
        angles[i] = (PARENT_RADII[i] * parent - behind[i]) / RADII[i]
        rates[i] = (PARENT_RADII[i] * turning - slower[i]) / RADII[i]
    expected = follow_gears(angles, rates, 14)
    orbit = follow(scene, 14)
    assert (orbit.mesh[1:] - 1).tolist() == [i for _, i, _ in expected]
    assert set(orbit.mesh[1:]) == {1, 2, 3, 4}
    times = [OMEGA * t for t, _, _ in expected]
    np.testing.assert_allclose(orbit.tau[1:], times, rtol=1e-9)
    approaches = [sign[i] * rate / unit.speed for _, i, rate in expected]
    struck = [orbit.before[k, 2 * i + 1] for k, (_, i, _) in enumerate(expected, 1)]
    np.testing.assert_allclose(struck, approaches, rtol=1e-7)
    wrong = follow(scene.with_gears(**{"wheel.first.parent_radius": 20.002}), 14)
    assert not np.allclose(wrong.tau[1:], times, rtol=1e-7)  # a fault of 1e-4 is seen


def test_two_wheels_in_a_row_are_the_numbered_pair():
    kinds = ("inertia", "radius", "backlash", "damping", "torque")
    wheels = [{kind: getattr(DAT21, f"{kind}{i}") for kind in kinds} for i in (1, 2)]
    wheels[1]["meshes"] = 1
    pair = Gears(alpha=1.5, epsilon=0.9, omega=300.0, wheels=wheels)
    assert pair.units == DAT21.units
    assert [pair.beta(i) for i in (1, 2)] == [DAT21.beta(i) for i in (1, 2)]
    orbits = [follow(Scene.from_gears(gears), 20) for gears in (pair, DAT21)]
    np.testing.assert_allclose(orbits[0].before, orbits[1].before, rtol=1e-10, atol=1e-12)
    torques = [rattle_threshold(Scene.from_gears(gears)) for gears in (pair, DAT21)]
    assert [t.least for t in torques[0]] == pytest.approx([t.least for t in torques[1]], rel=1e-14)


def test_what_was_typed_is_kept_by_a_file_a_repr_and_a_copy():
    again = Scene.from_toml(SCENE.to_toml())
    assert again == SCENE
    assert again.gears.values == SCENE.gears.values
    assert "torque_over_rpm" in SCENE.to_toml()
    assert (
        eval(
            repr(SCENE),
            {name: globals()[name] for name in ("Scene", "Gears", "Start")}
            | {"Tolerance": type(SCENE.tolerance)},
        )
        == SCENE
    )
    wide = replace(SCENE.gears, omega=200.0)
    assert wide.wheels[0].torque == SCENE.gears.wheels[0].torque  # the mean speed adds to it once
    assert replace(SCENE, sigma=0.2).gears is SCENE.gears
    assert replace(SCENE, alpha=2.0).gears is None


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wheel.first.torque", "drag torque on wheel first"),
        ("wheel.3.torque", "drag torque on wheel 3"),
        ("torque3", "drag torque on wheel 3"),
    ],
)
def test_a_value_of_a_wheel_by_name_and_by_number(name, words):
    assert find_value(SCENE, name, "over") == 60.0
    changed = change(SCENE, {name: 90.0})
    assert changed.gears == replace(
        SCENE.gears, wheels=[replace(w, torque=90.0) if w.name == "first" else w for w in WHEELS]
    )
    assert unit_of_value(name) == "N mm"
    assert words_of_value(name) == words


def test_lengths_of_other_wheels_stay_when_the_unit_changes():
    wide = SCENE.with_gears(**{"wheel.shaft.backlash": 0.24, "speed_rpm": 1500.0})
    assert wide.gears.amplitude == SCENE.gears.amplitude
    assert wide.tree[3].gap == pytest.approx(0.5 * SCENE.tree[3].gap)
    assert wide.start.values[6] == wide.tree[3].gap  # on its flank
    assert wide.gears.tree[1].torque > SCENE.gears.tree[1].torque  # its table is read again
    assert change(SCENE, {"wheel.4.gap": 0.7, "start.y4": 1.0}).start.values[6:] == (0.7, 1.0)
    names = ("shaft", "fifth", "first", "4")
    assert (SCENE.wheel_names, SCENE.gears.wheel_names) == (names, names)


def written(old, new, text=TEXT):
    assert old in text
    return text.replace(old, new)


LONE = "\n[[wheel]]\ninertia = 700.0\nradius = 25.0\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (written('meshes = "shaft"', 'meshes = "shft"'), "first.meshes = 'shft': no wheel has"),
        (written('meshes = "shaft"', 'meshes = "shft"'), "did you mean 'shaft'?"),
        (written("meshes = 3", "meshes = 9"), "wheel.4.meshes = 9: there are 4 wheels"),
        (written("meshes = 3", "meshes = 4"), "line 35: wheel.4.meshes = 4: wheel 4 must stand"),
        (written('"fifth"', '"shaft"'), "wheel.2.name = 'shaft': two wheels have this name"),
        (written('"fifth"', '"2"'), "wheel.2.name = '2': write a letter"),
        (written('"fifth"', '"driver"'), "is the name of the driver"),
        (written("parent_radius = 20.0", "parent_radius = 0.0"), "greater than 0"),
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
        (TEXT + "[gears.tolerance]\nbacklash1 = 0.01\n", "give it as backlash_tolerance"),
        (TEXT + 29 * LONE, "wheels = 33: at most 32 wheels"),
        (f"[scene]\nalpha = 1.0{LONE}", "needs [gears]"),
    ],
)
def test_a_gearbox_that_cannot_be_is_refused_by_wheel_value_and_remedy(tmp_path, text, words):
    path = tmp_path / "box.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        Scene.load(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_second_radius_of_the_driver_needs_the_first():
    wheel = {"inertia": 900.0, "radius": 30.0, "backlash": 0.1}
    others = {"amplitude": 0.3, "omega": 180.0, "epsilon": 0.5}
    with pytest.raises(
        InputError, match=r"wheel\.2\.parent_radius = 40\.0: give the driver's radius"
    ):
        Gears.driven(wheels=[wheel, wheel | {"parent_radius": 40.0}], **others)
    box = Gears.driven(
        wheels=[wheel | {"parent_radius": 32.0}, wheel | {"parent_radius": 40.0}], **others
    )
    assert [w.ratio for w in Scene.from_gears(box).wheels] == [1.0, 1.25]
    turned = Gears.driven(wheels=box.wheels, amplitude_rad=0.01, omega=180.0, epsilon=0.5)
    assert turned.amplitude == 0.32
    with pytest.raises(InputError, match=r"driver_radius = 30\.0: wheel 1 has parent_radius too"):
        Gears.driven(wheels=box.wheels, driver_radius=30.0, **others)
