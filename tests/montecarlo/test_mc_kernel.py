"""The compiled kernel against the plain-Python oracle, on the kernel's own random numbers, path by
path."""

from dataclasses import replace

import numpy as np
import pytest
from mc_checks import DAMPED, bridge_normal, dat21, step_normals
from naive import FAULTS, IN_STEPS, LOCATED_FAULTS, Path

from rattle.montecarlo import Record, largest_step, simulate
from rattle.montecarlo.noise.philox import key_of
from rattle.scene import Scene, Start

KEPT = [0, 2, 3, 4, 5, 6]  # columns of a row that the oracle has: all but the time of flight
IMPACTS = 12
LOCATED = "euler-maruyama-located"
SCHEMES = ("euler-maruyama", LOCATED)

# tiny gaps, a light wheel thrown about by a heavy one, the longest step: several impacts in a step,
# at both meshes
TIGHT = Scene(
    alpha=0.9,
    epsilon=0.95,
    beta1=0.08,
    beta2=0.5,
    gamma1=0.057,
    gamma2=0.2,
    mu=0.9,
    gap1=0.05,
    gap2=0.05,
    sigma=1.0,
    start=Start(0.3, 0.05, 2.0, 0.0, -2.0, mesh=1),
)
CASES = {
    "DAT21": (dat21(0.5), 5e-3),
    "rough": (replace(DAMPED, sigma=0.8), 5e-3),
    "tight": (TIGHT, 0.99 * largest_step(TIGHT)[0]),
    "single": (dat21(0.7, stages=1), 1e-2),
}


def follow_oracle(case, scheme, seed, number, fault=None, steps=4000):
    """An oracle path on the random numbers of a path of a run, until it has had its impacts."""
    scene, dt = CASES[case]
    key = key_of(np.random.SeedSequence(seed))
    path = Path.start(scene, dt, scheme == LOCATED, fault)
    for n, z in enumerate(step_normals(key, number, steps).tolist()):
        path.step(z, lambda leg, n=n: bridge_normal(key, number, n, leg))
        if len(path.impacts) >= IMPACTS:
            break
    return path


def furthest(case, scheme, paths, fault=None, seed=5):
    """Largest difference of an impact's time and state between kernel and oracle over what rounding
    allows.

    Rounding grows at each impact (measured: to 4e-15 at the first, ten-fold at each in the worst of
    200 paths with located impacts), and by more in a path that all but grazes: of the worst tenth
    of the paths only meshes and sides count.  Infinite if one of these differs.
    """
    scene, dt = CASES[case]
    allowed = 1e-13 * 8.0 ** np.arange(1, IMPACTS + 1)
    record = Record(raw=True)
    given = {"paths": paths, "impacts": IMPACTS, "dt": dt, "scheme": scheme, "rng": seed}
    run = simulate(scene, record=record, **given)
    worst = []
    for number, raw in enumerate(run.raw[:, :, KEPT]):
        path = follow_oracle(case, scheme, seed, number, fault)
        impacts = np.array(path.impacts[:IMPACTS])
        if impacts.shape != raw.shape or (impacts[:, 5] != raw[:, 5]).any():
            return np.inf
        off = np.abs(impacts - raw)[:, : 1 + 2 * scene.stages].max(axis=1)
        worst.append((off / allowed).max())
    return np.quantile(worst, 0.9)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("case", CASES)
def test_kernel_follows_oracle(case, scheme):
    assert furthest(case, scheme, 50) < 1.0


def test_tight_case_has_several_impacts_in_one_step_at_both_meshes():
    steps = [codes for p in range(12) for codes in follow_oracle("tight", LOCATED, 3, p).per_step]
    assert max(len(codes) for codes in steps) >= 3
    assert any({1, 2} <= {abs(code) for code in codes} for codes in steps)


@pytest.mark.parametrize("fault", [*FAULTS, *IN_STEPS])
def test_a_fault_is_seen(fault):
    assert furthest("rough", "euler-maruyama", 2, fault) > 1e6


@pytest.mark.parametrize("fault", LOCATED_FAULTS)
def test_a_fault_of_location_is_seen(fault):
    assert furthest("tight", LOCATED, 8, fault) > 1e6
