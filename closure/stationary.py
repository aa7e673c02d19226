"""The closures in the long run: what each says of the stationary motion.

A stationary law is a mixture over impacts: a weight, the mesh, and mean and sd of the speed and of
the flight of each.

- **Linear** (`saltation`): at a stable periodic orbit the covariance of the section state after a
  cycle is that before it, ``P = A P A' + Q`` (a discrete Lyapunov equation).  Means are shifted to
  second order in the noise.
- **Orbit average** (`published`, `corrected`): the mean map is iterated, and the average over its
  orbit is taken for the stationary law, as the paper does.
- **Branching**: the mixture is followed until it no longer changes from impact to impact.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from rattle.closure.mean_map import mean_map, refusals
from rattle.closure.saltation import propagate
from rattle.closure.section_map import plain_size, section_derivatives
from rattle.scene import Floats, Ints, Scene
from rattle.scene.elementary import unknown
from rattle.scene.flight import noise_covariance
from rattle.scene.impact import GRAZE, contact_matrix
from rattle.scene.linear_algebra import transform
from rattle.scene.long_orbit import PERIODIC, Attractor, struck_speeds
from rattle.scene.orbit import Impacts

MAPPED = 4000  # impacts of a mean map whose average is taken
DROPPED = 400  # of those, before the average begins
BRANCHED = 32  # impacts through which `branching` is followed
CONVERGED = 0.02  # relative change between quarters of these impacts up to which it has converged
DISCARDED = 0.02  # probability that may have been discarded by then
LEAST_OF_START = 1e-10  # of a start that the means have to forget
MOST_PASSES = 400  # cycles through which they are followed


class NotPredicted(Exception):
    """A closure says nothing of the stationary motion; its text is the reason."""


class Law(NamedTuple):
    """A stationary law: a mixture over impacts."""

    rate: float  # impacts per unit of time
    weight: Floats  # share of the impacts; they sum to 1; (parts,)
    mesh: Ints  # what is struck; (parts,)
    speed: Floats  # speed, sd_speed: mean and sd of the speed before the impact; (parts,)
    sd_speed: Floats
    flight: Floats  # flight, sd_flight: mean and sd of the time since the last impact; (parts,)
    sd_flight: Floats
    # back, sd_back: mean and sd of the time since the last impact at the same mesh; NaN where there
    # is no such prediction; (parts,)
    back: Floats
    sd_back: Floats
    # relative standard error of averages over a mean map's orbit; 0 for a law that is not an
    # average
    se: float = 0.0


def _cycle_map(scene: Scene, a: Attractor) -> tuple[Floats, Floats, Floats, Floats]:
    """Map and noise of a whole cycle on the section state after an impact; section and restitution
    map of each one."""
    c = scene.constants
    size = plain_size(c)
    first, _, _ = section_derivatives(c, Impacts.of(a), size)
    flights = zip(a.tau[:-1], np.diff(a.tau), strict=True)
    covariances = np.array([noise_covariance(c, tau, t) for tau, t in flights])
    noise = transform(first[:, :, size:], covariances)
    flown = first[:, :, :size]
    hit = np.array([contact_matrix(c, mesh, 0.0, size, 1) for mesh in a.mesh[1:]])
    whole = np.eye(size)
    added = np.zeros((size, size))
    for f, q, h in zip(flown, noise, hit, strict=True):
        step = h @ f
        whole = step @ whole
        added = step @ added @ step.T + h @ q @ h.T
    return whole, added, flown, hit


def linear_law(scene: Scene, a: Attractor) -> Law:
    """The stationary law of the linear closure at a stable periodic orbit."""
    if a.kind != PERIODIC:
        raise NotPredicted(f"the orbit {a.reason}")
    if scene.correlation_time:
        raise NotPredicted(
            "the noise has a memory; the stationary covariance is that of white noise"
        )
    if a.sticks:
        raise NotPredicted("the orbit sticks at times: its linearisation ends there")
    if scene.tolerance is not None and scene.tolerance.distribution != "fixed":
        raise NotPredicted(
            "the tolerance is random; the stationary covariance is that of the noise alone"
        )
    struck = struck_speeds(a.mesh[1:], a.before[1:])
    speeds = np.abs(struck)
    if speeds.min() < GRAZE * max(speeds.max(), scene.alpha):
        raise NotPredicted("the orbit grazes a wall: no derivative there")
    whole, added, flown, hit = _cycle_map(scene, a)
    largest = float(np.abs(np.linalg.eigvals(whole)).max())
    if largest >= 1.0 - 1e-9:
        raise NotPredicted(f"the orbit is not stable (multiplier {largest:.6g})")
    solved = np.asarray(solve_discrete_lyapunov(whole, added), dtype=np.float64)
    start = 0.5 * (solved + solved.T)
    shift, sd, section, after = _second_order(scene, a, start, largest)
    n = a.impacts
    rates = np.arange(n), 1 + 2 * a.mesh[1:]  # places of the struck rates
    back, sd_back = _since_same_mesh(a, flown, hit, section, after)
    rate = n / (2.0 * math.pi * a.periods)
    flight = np.diff(a.tau) + np.nan_to_num(shift[:, 1])
    speed = speeds + np.sign(struck) * shift[rates]
    return Law(
        rate, np.full(n, 1.0 / n), a.mesh[1:], speed, sd[rates], flight, sd[:, 1], back, sd_back
    )


def _second_order(
    scene: Scene, a: Attractor, start: Floats, largest: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean shifts, sds and covariances before and after the impacts of the last of many cycles; the
    first is linear.

    The covariance starts as the stationary one; the shift of the mean converges from cycle to
    cycle.
    """
    n = a.impacts
    passes = min(
        2 + (math.ceil(math.log(LEAST_OF_START) / math.log(largest)) if largest > 0.0 else 0),
        MOST_PASSES,
    )
    turn = 2.0 * math.pi * a.periods
    cycles = Impacts(
        *(np.concatenate([values[:1], *[values[1:]] * passes]) for values in Impacts.of(a))
    )
    cycles.tau[1:] += turn * np.repeat(np.arange(passes), n)
    _, shift, sd, _, section, after = propagate(
        scene.constants, cycles, passes * n, start, np.zeros(0), True
    )
    return shift[-n:], sd[-n:], section[-n:], after[-n:]


