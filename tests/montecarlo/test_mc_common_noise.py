"""Long paths on a shared Brownian tree: right in distribution, the same however they are cut into
stretches, and not stopped by chatter."""

from dataclasses import replace

import numpy as np
import pytest
from mc_checks import orbit_of
from scenes import PAPER_SIGMA, dat21

from rattle import Scene, Wheel, simulate
from rattle.montecarlo.coupling.paths import LongPath
from rattle.montecarlo.noise.philox import Word


def first_impacts(sigma, paths, impacts):
    """Time and rates at the first impacts of many paths, shape (paths, impacts, 3)."""
    walker = LongPath(dat21(sigma), 11, depth=12)
    begin = walker.at.copy()
    out = np.empty((paths, impacts, 3))
    for p in range(paths):
        walker.path = Word(p)
        walker.steps = 0
        walker.at[:] = begin
        s, _ = walker.stretch(100, tangent=False, velocities=False)
        out[p, :, 0] = np.cumsum(s.flight[:impacts])
        out[p, :, 1:] = s.before[:impacts, 1::2]
    return out


def test_sections_of_long_paths_are_those_of_exact_flights_on_the_same_increments():
    """Same seed and step: only the splits near walls are drawn apart, so that most of the sampling
    error is shared.

    Of 20 000 such paths sds differed by 0.4 % at most; 4 000 are allowed three times that, times
    sqrt(5).
    """
    given = {"paths": 4000, "impacts": 4, "rng": 11, "dt": 2.0 * np.pi / 128.0}
    found = first_impacts(PAPER_SIGMA, 4000, 4)
    run = simulate(dat21(PAPER_SIGMA), scheme="exact-flight", **given).section
    mean, sd = (run[[start + n for n in ("tau", "y1", "y2")]].to_numpy() for start in ("", "sd_"))
    assert np.abs((found.mean(axis=0) - mean) / sd).max() < 0.03
    assert np.abs(found.std(axis=0) / sd - 1.0)[0].max() < 0.027
    wrong = first_impacts(1.05 * PAPER_SIGMA, 4000, 1)
    assert np.abs(wrong.std(axis=0) / sd[:1] - 1.0).max() > 0.027


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
