"""Where to draw the paths that leave the noise-free itinerary: pilot paths tell which noise makes
them leave.

The design points of the search are first order in the noise: where a branch is curved they may be
far from the noise that paths leave with.  So they only begin a search by paths.  Pilots with
amplified noise, and paths near the design points, leave by each exit (an impact, and the wall that
is struck there instead); the mean noise of those that left, in proportion to how probable it is, is
where the next pilot's paths are drawn (cross-entropy method; Rubinstein 1999). What matters of the
noise has few dimensions: the response of the state before each impact, to first order.

The pilots depend on the scene alone.  What is counted later has no influence on where its paths are
drawn.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from rattle.montecarlo.branches.choose import LIKELY, list_distinct
from rattle.montecarlo.branches.rare_events import LATEST_OTHER
from rattle.montecarlo.branches.search import SEARCHED_STEPS, SMALLEST, search_of
from rattle.montecarlo.kernel.block import BLOCK, Plan, impact_codes, sample_mixture
from rattle.montecarlo.kernel.mixture import BEFORE, SPLIT, BranchMixture, mixture_of, tail
from rattle.montecarlo.settings import EXACT_SCHEME, NOISE_FREE, plan_of
from rattle.scene import Floats, Scene

MOST_EXITS = 12  # exits that are aimed at, the most probable first
NEAR_EXITS = 0.8  # share of the paths that are drawn near exits
AMPLIFIED = (1.0, 1.5, 2.0, 3.0)  # times the noise of the scene, of the first pilots
MOST_PILOTS = 8  # pilots, at most, each aimed by the one before
PILOT_BLOCKS = 4  # blocks of paths of a pilot, at least; one for each exit if that is more
ENOUGH_PATHS = 50.0  # effective paths of a pilot from which on an exit is aimed at
PLENTY = 100.0  # effective paths from which on no further pilot is wanted
# effective paths below which probabilities are levelled, so that more than one path decides the aim
LEVELLED_PATHS = 10.0
MOST_POINTS = 3  # points of the noise of an exit near which paths are drawn
# second moment of the weights, over that without a further point, below which that point is taken
HELPS = 0.5
DISTANCE_SHARE = 0.3  # share of what left that a point's distance leaves behind
# sd of a response, over its own, within the responses before it: below that it is nothing new
NEW_RESPONSE = 0.03
AIM_KEY = 0xA13  # of the pilots' random numbers


class Exit(NamedTuple):
    """A way to leave the itinerary, as pilots know it."""

    # impact, code: number of the impact at which it is left, and ``mesh * side`` of what is struck
    # instead
    impact: int
    code: int
    probability: float  # as pilots have it, those of amplified noise only where no others have
    effective: float  # effective number of their paths that took it, with the noise as it is
    points: list[Floats]  # of the noise near which paths are drawn; (steps,) each


class _Pilot(NamedTuple):
    """A pilot: what its paths were drawn from, and how many there were."""

    mixture: BranchMixture
    along: Floats  # unit vectors of its parts along the directions; (parts, directions)
    amplified: float  # times the noise of the scene
    paths: int
    # noise of those that left, by impact and ``mesh * side``
    left: dict[tuple[int, int], list[Floats]]

    def expect(self, noise: Floats) -> Floats:
        """How many of its paths have a noise, over its plain probability.

        Shapes: `noise` (points, directions of the first impacts).
        """
        known = noise.shape[1]
        ratio = (
            np.exp(0.5 * (noise**2).sum(axis=1) * (1.0 - self.amplified**-2))
            * self.amplified**-known
        )
        if len(self.along):
            along = self.along[:, :known]
            # of later noise, not known here
            rest = np.sqrt(np.maximum(1.0 - (along**2).sum(axis=1), 1e-12))
            beyond = (noise @ along.T)[:, :, None] - self.mixture.level[: len(along)]
            chance = ndtr(beyond / rest[:, None]) * self.mixture.rate[: len(along)]
            ratio = self.mixture.plain + chance.sum(axis=(1, 2))
        return np.asarray(self.paths * ratio)


@lru_cache(maxsize=32)
def aim(scene: Scene, impacts: int, dt: float) -> tuple[Exit, ...]:
    """The exits from the noise-free itinerary that are rarer than `LIKELY`, the most probable
    first."""
    search = search_of(scene, impacts, dt)
    orbit = search.orbit
    steps = min(
        math.ceil((np.nanmax(orbit[:, 0], initial=scene.phase) + LATEST_OTHER - scene.phase) / dt),
        SEARCHED_STEPS,
    )
    branches = [branch for branch in search.until(1.0).within(steps) if branch.shift.any()]
    if not search.responses:
        return ()
    directions, known = _list_directions([response[:, :steps] for response in search.responses])
    if not len(directions):  # all impacts are at the start
        return ()
    plan = plan_of(scene, BLOCK, impacts, dt, EXACT_SCHEME, AIM_KEY)
    pilots = list[_Pilot]()

    def run_pilot(
        points: Sequence[Floats], shares: Sequence[float], blocks: int, amplified: float = 1.0
    ) -> None:
        zeros = [0.0] * len(directions)
        centre = np.zeros((impacts, 2 + 2 * scene.stages))
        mixture = mixture_of([*points, *directions], [*shares, *zeros], centre, BLOCK)
        seed = np.random.SeedSequence(AIM_KEY, spawn_key=(len(pilots),))
        one = plan._replace(seed=seed, scene=replace(scene, sigma=amplified * scene.sigma))
        along = mixture.unit[: len(points), : directions.shape[1]] @ directions.T
        pilots.append(_Pilot(mixture, along, amplified, blocks * BLOCK, {}))
        for block in range(blocks):
            _list_left(one, pilots[-1], known, block)

    for amplified in AMPLIFIED:
        run_pilot([], [], PILOT_BLOCKS, amplified)
    near = [
        b.shift for b in list_distinct(sorted(branches, key=lambda b: -b.probability), MOST_EXITS)
    ]
    if near:
        run_pilot(near, [NEAR_EXITS / len(near)] * len(near), max(PILOT_BLOCKS, len(near)))
    rare = _list_rare(pilots, directions)
    for _ in range(MOST_PILOTS):
        wanted = [one for one in rare if one.effective < PLENTY]
        if not wanted:
            break
        run_pilot(*share_out(wanted), max(PILOT_BLOCKS, len(wanted)))
        rare = _list_rare(pilots, directions)
    return tuple(one for one in rare if one.effective > 0.0)


def share_out(exits: Sequence[Exit]) -> tuple[list[Floats], list[float]]:
    """Points of the noise near which paths are drawn, and the share of the paths of each."""
    points = [point for one in exits for point in one.points]
    return points, [NEAR_EXITS / len(exits) / len(one.points) for one in exits for _ in one.points]


def _list_rare(pilots: list[_Pilot], directions: Floats) -> list[Exit]:
    """Exits that are rare, as the pilots have it.

    Those of amplified noise, which is so beside the directions too, serve where the others have too
    few paths.
    """
    exits = []
    plain = [pilot for pilot in pilots if pilot.amplified == 1.0]
    # of the first, plain pilot: what more paths take is not rare
    most = 2.0 * LIKELY * pilots[0].paths
    taken = {key: None for pilot in pilots for key in pilot.left}
    for impact, code in (key for key in taken if sum(map(len, pilots[0].left.get(key, ()))) < most):
        noise, weights = _weigh(plain, (impact, code))
        effective = _count_effective(weights)
        probability = float(weights.sum())
        if effective < LEVELLED_PATHS:
            noise, weights = _weigh(pilots, (impact, code))
            probability = probability or float(weights.sum())
        if SMALLEST <= probability < LIKELY:
            points = [point @ directions[: point.size] for point in _find_points(noise, weights)]
            exits.append(Exit(impact, code, probability, effective, points))
    return sorted(exits, key=lambda one: -one.probability)[:MOST_EXITS]


def _weigh(pilots: list[_Pilot], key: tuple[int, int]) -> tuple[Floats, Floats]:
    """Noise and weights of all paths that left by an exit: each counts the less, the more such the
    pilots expect."""
    each = [one for pilot in pilots for one in pilot.left.get(key, ())]
    if not each:
        return np.zeros((0, 0)), np.zeros(0)
    noise = np.concatenate(each)
    return noise, 1.0 / np.sum([pilot.expect(noise) for pilot in pilots], axis=0)


def _list_directions(responses: Sequence[Floats]) -> tuple[Floats, list[int]]:
    """Orthonormal directions of the noise to which states before impacts respond, and how many are
    known by each.

    Shapes: `responses`, each (2 wheels, steps); result (directions, steps).
    """
    directions = np.zeros((0, responses[0].shape[1]))
    known = []
    for response in responses:
        sd = np.linalg.norm(response, axis=1)
        own = response[sd > 1e-9 * sd.max(initial=0.0)]
        own = own / np.linalg.norm(own, axis=1)[:, None]
        own = own - (own @ directions.T) @ directions
        _, size, new = np.linalg.svd(own, full_matrices=False)
        directions = np.concatenate([directions, new[size > NEW_RESPONSE]])
        known.append(len(directions))
    return directions, known


def _list_left(plan: Plan, pilot: _Pilot, known: Sequence[int], block: int) -> None:
    """Add the noise of the paths of a block that leave the itinerary.

    The last unit vectors of the mixture are the directions.
    """
    orbit = plan.itineraries[NOISE_FREE]
    rows, _, along, _ = sample_mixture(plan, pilot.mixture, block)
    noise = pilot.amplified * along[:, :, along.shape[2] - known[-1] :]
    follows = np.ones(BLOCK, dtype=bool)
    for k, directions in enumerate(known):
        for code in impact_codes(plan.scene.stages):
            leave = follows & (rows[:, k, -1] == code)
            if code != orbit[k] and leave.any():
                pilot.left.setdefault((k + 1, code), []).append(noise[leave, k, :directions])
        follows &= rows[:, k, -1] == orbit[k]


def _find_points(noise: Floats, weights: Floats) -> list[Floats]:
    """Points near which paths that left with such noise are drawn with weights that vary little.

    A further point is for those whose weights are the largest so far: for a second mechanism, or a
    curved branch.
    """
    weights = _level(weights)
    often = np.ones(weights.size)
    points = list[Floats]()
    while len(points) < MOST_POINTS:
        heavy = weights / often
        direction = noise[heavy.argmax()]
        for _ in range(8):  # those on its side alone: an exit may be reached by opposite noise
            side = noise @ direction > 0.0
            direction = heavy[side] @ noise[side]
            direction = direction / math.sqrt(float(direction @ direction))
        along = noise @ direction
        order = np.argsort(np.where(along > 0.0, along, np.inf))
        share = np.cumsum(heavy[order] * (along[order] > 0.0))
        distance = max(
            float(along[order][np.searchsorted(share, DISTANCE_SHARE * share[-1])]), BEFORE[1]
        )
        point = distance * direction
        more = often + _expect_near(noise, point)
        if points and (weights / more).sum() > HELPS * heavy.sum():
            break
        points.append(point)
        often = more
    return points


def _expect_near(noise: Floats, point: Floats) -> Floats:
    """How many paths near a point have a noise, over those drawn plainly."""
    distance = math.sqrt(float(point @ point))
    level = distance - BEFORE
    rate = SPLIT / np.array([tail(one) for one in level])
    beyond = (noise @ point / distance)[:, None] > level
    return np.asarray(NEAR_EXITS / (1.0 - NEAR_EXITS) * (rate * beyond).sum(axis=1))


def _level(weights: Floats) -> Floats:
    """Weights, levelled by a power where few paths have nearly all of them."""
    power = 1.0
    weights = weights / weights.max()
    while _count_effective(weights**power) < min(LEVELLED_PATHS, 0.5 * weights.size):
        power *= 0.7
    return np.asarray(weights**power)


def _count_effective(weights: Floats) -> float:
    """Effective number of paths with such weights (Kish 1965)."""
    return float(weights.sum() ** 2 / (weights**2).sum()) if weights.size else 0.0
