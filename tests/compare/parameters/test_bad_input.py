"""What a search or a sensitivity cannot use is refused with its field and a remedy, before any
run."""

import pytest
from searches import QUIET, SEARCHES, WEAK

from rattle import InputError, Scene, sensitivity
from rattle.compare import closure_sensitivity
from rattle.scene import RattleError

BAD_SEARCHES = {
    "boundary": [
        ({"over": "sigmaa"}, "did you mean 'sigma'"),
        ({"closure": "saltatoin"}, "did you mean 'saltation'"),
        ({"between": (0.5, 0.1)}, "sigma HIGH = 0.1: must be greater than LOW = 0.5"),
        ({"over": "epsilon", "between": (0.5, 1.5)}, "epsilon = 1.5: no scene can have it"),
        ({"points": 1}, "must be at least 2"),
    ],
    "map": [
        ({"along": "alpah"}, "did you mean 'alpha'"),
        ({"along": "sigma"}, "is the first parameter too"),
        ({"along": "drive.2.amplitude", "reach": None}, "give a range"),
        ({"pints": 3}, "did you mean 'points'"),
        ({"scheduler": "ucx://127.0.0.1:1"}, "give tcp://HOST:PORT"),
    ],
    "crossing": [
        ({"quantity": "powr"}, "did you mean 'power'"),
        ({"level": 0.0}, "level = 0.0"),
        ({"slow": 0.0}, "slow = 0.0"),
    ],
    "closure_sensitivity": [
        ({"scene": QUIET}, "sigma = 0.0"),
        ({"paths": 100}, "paths = 100"),
    ],
    "sensitivity": [
        ({"quantities": ["powr"]}, "did you mean 'power'"),
        ({"parameters": ["torque3"]}, "did you mean 'torque"),
        ({"parameters": ["correlation_time"]}, "is 0 in this scene"),
        ({"parameters": ["speed_rpm"]}, "these gears were given without it"),
        ({"accuracy": 0.0}, "accuracy = 0.0: must be greater than 0"),
        ({"scene": Scene(alpha=0.1, epsilon=0.5, beta1=0.1, gamma1=1.0, stages=1)}, "at rest"),
    ],
}
FUNCTIONS = SEARCHES | {
    "closure_sensitivity": (closure_sensitivity, WEAK, {}),
    "sensitivity": (sensitivity, WEAK, {}),
}


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [(name, changes, message) for name, rows in BAD_SEARCHES.items() for changes, message in rows],
)
def test_bad_input_is_refused(name, changes, message):
    function, scene, settings = FUNCTIONS[name]
    with pytest.raises((InputError, RattleError), match=message):
        function(**{"scene": scene, **settings, **changes})
