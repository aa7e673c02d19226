"""Gearboxes of any number of wheels, compared with the oracle: impacts, energy, which meshes stick,
sticking phases, chatter, and the growth of neighbours."""

from dataclasses import replace
from functools import cache
from itertools import pairwise, product

import numpy as np
import pytest
from oracle import gearbox
from scenes import STICKING, TREES, tree
from scipy.integrate import solve_ivp

from rattle import Scene, Start, Wheel, follow
from rattle.scene.drive import velocity_acceleration
from rattle.scene.impact import energy_loss, next_impact, strike
from rattle.scene.long_orbit import LongOrbit, attractor
from rattle.scene.sticking import (
    CHATTER_LIMIT,
    as_bodies,
    find_sticking,
    open_meshes,
    take_open,
)
from rattle.scene.types import BODY

TREE_IMPACTS = 40


@cache
def orbit_of(name):
    orbit = follow(TREES[name], TREE_IMPACTS)
    assert (orbit.found, orbit.sticking) == (TREE_IMPACTS, ())
    return orbit


def with_ratio(scene, factor):
    """The scene with another ratio of its last wheel."""
    *others, last = scene.wheels
    return replace(scene, wheels=(*others, replace(last, ratio=factor * last.ratio)))


def flight_errors(orbit, box, impacts):
    """What the states before and after each impact are off by, and how far the oracle flies beyond
    a wall before."""
    errors = []
    for k in range(impacts):
        run = box.fly(orbit.tau[k], orbit.after[k], orbit.flight[k + 1], dense_output=True)
        errors.append(abs(run.y[:, -1] - orbit.before[k + 1]).max())
        after = box.restitution(orbit.mesh[k + 1]) @ orbit.before[k + 1]
        errors.append(abs(after - orbit.after[k + 1]).max())
        x = run.sol(np.linspace(orbit.tau[k], orbit.tau[k + 1], 60))[::2]
        errors.append((abs(x).max(axis=1) - box.gaps).max())
    return max(errors)


@pytest.mark.parametrize("name", TREES)
def test_flights_and_impacts_are_those_of_the_oracle(name):
    orbit = orbit_of(name)
    struck = (orbit.mesh[1:], 2 * orbit.mesh[1:] - 2)
    assert set(struck[0]) == set(range(1, TREES[name].stages + 1))
    assert (abs(orbit.before[range(1, TREE_IMPACTS + 1), struck[1]])).tolist() == [
        orbit.constants.wheels[mesh - 1].wall for mesh in struck[0]
    ]
    assert flight_errors(orbit, gearbox(orbit.constants), TREE_IMPACTS) < 1e-10
    wrong = gearbox(with_ratio(TREES[name], 1.0 + 1e-7).constants)  # negative control
    assert flight_errors(orbit, wrong, 10) > 1e-10


@pytest.mark.parametrize("name", TREES)
def test_impacts_keep_momentum_and_lose_the_energy_that_is_counted(name):
    orbit = orbit_of(name)
    c = orbit.constants
    mass = c.wheels["mass"]
    to_gaps = gearbox(c).to_gaps
    for mesh, before, after in zip(orbit.mesh[1:], orbit.before[1:], orbit.after[1:], strict=True):
        struck = c.wheels[mesh - 1]
        v, then = (np.linalg.solve(to_gaps, state[1::2]) for state in (before, after))
        momentum = mass * (then - v)
        expected = np.zeros(mass.size)
        expected[mesh - 1] = momentum[mesh - 1]
        if struck.parent >= 0:
            expected[struck.parent] = -struck.ratio * momentum[mesh - 1]
        assert momentum == pytest.approx(expected, abs=1e-13)
        lost = 0.5 * mass @ (v**2 - then**2)
        counted = energy_loss(c, mesh, before[2 * mesh - 1])
        assert counted == pytest.approx(lost, rel=1e-11, abs=1e-13)
        if struck.parent >= 0 and lost > 1e-6:  # negative control: a parent that does not move
            assert counted / (1.0 - struck.share) != pytest.approx(lost, rel=1e-3)


