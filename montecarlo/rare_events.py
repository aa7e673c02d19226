"""Rare events along the noise-free orbit: which other impact may come instead of, or before, its next one.

A flight is linear, so that around the orbit its state is Gaussian with a covariance that the saltation matrices carry
from impact to impact.  The distance from a wall, in its own sds, is smallest at the *design point*: the most probable
noise that brings the other impact about (first-order reliability method; Hasofer and Lind 1974).  Its distance is the
reliability index beta.  The velocity is the rate of the displacement, so a wall met during a flight has the mean number
of upcrossings as its probability (Rice 1944), which is ``Phi(-beta)`` corrected to second order in the time.
Two kinds are looked for in every flight: another wall that is met before the orbit's next impact, on the way or just
before, and an impact that all but grazes and is missed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp

from rattle.scene.compiled import jit
from rattle.scene.constants import Constants
from rattle.scene.flight import flow, jacobian, noise_covariance
from rattle.scene.impact import next_impact, struck
from rattle.scene.scene import Scene
from rattle.scene.tangent import saltation_matrix

__all__ = ["FURTHEST", "Branch", "RareEvents", "rare_events"]

Floats = NDArray[np.float64]

FURTHEST = 6.0
"""Largest reliability index that is looked for: a probability of 1e-9."""
GRID = 64  # points of a flight at which the walls' distances are looked at
PLACES = (0.5 + np.arange(1, 13) * np.array([[0.8191725134], [0.6710436067], [0.5497004779]])) % 1.0
"""Twelve points of the unit cube, an additive recurrence of low discrepancy: time, room and speed of a branch."""
TURN = 2.0  # time within which a grazing path turns
SAMPLE = 2000  # Gaussian paths around the design point of a missed impact
LONGEST = 100.0  # flight; a longer one ends the search
GRAZE = 1e-6  # impact speed, over the largest of alpha, gamma1 and initial speeds, below which the orbit grazes
FAINT = -60.0  # logarithm of the flux below which a peak is not looked at
LATEST = 1.0  # time after the orbit's own impact up to which another may still come before that of a path
STRATA = np.array([0.6, 0.35, 0.05])  # of the depth by which a missed impact is missed; each has one representative
MIDDLES = np.cumsum(STRATA) - 0.5 * STRATA
MOST = 12  # branches that are followed further, the most probable first


class Branch(NamedTuple):
    """Paths that leave the orbit, or another branch, by one other event.

    Attributes
    ----------
    impact : int
        Number of the impact that differs.
    mesh, side : int
        The wall that is met, or missed.
    missed : bool
        Whether that impact is missed rather than added.
    beta : float
        Reliability index: distance of the design point in sds.
    probability : float
        Of the branch.
    weights : ndarray, shape (strata,)
        Probabilities of its strata, by depth beyond the design point.
    section : ndarray, shape (strata, impacts, 6)
        ``tau, flight, x1, y1, x2, y2`` before each impact of a representative of each stratum; those of the parent
        before `impact`, NaN where it has ended.
    parent : ndarray, shape (impacts, 6)
        The same of the path that it leaves.
    """

    impact: int
    mesh: int
    side: int
    missed: bool
    beta: float
    probability: float
    weights: Floats
    section: Floats
    parent: Floats


class RareEvents(NamedTuple):
    """The branches of an orbit.

    Attributes
    ----------
    orbit : ndarray, shape (impacts, 6)
        ``tau, flight, x1, y1, x2, y2`` before each impact; NaN where the orbit has ended.
    branches : tuple of Branch
        In the order of their discovery; of equal distance or not, each is an own branch.
    known : int
        Number of impacts up to which the search was complete: later ones have unknown branches.
    why : str
        What ended the search before the last impact; else empty.
    """

    orbit: Floats
    branches: tuple[Branch, ...]
    known: int
    why: str


@jit
def _covariances(
    c: Constants, tau: float, after: Floats, start: Floats, times: Floats, means: Floats, spread: Floats
) -> None:
    """Mean state and covariance of a flight at each time since its start, `start` the covariance there."""
    for n in range(times.size):
        t = times[n]
        x1, y1, x2, y2 = flow(c, tau, after[0], after[1], after[2], after[3], t)
        means[n, 0], means[n, 1], means[n, 2], means[n, 3] = x1, y1, x2, y2
        j, q = jacobian(c, t), noise_covariance(c, tau, t)
        for a in range(4):
            for b in range(4):
                total = q[a, b]
                for k in range(4):
                    for m in range(4):
                        total += j[a, k] * start[k, m] * j[b, m]
                spread[n, a, b] = total


@jit
def _onward(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, mesh: int, first: int, rows: Floats
) -> None:
    """Follow a noise-free path from an impact, whose row is written already, through the rows after it."""
    for k in range(first, rows.shape[0]):
        if mesh > 0:
            y1, y2 = struck(c, mesh, y1, y2)
        t, mesh, _, x1, y1, x2, y2 = next_impact(c, tau, x1, y1, x2, y2, LONGEST)
        if mesh <= 0:
            return
        tau += t
        rows[k, 0], rows[k, 1] = tau, t
        rows[k, 2], rows[k, 3], rows[k, 4], rows[k, 5] = x1, y1, x2, y2


class _Flight:
    """A flight with its Gaussian state around a noise-free path, to or beyond that path's next impact."""

    def __init__(self, c: Constants, tau: float, after: Floats, start: Floats) -> None:
        self.c, self.tau, self.after, self.start = c, tau, after, start
        self.time, self.mesh, self.side, *before = next_impact(c, tau, after[0], after[1], after[2], after[3], LONGEST)
        self.before = np.array(before)

    def at(self, times: Floats) -> tuple[Floats, Floats]:
        """Mean and covariance at times since the start."""
        means, spread = np.empty((times.size, 4)), np.empty((times.size, 4, 4))
        _covariances(self.c, self.tau, self.after, self.start, times, means, spread)
        return means, spread


