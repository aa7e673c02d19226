"""The margin of exact flights: a path that may meet a wall inside a trial is looked at, with the
right probability."""

import math

import numpy as np
import pytest
from mc_checks import limit

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.schemes.exact_flight import advance_exactly
from rattle.montecarlo.schemes.step_state import MOST_PARTS, Inside, Progress, Walls
from rattle.montecarlo.schemes.sticking import hold_only
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
def share_that_hits(c, key, first, paths, distance, room):
    """Share of paths that meet the wall in a time whose increment and area are zero, at rest beside
    it at both ends."""
    walls = Walls(c.wall1, c.wall1, c.wall2, c.wall2)
    hits = 0
    s = (c.wall1 - distance, 0.0, 0.0, 0.0)
    for p in range(paths):
        at = Progress(0, TAU, H, Noise(0.0, 0.0), s)
        step = Inside(c, key, np.uint64(first + p), 0, 0, s, True, hold_only((0, 0)), room)
        after, _ = advance_exactly(step, 0, at, sine_cosine(TAU), walls)
        hits += after.code != 0
    return hits / paths


def found(distance, paths):
    """By the refinement of exact flights."""
    c = Scene(
        alpha=0.0, epsilon=1.0, beta1=0.0, gamma1=0.0, gap1=WALL, sigma=1.0, stages=1
    ).constants
    return share_that_hits(
        c, key_of(np.random.SeedSequence(1)), 0, paths, distance * SPREAD, np.empty((MOST_PARTS, 3))
    )


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
