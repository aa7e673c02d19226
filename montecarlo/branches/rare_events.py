"""Rare events along the noise-free orbit: which other impact may come instead of, or before, its
next one.

A flight is linear, so that around the orbit its state is Gaussian with a covariance that the
saltation matrices carry from impact to impact.  The distance from a wall, in its own sds, is
smallest at the *design point*: the most probable noise that brings the other impact about
(first-order reliability method; Hasofer and Lind 1974).  Its distance is the reliability index
beta.  The velocity is the rate of the displacement, so a wall met during a flight has the mean
number of upcrossings as its probability (Rice 1944), which is ``Phi(-beta)`` corrected to second
order in the time. Two kinds are looked for in every flight: another wall that is met before the
orbit's next impact, on the way or just before, and an impact that all but grazes and is missed.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp

from rattle.montecarlo.schemes.short_flight import kick
from rattle.montecarlo.schemes.step_state import TERMS_AND_NOISE
from rattle.montecarlo.statistics.section_statistics import undefined
from rattle.scene import Constants, Floats
from rattle.scene.compiled import jit
from rattle.scene.flight import flow, jacobian, noise_covariance
from rattle.scene.impact import add_scatter, next_impact, strike
from rattle.scene.linear_algebra import add, apply, congruence, put, put_row
from rattle.scene.orbit import Impacts, empty_legs, fill_impacts, put_impact
from rattle.scene.tangent import saltation_matrix

FURTHEST = 6.0
"""Largest reliability index that is looked for: a probability of 1e-9."""
NO_SD = 1e-150  # sd or speed that stands for none: a quotient by it does not overflow
GRID = 64  # points of a flight at which the walls' distances are looked at
CUBE_POINTS = (
    0.5 + np.arange(1, 13) * np.array([[0.8191725134], [0.6710436067], [0.5497004779]])
) % 1.0
"""Twelve points of the unit cube, an additive recurrence of low discrepancy: time, room and speed
of a branch."""
TURN_TIME = 2.0  # time within which a grazing path turns
SAMPLE = 2000  # Gaussian paths around the design point of a missed impact
LONGEST_SEARCHED_FLIGHT = 100.0  # flight; a longer one ends the search
RAREST = math.log(1e-9)  # logarithm of a probability below which a branch is not looked for
FAINT = -20.0  # logarithm of the flux, over that of its peak, from which on it is neglected
NEVER = -1e300  # logarithm of no flux; differences of it are finite
NARROWING_ROUNDS = 12  # of fourfold narrowing, at most, in which a peak of the flux is found
# time after the orbit's own impact up to which another may still come before that of a path
LATEST_OTHER = 1.0
# of the depth by which a missed impact is missed; each has one representative
STRATA = np.array([0.6, 0.35, 0.05])
MIDDLES = np.cumsum(STRATA) - 0.5 * STRATA


@jit
def _covariances(
    c: Constants, tau: float, after: Floats, start: Floats, times: Floats
) -> tuple[Floats, Floats]:
    """Mean state and covariance of a flight at each time since its start, `start` the covariance
    there."""
    means = np.empty((times.size, after.size))
    spread = np.empty((times.size, after.size, after.size))
    for n in range(times.size):
        t = times[n]
        put_row(means[n], flow(c, tau, after, t))
        put(spread[n], noise_covariance(c, tau, t))
        add(spread[n], congruence(jacobian(c, t), start))
    return means, spread


def follow_on(c: Constants, tau: float, state: Floats, mesh: int, rows: Floats) -> None:
    """Write the impacts of a noise-free path, ``tau, flight, x1, y1, ..., mesh * side`` a row, from
    a state just before an impact on, or in flight with mesh 0.

    Shapes: `state` (2 wheels,); `rows` (impacts, 3 + 2 wheels).
    """
    at = Impacts.empty(len(rows), c.wheels.size)
    put_impact(c, at, 0, tau, math.nan, mesh, state)
    fill_impacts(c, at, empty_legs(len(rows), c.wheels.size))
    rows[:] = np.column_stack([at.tau, at.flight, at.before, at.mesh * at.side])[1:]


@jit
def _add_noise(
    c: Constants, grid: tuple[float, float], tau: float, t: float, cross: Floats
) -> None:
    """Add what the increments of a step grid (its begin and step) do to the state within a flight
    of time t.

    Increments are in units of their sd; the area of a step, a part in a hundred of its effect, is
    left out. Shapes: `cross` (2 wheels, steps).
    """
    push = np.empty(2 * c.wheels.size)
    series = np.zeros((3 + c.wheels.size, TERMS_AND_NOISE))  # the last row stays 0: see `Scratch`
    begin, dt = grid
    for n in range(
        max(0, int((tau - begin) / dt)), min(cross.shape[1], int((tau + t - begin) / dt) + 1)
    ):
        first = max(tau, begin + n * dt)
        last = min(tau + t, begin + (n + 1) * dt)
        if last > first:
            kick(c, first, last - first, (last - first) / math.sqrt(dt), 0.0, series, push)
            carried = apply(jacobian(c, tau + t - last), push)
            for a in range(push.size):
                cross[a, n] += carried[a]


class Gaussian(NamedTuple):
    """A Gaussian state, and the noise that it comes from: increments of steps in units of their
    sd."""

    mean: Floats  # (2 wheels,)
    spread: Floats  # covariance; (2 wheels, 2 wheels)
    noise: Floats  # mean of the noise; (steps,)
    cross: Floats  # covariance of the state with the noise; (2 wheels, steps)

    def given(self, i: int, value: float) -> "Gaussian":
        """The same, given one component of the state."""
        if self.spread[i, i] <= 0.0:
            return self
        gain = self.spread[:, i] / self.spread[i, i]
        off = value - self.mean[i]
        moved = self.mean + gain * off
        moved[i] = value
        along = self.cross[i].copy()
        noise = self.noise + along * (off / self.spread[i, i])
        cross = self.cross - np.outer(gain, along)
        return Gaussian(moved, self.spread - np.outer(gain, self.spread[i]), noise, cross)

    def across(self, c: Constants, mesh: int, tau: float) -> "Gaussian":
        """The same after an impact of the mean, to first order."""
        carry = saltation_matrix(c, mesh, tau, self.mean)
        mean = self.mean.copy()
        strike(c, mesh, mean)
        spread = carry @ self.spread @ carry.T
        section = np.zeros((mean.size + 1, mean.size + 1))
        at = 2 * mesh - 1
        add_scatter(c, mesh, self.mean[at], self.spread[at, at], section)
        return Gaussian(mean, spread + section[1:, 1:], self.noise, carry @ self.cross)


@dataclass
class SearchedFlight:
    """A flight with its Gaussian state around a noise-free path, to or beyond that path's next
    impact."""

    c: Constants
    tau: float
    start: Gaussian
    grid: tuple[float, float]  # begin and step of the noise that is followed too

    def __post_init__(self) -> None:
        self.time, self.mesh, self.side, self.before = next_impact(
            self.c, self.tau, self.start.mean, LONGEST_SEARCHED_FLIGHT
        )

    def at(self, times: Floats) -> tuple[Floats, Floats]:
        """Mean and covariance at times since the start."""
        return _covariances(self.c, self.tau, self.start.mean, self.start.spread, times)

    def states(self, times: Floats) -> list[Gaussian]:
        """State and noise at times since the start."""
        starts = []
        crosses = np.zeros((times.size, *self.start.cross.shape))
        if self.start.noise.size:
            for t, cross in zip(times, crosses, strict=True):
                cross += jacobian(self.c, t) @ self.start.cross
                _add_noise(self.c, self.grid, self.tau, t, cross)
        for mean, spread, cross in zip(*self.at(times), crosses, strict=True):
            starts.append(Gaussian(mean, spread, self.start.noise, cross))
        return starts


def _wall(c: Constants, mesh: int) -> float:
    """Half gap of a mesh."""
    return float(c.wheels["wall"][mesh - 1])


class Event(NamedTuple):
    """An event: its kind, its probability within the flight, and per stratum the state before the
    branch's impact."""

    mesh: int
    side: int
    missed: bool
    beta: float
    probability: float
    weights: Floats
    # time since the start, state there, mesh struck (or 0)
    states: list[tuple[float, Gaussian, int]]

    @property
    def shift(self) -> Floats:
        """Mean noise that brings it about: about its design point; (steps,)."""
        return np.asarray(
            sum(w * state.noise for w, (_, state, _) in zip(self.weights, self.states, strict=True))
        )