def _wall(c: Constants, mesh: int) -> float:
    """Half gap of a mesh."""
    return c.wall1 if mesh == 1 else c.wall2


def _distance(flight: _Flight, means: Floats, spread: Floats, mesh: int, side: int) -> Floats:
    """Distance from a wall in sds."""
    i = 2 * (mesh - 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((_wall(flight.c, mesh) - side * means[:, i]) / np.sqrt(np.maximum(spread[:, i, i], 0.0)))


class _Found(NamedTuple):
    """An event: its kind, its probability within the flight, and per stratum the state before the branch's impact."""

    mesh: int
    side: int
    missed: bool
    beta: float
    probability: float
    weights: Floats
    states: list[tuple[float, Floats, Floats, int]]  # time since the start, state, covariance there, mesh struck (or 0)


def _log_flux(flight: _Flight, times: Floats, mesh: int, side: int) -> Floats:
    """Logarithm of the rate at which paths meet a wall that have not met the orbit's own: Rice's formula."""
    means, spread = flight.at(times)
    i, own = 2 * (mesh - 1), 2 * (flight.mesh - 1)
    var, cov, rate = spread[:, i, i], spread[:, i, i + 1], spread[:, i + 1, i + 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        gap = _wall(flight.c, mesh) - side * means[:, i]
        sd = np.sqrt(np.maximum(rate - cov**2 / var, 1e-300))
        u = (side * means[:, i + 1] + cov / var * gap) / sd  # speed towards the wall of a path that is there, in sds
        normal = -0.5 * u * u - 0.5 * math.log(2.0 * math.pi)
        # E max(u + N, 0) = phi(u) + u Phi(u), which cancels where u is far below zero
        outward = np.where(u > -6.0, np.log(np.exp(normal) + u * ndtr(u)), normal - np.log(2.0 + u * u))
        found = np.log(sd) + outward - 0.5 * (gap**2 / var + np.log(2.0 * math.pi * var))
        if own != i:
            cross = spread[:, own, i] / var
            rest = np.sqrt(np.maximum(spread[:, own, own] - cross * spread[:, own, i], 1e-300))
            left = _wall(flight.c, flight.mesh) - flight.side * (means[:, own] + cross * side * gap)
            found += log_ndtr(left / rest)
    return np.asarray(np.nan_to_num(found, nan=-np.inf, posinf=-np.inf))


def _earlier(flight: _Flight, mesh: int, side: int) -> list[_Found]:
    """Another wall that is met before the orbit's own: an event for each peak of the flux of paths that meet it."""
    same = mesh == flight.mesh
    end = flight.time if same else flight.time + min(flight.time, LATEST)
    times = np.linspace(0.0, end, GRID + 1)[1:]
    flux = _log_flux(flight, times, mesh, side)
    peaks = np.flatnonzero((flux[1:-1] >= flux[:-2]) & (flux[1:-1] > flux[2:]) & (flux[1:-1] > FAINT)) + 1
    found = []
    if same and side == flight.side:  # the last peak may be the orbit's own impact
        i = 2 * (mesh - 1)
        late = math.sqrt(max(flight.at(times[-1:])[1][0, i, i], 0.0)) / max(abs(flight.before[i + 1]), 1e-300)
        peaks = peaks[times[peaks] < flight.time - FURTHEST * late]
    for peak in peaks:
        at = times[peak - 1 : peak + 2]
        for _ in range(4):  # narrow the bracket
            fine = np.linspace(at[0], at[2], 9)
            log = _log_flux(flight, fine, mesh, side)
            best = int(np.clip(log.argmax(), 1, 7))
            at = fine[best - 1 : best + 2]
        bend = (2.0 * log[best] - log[best - 1] - log[best + 1]) / (at[1] - at[0]) ** 2
        width = 6.0 / math.sqrt(bend) if bend > 0.0 else end
        around = np.linspace(max(at[1] - width, times[0]), min(at[1] + width, end), 65)
        density = np.exp(_log_flux(flight, around, mesh, side))
        mass = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(around))])
        probability = min(float(mass[-1]), 1.0)
        if probability > ndtr(-FURTHEST):
            found.append(_met(flight, mesh, side, probability, np.interp(PLACES[0], mass / mass[-1], around)))
    return found


