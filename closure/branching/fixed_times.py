"""Moments of the branching closure at fixed times, when components are on different flights
(docs/theory/closures.md).

At a time s a path is on the flight between its impacts at tau and tau' if ``tau <= s < tau'``.  A
component and its two times are jointly Gaussian, so both ends are cuts of a Gaussian.  Given tau,
the flight is affine, flown from three points of the Gaussian of tau (Gauss-Hermite); what acts
after s is taken back by its Gaussian regression on the point.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.closure.branching.advance import Advance, Buffers, Level
from rattle.closure.branching.mixture import Mixture
from rattle.closure.branching.propagate import half
from rattle.closure.section_map import plain_size, start_covariance
from rattle.scene import Constants, Floats, Ints, Scene
from rattle.scene.compiled import internal, jit, little_code, splice
from rattle.scene.elementary import unknown
from rattle.scene.flight import flow, jacobian, noise_covariance
from rattle.scene.linear_algebra import (
    apply,
    beyond,
    congruence,
    eigen,
    put,
    put_row,
    put_scaled,
    times,
    transform,
)
from rattle.scene.moments import semidefinite
from rattle.scene.orbit import Orbit

CUT_REACH = 6.0  # distance of a cut, in sds, beyond which a Gaussian is on one side of it
HERMITE_POINTS = np.array([-math.sqrt(3.0), 0.0, math.sqrt(3.0)])
HERMITE_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
LEAST_COMPONENT_WEIGHT = 1e-7  # weight of a component on a flight that is left out
# eigenvalue, relative to the largest, below which a direction does not vary
LEAST_EIGENVALUE = 1e-14
MOST_BEYOND_LAST_FLIGHT = 1e-3  # share of paths beyond the last flight that is followed
LACKING = 0.05  # weight too little or too much, above which there are no moments
FURTHER = 2, 8  # flights followed, at most: per impact asked for, and besides


class InFlight(NamedTuple):
    """Components between two impacts."""

    # weight, mean, covariance: at the start, after splitting, the noise of the flight included;
    # (n,), (n, d), (n, d, d)
    weight: Floats
    mean: Floats
    covariance: Floats
    # mean and variance of the time of the next impact; infinite mean if there is none; (n, 2)
    end: Floats
    crossing: Floats  # covariance of the start with that time; (n, d)
    parent: Ints  # the component before splitting; (n,)
    centre: Floats  # its mean; (parents, d)
    regression: Floats  # inverse of its covariance, on its range; (parents, d, d)
    # time of its mean's flight, whose noise was added; 0 if it does not end; (parents,)
    time: Floats


@jit
def _inverse(covariance: Floats) -> Floats:
    """Inverse of a covariance on its range."""
    d = covariance.shape[0]
    values, vectors = eigen(covariance)
    out = np.zeros((d, d))
    for k in range(d):
        if values[k] > LEAST_EIGENVALUE * values[d - 1] and values[k] > 0.0:
            for i in range(d):
                for j in range(d):
                    out[i, j] += vectors[i, k] * vectors[j, k] / values[k]
    return out


def _in_flight(whole: Mixture, b: Buffers, count: int) -> InFlight:
    """Copies of the components of a flight; those that a boundary halves as their halves."""
    section = b.image.section
    place = np.flatnonzero(section.weight[: 2 * count] > 0.0)
    of = place // 2
    mean = b.start.mean[of]
    covariance = b.start.covariance[of]
    for j in np.flatnonzero(b.halved[of] > 0.0):
        plane = b.plane[of[j]]
        _, rate, variance = half(b.halved[of[j]], bool(place[j] % 2 == 0))
        mean[j] += rate * plane
        covariance[j] -= (1.0 - variance) * np.outer(plane, plane)
    end = np.column_stack([section.mean[place, 0], section.covariance[place, 0, 0]])
    end[section.label[place] == 0] = np.inf, 0.0
    return InFlight(
        section.weight[place],
        mean,
        covariance,
        end,
        b.image.crossing[place],
        b.parent[of],
        whole.mean,
        np.array([_inverse(one) for one in whole.covariance]),
        b.time[: len(whole.mean)].copy(),
    )


@internal
def _below(depth: float) -> tuple[float, float, float]:
    """Weight, mean and variance of a standard normal below `depth`."""
    if depth >= CUT_REACH:
        return 1.0, 0.0, 1.0
    if depth <= -CUT_REACH:
        return 0.0, 0.0, 1.0
    weight, rate, variance = half(abs(depth), depth >= 0.0)
    return weight, (rate if depth >= 0.0 else -rate), variance


@internal
def _depth(gap: float, variance: float) -> float:
    """A gap in sds."""
    if variance > 0.0:
        return gap / math.sqrt(variance)
    return math.inf if gap >= 0.0 else -math.inf


@splice
def _at(
    c: Constants,
    t: float,
    centre: Floats,
    regression: Floats,
    mean: Floats,
    covariance: Floats,
    time: float,
    out: Floats,
    spread: Floats,
) -> None:
    """State at a time, of the starts with the time `mean[0]` and this Gaussian: its mean and
    covariance.

    `t`, `centre`, `regression`: As of `InFlight`, of the component before splitting.
    """
    d = mean.size
    done = min(max(time - mean[0], 0.0), t)
    # derivative of the state at the start, with the noise up to `time` only
    plain = plain_size(c)
    turned = np.eye(plain - 1, d, 1)
    put(spread, congruence(turned, covariance))
    start = mean[1:plain].copy()
    if done < t:
        rest = congruence(jacobian(c, -t), noise_covariance(c, centre[0] + done, t - done))
        gain = times(rest, regression[1:plain])
        back = apply(gain, beyond(mean, -1.0, centre))
        for i in range(plain - 1):
            start[i] -= back[i]
            for j in range(d):
                turned[i, j] -= gain[i, j]
        put(spread, congruence(turned, covariance))
        known = times(gain[:, 1:plain].copy(), rest)
        for i in range(plain - 1):
            for j in range(plain - 1):
                spread[i, j] += rest[i, j] - known[i, j]
    left = time - mean[0]
    put_row(out, flow(c, mean[0], start, left))
    put(spread, congruence(jacobian(c, left), spread))


@internal
def _cut(mean: Floats, covariance: Floats, along: Floats, shift: float, narrow: float) -> None:
    """Cut a Gaussian in place: a standard normal, whose covariance with it is `along`, gets this
    mean and variance."""
    for i in range(mean.size):
        mean[i] += shift * along[i]
        for j in range(mean.size):
            covariance[i, j] -= (1.0 - narrow) * along[i] * along[j]


@jit
def _add(
    c: Constants, f: InFlight, time: float, weight: Floats, mean: Floats, covariance: Floats
) -> float:
    """Gaussians of the state at a time on a flight, three for each component; returns the share of
    started paths."""
    little_code()
    started = 0.0
    weights = f.weight
    means = f.mean
    spreads = f.covariance
    ends = f.end
    d = means.shape[1]
    along = np.empty(d)
    for j in range(weights.size):
        share, shift, narrow = _below(_depth(time - means[j, 0], spreads[j, 0, 0]))
        share *= weights[j]
        started += share
        if share < LEAST_COMPONENT_WEIGHT:
            continue
        m = means[j].copy()
        s = spreads[j].copy()
        crossing = f.crossing[j].copy()
        end = ends[j, 0]
        variance = ends[j, 1]
        if narrow < 1.0:
            sd = math.sqrt(s[0, 0])
            put_scaled(along, s[0], sd)
            ahead = crossing[0] / sd
            _cut(m, s, along, shift, narrow)
            end += shift * ahead
            variance -= (1.0 - narrow) * ahead * ahead
            for k in range(d):
                crossing[k] -= (1.0 - narrow) * along[k] * ahead
        flying, early, narrow = _below(_depth(end - time, variance))
        share *= flying
        if share < LEAST_COMPONENT_WEIGHT:
            continue
        if narrow < 1.0:
            put_scaled(along, crossing, math.sqrt(variance))
            _cut(m, s, along, -early, narrow)
        for k in range(d):
            along[k] = 0.0
        if s[0, 0] > 0.0:
            put_scaled(along, s[0], math.sqrt(s[0, 0]))
        _cut(m, s, along, 0.0, 0.0)  # tau is given
        parent = f.parent[j]
        t = f.time[parent]
        centre = f.centre[parent]
        regression = f.regression[parent]
        for point in range(3):
            at = 3 * j + point
            given = beyond(m, HERMITE_POINTS[point], along)
            weight[at] = share * HERMITE_WEIGHTS[point]
            _at(c, t, centre, regression, given, s, time, mean[at], covariance[at])
    return started


class FixedTimes:
    """Mean and covariance of the state at fixed times, from flights kept; follows the closure on
    where a time asks.

    `run`: the closure, impact by impact. `flights`: its flights so far.
    """

    def __init__(self, scene: Scene, orbit: Orbit, level: Level, impacts: int) -> None:
        """Begin at the start of an orbit, before the first flight."""
        self.constants = scene.constants
        self.orbit = orbit
        plain = plain_size(scene.constants)
        self.start = start_covariance(scene)[1:plain, 1:plain].copy()
        self.most = FURTHER[0] * impacts + FURTHER[1]
        self.run = Advance(scene, orbit, level)
        self.flights: list[InFlight] = []

    def __call__(self, time: float) -> tuple[Floats, Floats]:
        """Mean and covariance of the state at a local time; NaN where `LACKING`.

        Until a path has struck, they are those of the one flight that all paths are on.
        """
        if not self.flights:
            self._follow()
        tau = self.orbit.tau[0]
        end = self.flights[0].end
        if time == tau or (end[:, 0] - time > CUT_REACH * np.sqrt(end[:, 1])).all():
            flown = transform(jacobian(self.constants, time - tau), self.start)
            return self.orbit.state(time), flown + noise_covariance(self.constants, tau, time - tau)
        weight, mean, covariance = self.gaussians(time)
        total = weight.sum()
        if abs(total - 1.0) > LACKING:
            return unknown(mean.shape[1]), unknown(*covariance.shape[1:])
        share = weight / total
        centre = mean[0] + share @ (mean - mean[0])
        off = mean - centre
        covariances = np.einsum("n,nij->ij", share, covariance) + np.einsum(
            "n,ni,nj->ij", share, off, off
        )
        # of noise taken back, rounding is left
        return centre, semidefinite(covariances, np.sqrt(np.abs(np.diagonal(covariances))))

    def gaussians(self, time: float) -> tuple[Floats, Floats, Floats]:
        """The mixture of states at a local time: weights, means and covariances; the weights sum to
        nearly 1."""
        mixtures = []
        states = len(self.start)
        for k in range(self.most):
            if k == len(self.flights) and not self._follow():
                break
            n = 3 * self.flights[k].weight.size
            weight = np.zeros(n)
            mean = np.zeros((n, states))
            covariance = np.zeros((n, states, states))
            started = _add(self.constants, self.flights[k], time, weight, mean, covariance)
            mixtures.append((weight[weight > 0.0], mean[weight > 0.0], covariance[weight > 0.0]))
            if started < MOST_BEYOND_LAST_FLIGHT:
                break
        return tuple(np.concatenate(a) for a in zip(*mixtures, strict=True))  # type: ignore[return-value]

    def fly(self) -> None:
        """One more flight of the closure, which is kept."""
        whole = self.run.fly()
        self.flights.append(_in_flight(whole, self.run.buffers, self.run.flown))

    def _follow(self) -> bool:
        """Follow one more flight; False if the closure has ended."""
        run = self.run
        k = len(self.flights)
        if run.struck < k:
            run.strike(
                int(self.orbit.mesh[k] * self.orbit.side[k]) if k < len(self.orbit.mesh) else 0
            )
        if k > 0 and run.kept == 0:
            return False
        if run.merged < k:
            run.merge()
        self.fly()
        return True
