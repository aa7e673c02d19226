from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal

from rattle import DAT21, Gears, Scene


def test_dat21_has_the_dimensionless_numbers_of_the_model():
    found = [
        *map(DAT21.beta, (1, 2)),
        *map(DAT21.gamma, (1, 2)),
        DAT21.mu,
        DAT21.gap2,
        DAT21.alpha,
        DAT21.epsilon,
    ]
    printed = [0.083333, 0.133333, 0.056944, 0.029333, 0.601187, 0.5, 1.5, 0.9]
    # docs/model.md section 1 prints six decimals
    assert found == pytest.approx(printed, rel=0, abs=6e-7)


def test_whole_and_numpy_numbers_become_floats():
    gears = replace(DAT21, omega=300, radius1=np.float32(41.0), inertia1=np.int64(4000))
    assert gears == DAT21
    assert {type(gears.omega), type(gears.radius1), type(gears.inertia1)} == {float}


ONE_WHEEL = {
    "alpha": 1.5,
    "epsilon": 0.9,
    "omega": 300.0,
    "inertia1": 4000.0,
    "radius1": 41.0,
    "backlash1": 0.2,
}


def test_gears_of_one_stage_have_one_wheel():
    gears = Gears(**ONE_WHEEL, damping1=100.0, torque1=100.0)
    assert (gears.wheel_names, DAT21.wheel_names) == (("1",), ("1", "2"))
    assert "2=" not in repr(gears)
    with refusal("stages = 2: these gears have no wheel 2"):
        Scene.from_gears(gears)
    for call in (lambda: gears.mu, lambda: gears.gamma(2)):
        with refusal("wheel = 2: there is one loose wheel, 1"):
            call()


@pytest.mark.parametrize(("given", "other"), [("inertia2", "radius2"), ("radius2", "inertia2")])
def test_a_second_wheel_has_an_inertia_and_a_radius(given, other):
    with refusal(f"{other} = None: goes with {given}"):
        Gears(**ONE_WHEEL, **{given: 30.0})