def _met(flight: _Flight, mesh: int, side: int, probability: float, times: Floats) -> _Found:
    """An event with representatives at given times: how near the own wall is, and the speed, are spread as they are."""
    i, own, wall = 2 * (mesh - 1), 2 * (flight.mesh - 1), side * _wall(flight.c, mesh)
    means, spreads = flight.at(times)
    states, weights = [], np.empty(times.size)
    for n, t in enumerate(times):
        mean, spread = _given(means[n], spreads[n], i, wall)
        if own != i:
            sd = math.sqrt(max(spread[own, own], 0.0))
            room = (_wall(flight.c, flight.mesh) - flight.side * mean[own]) / max(sd, 1e-300)
            at = float(ndtri_exp(log_ndtr(room) + math.log(PLACES[1, n])))
            mean, spread = _given(mean, spread, own, mean[own] + flight.side * at * sd)
        sd = math.sqrt(max(spread[i + 1, i + 1], 0.0))
        least = -side * mean[i + 1] / max(sd, 1e-300)
        speed = side * mean[i + 1] - sd * float(ndtri_exp(log_ndtr(-least) + math.log(PLACES[2, n])))
        weights[n] = max(speed, 0.0)
        mean, spread = _given(mean, spread, i + 1, side * speed)
        states.append((float(t), mean, spread, mesh))
    weights = weights / weights.sum() if weights.sum() > 0.0 else np.full(times.size, 1.0 / times.size)
    return _Found(mesh, side, False, float(-ndtri(probability)), probability, weights, states)


def _given(mean: Floats, spread: Floats, i: int, value: float) -> tuple[Floats, Floats]:
    """Mean and covariance of a Gaussian, given one component."""
    if spread[i, i] <= 0.0:
        return mean, spread
    gain = spread[:, i] / spread[i, i]
    moved = mean + gain * (value - mean[i])
    moved[i] = value
    return moved, spread - np.outer(gain, spread[i])


def _missed(flight: _Flight) -> _Found | None:
    """The orbit's own impact, if it all but grazes: paths that stay within the wall.

    The design point is where the wall is furthest behind, in sds; a path that is within it then has to be so all along,
    which a small sample of Gaussian paths around the design point tells.
    """
    mesh, side, i = flight.mesh, flight.side, 2 * (flight.mesh - 1)
    times = flight.time + np.linspace(0.0, TURN, 2 * GRID)
    means, spread = flight.at(times)
    beta = -_distance(flight, means, spread, mesh, side)
    falls = np.flatnonzero(beta[1:] < beta[:-1])
    best = int(falls[0]) if falls.size else 0
    if best == 0 or not beta[best] < FURTHEST:
        return None
    if flight.c.stages == 2 and (np.abs(means[: best + 1, 2 - i]) > _wall(flight.c, 3 - mesh)).any():
        return None  # the other mesh is struck first: `_swapped`
    top, nearest = float(times[best]), float(beta[best])
    around = np.linspace(flight.time, top + (top - flight.time), 13)  # the seventh is the top
    means, spread = flight.at(around)
    joint = np.empty((13, 13))
    for a in range(13):
        for b in range(a, 13):
            joint[a, b] = joint[b, a] = spread[a, i] @ jacobian(flight.c, around[b] - around[a])[i]
    rng = np.random.default_rng(0)
    rest = joint - np.outer(joint[6], joint[6]) / joint[6, 6]
    size, axes = np.linalg.eigh(rest)
    root = (axes * np.sqrt(np.maximum(size, 0.0))) @ axes.T
    depths = -ndtri(ndtr(-nearest) * (1.0 - (np.arange(SAMPLE) + 0.5) / SAMPLE))
    paths = rng.standard_normal((SAMPLE, 13)) @ root.T - depths[:, None] * joint[6] / math.sqrt(joint[6, 6])
    within = (paths + side * means[:, i] < _wall(flight.c, mesh)).all(axis=1)
    share = max(within.mean(), 1.0 / SAMPLE)
    sd, states = math.sqrt(joint[6, 6]), []
    for depth in np.quantile(depths[within] if within.any() else depths, MIDDLES):
        states.append((top, *_given(means[6], spread[6], i, means[6, i] - side * depth * sd), 0))
    return _Found(mesh, side, True, nearest, float(ndtr(-nearest) * share), STRATA, states)


