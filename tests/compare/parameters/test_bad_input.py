"""What a search or a sensitivity cannot use is refused with its field and a remedy, before any
run."""

import pytest
from test_boundary import DRIVEN
from test_crossing import SETTINGS as CROSSING
from test_map import SETTINGS as MAP
from test_sensitivity import SMALL

from rattle import InputError, Scene, boundary, boundary_map, crossing, sensitivity
from rattle.compare import closure_sensitivity
from rattle.scene import RattleError

RESTING = Scene(alpha=0.1, epsilon=0.5, beta1=0.1, gamma1=1.0, stages=1)


@pytest.mark.parametrize(
    ("ask", "scene", "settings", "message"),
    [
        (boundary, DRIVEN, {"over": "sigmaa"}, "did you mean 'sigma'"),
        (boundary, DRIVEN, {"closure": "saltatoin"}, "did you mean 'saltation'"),
        (boundary, DRIVEN, {"between": (0.5, 0.1)}, "give a smaller and a larger value"),
        (
            boundary,
            DRIVEN,
            {"over": "epsilon", "between": (0.5, 1.5)},
            "no scene can have epsilon = 1.5",
        ),
        (boundary, DRIVEN, {"points": 1}, "must be at least 2"),
        (boundary, DRIVEN, {"width": 0.0}, "width = 0.0"),
        (boundary, DRIVEN, {"width": 1.0}, "width = 1.0"),
        (boundary_map, DRIVEN, MAP | {"along": "alpah"}, "did you mean 'alpha'"),
        (boundary_map, DRIVEN, MAP | {"along": "sigma"}, "is the first parameter too"),
        (
            boundary_map,
            DRIVEN,
            MAP | {"along": "epsilon", "reach": (0.5, 1.5)},
            "no scene can have epsilon = 1.5",
        ),
        (boundary_map, DRIVEN, MAP | {"along": "drive.2.amplitude", "reach": None}, "give a range"),
        (boundary_map, DRIVEN, MAP | {"values": 1}, "must be at least 2"),
        (boundary_map, DRIVEN, MAP | {"pints": 3}, "did you mean 'points'"),
        (boundary_map, DRIVEN, MAP | {"points": 1}, "must be at least 2"),
        (crossing, DRIVEN, CROSSING | {"quantity": "powr"}, "did you mean 'power'"),
        (crossing, DRIVEN, CROSSING | {"level": 0.0}, "level = 0.0"),
        (crossing, DRIVEN, CROSSING | {"points": 1}, "must be at least 2"),
        (crossing, DRIVEN, CROSSING | {"width": 1.0}, "width = 1.0"),
        (crossing, DRIVEN, CROSSING | {"slow": 0.0}, "slow = 0.0"),
        (closure_sensitivity, SMALL.with_sigma(0.0), {}, "sigma = 0.0"),
        (closure_sensitivity, SMALL, {"closure": "saltatoin"}, "did you mean 'saltation'"),
        (closure_sensitivity, SMALL, {"paths": 100}, "paths = 100"),
        (sensitivity, SMALL, {"quantities": ["powr"]}, "did you mean 'power'"),
        (sensitivity, SMALL, {"parameters": ["torque3"]}, "did you mean 'torque"),
        (sensitivity, SMALL, {"accuracy": 0.0}, "accuracy = 0.0: must be greater than 0"),
        (sensitivity, SMALL, {"budget": -1.0}, "budget = -1.0"),
        (sensitivity, RESTING, {}, "at rest"),
    ],
)
def test_bad_input_is_refused(ask, scene, settings, message):
    with pytest.raises((InputError, RattleError), match=message):
        ask(scene, **settings)
