"""What every scheme promises, whatever its order: each test is run for each entry of SCHEMES."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mc_checks import orbit_of, stepped
from scenes import UNEQUAL, dat21
from settings import USEFUL_STEP, recorded

from rattle import Start, Tolerance
from rattle.montecarlo import SCHEMES

ORBITS = {
    "DAT21": dat21(),
    "unequal": UNEQUAL.noise_free,
    "plastic": replace(UNEQUAL.noise_free, epsilon=0.05),
    "in flight": replace(dat21(), start=Start(0.4, 0.1, -0.3, -0.2, 0.6)),
}


pytestmark = pytest.mark.parametrize("scheme", SCHEMES)


def run(scheme, scene, **settings):
    given = {"paths": 200, "impacts": 8, "dt": USEFUL_STEP[scheme], "rng": 2, "raw": True}
    return stepped(scene, scheme=scheme, **recorded(given | settings))


# --- truths


@pytest.mark.parametrize("name", ORBITS)
def test_noise_free_path_converges_to_the_orbit(scheme, name):
    """At first order within a bound for Euler's steps (a late detection jumps with dt); at once for
    exact ones, which place impacts to 1e-10 of the half gap."""
    orbit = orbit_of(ORBITS[name], 5)
    exact = not SCHEMES[scheme].has_step_bias
    steps = (0.1 if exact else 2e-3) / 4.0 ** np.arange(0, 5, 2)
    errors = []
    for dt in steps:
        path = np.delete(run(scheme, ORBITS[name], paths=1, impacts=5, dt=dt).raw[0], 1, axis=1)
        assert (path[:, 5] == orbit[:, 5]).all()
        errors.append(np.abs(path - orbit).max())
    if exact:
        assert max(errors) < 1e-9
    else:
        assert (errors / steps).max() < 20.0
        assert errors[-1] < 0.03 * errors[0]


def test_single_stage_is_the_first_stage_of_a_pair_whose_second_never_touches(scheme):
    """Its paths but for rounding, and its growth; its tables have no second stage."""
    pair = replace(dat21(0.2), gap2=1e6, start=Start(0.0, 0.5, 2.0, 0.0, 0.0, mesh=1))
    given = {"impacts": 6, "times": [0.5], "step_bias": True}
    lone, both = (run(scheme, scene, **given) for scene in (dat21(0.2, stages=1), pair))
    rounding = 1e-11 if scheme == "exact-flight" else 0.0
    assert np.abs(lone.raw - both.raw[:, :, [0, 1, 2, 3, 6]]).max() <= rounding
    for table in (lone.section, lone.at_times()):
        assert not [name for name in table if "2" in name]
        assert table.notna().any(axis=0).all()


def test_no_path_runs_beyond_the_horizon_by_more_than_a_step(scheme):
    found = run(scheme, dat21(0.3), impacts=60, horizon=1.5)
    assert found.unfinished == 200
    assert np.nanmax(found.raw[:, :, 0]) <= 1.5 + USEFUL_STEP[scheme]
    assert found.path_steps == 200 * math.ceil(1.5 / USEFUL_STEP[scheme])


# --- walls


@pytest.mark.parametrize("draw", ["path", "contact"])
def test_fixed_tolerance_is_a_wider_gap(scheme, draw):
    tolerance = Tolerance(0.04, 0.02, distribution="fixed", draw=draw)
    start = Start(0.0, 0.54, 2.0, 0.52, 2.0, mesh=1)
    wider = replace(dat21(0.3), gap1=0.54, gap2=0.52, start=start)
    tolerant = run(scheme, dat21(0.3, tolerance=tolerance))
    assert np.array_equal(tolerant.raw, run(scheme, wider).raw)


@pytest.mark.parametrize("mesh", [1, 2])
def test_a_flank_is_redrawn_when_and_only_when_the_opposite_is_struck(scheme, mesh):
    scene = dat21(0.5, tolerance=Tolerance(0.04, 0.02, draw="contact"))
    kept = 0
    for path in run(scheme, scene, impacts=40).raw:
        struck = path[np.abs(path[:, 6]) == mesh]
        walls = struck[:, 2 * mesh]
        turned = np.diff(struck[:, 6]) != 0.0
        assert (walls[1:] == walls[:-1])[~turned].all()
        assert (walls[2:] != walls[:-2])[turned[1:] & turned[:-1]].all()
        kept += (~turned).sum()
    assert kept > 200
