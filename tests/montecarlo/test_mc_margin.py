"""The margin of exact flights: a path that may meet a wall inside a trial is looked at, with the
right probability."""

import math

import numpy as np
import pytest
from mc_checks import limit

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.schemes.exact_flight import advance_exactly
from rattle.montecarlo.schemes.lanes import lanes_of
from rattle.montecarlo.schemes.step_state import Inside, Progress
from rattle.scene import Scene
from rattle.scene.compiled import jit
from rattle.scene.drive import sine_cosine

H = 1e-3
WALL = 0.5
TAU = -0.5 * math.pi - 0.5 * H  # the modulation is 1 to 1e-6 in this time
# sd of the displacement half way, given both ends and the area
SPREAD = H**1.5 / (8.0 * math.sqrt(3.0))
# of a path at rest beside the wall, in these sds: between the margins of 1.5 and 6 sds
DISTANCES = (
    2.0,
    2.5,
)


@jit
def share_that_hits(c, key, paths, distance, scratch):
    """Share of paths that meet the wall in a time whose increment and area are zero, at rest beside
    it at both ends."""
    hits = 0
    for p in range(paths):
        for state in (scratch.state, scratch.whole):
            state[0] = WALL - distance
            state[1] = 0.0
        at = Progress(0, TAU, H, Noise(0.0, 0.0))
        step = Inside(c, key, np.uint64(p), 0, 0, True, False, scratch)
        after, _ = advance_exactly(step, 0, at, sine_cosine(TAU))
        hits += after.code != 0
    return hits / paths


def found(distance, paths):
    """By the refinement of exact flights."""
    c = Scene(
        alpha=0.0, epsilon=1.0, beta1=0.0, gamma1=0.0, gap1=WALL, sigma=1.0, stages=1
    ).constants
    walls = np.full((2, 1), WALL)
    scratch = lanes_of(1, 0, np.zeros((2, 1)), walls, TAU, 5)[1].scratch
    scratch.walls[:] = WALL
    key = key_of(np.random.SeedSequence(1))
    return share_that_hits(c, key, paths, distance * SPREAD, scratch)


def truth(paths, pieces=400):
    """By brute force: a Brownian path in many pieces, its increment and area projected out."""
    rng = np.random.default_rng(2)
    most = []
    level = np.ones(pieces) / math.sqrt(pieces)
    slope = np.arange(pieces) - 0.5 * (pieces - 1)
    slope /= np.linalg.norm(slope)
    for _ in range(paths // 1000):
        db = rng.standard_normal((1000, pieces))
        db -= np.outer(db @ level, level) + np.outer(db @ slope, slope)
        b = np.cumsum(db, axis=1)
        most.append((np.cumsum(b, axis=1) - 0.5 * b).max(axis=1) / pieces**1.5)
    return np.concatenate(most) * 8.0 * math.sqrt(3.0)  # the farthest a path comes, in sds half way


def agree(shares, paths, farthest):
    """Whether hits are as frequent as excursions; 1 % of the distance is left to the finite
    pieces."""
    scores = []
    for distance, share in zip(DISTANCES, shares, strict=True):
        low, high = ((farthest > factor * distance).mean() for factor in (1.01, 0.99))
        se = math.sqrt(high * (1.0 - high) * (1.0 / paths + 1.0 / farthest.size))
        scores.append(max(low - share, share - high) / se)
    return max(scores) < limit(len(scores))


@pytest.fixture(scope="module")
def farthest():
    return truth(40_000)


def test_impacts_inside_a_trial_are_as_frequent_as_a_brownian_path_has_them(farthest):
    assert agree([found(distance, 40_000) for distance in DISTANCES], 40_000, farthest)


def test_a_half_of_the_impacts_that_is_not_looked_at_is_seen(farthest):
    """The negative control."""
    shares = [0.5 * found(distance, 40_000) for distance in DISTANCES]
    assert not agree(shares, 40_000, farthest)
