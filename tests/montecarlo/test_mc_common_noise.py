"""Long paths on a shared Brownian tree: right in distribution, the same however they are cut into
stretches, and not stopped by chatter."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mc_checks import orbit_of
from scenes import PAPER_SIGMA, dat21

from rattle import Scene, Wheel
from rattle.montecarlo.coupling.paths import LongPath
from rattle.montecarlo.long_run import long_run


def test_impacts_of_a_long_path_are_those_of_a_long_run():
    """The squared speed at mesh 1, within 4 standard errors; with 8 % more noise it is not."""
    scene = dat21(PAPER_SIGMA)
    known = long_run(scene, periods=64, paths=128, rng=3).estimates["rms_speed_mesh1"]
    truth = known.value**2
    z = []
    for noisy in (scene, scene.with_sigma(1.08 * PAPER_SIGMA)):
        s, _ = LongPath(noisy, 11).stretch(100_000, tangent=False, velocities=False)
        squares = s.before[np.abs(s.code) == 1, 1] ** 2
        batches = np.array([part.mean() for part in np.array_split(squares, 50)])
        error = math.hypot(batches.std() / math.sqrt(50.0), 2.0 * known.value * known.se)
        z.append(abs(batches.mean() - truth) / error)
    assert z[0] < 4.0 < z[1]


def test_a_path_is_the_same_however_it_is_cut():
    whole, velocity = LongPath(dat21(PAPER_SIGMA), 3).stretch(4001)
    parts = LongPath(dat21(PAPER_SIGMA), 3)
    pieces = [parts.stretch(n) for n in (1, 1000, 333, 2667)]
    for i, name in enumerate(whole._fields):
        assert (np.concatenate([s[i] for s, _ in pieces]) == whole[i]).all(), name
    assert (np.concatenate([v for _, v in pieces]) == velocity).all()


SHAFT = Wheel(beta=0.1, gamma=0.3, gap=0.5, epsilon=0.7)
ON_SHAFT = Wheel(beta=0.1, gamma=2.0, gap=0.3, parent=1, mass=0.2, epsilon=0.3)
ON_DRIVER = Wheel(beta=0.1, gamma=5.0, gap=0.3, epsilon=0.5)


def fast_impacts(tau, before, code):
    """Times and codes of the impacts that are no chatter, shape (impacts, 2)."""
    mesh = np.abs(code).astype(int)
    fast = np.abs(before[np.arange(mesh.size), 2 * mesh - 1]) > 0.2
    return np.column_stack([tau[fast], code[fast]])


def walk(scene, steps, seed=3, depth=12):
    """Times, states and codes at the impacts of so many steps: full stretches end early."""
    walker = LongPath(scene, seed, depth=depth)
    pieces = []
    while walker.steps < steps:
        s, _ = walker.stretch(steps - walker.steps, tangent=False)
        pieces.append((s.flight, s.before, s.code))
    flight, before, code = map(np.concatenate, zip(*pieces, strict=True))
    return np.cumsum(flight), before, code


@pytest.mark.parametrize("epsilon", [0.3, 0.3001])
def test_wheels_on_a_shaft_chatter_and_stick_as_the_orbit_does(epsilon):
    """Through seven phases in which one to three meshes are closed, and the impacts that end them;
    another restitution is noticed."""
    other = replace(ON_SHAFT, gamma=2.5, mass=0.3)
    path = fast_impacts(*walk(Scene(alpha=3.0, wheels=(SHAFT, ON_SHAFT, other)), 97, depth=20))
    wheels = (SHAFT, replace(ON_SHAFT, epsilon=epsilon), other)
    orbit = orbit_of(Scene(alpha=3.0, wheels=wheels), 300)
    expected = fast_impacts(orbit[:, 0], orbit[:, 1:-1], orbit[:, -1])[: len(path)]
    assert set(np.abs(path[:, 1])) == {1.0, 2.0, 3.0}
    assert len(path) == 24
    same = np.allclose(path, expected, rtol=0.0, atol=1e-10)
    assert same == (epsilon == ON_SHAFT.epsilon)


@pytest.mark.parametrize("seed", [3, 4])
def test_beside_closed_meshes_a_wheel_moves_as_if_it_were_alone(seed):
    """At the driver, on the same noise and not on another; the two beside it are pressed shut for
    good.  How finely a step is split differs, which is 1e-7 of such noise."""
    loose = replace(ON_DRIVER, gamma=0.3)
    pressed = (ON_DRIVER, replace(ON_DRIVER, mass=2.0))
    beside = Scene(alpha=1.0, sigma=2e-4, wheels=(loose, *pressed))
    tau, before, code = walk(beside, 600)
    of_loose = np.abs(code) == 1
    closed = (np.abs(before[:, 2::2]) == ON_DRIVER.gap).all(axis=1)
    assert closed[of_loose & (tau > 10.0)].all()
    path = fast_impacts(tau[of_loose], before[of_loose], code[of_loose])
    alone = fast_impacts(*walk(replace(beside, wheels=(loose,)), 600, seed))
    assert len(path) == len(alone) == 16
    same = np.allclose(path, alone, rtol=0.0, atol=1e-6)
    assert same == (seed == 3)
