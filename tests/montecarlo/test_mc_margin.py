"""The margin of exact flights: a path that may meet a wall inside a trial is looked at, with the
right probability."""

import math

import numpy as np
import pytest
from limits import limit

from rattle import Scene
from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.schemes.exact_flight import advance_exactly
from rattle.montecarlo.schemes.lanes import lanes_of
from rattle.montecarlo.schemes.step_state import Inside, Progress
from rattle.scene.compiled import jit
from rattle.scene.drive import sine_cosine

STEP = 1e-3
WALL = 0.5
TAU = -0.5 * math.pi - 0.5 * STEP  # the modulation is 1 to 1e-6 in this time
# sd of the displacement half way, given both ends and the area
SPREAD = STEP**1.5 / (8.0 * math.sqrt(3.0))
SHARES = {2.0: (0.03104, 0.03421), 2.5: (0.00832, 0.00958)}
"""Of a path at rest beside the wall in so many of these sds, between the margins of 1.5 and 6:
shares of 2 million Brownian paths in 400 pieces, their increment and area projected out, that come
1 % farther and 1 % less far."""


@jit
def share_that_hits(c, key, paths, distance, scratch):
    """Share of paths that meet the wall in a time whose increment and area are zero, at rest beside
    it at both ends."""
    hits = 0
    for p in range(paths):
        for state in (scratch.state, scratch.whole):
            state[0] = WALL - distance
            state[1] = 0.0
        at = Progress(0, TAU, STEP, Noise(0.0, 0.0))
        step = Inside(c, key, np.uint64(p), 0, 0, True, False, scratch)
        after, _ = advance_exactly(step, 0, at, sine_cosine(TAU))
        hits += after.code != 0
    return hits / paths


def found(distance, paths):
    """By the refinement of exact flights."""
    lossless = {"alpha": 0.0, "epsilon": 1.0, "beta1": 0.0, "gamma1": 0.0, "stages": 1}
    c = Scene(**lossless, gap1=WALL, sigma=1.0).constants
    walls = np.full((2, 1), WALL)
    scratch = lanes_of(1, 0, np.zeros((2, 1)), walls, TAU, 5, np.zeros(1))[1].scratch
    scratch.walls[:] = WALL
    key = key_of(np.random.SeedSequence(1))
    return share_that_hits(c, key, paths, distance * SPREAD, scratch)


@pytest.mark.parametrize("distance", SHARES)
def test_impacts_inside_a_trial_are_as_frequent_as_a_brownian_path_has_them(distance):
    """Half of them would be noticed."""
    low, high = SHARES[distance]
    share = found(distance, 40_000)
    allowed = limit(len(SHARES)) * math.sqrt(high / 40_000)
    assert low - allowed < share < high + allowed
    assert 0.5 * share < low - allowed