def enumerate_sticking(box, tau, y, touching):
    """The closed meshes of each of many states, by trying all sets: every contact pushes, every
    other touching mesh accelerates away.

    Shapes: `tau` (states,); `y`, `touching`, result (wheels, states).
    """
    wheels = len(box.gaps)
    free = box.acceleration(tau, y)
    answer = np.zeros(touching.shape, int)
    answers = np.zeros(tau.size, int)
    for chosen in product((False, True), repeat=wheels):
        closed = np.array(chosen)
        push = np.zeros(free.shape)
        block = box.effect[np.ix_(closed, closed)]
        push[closed] = np.linalg.solve(block, -free[closed])
        motion = free + box.effect @ push
        right = np.where(closed[:, None], -push * touching > 0.0, motion * touching <= 0.0)
        right = right.all(axis=0)
        answers += right
        answer[:, right] = np.where(closed[:, None], touching, 0)[:, right]
    assert (answers == 1).all()
    return answer


def test_the_meshes_that_stick_are_the_one_set_in_which_all_contacts_push():
    """Of trees of six wheels, most of whose meshes touch; a mass that is a tenth off is seen."""
    rng = np.random.default_rng(4)
    states = 150
    seen = 0
    for seed in range(10):
        parents = [0, *(int(rng.integers(0, i + 1)) for i in range(1, 6))]
        scene = tree(parents, seed, alpha=0.5, gamma=1.0)
        c = scene.constants
        tau = rng.uniform(0.0, 6.0, states)
        touching = rng.choice([-1, 0, 1], (6, states), p=(0.42, 0.16, 0.42))
        y = np.where(touching != 0, 0.0, rng.normal(size=(6, states)))
        expected = enumerate_sticking(gearbox(c), tau, y, touching)
        state = np.zeros((states, 12))
        state[:, ::2] = 0.5 * touching.T
        state[:, 1::2] = y.T
        found = np.empty((states, 6), np.int64)
        bodies = np.empty(6, BODY)
        drivers = [velocity_acceleration(c.drive, t) for t in tau]
        for row in zip(drivers, state, touching.T, found, strict=True):
            find_sticking(c, *row, bodies)
        assert np.array_equal(found.T, expected)
        heavier = replace(scene.wheels[0], mass=1.0 / 1.1)
        wrong = replace(scene, wheels=(heavier, *scene.wheels[1:])).constants
        seen += (enumerate_sticking(gearbox(wrong), tau, y, touching) != expected).sum()
    assert seen > 5


def constrained(box, closed, begin, end, state):
    """The oracle's motion while some meshes are closed."""

    def rates(tau, s):
        out = np.empty(s.size)
        out[::2] = s[1::2]
        out[1::2] = box.contact_forces(tau, s, closed)[1]
        return out

    settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "dense_output": True}
    return solve_ivp(rates, (begin, end), state, **settings).sol


STICKING_TREES = {
    "tree of 4": tree((0, 1, 1, 2), 7, alpha=0.6, gamma=1.0, epsilon=(0.1, 0.4)),
} | STICKING


@pytest.mark.parametrize("name", STICKING_TREES)
def test_sticking_phases_are_those_of_contact_forces(name):
    """Every contact pushes until its mesh opens; a mesh that is left open is seen."""
    orbit = follow(STICKING_TREES[name], 90)
    box = gearbox(orbit.constants)
    states = 2 * len(box.gaps)
    phases = 0
    for leg, following in pairwise(orbit.legs):
        closed = leg[1 + states :]
        begin = leg[0]
        end = following[0]
        if not closed.any() or end - begin < 1e-3:
            continue
        phases += 1
        truth = constrained(box, closed != 0, begin, end, leg[1 : 1 + states])
        times = np.linspace(begin, end, 20)[:-1]
        exact = truth(times)
        states_then = np.array([orbit.state(t) for t in times]).T
        assert states_then == pytest.approx(exact, abs=1e-9)
        for tau, state in zip(times, exact.T, strict=True):
            push = box.contact_forces(tau, state, closed != 0)[0]
            assert (-closed * push >= -1e-9).all()
        if end not in orbit.tau:  # a mesh has opened
            push = box.contact_forces(end, truth(end), closed != 0)[0]
            assert abs(push[closed != 0]).min() < 1e-7
        wrong = constrained(box, np.cumsum(closed != 0) > 1, begin, end, leg[1 : 1 + states])
        assert abs(wrong(end) - truth(end)).max() > 1e-7
    assert phases >= 4


