"""Gearboxes of any number of wheels, compared with the oracle: impacts, energy, which meshes stick,
sticking phases, chatter, and the growth of neighbours."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from oracle import PRECISE, gearbox
from scenes import OSCILLATOR, STICKING, TREES, tree
from scipy.integrate import solve_ivp

from rattle import Scene, Start, Wheel, follow
from rattle.scene.drive import velocity_acceleration
from rattle.scene.impact import energy_loss
from rattle.scene.long_orbit import LongOrbit, attractor
from rattle.scene.sticking import CHATTER_LIMIT, find_sticking
from rattle.scene.tangent import saltation_matrix
from rattle.scene.types import BODY

TREE_IMPACTS = 40


@cache
def orbit_of(name):
    orbit = follow(TREES[name], TREE_IMPACTS)
    assert (orbit.found, orbit.sticking) == (TREE_IMPACTS, ())
    return orbit


@pytest.mark.parametrize("name", TREES)
def test_flights_and_impacts_are_those_of_the_oracle(name):
    orbit = orbit_of(name)
    struck = orbit.mesh[1:] - 1
    assert set(struck) == set(range(TREES[name].stages))
    there = abs(orbit.before[1:, ::2])[range(TREE_IMPACTS), struck]
    assert (there == orbit.constants.wheels["wall"][struck]).all()
    box = gearbox(orbit.constants)
    assert box.largest_error(orbit) < 1e-10
    box.drag *= 1.0 + 1e-7  # negative control
    assert box.largest_error(orbit) > 1e-10


@pytest.mark.parametrize("name", TREES)
def test_impacts_lose_the_energy_that_is_counted(name):
    orbit = orbit_of(name)
    c = orbit.constants
    from_gaps = np.linalg.inv(gearbox(c).to_gaps)
    before, after = (0.5 * (y[1:, 1::2] @ from_gaps.T) ** 2 for y in (orbit.before, orbit.after))
    lost = (before - after) @ c.wheels["mass"]
    struck = orbit.mesh[1:]
    y = orbit.before[range(1, struck.size + 1), 2 * struck - 1]
    counted = np.array([energy_loss(c, *of) for of in zip(struck, y, strict=True)])
    assert counted == pytest.approx(lost, rel=1e-11, abs=1e-13)


def sticks(box, tau, state, touching, closed):
    """Whether every contact pushes and every other touching mesh accelerates away, which is so of
    one set alone."""
    push, motion = box.contact_forces(tau, state, closed != 0)
    right = np.where(closed != 0, -push * touching > 0.0, motion * touching <= 0.0)
    return (right & (closed * (touching - closed) == 0)).all()


def test_the_meshes_that_stick_are_the_one_set_in_which_all_contacts_push():
    """Of trees of six wheels, most of whose meshes touch; a mass that is a tenth off is seen."""
    rng = np.random.default_rng(4)
    seen = 0
    for seed in range(10):
        parents = [0, *(int(rng.integers(0, i + 1)) for i in range(1, 6))]
        scene = tree(parents, seed, alpha=0.5, gamma=1.0)
        heavier = replace(scene.wheels[0], mass=1.0 / 1.1)
        wrong = gearbox(replace(scene, wheels=(heavier, *scene.wheels[1:])).constants)
        c = scene.constants
        box = gearbox(c)
        for tau in rng.uniform(0.0, 6.0, 150):
            touching = rng.choice([-1, 0, 1], 6, p=(0.42, 0.16, 0.42))
            y = np.where(touching != 0, 0.0, rng.normal(size=6))
            state = np.column_stack([0.5 * touching, y]).ravel()
            closed = np.empty(6, np.int64)
            driver = velocity_acceleration(c.drive, tau)
            find_sticking(c, driver, state, touching, closed, np.empty(6, BODY))
            assert sticks(box, tau, state, touching, closed)
            seen += not sticks(wrong, tau, state, touching, closed)
    assert seen > 5


def constrained(box, closed, begin, end, state):
    """The oracle's motion while some meshes are closed."""

    def rates(tau, s):
        _, motion = box.contact_forces(tau, s, closed)
        return np.column_stack([s[1::2], motion]).ravel()

    return solve_ivp(rates, (begin, end), state, **PRECISE, dense_output=True).sol


STICKING_TREES = {
    "tree of 4": tree((0, 1, 1, 2), 7, alpha=0.6, gamma=1.0, epsilon=(0.1, 0.4)),
} | STICKING