def _events(flight: _Flight) -> list[_Found]:
    """All other events of a flight within reach."""
    missed = _missed(flight)
    found = [] if missed is None else [missed]
    for mesh in range(1, flight.c.stages + 1):
        for side in (1, -1):
            found += _earlier(flight, mesh, side)
    return found


class _Parent(NamedTuple):
    """A path whose flights are to be searched from an impact on, with the covariance after that impact."""

    probability: float
    tau: float
    after: Floats
    start: Floats
    first: int
    rows: Floats


def rare_events(scene: Scene, impacts: int, least: float = 1.0) -> RareEvents:
    """Search the orbit, and the branches that are more probable than `least`, for other events.

    Parameters
    ----------
    scene : Scene
        What is modelled; it has noise.
    impacts : int
        Impacts after the start.
    least : float
        Probability from which on a representative of a branch is searched for branches of its own.

    Returns
    -------
    RareEvents

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> found = rare_events(Scene.from_gears(DAT21, sigma=0.1), 2)
    >>> found.known, [(b.impact, b.mesh, b.side, round(b.beta, 1)) for b in found.branches]
    (2, [(1, 2, -1, 3.3)])
    """
    c, start = scene.constants, scene.start
    state = np.array(scene.start_state)
    if start.mesh:
        state[1], state[3] = struck(c, start.mesh, state[1], state[3])
    orbit = np.full((impacts, 6), np.nan)
    _onward(c, scene.phase, state[0], state[1], state[2], state[3], 0, 0, orbit)
    fastest = max(c.alpha, c.gamma1, abs(state[1]), abs(state[3]))
    queue, branches = [_Parent(1.0, scene.phase, state, np.zeros((4, 4)), 0, orbit)], list[Branch]()
    known, why, followed = impacts, "", 0
    while queue and followed < MOST:
        queue.sort(key=lambda parent: parent.probability)
        parent = queue.pop()
        reached, ended = _search(c, parent, impacts, least, GRAZE * fastest, queue, branches)
        if followed == 0:
            known, why = reached, ended
        followed += 1
    return RareEvents(orbit, tuple(branches), known, why)


def _search(
    c: Constants, parent: _Parent, impacts: int, least: float, slowest: float,
    queue: list[_Parent], branches: list[Branch],
) -> tuple[int, str]:  # fmt: skip
    """Search the flights of a path; returns the impacts that were reached, and why not all."""
    tau, after, start = parent.tau, parent.after, parent.start
    for k in range(parent.first, impacts):
        flight = _Flight(c, tau, after, start)
        if flight.mesh <= 0:
            return k, f"the orbit ends after impact {k}"
        for event in _events(flight):
            probability = parent.probability * event.probability
            rows = np.repeat(parent.rows[None], len(event.states), axis=0)
            rows[:, k:] = np.nan
            for j, (t, state, spread, mesh) in enumerate(event.states):
                if mesh:
                    rows[j, k] = [tau + t, t, *state]
                _onward(c, tau + t, state[0], state[1], state[2], state[3], mesh, k + 1 if mesh else k, rows[j])
                if not mesh and k < impacts:
                    rows[j, k, 1] = rows[j, k, 0] - tau
                share = probability * event.weights[j]
                i = 2 * (mesh - 1)
                if share >= least and mesh and abs(state[i + 1]) > slowest:
                    hit = state.copy()
                    hit[1], hit[3] = struck(c, mesh, hit[1], hit[3])
                    across = saltation_matrix(c, mesh, tau + t, state[1], state[3])
                    queue.append(_Parent(share, tau + t, hit, across @ spread @ across.T, k + 1, rows[j]))
                elif share >= least and not mesh:
                    queue.append(_Parent(share, tau + t, state, spread, k, rows[j]))
            branches.append(
                Branch(
                    k + 1,
                    event.mesh,
                    event.side,
                    event.missed,
                    event.beta,
                    probability,
                    probability * event.weights,
                    rows,
                    parent.rows,
                )
            )
        i = 2 * (flight.mesh - 1)
        if abs(flight.before[i + 1]) < slowest:
            return k, f"impact {k + 1} of the orbit grazes its wall"
        spread = flight.at(np.array([flight.time]))[1][0]
        tau += flight.time
        across = saltation_matrix(c, flight.mesh, tau, flight.before[1], flight.before[3])
        after, start = flight.before.copy(), across @ spread @ across.T
        after[1], after[3] = struck(c, flight.mesh, after[1], after[3])
    return impacts, ""
