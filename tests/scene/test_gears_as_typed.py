"""Gears keep what was typed: a changed copy, a repr and a file have the drive in mm and the mean
speed as given."""

import math
import pickle
from dataclasses import replace

import pytest
from refusals import refusal
from scenes import BESIDE_ALPHA, TURNING

from rattle import DAT21, Gears, Order, Scene, rattle_threshold

MOVED = Gears.driven(amplitude=0.3, **BESIDE_ALPHA)
TURNED = Gears.driven(amplitude_rad=0.01, driver_radius=30.0, **BESIDE_ALPHA)
OIL = ((600.0, 20.0), (1000.0, 60.0), (3000.0, 100.0))
"""Drag over speed: 40 N mm at the 800/min of `TURNING`."""
WITHOUT_DRAG = {n: v for n, v in TURNING.values.items() if not n.startswith("torque")}
OILED = Gears.driven(**WITHOUT_DRAG, torque1_over_rpm=OIL)
"""The same as a polynomial: 40 N mm at 800/min too."""
POLYNOMIAL = Gears.driven(
    **WITHOUT_DRAG,
    torque1_over_rpm={"polynomial": [8.0, 0.02, 2.5e-5], "rpm": [600, 3000]},
)
TYPED = {"mm": MOVED, "rad": TURNED, "speed": TURNING, "oil": OILED, "polynomial": POLYNOMIAL}


@pytest.mark.parametrize("gears", TYPED.values(), ids=TYPED.keys())
def test_another_backlash_is_the_same_motion(gears):
    wide = replace(Scene.from_gears(gears).gears, backlash1=0.4)
    assert wide.amplitude == pytest.approx(0.3, rel=1e-15)
    assert wide.alpha == pytest.approx(0.75, rel=1e-15)
    back = replace(wide, backlash1=0.2)
    assert back == gears
    assert back.values == gears.values


def test_another_alpha_takes_the_place_of_the_amplitude():
    for gears in (MOVED, TURNED, TURNING):
        changed = replace(gears, alpha=2.0)
        assert (changed.alpha, changed.amplitude) == (2.0, 0.4)
        assert not {"amplitude", "amplitude_rad"} & set(changed.values)
    assert "driver_radius" not in replace(TURNED, alpha=2.0).values


def test_a_mean_speed_is_counted_in_again():
    brake = TURNING.torque1 - 100.0
    assert brake == pytest.approx(100.0 * 800.0 / 60.0 * 2.0 * math.pi * 30.0 / 41.0)
    assert replace(TURNING, torque1=50.0).torque1 == pytest.approx(50.0 + brake)
    assert replace(TURNING, damping1=200.0).torque1 == pytest.approx(100.0 + 2.0 * brake)
    assert replace(TURNING, damping1=200.0).values["torque1"] == 100.0


@pytest.mark.parametrize(
    ("gears", "drag", "kind"), [(OILED, 80.0, "table"), (POLYNOMIAL, 148.0, "polynomial")]
)
def test_drag_over_speed_is_read_again_at_every_speed(gears, drag, kind):
    """For wheel 2 as for wheel 1, until a constant takes its place."""
    brake = TURNING.torque1 - 100.0
    assert gears.torque1 == pytest.approx(40.0 + brake)
    scene = Scene.from_gears(gears, sigma=0.1)
    faster = scene.with_gears(speed_rpm=2000.0)
    assert faster.gears.torque1 == pytest.approx(drag + 2.5 * brake)
    assert rattle_threshold(faster)[1].drag == faster.gears.torque2
    with refusal(f"the {kind} ends at 600 and 3000 1/min; "):
        scene.with_gears(speed_rpm=3001.0)
    constant = replace(gears, torque1=50.0)
    assert constant.torque1 == pytest.approx(50.0 + brake)
    assert constant.values["torque2_over_rpm"] == gears.values["torque2_over_rpm"]


def test_a_repr_and_a_file_have_what_was_typed():
    assert "alpha" not in repr(MOVED)
    for typed in ("amplitude=0.3", "speed_rpm=800.0", "torque1=100.0"):
        assert typed in repr(TURNING)
    for gears in (*TYPED.values(), DAT21):
        scene = Scene.from_gears(gears, sigma=0.1)
        assert eval(repr(scene), {"Scene": Scene, "Gears": Gears, "DAT21": DAT21}) == scene
        again = Scene.from_toml(scene.to_toml())
        assert (again, repr(again)) == (scene, repr(scene))
        assert pickle.loads(pickle.dumps(gears)).values == gears.values


SINGLE_TEXT = "[scene]\nalpha = 1.5\nepsilon = 0.9\nbeta1 = 0.1\ngamma1 = 0.1\nstages = 1\n"
DRIVE_TEXT = f"{SINGLE_TEXT}[[drive]]\norder = 1\namplitude = 1.0\n"


def test_a_phase_is_in_radians_or_said_to_be_in_degrees():
    for phase in (30, -90.0, 6.4):
        with refusal(r"drive.phase = .*: is in radians, .* write .*, or phase_degrees = "):
            Scene.from_toml(f"{DRIVE_TEXT}phase = {phase}")
    with refusal(r"if it is in degrees, write 0\.523599"):
        Order(2, 0.4, 30.0)
    assert Scene.from_toml(f"{DRIVE_TEXT}phase_degrees = 30").drive[0].phase == math.radians(30.0)
    assert Scene.from_toml(f"{DRIVE_TEXT}phase = 6.2832").drive[0].phase == 6.2832
    for text, message in (
        ("phase_degrees = 500", "between 0 and 360"),
        ("phase = 1\nphase_degrees = 2", "keep one"),
    ):
        with refusal(f"drive.phase_degrees = .*{message}"):
            Scene.from_toml(DRIVE_TEXT + text)
