from itertools import product

import pytest
from oracle import gearbox

from rattle.scene import Scene, Start
from rattle.scene.orbit import follow

BETAS = (0.0, 1e-12, 1e-6, 0.08, 1.0, 50.0)
PAIRS = list(product(BETAS, BETAS))
STATE = (0.31, -1.2, -0.17, 0.9)


def far_from_walls(beta1, beta2, **changes):
    values = {
        "alpha": 1.5,
        "epsilon": 0.9,
        "gamma1": 0.06,
        "gamma2": 0.03,
        "mu": 0.6,
        "gap1": 1e3,
        "gap2": 1e3,
        "start": Start(0.7, *STATE),
    } | changes
    return Scene(beta1=beta1, beta2=beta2, **values)


@pytest.mark.parametrize(("beta1", "beta2"), PAIRS)
def test_flow_solves_the_equations_of_motion(beta1, beta2):
    scene = far_from_walls(beta1, beta2)
    # the solver's own error at rtol 1e-12 over this flight stays below 1e-11
    exact = gearbox(scene.constants).fly(0.7, STATE, 2.5)
    assert follow(scene, 1).state(3.2) == pytest.approx(exact, rel=0, abs=3e-11)


def test_the_misprinted_damping_of_stage_2_is_distinguished():
    scene = far_from_walls(0.08, 0.13)
    misprinted = gearbox(scene.constants)
    misprinted.damping[1, 1] = scene.beta1  # -beta_1 y_2, as Eqs. 3 and 5 have it
    wrong = misprinted.fly(0.7, STATE, 2.5)
    assert abs(follow(scene, 1).state(3.2) - wrong).max() > 1e-3


def test_stage_1_flies_alike_with_and_without_stage_2():
    one, two = (follow(far_from_walls(0.08, 0.13, stages=s), 1).state(3.2) for s in (1, 2))
    assert list(one[:2]) == list(two[:2])
