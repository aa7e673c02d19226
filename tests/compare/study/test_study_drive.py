"""Studies of drives: an axis over one order, and keys that orders do not change where there are none."""

import pytest
from study_files import study_text

from rattle import InputError, Order, Study

ORDERS = "[[drive]]\norder = 1\namplitude = 1.0\n[[drive]]\norder = 4\namplitude = 0.1\nphase = 1.0\n"


def test_an_axis_varies_one_order_and_keeps_the_others():
    study = Study.from_toml(
        study_text(more=ORDERS + '[[axes]]\n"drive.2.amplitude" = [0.0, 0.2]\ncorrelation_time = [0.0, 0.5]\n')
    )
    last = study.points[-1].sample.scene
    assert last.drive == (Order(1), Order(2, 0.2), Order(4, 0.1, 1.0))
    assert last.correlation_time == 0.5
    assert study.points[0].sample.scene.drive[1] == Order(2, 0.0)


def test_a_scene_without_orders_has_the_key_that_it_had():
    plain = Study.from_toml(study_text())
    sine = Study.from_toml(study_text(more="[[drive]]\norder = 1\namplitude = 1.0\n"))
    assert [cell.key for cell in plain.cells] == [cell.key for cell in sine.cells]
    assert [cell.key for cell in plain.cells] != [cell.key for cell in Study.from_toml(study_text(more=ORDERS)).cells]


@pytest.mark.parametrize("name", ["drive.0.amplitude", "drive.2", "drive.2.order", "drive.x.phase"])
def test_no_field_of_an_order_is_refused(name):
    with pytest.raises(InputError, match="no field of a scene"):
        Study.from_toml(study_text(more=f'[[axes]]\n"{name}" = [0.1, 0.2]\n'))
