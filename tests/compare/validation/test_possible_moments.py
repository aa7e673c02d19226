"""Moments that some distribution has, at fixed times and at impacts of random scenes: closures and simulation."""

import pickle

import numpy as np
import pytest

from rattle.closure import closures_for, mean_map
from rattle.montecarlo import Record, simulate
from rattle.scene import DAT21, Scene, Start, Tolerance
from rattle.scene.moments import ROUNDING, STATE

HONEST = ("saltation", "branching", "simulation")
"""Whose moments belong to a distribution; those of the paper's own closures may break its bounds, beyond rounding."""


def random_scene(rng):
    """Gears of one or two stages, with or without damping and tolerances; sigma from 1e-9 to 2 sqrt(alpha)."""
    alpha, gap2, stages = rng.uniform(0.3, 4.0), rng.uniform(0.2, 1.0), int(rng.integers(1, 3))
    rates = {f"beta{i}": rng.choice([0.0, 10.0 ** rng.uniform(-3.0, 0.0)]) for i in (1, 2)[:stages]}
    drags = {f"gamma{i}": rng.uniform(0.0, 0.5) for i in (1, 2)[:stages]}
    second = {"mu": rng.uniform(0.2, 0.8), "gap2": gap2} if stages == 2 else {}
    start = Start(rng.uniform(0.0, 6.0), 0.5, rng.uniform(0.5, 2.0), rng.uniform(-0.8, 0.8) * gap2, 1.0, 1)
    return Scene(
        alpha=alpha, epsilon=rng.uniform(0.2, 0.98), sigma=alpha**0.5 * 10.0 ** rng.uniform(-9.0, 0.3), stages=stages,
        tolerance=Tolerance(0.05, 0.05 if stages == 2 else 0.0) if rng.random() < 0.3 else None, start=start,
        **rates, **drags, **second,
    )  # fmt: skip


def impossible(table, stages):
    """What no distribution has: a row for each is returned in words."""
    found = []
    for stage in (1, 2):
        x, y, rho = f"x{stage}", f"y{stage}", table[f"rho{stage}"]
        known = table[[name for name in table if x in name or y in name or name == f"rho{stage}"]]
        if stage > stages:
            found += ["absent stage"] * int(known.notna().any(axis=None))
            continue
        variances = table[[f"cov_{x}_{x}", f"cov_{y}_{y}"]]
        found += ["variance < 0"] * int((variances < 0.0).any(axis=None)) + ["rho > 1"] * int((rho.abs() > 1.0).any())
        found += ["rho of what is constant"] * int(rho[(variances == 0.0).any(axis=1)].notna().any())
    return found


def beyond_rounding(value):
    return not 1.0 < abs(value) <= 1.0 + ROUNDING


@pytest.mark.parametrize("seed", range(12))
def test_moments_at_fixed_times_are_possible(seed):
    scene = random_scene(np.random.default_rng(seed))
    for closure in closures_for(scene):
        options = {"tolerance": 0.3} if closure == "branching" else {}
        m = mean_map(scene, impacts=2, closure=closure, **options)
        low, high = m.trace.span
        shares = np.array([0.0, 1e-9, 1e-6, 1e-3, 0.1, 0.4, 0.8])
        times = np.concatenate([low + (high - low) * shares, m.trace.tau[1 : m.trace.found + 1]])
        table = m.at_times(scene.to_absolute_time(np.sort(times[times < high - 1e-9])))
        section = m.section[["rho1", "rho2"]].stack()
        if closure in HONEST:
            assert not impossible(table, scene.stages), closure
            assert not (section.abs() > 1.0).any()
        else:
            assert "absent stage" not in impossible(table, scene.stages)
            assert table[["rho1", "rho2"]].stack().map(beyond_rounding).all()
            assert section.map(beyond_rounding).all()
        if "agreement" in m.section:
            assert (m.section["agreement"] <= 1.0).all()


@pytest.mark.parametrize("seed", range(6))
def test_sampled_moments_are_possible(seed):
    scene = random_scene(np.random.default_rng(seed))
    times = scene.start.tau + np.array([0.05, 0.1, 0.3, 1.0])
    run = simulate(scene, paths=64, impacts=2, scheme="exact-flight", record=Record(times=times))
    assert not impossible(run.at_times(), scene.stages)
    assert not (run.section[["rho1", "rho2"]].abs() > 1.0).any(axis=None)
    assert run.section["agreement"].between(0.0, 1.0).all()


@pytest.mark.parametrize("closure", ["saltation", "branching", "corrected"])
def test_nothing_varies_at_the_start(closure):
    scene = Scene.from_gears(DAT21, sigma=0.1)
    first = mean_map(scene, closure=closure, impacts=2).at_times([0.0, 1e-3])
    assert first[["rho1", "rho2"]].iloc[0].isna().all()
    assert (first.filter(like="cov_").iloc[0] == 0.0).all()
    exact = mean_map(scene, closure="saltation", impacts=2).at_times([0.0, 1e-3])
    np.testing.assert_allclose(first.iloc[1], exact.iloc[1], rtol=1e-6, atol=1e-300)


def test_the_control_is_seen():
    table = mean_map(Scene.from_gears(DAT21, sigma=0.1), impacts=1).at_times([0.3])
    assert not impossible(table, 2)
    assert impossible(table.assign(rho1=-1.22), 2) == ["rho > 1"]
    assert impossible(table.assign(cov_y2_y2=-1e-20), 2) == ["variance < 0"]
    assert impossible(table, 1) == ["absent stage"]
    assert not beyond_rounding(1.0000000000000002)


@pytest.mark.parametrize("closure", ["saltation", "branching", "corrected", "published"])
def test_a_prediction_is_the_same_when_pickled(closure):
    m = mean_map(Scene.from_gears(DAT21, sigma=0.1), closure=closure, impacts=2)
    again = pickle.loads(pickle.dumps(m))
    assert repr(again) == repr(m)
    assert again.at_times([0.3, 0.9]).equals(m.at_times([0.3, 0.9]))
    assert list(STATE) == list(again.at_times([0.3]).columns[:4])
