"""Scenes show themselves as the Python text that makes them; units of gears."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from rattle.scene import DAT21, Gears, InputError, Scene, Start, Tolerance
from rattle.scene.units import in_units

NAMES = {"DAT21": DAT21, "Gears": Gears, "Scene": Scene, "Start": Start, "Tolerance": Tolerance}
LOOSE = replace(DAT21, backlash2=0.25)


@pytest.mark.parametrize(
    "scene",
    [
        Scene.from_gears(DAT21),
        Scene.from_gears(LOOSE, sigma=0.1, tolerance=Tolerance(0.01, 1e-3, draw="contact")),
        Scene(alpha=1.5, epsilon=0.9, beta1=1 / 3, gamma1=0.0, stages=1, start=Start(tau=7.0)),
        Scene(alpha=1.5, epsilon=0.9, beta1=0.1, gamma1=0.0, mu=0.5, sigma=-0.0),
    ],
)
def test_its_repr_and_its_toml_make_a_scene_again_to_the_last_bit(scene):
    for again in (eval(repr(scene), NAMES), Scene.from_toml(scene.to_toml())):
        assert (again, again.gears, repr(again)) == (scene, scene.gears, repr(scene))
    assert repr(replace(scene, alpha=np.nextafter(scene.alpha, 9.0))) != repr(scene)  # one bit would be noticed
    assert len(repr(scene).splitlines()) <= 4
    assert max(map(len, repr(scene).splitlines())) <= 100
    assert "<pre>Scene" in scene._repr_html_()


def test_dat21_is_called_by_its_name():
    assert repr(Scene.from_gears(DAT21, sigma=0.1)) == "Scene.from_gears(DAT21, sigma=0.1)"


def test_one_unit_of_dat21():
    time, length, speed, energy = DAT21.units
    assert (time, length, speed) == (pytest.approx(1000.0 / 300.0), 0.2, pytest.approx(60.0))
    rim_mass = 4000e-6 / 0.041**2  # kg
    assert energy == pytest.approx(1e3 * rim_mass * 0.060**2)  # mJ


def test_columns_in_physical_units():
    values = {"tau": 3.0, "sd_x1": 0.5, "se_sd_y2": 0.1, "skew_y2": 1.0}
    columns = {name: np.array([value]) for name, value in values.items()}
    found = in_units(columns | {"flight": np.array([2.0])}, DAT21, "physical")
    assert {name: value.item() for name, value in found.items()} == pytest.approx(
        {"tau_ms": 10.0, "sd_x1_mm": 0.1, "se_sd_y2_mm_per_s": 6.0, "skew_y2": 1.0, "flight_ms": 20 / 3,
         "impacts_per_s": 150.0}
    )  # fmt: skip
    assert in_units(columns, None, "dimensionless") == columns


def test_an_error_keeps_its_place_between_processes():
    error = pickle.loads(pickle.dumps(InputError("sigma", -1.0, "must be 0 or greater", "mine.toml, line 2")))
    assert str(error) == "mine.toml, line 2: sigma = -1.0: must be 0 or greater"
    assert error.where == "mine.toml, line 2"
