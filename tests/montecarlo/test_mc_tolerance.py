"""Backlash tolerances: how walls are distributed, and when they change.

What holds for every scheme is in the contract.
"""

import numpy as np
import pytest
from limits import FALSE_ALARM
from mc_checks import stepped as simulate
from scipy import stats

from rattle import Record, Scene, Start, Tolerance

GAP = 0.5
C1 = 0.04
C2 = 0.02
BOUNCING_PATHS = 4000
UNIFORM_WALLS = stats.uniform(-1.0, 2.0)
TRUNCATED = stats.truncnorm(-2.0, 2.0, scale=0.5)


def free(distribution, draw, mesh=1, times=(), impacts=4):
    """A lossless free wheel that bounces between the flanks of one mesh at speed 2, the other mesh
    far off.

    Every path meets the flanks -, +, -... in turn, so that no path is selected by its walls.
    """
    lossless = {"alpha": 0.0, "epsilon": 1.0, "beta1": 0.0, "gamma1": 0.0, "mu": 0.5}
    starts = {1: Start(0.0, GAP, 2.0, mesh=1), 2: Start(0.0, 0.0, 0.0, GAP, 2.0, mesh=2)}
    gaps = {"gap1": GAP, "gap2": GAP, f"gap{3 - mesh}": 1e3}
    tolerance = Tolerance(C1, C2, distribution=distribution, draw=draw)
    scene = Scene(**lossless, **gaps, start=starts[mesh], tolerance=tolerance)
    given = {"paths": BOUNCING_PATHS, "impacts": impacts, "dt": 0.01, "rng": 2}
    return simulate(scene, record=Record(raw=True, times=times), **given)


def fits(values, distribution):
    return stats.kstest(values, distribution.cdf).pvalue > FALSE_ALARM / 4


WALL_CASES = [
    ("uniform", "path", 2, UNIFORM_WALLS, TRUNCATED),
    ("normal", "contact", 1, TRUNCATED, UNIFORM_WALLS),
]


@pytest.mark.parametrize(("name", "draw", "mesh", "right", "wrong"), WALL_CASES)
def test_walls_have_the_distribution_asked_for(name, draw, mesh, right, wrong):
    raw = free(name, draw, mesh).raw
    assert (raw[:, :, 6] == mesh * np.array([-1, 1, -1, 1])).all()
    for walls in np.abs(raw[:, :, 2 * mesh]).T:
        deviation = (walls - GAP) / (C1, C2)[mesh - 1]
        assert fits(deviation, right)
        assert not fits(deviation, wrong)
        assert not fits(1.25 * deviation, right)


@pytest.mark.parametrize("draw", ["path", "contact"])
def test_a_start_on_a_flank_is_on_the_paths_own_wall(draw):
    """The first flight, at speed 2, tells where it began: on a wall drawn like any other."""
    first = free("uniform", draw).raw[:, 0]
    far = -first[:, 2] - GAP
    own = 2.0 * first[:, 0] - 2.0 * GAP - far
    if draw == "path":
        assert np.abs(own - far).max() < 1e-12
    else:
        assert fits(own / C1, UNIFORM_WALLS)
        correlation = abs(np.corrcoef(own, far)[0, 1])
        assert correlation * np.sqrt(BOUNCING_PATHS) < stats.norm.isf(0.5 * FALSE_ALARM)


@pytest.mark.parametrize("impacts", [1, 40])
def test_walls_of_successive_contacts_add_up_as_independent(impacts):
    """At a time when a wheel is nominally half way the start's wall has shifted its place once;
    each of 20 walls met since, of sd C1 / sqrt(3), twice.

    How many impacts are tabled does not matter: a later time keeps paths running, and the contacts
    beyond have walls of their own.
    """
    run = free("uniform", "contact", impacts=impacts, times=[20.5 * GAP])
    sd = np.sqrt(run.at_times().cov_x1_x1.iloc[0] / (C1**2 / 3.0 * (1.0 + 4.0 * 20.0)))
    assert abs(sd - 1.0) < 4.0 / np.sqrt(2.0 * BOUNCING_PATHS)
