import math
from dataclasses import replace

import numpy as np
import pytest
from oracle import gearbox
from scenes import UNEQUAL, dat21

from rattle import Scene, Start, follow


def still(**changes):
    """A scene in which nothing accelerates except by the changes given: flights are parabolas."""
    values = {"alpha": 0.0, "epsilon": 0.9, "beta1": 0.0, "gamma1": 0.0, "mu": 0.5} | changes
    return Scene(**values)


STRUCK = {
    "DAT21": dat21(),
    "unequal gaps": UNEQUAL,
    "strong damping": Scene(
        alpha=3.0, epsilon=0.5, beta1=4.0, beta2=9.0, gamma1=1.0, gamma2=6.0, mu=0.8, gap2=0.05
    ),
}


def first_impact(scene, tau, state):
    """Time of the first flight, mesh, side and state at its end."""
    orbit = follow(replace(scene, start=Start(tau, *state)), 1)
    return orbit.flight[1], orbit.mesh[1], orbit.side[1], orbit.before[1]


@pytest.mark.parametrize("name", STRUCK)
def test_the_first_impact_is_the_first_crossing_of_an_integrator(name):
    scene = STRUCK[name]
    box = gearbox(scene.constants)
    rng = np.random.default_rng(5)
    for _ in range(40):
        state = rng.uniform(-1, 1, (scene.stages, 2)) * np.column_stack([scene.windows, [2.0, 2.0]])
        start = Start(rng.uniform(0, 2 * math.pi), *state.ravel())
        orbit = follow(replace(scene, start=start), 1)
        i = orbit.mesh[1] - 1
        assert orbit.before[1, 2 * i] == orbit.side[1] * box.gaps[i]
        assert box.largest_error(orbit) < 1e-10


@pytest.mark.parametrize("speed", [1.0, 1e-6])
@pytest.mark.parametrize("mesh", [1, 2])
def test_the_same_wall_is_struck_twice_in_a_row(speed, mesh):
    drag = 3.0
    if mesh == 1:  # pulls wheel 1 back, so that x1 is pulled up; both wheels alike: x2 stays
        scene = still(gamma1=drag, gamma2=drag)
        state = (0.5, -speed, 0.1, 0.0)
    else:  # drag on wheel 2 alone: x2 falls
        scene = still(gamma2=drag)
        state = (0.0, 0.0, -0.5, speed)
    t, *struck, there = first_impact(scene, 0.3, state)
    assert struck == ([1, 1] if mesh == 1 else [2, -1])
    assert [t, abs(there[2 * mesh - 1])] == pytest.approx([2 * speed / drag, speed], rel=1e-7)


@pytest.mark.parametrize("duration", [1e-3, 1e-6])
def test_a_short_excursion_beyond_a_wall_is_met(duration):
    """x1 is thrown down against a pull, and would be beyond the wall for that time."""
    drag = 3.0
    scene = still(gamma1=drag, gamma2=drag)
    speed = math.sqrt(2.0 * drag * (0.9 + drag * duration**2 / 8.0))
    t, mesh, side, there = first_impact(scene, 0.3, (0.4, -speed, 0.1, 0.0))
    assert (mesh, side) == (1, -1)
    # x1 rounds to 1e-16, over the pull and the duration: 1e-10 against 1e-6
    assert t == pytest.approx(speed / drag - 0.5 * duration, rel=0, abs=1e-2 * duration)
    assert there[1] == pytest.approx(-0.5 * drag * duration, rel=1e-2)


def test_a_start_at_an_impact_is_the_state_before_it():
    scene = dat21(start=Start(0.4, 0.1, 0.9, -0.5, -1.0, mesh=2))
    orbit = follow(scene, 4)
    assert (orbit.mesh[0], *orbit.before[0]) == (2, *scene.start.values)
    assert gearbox(scene.constants).largest_error(orbit) < 1e-10