def _log_flux(
    flight: SearchedFlight, moments: tuple[Floats, Floats], mesh: int, side: int
) -> Floats:
    """Logarithm of the rate at which paths meet a wall that have not met the orbit's own, at the
    times of the moments: Rice's formula."""
    means, spread = moments
    i = 2 * (mesh - 1)
    own = 2 * (flight.mesh - 1)
    var = spread[:, i, i]
    cov = spread[:, i, i + 1]
    rate = spread[:, i + 1, i + 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        gap = _wall(flight.c, mesh) - side * means[:, i]
        sd = np.sqrt(np.maximum(rate - cov**2 / var, 1e-300))
        # speed towards the wall of a path that is there, in sds
        u = (side * means[:, i + 1] + cov / var * gap) / sd
        normal = -0.5 * u * u - 0.5 * math.log(2.0 * math.pi)
        # E max(u + N, 0) = phi(u) + u Phi(u), which cancels where u is far below zero
        outward = np.where(
            u > -6.0, np.log(np.exp(normal) + u * ndtr(u)), normal - np.log(2.0 + u * u)
        )
        flux = np.log(sd) + outward - 0.5 * (gap**2 / var + np.log(2.0 * math.pi * var))
        if own != i:
            cross = spread[:, own, i] / var
            rest = np.sqrt(np.maximum(spread[:, own, own] - cross * spread[:, own, i], 1e-300))
            left = _wall(flight.c, flight.mesh) - flight.side * (means[:, own] + cross * side * gap)
            flux += log_ndtr(left / rest)
    return np.maximum(np.nan_to_num(flux, nan=-np.inf, posinf=-np.inf), NEVER)


def _earlier(
    flight: SearchedFlight, mesh: int, side: int, times: Floats, moments: tuple[Floats, Floats]
) -> list[Event]:
    """Another wall that is met before the orbit's own: an event for each peak of the flux of paths
    that meet it.

    `moments`: Of the flight at the times.
    """
    end = times[-1]
    flux = _log_flux(flight, moments, mesh, side)
    peaks = np.flatnonzero((flux[1:-1] >= flux[:-2]) & (flux[1:-1] > flux[2:])) + 1
    valley = np.append(True, np.append((flux[1:-1] <= flux[:-2]) & (flux[1:-1] < flux[2:]), True))
    impacts = []
    if mesh == flight.mesh and side == flight.side:  # the last peak may be the orbit's own impact
        i = 2 * (mesh - 1)
        late = math.sqrt(max(moments[1][-1, i, i], 0.0)) / max(abs(flight.before[i + 1]), NO_SD)
        peaks = peaks[times[peaks] < flight.time - FURTHEST * late]
    for peak in peaks:
        at = times[peak - 1 : peak + 2]
        log = flux[peak - 1 : peak + 2]
        for n in range(NARROWING_ROUNDS):  # narrow the bracket
            highest = 2.0 * log[1] - log.min()  # bound of a log-concave flux within it
            rare = highest + math.log(end) < RAREST
            if rare or (n > 3 and highest < log[1] + 1.0):
                break
            fine = np.linspace(at[0], at[2], 9)
            log = _log_flux(flight, flight.at(fine), mesh, side)
            best = int(np.clip(log.argmax(), 1, 7))
            at = fine[best - 1 : best + 2]
            log = log[best - 1 : best + 2]
        if rare:
            continue
        bend = 2.0 * log[1] - log[0] - log[2]
        width = 6.0 * (at[1] - at[0]) / math.sqrt(bend) if bend > 0.0 else end
        # the peak may be far from symmetric
        faint = np.flatnonzero(valley | (flux < log[1] + FAINT))
        low = times[faint[faint < peak].max(initial=0)]
        high = times[faint[faint > peak].min(initial=GRID - 1)]
        near = np.linspace(max(at[1] - width, low), min(at[1] + width, high), 65)
        around = np.unique(np.concatenate([near, np.linspace(low, high, 65)]))
        density = np.exp(_log_flux(flight, flight.at(around), mesh, side))
        mass = np.concatenate(
            [[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(around))]
        )
        probability = min(float(mass[-1]), 1.0)
        if probability > ndtr(-FURTHEST):
            impacts.append(
                _meet(
                    flight,
                    mesh,
                    side,
                    probability,
                    np.interp(CUBE_POINTS[0], mass / mass[-1], around),
                )
            )
    return impacts


def _meet(flight: SearchedFlight, mesh: int, side: int, probability: float, times: Floats) -> Event:
    """An event with representatives at given times: how near the own wall is, and the speed, are
    spread as they are."""
    i = 2 * (mesh - 1)
    own = 2 * (flight.mesh - 1)
    wall = side * _wall(flight.c, mesh)
    states = []
    weights = np.empty(times.size)
    for n, (t, state) in enumerate(zip(times, flight.states(times), strict=True)):
        state = state.given(i, wall)
        if own != i:
            sd = math.sqrt(max(state.spread[own, own], 0.0))
            room = (_wall(flight.c, flight.mesh) - flight.side * state.mean[own]) / max(sd, NO_SD)
            at = float(ndtri_exp(log_ndtr(room) + math.log(CUBE_POINTS[1, n])))
            state = state.given(own, state.mean[own] + flight.side * at * sd)
        sd = math.sqrt(max(state.spread[i + 1, i + 1], 0.0))
        least = -side * state.mean[i + 1] / max(sd, NO_SD)
        speed = side * state.mean[i + 1] - sd * float(
            ndtri_exp(log_ndtr(-least) + math.log(CUBE_POINTS[2, n]))
        )
        weights[n] = max(speed, 0.0)
        states.append((float(t), state.given(i + 1, side * speed), mesh))
    weights = (
        weights / weights.sum() if weights.sum() > 0.0 else np.full(times.size, 1.0 / times.size)
    )
    return Event(mesh, side, False, float(-ndtri(probability)), probability, weights, states)


def _miss(flight: SearchedFlight) -> Event | None:
    """The orbit's own impact, if it all but grazes: paths that stay within the wall.

    The design point is the time at which the orbit is furthest beyond the wall, in sds.  Whether a
    path that is within the wall then has been within it all along is found from a small sample of
    Gaussian paths around the design point.
    """
    mesh = flight.mesh
    side = flight.side
    i = 2 * (flight.mesh - 1)
    wall = _wall(flight.c, mesh)
    times = flight.time + np.linspace(0.0, TURN_TIME, 2 * GRID)
    means, spread = flight.at(times)
    with undefined():
        beta = (side * means[:, i] - wall) / np.sqrt(np.maximum(spread[:, i, i], 0.0))
    falls = np.flatnonzero(beta[1:] < beta[:-1])
    best = int(falls[0]) if falls.size else 0
    if best == 0 or not beta[best] < FURTHEST:
        return None
    x = means[: best + 1, ::2]
    beyond = (x > flight.c.wheels["wall"]) | (-x > flight.c.wheels["low"])
    beyond[:, mesh - 1] = False
    if beyond.any():
        return None  # another mesh is struck first: `_earlier`
    top = float(times[best])
    nearest = float(beta[best])
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
    paths = rng.standard_normal((SAMPLE, 13)) @ root.T - depths[:, None] * joint[6] / math.sqrt(
        joint[6, 6]
    )
    within = (paths + side * means[:, i] < wall).all(axis=1)
    share = max(within.mean(), 1.0 / SAMPLE)
    sd = math.sqrt(joint[6, 6])
    states = []
    (state,) = flight.states(np.array([top]))
    for depth in np.quantile(depths[within] if within.any() else depths, MIDDLES):
        states.append((top, state.given(i, means[6, i] - side * depth * sd), 0))
    return Event(mesh, side, True, nearest, float(ndtr(-nearest) * share), STRATA, states)


def events(flight: SearchedFlight) -> list[Event]:
    """All other events of a flight within reach."""
    missed = _miss(flight)
    branches = [] if missed is None else [missed]
    # times at which the own mesh, and at which another one, may be struck first
    ends = flight.time, flight.time + min(flight.time, LATEST_OTHER)
    grids = [np.linspace(0.0, end, GRID + 1)[1:] for end in ends]
    moments = [flight.at(times) for times in grids]
    for mesh in range(1, flight.c.wheels.size + 1):
        other = int(mesh != flight.mesh)
        for side in (1, -1):
            branches += _earlier(flight, mesh, side, grids[other], moments[other])
    return branches