@pytest.mark.parametrize("name", STICKING_TREES)
def test_sticking_phases_are_those_of_contact_forces(name):
    """Every contact pushes until its mesh opens; a mesh that is left open is seen."""
    orbit = follow(STICKING_TREES[name], 90)
    box = gearbox(orbit.constants)
    phases = 0
    for leg, (end, *_) in pairwise(orbit.legs):
        (begin,), state, sides = np.split(leg, (1, 1 + orbit.before.shape[1]))
        closed = sides != 0
        if not closed.any() or end - begin < 1e-3:
            continue
        phases += 1
        truth = constrained(box, closed, begin, end, state)
        times = np.linspace(begin, end, 20)[:-1]
        exact = truth(times).T
        found = np.array([orbit.state(t) for t in times])
        assert found == pytest.approx(exact, abs=1e-9)
        for of in zip(times, exact, strict=True):
            assert (-sides * box.contact_forces(*of, closed)[0] >= -1e-9).all()
        if end not in orbit.tau:  # a mesh has opened
            push, _ = box.contact_forces(end, truth(end), closed)
            assert abs(push[closed]).min() < 1e-7
        wrong = constrained(box, np.cumsum(closed) > 1, begin, end, state)
        assert abs(wrong(end) - truth(end)).max() > 1e-7
    assert phases >= 4


def test_meshes_that_accumulate_at_once_close_as_each_would_alone():
    """Wheels on the driver do not feel each other; their first impacts are 1e-8 apart.  Closed
    together, they are early by `CHATTER_LIMIT` at most; a drag that is 1e-4 off is seen."""
    wheels = [
        Wheel(beta=0.1, gamma=1.0, epsilon=0.3, mass=mass, ratio=ratio)
        for mass, ratio in ((1.0, 1.0), (0.4, 1.0), (2.0, 1.1))
    ]
    states = [(0.45, 0.1 + 1e-7 * i) for i in range(3)]

    def phases(wheels, states, impacts):
        start = Start(0.3, state=tuple(np.ravel(states)))
        return follow(Scene(alpha=0.4, wheels=wheels, start=start), impacts).sticking

    together = phases(wheels, states, 100)
    for mesh, (wheel, state) in enumerate(zip(wheels, states, strict=True), 1):
        alone, wrong = (phases([replace(wheel, gamma=g)], state, 25)[0] for g in (1.0, 1.0001))
        found = next(phase for phase in together if phase.mesh == mesh)
        assert found.side == alone.side
        assert found.closed == pytest.approx(alone.closed, rel=0, abs=CHATTER_LIMIT)
        assert abs(found.closed - wrong.closed) > CHATTER_LIMIT


def test_chatter_beside_a_closed_mesh_takes_as_long_as_its_impacts_one_by_one():
    """In a chain, whose first mesh is closed and whose second is open, at the third; flights become
    shorter as a geometric series does."""
    drags = (1.0, 0.01, 1.0)
    wheels = [
        Wheel(beta=0.1, gamma=gamma, gap=gap, parent=i, ratio=1.0 + 0.1 * i, epsilon=0.3)
        for i, (gamma, gap) in enumerate(zip(drags, (0.5, 5.0, 0.5), strict=True))
    ]
    start = Start(state=(0.4, 0.0, 0.0, 0.0, 0.3, 0.0))
    orbit = follow(Scene(alpha=0.2, wheels=wheels, start=start), 60)
    phase = next(p for p in orbit.sticking if p.mesh == 3)
    last = slice(phase.impact - 2, phase.impact + 1)
    assert orbit.mesh[last].tolist() == [3, 3, 3]
    assert (orbit.after[last, :2] == [0.5, 0.0]).all()
    before, flight = np.diff(orbit.tau[last])
    left = flight**2 / (before - flight)
    assert phase.closed == pytest.approx(orbit.tau[phase.impact] + left, abs=1e-11)
    assert left > 1e-9  # negative control: nothing summed up


@pytest.mark.parametrize("scene", [*TREES.values(), OSCILLATOR])
def test_neighbours_at_an_impact_are_those_of_the_oracle(scene):
    orbit = follow(scene, 12)
    box = gearbox(orbit.constants)
    for impact in zip(orbit.mesh[1:], orbit.tau[1:], orbit.before[1:], strict=True):
        exact = box.saltation(*impact)
        found = saltation_matrix(orbit.constants, *impact)
        assert found == pytest.approx(exact, rel=1e-12, abs=1e-12)


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


def test_a_tree_under_drag_comes_to_rest_for_good():
    scene = tree((0, 1, 1, 0), 2, alpha=0.05, gamma=3.0)
    end = attractor(scene)
    assert (end.kind, end.contact) == ("rest", (1.0, 1.0, 1.0, 1.0))
    light = attractor(tree((0, 1, 1, 0), 2, alpha=3.0, gamma=3.0))
    assert light.kind != "rest"
