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


def first_impact(scene, tau, state, mesh=0):
    """Time of the first flight, mesh, side and state at its end; None where there is no impact."""
    orbit = follow(replace(scene, start=Start(tau, *state, mesh=mesh)), 1)
    if orbit.found == 0:
        return None
    return orbit.tau[1] - orbit.tau[0], orbit.mesh[1], orbit.side[1], orbit.before[1]


@pytest.mark.parametrize("name", STRUCK)
def test_the_first_impact_is_the_first_crossing_of_an_integrator(name):
    scene = STRUCK[name]
    box = gearbox(scene.constants)
    rng = np.random.default_rng(5)
    for _ in range(40):
        tau = rng.uniform(0, 2 * math.pi)
        state = rng.uniform(-1, 1, 2 * scene.stages)
        state[::2] *= scene.windows
        state[1::2] *= 2.0
        expected = box.first_crossing(tau, state, 20.0)
        found = first_impact(scene, tau, state)
        if expected is None:
            assert found is None or found[0] > 20.0
            continue
        t, mesh, side, there = found
        assert (mesh, side) == expected[1:3]
        speed = abs(there[2 * mesh - 1])
        assert (
            abs(t - expected[0]) < 1e-11 + 1e-11 / speed
        )  # what the integrator leaves in x, over the speed
        assert there == pytest.approx(expected[3], rel=0, abs=1e-10 + 1e-10 / speed)


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
    t, struck, side, there = first_impact(scene, 0.3, state)
    assert (struck, side) == ((1, 1) if mesh == 1 else (2, -1))
    assert t == pytest.approx(2 * speed / drag, rel=1e-7)
    assert abs(there[2 * mesh - 1]) == pytest.approx(speed, rel=1e-7)


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


@pytest.mark.parametrize("k", [1, 5])
def test_an_orbit_restarted_at_its_own_impact_repeats_itself(k):
    orbit = follow(dat21(), 12)
    start = Start(orbit.tau[k], *orbit.before[k], mesh=int(orbit.mesh[k]))
    again = follow(dat21(start=start), 12 - k)
    assert np.diff(again.tau) == pytest.approx(np.diff(orbit.tau[k:]), abs=1e-13)
    assert again.before == pytest.approx(orbit.before[k:], rel=0, abs=1e-13)
    assert np.array_equal(again.mesh, orbit.mesh[k:])