def _since_same_mesh(
    a: Attractor, flown: Floats, hit: Floats, section: Floats, after: Floats
) -> tuple[Floats, Floats]:
    """Mean and sd of the time since the last impact at the same mesh, for each impact of a
    cycle."""
    n = a.impacts
    turn = 2.0 * math.pi * a.periods
    mean, sd = unknown(2, n)
    for k in range(n):
        # derivative of the state before impact k by that after an earlier one
        reach = np.eye(section.shape[1])
        for steps in range(1, n + 1):
            j = k - steps
            reach = (
                reach @ flown[k] if steps == 1 else reach @ hit[(j + 1) % n] @ flown[(j + 1) % n]
            )
            if a.mesh[1 + j % n] != a.mesh[1 + k]:
                continue
            mean[k] = a.tau[1 + k] - a.tau[1 + j % n] + (turn if j < 0 else 0.0)
            covariance = (reach @ after[j % n])[0, 0]
            sd[k] = math.sqrt(max(section[k, 0, 0] + after[j % n, 0, 0] - 2.0 * covariance, 0.0))
            break
    return mean, sd


def _check(scene: Scene, closure: str) -> None:
    """Say why a closure that does not apply to a scene predicts nothing."""
    if why := refusals(scene).get(closure):
        raise NotPredicted(why)


def orbit_average(scene: Scene, closure: str) -> Law:
    """The average over the orbit of a closure's mean map, which the paper takes for the stationary
    law."""
    _check(scene, closure)
    t = mean_map(scene.phase_reduced, impacts=MAPPED, closure=closure, order=2).trace
    if t.found < MAPPED:
        raise NotPredicted(f"the mean map ends at impact {t.found}: {t.stopped}")
    last = unknown(t.wheels + 1)
    since = unknown(MAPPED + 1)
    for k in range(1, MAPPED + 1):
        since[k] = t.tau[k] - last[t.mesh[k]]
        last[t.mesh[k]] = t.tau[k]
    part = slice(DROPPED, MAPPED + 1)
    tau = t.tau[part]
    mesh = t.mesh[part]
    back = since[part]
    n = tau.size - 1
    speed = np.abs(struck_speeds(mesh, t.mean[part]))[1:]
    zero = np.zeros(n)
    spread = (
        speed[: n // 32 * 32].reshape(32, -1).mean(axis=1).std(ddof=1)
        / math.sqrt(32.0)
        / speed.mean()
    )
    rate = n / float(tau[-1] - tau[0])
    weight = np.full(n, 1.0 / n)
    return Law(
        rate, weight, mesh[1:], speed, zero, np.diff(tau), zero, back[1:], zero, float(spread)
    )


def branching_law(scene: Scene) -> Law:
    """The mixture of `branching` once it no longer changes from impact to impact."""
    _check(scene, "branching")
    t = mean_map(scene.phase_reduced, impacts=BRANCHED, closure="branching").trace
    if t.found < BRANCHED or t.parts is None or t.discarded is None:
        raise NotPredicted(f"it ends at impact {t.found}: {t.stopped}")
    if t.discarded[BRANCHED] > DISCARDED:
        raise NotPredicted(
            f"it has discarded {t.discarded[BRANCHED]:.1%} of the probability by impact {BRANCHED}"
        )
    half = BRANCHED // 2
    last = 3 * BRANCHED // 4
    early, late = (_join(t.parts, range(a + 1, b + 1)) for a, b in ((half, last), (last, BRANCHED)))
    for name in ("flight", "speed"):
        a, b = (float((law.weight * getattr(law, name)).sum()) for law in (early, late))
        if abs(a - b) > CONVERGED * abs(b):
            change = f"the mean {name} still changes by {abs(a / b - 1.0):.1%}"
            raise NotPredicted(f"it has not converged within {BRANCHED} impacts: {change}")
    return late


def _join(parts: dict[int, tuple[Floats, Floats, Floats]], impacts: range) -> Law:
    """The mixtures of several impacts together."""
    weight = np.concatenate([parts[k][0] for k in impacts]) / len(impacts)
    mean, variance = (np.concatenate([parts[k][i] for k in impacts]) for i in (1, 2))
    # the struck displacement lies on its wall
    mesh = 1 + variance[:, 2::2].argmin(axis=1)
    rates = np.arange(weight.size), 1 + 2 * mesh  # places of the struck rates
    nothing = unknown(weight.size)
    flight = mean[:, 1]
    sd_flight = np.sqrt(variance[:, 1])
    rate = float(1.0 / (weight * flight).sum())
    speed = np.abs(mean[rates])
    sd = np.sqrt(variance[rates])
    return Law(rate, weight, mesh, speed, sd, flight, sd_flight, nothing, nothing)
