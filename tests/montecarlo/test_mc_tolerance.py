"""Backlash tolerances: where the walls are found, how they are distributed, and when they change.

What holds for every scheme is in the contract.
"""

import numpy as np
import pytest
from mc_checks import FALSE_ALARM
from mc_checks import stepped as simulate
from scipy import stats
from settings import recorded

from rattle.scene import Scene, Start, Tolerance

GAP = 0.5
C1 = 0.04
C2 = 0.02
PATHS = 4000
DISTRIBUTIONS = {
    "uniform": lambda c: stats.uniform(-c, 2.0 * c),
    "normal": lambda c: stats.truncnorm(-2.0, 2.0, scale=0.5 * c),
}
REJECTED = {"uniform": "normal", "normal": "uniform"}


def free(distribution, draw, mesh=1, impacts=4, paths=PATHS, start=None, **settings):
    """A lossless free wheel that bounces between the flanks of one mesh at speed 2, the other mesh
    far off.

    Every path meets the flanks -, +, -... in turn, so that no path is selected by its walls.
    """
    start = (
        start
        or {
            1: Start(0.0, GAP, 2.0, 0.0, 0.0, mesh=1),
            2: Start(0.0, 0.0, 0.0, GAP, 2.0, mesh=2),
        }[mesh]
    )
    scene = Scene(
        alpha=0.0,
        epsilon=1.0,
        beta1=0.0,
        gamma1=0.0,
        mu=0.5,
        start=start,
        tolerance=Tolerance(C1, C2, distribution=distribution, draw=draw),
        gap1=1e3 if mesh == 2 else GAP,
        gap2=1e3 if mesh == 1 else GAP,
    )
    return simulate(
        scene, paths=paths, impacts=impacts, dt=0.01, rng=2, **recorded({"raw": True} | settings)
    )


def fits(values, distribution, c, checks):
    return stats.kstest(values, DISTRIBUTIONS[distribution](c).cdf).pvalue > FALSE_ALARM / checks


@pytest.mark.parametrize("mesh", [1, 2])
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("draw", ["path", "contact"])
@pytest.mark.parametrize("scheme", ["euler-maruyama-located", "exact-flight"])
def test_walls_have_the_distribution_asked_for(distribution, draw, mesh, scheme):
    raw = free(distribution, draw, mesh, scheme=scheme).raw
    c = (C1, C2)[mesh - 1]
    assert (raw[:, :, 6] == mesh * np.array([-1, 1, -1, 1])).all()
    for k in range(4):
        deviation = np.abs(raw[:, k, 2 * mesh]) - GAP
        assert fits(deviation, distribution, c, 4)
        assert not fits(deviation, REJECTED[distribution], c, 4)
        assert not fits(1.25 * deviation, distribution, c, 4)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("draw", ["path", "contact"])
def test_a_start_on_a_flank_is_on_the_paths_own_wall(distribution, draw):
    """The first flight, at speed 2, tells where it began: on a wall drawn like any other."""
    first = free(distribution, draw).raw[:, 0]
    far = -first[:, 2] - GAP
    own = 2.0 * first[:, 0] - 2.0 * GAP - far
    if draw == "path":
        assert np.abs(own - far).max() < 1e-12
    else:
        assert fits(own, distribution, C1, 1)
        assert uncorrelated(own, far)


def uncorrelated(a, b):
    return abs(np.corrcoef(a, b)[0, 1]) * np.sqrt(a.size) < stats.norm.isf(0.5 * FALSE_ALARM)


def spread_after_twenty_crossings(impacts):
    """sd of a bouncing wheel's place at a time when it is nominally half way, and the sd's relative
    error."""
    run = free("uniform", "contact", impacts=impacts, times=[20.5 * GAP])
    return np.sqrt(run.at_times().cov_x1_x1.iloc[0]), 1.0 / np.sqrt(2.0 * PATHS)


def test_walls_of_successive_contacts_add_up_as_independent():
    """The start's wall shifts the place once; each of 20 walls met since, of sd C1 / sqrt(3),
    shifts it twice."""
    sd, error = spread_after_twenty_crossings(40)
    assert abs(sd / (C1 / np.sqrt(3.0) * np.sqrt(1.0 + 4.0 * 20.0)) - 1.0) < 4.0 * error


def test_contacts_beyond_the_impacts_asked_for_have_walls_of_their_own():
    """A fixed time after the last impact keeps paths running; how many impacts are tabled must not
    matter to it."""
    short, error = spread_after_twenty_crossings(1)
    full, _ = spread_after_twenty_crossings(40)
    assert abs(short / full - 1.0) < 4.0 * np.sqrt(2.0) * error
