import math

import numpy as np
import pytest
from oracle import gearbox

from rattle.scene import DAT21, Scene, Start
from rattle.scene.flight import flow, jacobian
from rattle.scene.impact import NONE, REST, next_impact
from rattle.scene.orbit import follow

HORIZON = 50.0
TOUCHING = np.array([0.5, 0.0, 0.0, 0.0])


DAT = Scene.from_gears(DAT21)


def still(**changes):
    """A scene in which nothing accelerates except by the changes given: flights are parabolas."""
    values = {"alpha": 0.0, "epsilon": 0.9, "beta1": 0.0, "gamma1": 0.0, "mu": 0.5} | changes
    return Scene(**values).constants


SCENES = {
    "DAT21": DAT,
    "unequal gaps": Scene(
        alpha=0.8,
        epsilon=0.7,
        beta1=0.3,
        beta2=0.01,
        gamma1=0.2,
        gamma2=0.5,
        mu=0.3,
        gap1=0.2,
        gap2=1.1,
    ),
    "single stage": Scene(alpha=2.0, epsilon=0.6, beta1=0.1, gamma1=0.3, stages=1),
    "strong damping": Scene(
        alpha=3.0, epsilon=0.5, beta1=4.0, beta2=9.0, gamma1=1.0, gamma2=6.0, mu=0.8, gap2=0.05
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_next_impact_is_the_first_crossing_of_an_integrator(name):
    c = SCENES[name].constants
    box = gearbox(c)
    rng = np.random.default_rng(5)
    for _ in range(80):
        tau = rng.uniform(0, 2 * math.pi)
        state = rng.uniform(-1, 1, 2 * c.wheels.size)
        state[::2] *= c.wheels["wall"]
        state[1::2] *= 2.0
        expected = box.first_crossing(tau, state, 20.0)
        t, mesh, side, there = next_impact(c, tau, state, 20.0)
        if expected is None:
            assert mesh == NONE
            continue
        assert (mesh, side) == expected[1:3]
        speed = abs(there[2 * mesh - 1])
        assert (
            abs(t - expected[0]) < 1e-11 + 1e-11 / speed
        )  # what the integrator leaves in x, over the speed
        assert there == pytest.approx(expected[3], rel=0, abs=1e-10 + 1e-10 / speed)


def turning_state(c, tau, x1, before):
    """The state `before` earlier than a turning point of x1 at time tau (x2 in the middle, at
    rest)."""
    flown = flow(c, tau - before, np.zeros(4), before)
    return np.linalg.solve(jacobian(c, before), np.array([x1, 0.0, 0.0, 0.0]) - flown)


TURN = 2.0  # tau of the turning point: x1'' = about -1.4 there, so x1 is highest


def outward_bend(c):
    wheel = c.wheels[0]
    return c.alpha * (math.sin(TURN) - wheel.beta * math.cos(TURN)) - wheel.gamma


@pytest.mark.parametrize("duration", [1e-3, 1e-4, 1e-5, 1e-6])
def test_a_short_excursion_under_the_excitation_is_met(duration):
    c = DAT.constants
    depth = outward_bend(c) * duration**2 / 8
    state = turning_state(c, TURN, c.wheels[0].wall + depth, 0.4)
    t, mesh, side, there = next_impact(c, TURN - 0.4, state, HORIZON)
    assert (mesh, side) == (1, 1)
    # x1 rounds to 1e-16, over the bend and the duration: 1e-10 against 1e-6
    assert t == pytest.approx(0.4 - 0.5 * duration, rel=0, abs=1e-2 * duration)
    assert there[1] == pytest.approx(0.5 * outward_bend(c) * duration, rel=1e-2)


@pytest.mark.parametrize("distance", [1e-6, 1e-9, 1e-12])
def test_a_narrow_miss_is_no_impact(distance):
    c = DAT.constants
    state = turning_state(c, TURN, c.wheels[0].wall - distance, 0.4)
    t, mesh, side, _ = next_impact(c, TURN - 0.4, state, HORIZON)
    assert (mesh, side) != (1, 1)
    assert t > 0.5


@pytest.mark.parametrize("speed", [1.0, 1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("side", [1, -1])
def test_the_same_wall_is_struck_twice_in_a_row(speed, side):
    # pulls wheel 1 back, so that x1 is pulled up; both wheels alike, so x2 keeps its place
    drag = 3.0
    c = still(gamma1=drag, gamma2=drag)
    x2 = 0.1
    if side < 0:  # drag on wheel 2 alone: x2 falls
        c = still(gamma2=drag)
        x2 = -0.5
    state = (0.5, -speed, x2, 0.0) if side > 0 else (0.0, 0.0, -0.5, speed)
    t, mesh, hit, there = next_impact(c, 0.3, np.array(state), HORIZON)
    assert (mesh, hit) == ((1, 1) if side > 0 else (2, -1))
    assert t == pytest.approx(2 * speed / drag, rel=1e-7)
    assert abs(there[2 * mesh - 1]) == pytest.approx(speed, rel=1e-7)


@pytest.mark.parametrize("drag", [3.0, 50.0])
def test_a_mesh_under_drag_sticks(drag):
    t, mesh, *_ = next_impact(still(gamma1=drag, gamma2=drag), 0.0, TOUCHING, HORIZON)
    assert (t, mesh) == (0.0, REST)


def test_a_touch_at_no_acceleration_rests_when_it_is_pushed_and_strikes_when_it_is_pulled():
    c = still(alpha=1.0)
    assert next_impact(c, math.pi + 1e-7, TOUCHING, HORIZON)[:2] == (0.0, REST)
    t, mesh, *_ = next_impact(c, math.pi - 1e-3, TOUCHING, HORIZON)
    assert (t, mesh) == (pytest.approx(3e-3, rel=1e-6), 1)


def test_the_paper_s_orbit_is_that_of_an_integrator_with_events():
    box = gearbox(DAT.constants)
    orbit = follow(DAT, 12)
    tau = 0.0
    state = box.restitution(1) @ (0.5, 2.0, 0.5, 2.0)
    for k in range(1, 13):
        t, mesh, side, before = box.first_crossing(tau, state, 20.0)
        tau = tau + t
        state = box.restitution(mesh) @ before
        assert (orbit.mesh[k], orbit.side[k]) == (mesh, side)
        # 1e-13 of the integrator, stretched by the divergence of a chaotic orbit over 12 impacts
        assert orbit.tau[k] == pytest.approx(tau, rel=0, abs=1e-9)
        assert orbit.before[k] == pytest.approx(before, rel=0, abs=1e-9)
        assert orbit.after[k] == pytest.approx(state, rel=0, abs=1e-9)


def test_an_orbit_without_the_mesh_2_impact_rule_is_distinguished():
    """Eq. 10 applied after every impact, as the paper has it, leaves the true orbit at its first
    mesh-2 impact."""
    orbit = follow(DAT, 12)
    everywhere = gearbox(DAT.constants).restitution(1)
    k = int(np.flatnonzero(orbit.mesh == 2)[0])
    assert abs(everywhere @ orbit.before[k] - orbit.after[k]).max() > 0.1


@pytest.mark.parametrize("k", [1, 5, 9])
def test_an_orbit_restarted_at_its_own_impact_repeats_itself(k):
    orbit = follow(DAT, 12)
    start = Start(orbit.tau[k], *orbit.before[k], mesh=int(orbit.mesh[k]))
    again = follow(Scene.from_gears(DAT21, start=start), 12 - k)
    assert np.diff(again.tau) == pytest.approx(np.diff(orbit.tau[k:]), abs=1e-13)
    assert again.before == pytest.approx(orbit.before[k:], rel=0, abs=1e-13)
    assert np.array_equal(again.mesh, orbit.mesh[k:])
