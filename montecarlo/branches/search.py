"""The branches of the noise-free orbit: paths that leave it, or another branch, by one other event
each.

The orbit is searched first (`rattle.montecarlo.branches.rare_events`), then representatives of its
branches, the most probable first.  Every path that was searched stands for all smaller
probabilities too, so that one search serves all of them.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.branches.rare_events import (
    Event,
    Gaussian,
    SearchedFlight,
    events,
    follow_on,
)
from rattle.montecarlo.kernel.kernel import columns_recorded
from rattle.montecarlo.schemes.step_size import default_step
from rattle.montecarlo.settings import EXACT_SCHEME
from rattle.scene import Floats, Scene
from rattle.scene.impact import slowest_impact
from rattle.scene.orbit import first_state

MOST_SEARCHED_PATHS = 12  # paths that are searched: the orbit, and the most probable branches
# flights that are searched, so that orbits of many impacts take no more than about a second; the
# square of so many more wheels than `FEW_WHEELS` fewer, for their covariances take longer
MOST_SEARCHED_FLIGHTS = 300
FEW_WHEELS = 8
# steps whose noise is known for each branch: later impacts have plain paths alone
SEARCHED_STEPS = 2048
SMALLEST = 1e-9
"""Probability down to which branches are known, and searched for branches of their own."""


class Branch(NamedTuple):
    """Paths that leave the orbit, or another branch, by one other event."""

    impact: int  # number of the impact that differs
    mesh: int  # mesh, side: the wall that is met, or missed
    side: int
    missed: bool  # whether that impact is missed rather than added
    beta: float  # reliability index: distance of the design point in sds
    probability: float  # of the branch
    weights: Floats  # probabilities of its strata, by depth beyond the design point; (strata,)
    # ``tau, flight, x1, y1, ..., mesh * side`` of each impact of a representative of each stratum;
    # those of the parent before `impact`, NaN where it has ended; (strata, impacts, columns)
    rows: Floats
    # what the branch adds to the mean deviation from the orbit, to its square and to its fourth
    # power, in place of the path that it leaves; (3, impacts, quantities)
    added: Floats
    # mean of the noise that brings it about, increments in units of their sd; (steps,) or none
    shift: Floats


@dataclass(frozen=True)
class RareEvents:
    """The branches of an orbit."""

    # ``tau, flight, x1, y1, ..., mesh * side`` of each impact; NaN where the orbit has ended;
    # (impacts, columns)
    orbit: Floats
    # in the order of their discovery; of equal distance or not, each is an own branch
    branches: tuple[Branch, ...]
    # number of impacts up to which the search was complete: later ones have unknown branches
    known: int
    why: str  # what ended the search before the last impact; else empty

    @cached_property
    def probabilities(self) -> Floats:
        """Of the branches."""
        return np.array([branch.probability for branch in self.branches])

    @cached_property
    def additions(self) -> Floats:
        """What each branch adds to mean, square and fourth power, shape (3, branches, impacts,
        quantities)."""
        added = np.array([branch.added for branch in self.branches])
        shape = self.orbit[:, :-1].shape
        return added.reshape(len(self.branches), 3, *shape).swapaxes(0, 1)

    def within(self, steps: int) -> tuple[Branch, ...]:
        """The branches, with the noise of the first steps alone."""
        return tuple(branch._replace(shift=branch.shift[:steps]) for branch in self.branches)

    def additions_on(self, itinerary: Sequence[int]) -> Floats:
        """As `additions`, of what still has the meshes and sides of an itinerary, in place of
        nothing."""
        added = np.zeros_like(self.additions)
        for sums, branch in zip(added.swapaxes(0, 1), self.branches, strict=True):
            agrees = branch.rows[..., -1] == np.array(itinerary)
            follows = np.logical_and.accumulate(agrees, axis=1)[..., None]
            away = np.where(follows, branch.rows[..., :-1] - self.orbit[:, :-1], 0.0)
            for total, power in zip(sums, (1, 2, 4), strict=True):
                total += np.nan_to_num(branch.weights[:, None, None] * away**power).sum(axis=0)
        return added


class _Parent(NamedTuple):
    """A path whose flights are to be searched from an impact on, with the covariance after that
    impact."""

    probability: float
    tau: float
    start: Gaussian
    first: int
    rows: Floats


class BranchSearch:
    """A search of the orbit and of its branches for other events, which goes on where less probable
    ones are wanted.

    `dt`: Length of the steps whose noise is known for each branch; None where it is not wanted.
    """

    def __init__(self, scene: Scene, impacts: int, dt: float | None) -> None:
        c = scene.constants
        state = first_state(scene)
        self.constants = c
        self.impacts = impacts
        self.orbit = np.full((impacts, columns_recorded(scene.stages)), np.nan)
        follow_on(c, scene.phase, state, 0, self.orbit)
        self._slowest = slowest_impact(c, state)
        still = np.zeros((state.size, state.size))
        steps = 0 if dt is None else SEARCHED_STEPS
        begin = Gaussian(state, still, np.zeros(steps), np.zeros((state.size, steps)))
        self._queue = [_Parent(1.0, scene.phase, begin, 0, self.orbit)]  # the most probable last
        self._grid = scene.phase, 1.0 if dt is None else dt  # of any length where there is no step
        self._branches: list[Branch] = []
        # of the state before each impact of the orbit to the noise; (2 wheels, steps) each
        self.responses: list[Floats] = []
        # probability of each path, and number of branches after it
        self._searched: list[tuple[float, int]] = []
        wheels = max(scene.stages, FEW_WHEELS)
        self._most_flights = MOST_SEARCHED_FLIGHTS * FEW_WHEELS**2 // wheels**2
        self._flights = 0
        self._found: dict[int, RareEvents] = {}
        self._known = impacts
        self._why = ""
        self._one_at_a_time = threading.Lock()
        if scene.correlation_time:  # flights of such noise are not independent of each other
            self._queue = []
            self._why = "branches are searched for with white noise only"

    def until(self, least: float) -> RareEvents:
        """Branches of the orbit, and of those of its branches that are at least so probable."""
        with self._one_at_a_time:
            while (
                self._queue
                and len(self._searched) < MOST_SEARCHED_PATHS
                and self._flights < self._most_flights
            ):
                if self._searched and self._queue[-1].probability < least:
                    break
                parent = self._queue.pop()
                known, why = self._search(parent)
                if not self._searched:
                    self._known = known
                    self._why = why
                self._searched.append((parent.probability, len(self._branches)))
                self._queue = sorted(self._queue, key=lambda one: one.probability)[
                    -MOST_SEARCHED_PATHS:
                ]
            number = max(
                n for k, (p, n) in enumerate([*self._searched, (0.0, 0)]) if k == 0 or p >= least
            )
            if number not in self._found:
                branches = tuple(self._branches[:number])
                self._found[number] = RareEvents(self.orbit, branches, self._known, self._why)
            return self._found[number]

    def _search(self, parent: _Parent) -> tuple[int, str]:
        """Search the flights of a path; gives the impacts that were reached, and why not all."""
        c = self.constants
        tau = parent.tau
        start = parent.start
        for k in range(parent.first, self.impacts):
            if self._flights == self._most_flights:
                return k, f"{self._flights} flights were searched"
            self._flights += 1
            flight = SearchedFlight(c, tau, start, self._grid)
            if flight.mesh <= 0:
                return k, f"the orbit ends after impact {k}"
            for event in events(flight):
                self._add(parent, tau, k, event)
            if abs(flight.before[2 * flight.mesh - 1]) < self._slowest:
                return k, f"impact {k + 1} of the orbit grazes its wall"
            tau += flight.time
            (before,) = flight.states(np.array([flight.time]))
            if not self._searched:
                self.responses.append(before.cross)
            start = before._replace(mean=flight.before).across(c, flight.mesh, tau)
        return self.impacts, ""

    def _add(self, parent: _Parent, tau: float, k: int, event: Event) -> None:
        """Follow the representatives of a branch that leaves in the flight before impact `k`,
        counted from 0."""
        c = self.constants
        probability = parent.probability * event.probability
        rows = np.repeat(parent.rows[None], len(event.states), axis=0)
        rows[:, k:] = np.nan
        # rarer ones are never searched
        rarest = self._queue[0].probability if len(self._queue) >= MOST_SEARCHED_PATHS else 0.0
        for j, (t, state, mesh) in enumerate(event.states):
            if mesh:
                rows[j, k] = [tau + t, t, *state.mean, mesh * event.side]
            follow_on(c, tau + t, state.mean, mesh, rows[j, k + (mesh > 0) :])
            if not mesh:
                rows[j, k, 1] = rows[j, k, 0] - tau
            share = probability * event.weights[j]
            i = 2 * (mesh - 1)
            if share < rarest:
                continue
            if not mesh:
                self._queue.append(_Parent(share, tau + t, state, k, rows[j]))
            elif abs(state.mean[i + 1]) > self._slowest:
                after = state.across(c, mesh, tau + t)
                self._queue.append(_Parent(share, tau + t, after, k + 1, rows[j]))
        shares = probability * event.weights
        orbit = self.orbit[:, :-1]
        added = np.zeros((3, *orbit.shape))
        gap = rows[:, k:, :-1] - orbit[k:]
        before = parent.rows[k:, :-1] - orbit[k:]
        for n in range(3):  # powers 1, 2 and 4
            added[n, k:] = np.nan_to_num(shares[:, None, None] * (gap - before)).sum(axis=0)
            gap = gap * gap
            before = before * before
        what = event.mesh, event.side, event.missed, event.beta
        self._branches.append(Branch(k + 1, *what, probability, shares, rows, added, event.shift))


_remembered = lru_cache(maxsize=32)(BranchSearch)


def search_of(scene: Scene, impacts: int, dt: float | None = None) -> BranchSearch:
    """The search for the branches of a scene over a number of impacts, remembered with what it has
    found.

    `dt`: Step of the noise that is known for each branch; by default that of exact flights, so that
    one search serves all who ask.  For many wheels the noise takes as long as the rest: by default
    it is not known then.
    """
    if dt is None and scene.stages <= FEW_WHEELS:
        dt = default_step(scene, EXACT_SCHEME)
    return _remembered(scene, impacts, dt)