def on_the_driver(*wheels, **settings):
    """A scene of wheels on the driver, and each of them alone."""
    state = [value for i, wheel in enumerate(wheels) for value in (0.9 * wheel.gap, 0.1 + 1e-7 * i)]
    start = Start(0.3, state=state)
    together = Scene(wheels=wheels, start=start, **settings)
    alone = []
    for i, wheel in enumerate(wheels):
        first = Start(0.3, state=state[2 * i : 2 * i + 2])
        alone.append(Scene(wheels=[replace(wheel, mass=1.0)], start=first, **settings))
    return together, alone


def test_meshes_that_accumulate_at_once_close_as_each_would_alone():
    """Wheels on the driver do not feel each other; their first impacts are 1e-8 apart.  Closed
    together, they are early by `CHATTER_LIMIT` at most; a drag that is 1e-4 off is seen."""
    wheels = [
        Wheel(beta=0.1, gamma=1.0, epsilon=0.3, mass=mass, ratio=ratio)
        for mass, ratio in ((1.0, 1.0), (0.4, 1.0), (2.0, 1.1))
    ]
    heavier = [replace(wheel, gamma=1.0001 * wheel.gamma) for wheel in wheels]
    together, alone = on_the_driver(*wheels, alpha=0.4)
    _, wrong = on_the_driver(*heavier, alpha=0.4)
    phases = follow(together, 100).sticking
    for mesh, pair in enumerate(zip(alone, wrong, strict=True), 1):
        expected, other = (follow(scene, 25).sticking[0] for scene in pair)
        closed = next(phase for phase in phases if phase.mesh == mesh)
        assert closed.side == expected.side
        assert closed.closed == pytest.approx(expected.closed, rel=0, abs=CHATTER_LIMIT)
        assert abs(other.closed - closed.closed) > CHATTER_LIMIT


def test_chatter_beside_a_closed_mesh_takes_as_long_as_its_impacts_one_by_one():
    """In a chain, whose first mesh is closed and whose second is open, at the third."""
    drags = (1.0, 0.01, 1.0)
    wheels = [
        Wheel(beta=0.1, gamma=gamma, gap=gap, parent=i, ratio=1.0 + 0.1 * i, epsilon=0.3)
        for i, (gamma, gap) in enumerate(zip(drags, (0.5, 5.0, 0.5), strict=True))
    ]
    start = Start(state=(0.4, 0.0, 0.0, 0.0, 0.3, 0.0))
    orbit = follow(Scene(alpha=0.2, wheels=wheels, start=start), 60)
    phase = next(p for p in orbit.sticking if p.mesh == 3)
    k = phase.impact - 4
    assert orbit.after[k, :2].tolist() == [0.5, 0.0]
    closed = np.array([1, 0, 0])
    bodies = as_bodies(orbit.constants, closed)
    state = np.empty(4)
    take_open(orbit.after[k], open_meshes(closed), state)
    tau = float(orbit.tau[k])
    while abs(state[3]) > 1e-13:
        t, mesh, _, state = next_impact(bodies, tau, state, 1.0)
        assert mesh == 2
        strike(bodies, mesh, state)
        tau += t
    assert phase.closed == pytest.approx(tau, abs=1e-11)
    assert tau - orbit.tau[phase.impact] > 1e-9  # negative control: nothing summed up


@pytest.mark.parametrize("name", TREES)
def test_neighbours_grow_by_the_determinants_of_flights_and_impacts(name):
    """The Lyapunov exponents add up: a flight shrinks volumes by its dampings, an impact by
    epsilon squared."""
    run = LongOrbit(TREES[name])
    stretch = run.stretch(TREE_IMPACTS)
    wheels = run.c.wheels
    assert stretch.flight == pytest.approx(orbit_of(name).flight[1:], abs=1e-9)
    struck = wheels["epsilon"][abs(stretch.code) - 1]
    expected = 2.0 * np.log(struck) - wheels["beta"].sum() * stretch.flight
    assert stretch.growth.sum(axis=1) == pytest.approx(expected, rel=1e-9, abs=1e-10)
    assert abs(run.frame @ run.frame.T - np.eye(2 * wheels.size)).max() < 1e-12


def test_a_tree_under_drag_comes_to_rest_for_good():
    scene = tree((0, 1, 1, 0), 2, alpha=0.05, gamma=3.0)
    end = attractor(scene)
    assert (end.kind, end.contact) == ("rest", (1.0, 1.0, 1.0, 1.0))
    light = attractor(tree((0, 1, 1, 0), 2, alpha=3.0, gamma=3.0))
    assert light.kind != "rest"
    assert len(light.contact) == 4
