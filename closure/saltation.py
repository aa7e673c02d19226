"""The saltation closure: first order in the noise, exactly, and its second-order corrections
(docs/model.md section 6).

What is propagated is the state that each path has at its own k-th impact (the section state: ``tau,
x1, y1, x2, y2, ...``, then the deviations of the flanks where they vary, or a noise's memory), by
the derivative of the map from section to section; at fixed times that is the saltation matrix ``Xi
= R + (F+ - R F-) g' / (g' F-)``.  From order 3 on, the second derivatives add the shift of the
mean, an O(sigma^2) effect, and the third cumulants.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from rattle.closure.moments import Trace, gap_moments
from rattle.closure.section_map import (
    column,
    plain_size,
    redrawn_variances,
    section_derivatives,
    start_covariance,
)
from rattle.scene import Constants, Floats, Ints, Scene, memory
from rattle.scene.elementary import unknown
from rattle.scene.flight import field, jacobian, noise_covariance, noise_rate
from rattle.scene.impact import (
    add_scatter,
    contact_matrix,
    falloff,
    rebound_axis,
    rebound_bend,
    slowest_impact,
)
from rattle.scene.linear_algebra import image, product, total, totals, transform
from rattle.scene.long_orbit import struck_speeds
from rattle.scene.moments import SMALLEST_DIVISOR, semidefinite
from rattle.scene.orbit import Impacts, Orbit, follow, last_until

IMPACTS_AT_ONCE = 256  # impacts whose derivatives are computed at once


class Steps(NamedTuple):
    """Steps from section to section; d components of the state, m of the noise."""

    first: Floats  # derivatives of the next state by state and noise; (steps, d, d + m)
    # second derivatives of the components `bent`; (steps, components, d + m, d + m)
    hessian: Floats
    bent: Ints  # components that are not linear
    noise: Floats  # covariances of the noise; (steps, m, m)
    kick: Floats  # covariance that white noise adds at the impact, per unit of time; (steps, d, d)


def section_start(scene: Scene) -> Floats:
    """Covariance of the section state after the start."""
    plain = start_covariance(scene)
    if not scene.correlation_time:
        return plain
    out = np.zeros((len(plain) + 1, len(plain) + 1))
    out[:-1, :-1] = plain
    out[-1, -1] = 0.5 / scene.correlation_time
    return out


def section_steps(c: Constants, at: Impacts, d: int) -> Steps:
    """The steps between successive impacts; d is the size of the section state."""
    first, hessian, bent = section_derivatives(c, at, d)
    flights = list(zip(at.tau[:-1], np.diff(at.tau), strict=True))
    common = np.zeros((len(at.tau) - 1, d))
    if c.memory:
        noise = np.array([memory.covariance(c, s, t)[0] for s, t in flights])
        common[:, d - 1] = 1.0 / c.memory
    else:
        noise = np.array([noise_covariance(c, s, t) for s, t in flights])
        for i in range(c.wheels.size):
            common[:, 2 + 2 * i] = [c.sigma * noise_rate(c, s + t, i) for s, t in flights]
    kick = common[:, :, None] * common[:, None]
    rates = slice(2, 1 + 2 * c.wheels.size, 2)
    kick[:, rates, rates] += shaking_covariance(c)
    return Steps(first, hessian, bent, noise, kick)


def shaking_covariance(c: Constants) -> Floats:
    """Covariance that noises of single wheels add to the rates of the gaps, per unit of time.

    Shapes: result (wheels, wheels).
    """
    effect = np.diag(c.wheels["alone"])  # of each noise in each gap
    for i, wheel in enumerate(c.wheels):
        effect[i, i] *= wheel.sign
        if wheel.parent >= 0:
            effect[i, wheel.parent] = wheel.ratio * c.wheels[wheel.parent].alone
    return c.sigma**2 * product(effect, effect.T)


def noise_slope(c: Constants, tau: float, t: float) -> Floats:
    """Derivative of the covariance of a flight's noise with respect to the time of its start, shape
    (m, m).

    That of white noise is ``A + B cos 2 tau + C sin 2 tau``, so a difference over a quarter of a
    period gives it exactly.  For several orders it is bilinear in the modulation m and its
    derivative: half the difference of the covariances for ``m + m'`` and ``m - m'``.
    """
    if c.memory:
        return memory.covariance(c, tau, t)[1]
    if c.drive:
        d = c.drive
        more, less = (
            c._replace(
                drive=d._replace(
                    odd=d.odd - sign * d.order * d.even, even=d.even + sign * d.order * d.odd
                )
            )
            for sign in (1.0, -1.0)
        )
        return 0.5 * (noise_covariance(more, tau, t) - noise_covariance(less, tau, t))
    eighth = 0.25 * math.pi
    return noise_covariance(c, tau + eighth, t) - noise_covariance(c, tau - eighth, t)


def propagate(
    c: Constants, at: Impacts, reached: int, start: Floats, redrawn: Floats, second: bool
) -> tuple[int, Floats, Floats, Floats, Floats, Floats]:
    """Mean shift, sd and skewness of the section quantities, and covariance of the section state
    before and after.

    `reached`: How many impacts there are. `start`: Covariance of the section state after the start;
    its size tells whether flanks vary. `redrawn`: See
    `rattle.closure.section_map.redrawn_variances`. Shapes: `start` (d, d); result (impacts + 1,
    2 + 2 wheels); result (impacts + 1, d, d).
    """
    tau = at.tau
    mesh = at.mesh
    before = at.before
    count = tau.size
    d = start.shape[0]
    plain = plain_size(c)
    shift, sd, skew = unknown(3, count, plain + 1)
    section, covariance = unknown(2, count, d, d)  # before the impact, and after it
    section[0] = covariance[0] = start
    moved = np.zeros(d)
    third = np.zeros((d, d, d))
    speed = struck_speeds(mesh[1 : reached + 1], before[1 : reached + 1])
    reached = int(np.append(np.abs(speed) < slowest_impact(c, before[0]), True).argmax())
    # place of the deviation that is drawn anew, where flanks vary
    flank = column(c.wheels.size, mesh, -at.side)
    hits = [np.eye(d)]
    for k, w in enumerate(speed[:reached].tolist(), 1):
        hit = contact_matrix(c, mesh[k], w, d, 1)
        if redrawn.size:
            hit[flank[k]] = 0.0  # nothing is known of it
        hits.append(hit)
    for low in range(0, reached, IMPACTS_AT_ONCE):
        high = min(low + IMPACTS_AT_ONCE, reached)
        ends = slice(low, high + 1)
        part = slice(low + 1, high + 1)
        steps = section_steps(c, Impacts.of(at, ends), d)
        linear = steps.first[:, :, :d]
        added = transform(steps.first[:, :, d:], steps.noise)
        for k, flown, noise in zip(range(low + 1, high + 1), linear, added, strict=True):
            section[k] = transform(flown, covariance[k - 1]) + noise
            covariance[k] = transform(hits[k], section[k])
            struck = 2 * mesh[k]
            w = before[k, struck - 1]
            add_scatter(c, mesh[k], w, section[k, struck, struck], covariance[k])
            if redrawn.size:
                covariance[k, flank[k], flank[k]] = redrawn[flank[k] - plain]
        p = covariance[low:high]
        cross = total(linear[:, 0] * p[:, 0])  # cov(tau_k, tau_k-1)
        spread = section[part, 0, 0] + p[:, 0, 0] - 2.0 * cross  # variance of the flight time
        variances = np.diagonal(section[part], axis1=1, axis2=2)[:, :plain]
        sd[part] = np.sqrt(np.maximum(np.insert(variances, 1, spread, axis=1), 0.0))
        if second:
            rebounds = [
                (hits[k], *rebound_cumulants(c, mesh[k], before[k], hits[k], section[k]))
                for k in range(low + 1, high + 1)
            ]
            slope = np.array(
                [
                    noise_slope(c, s, t)
                    for s, t in zip(tau[low:high], np.diff(tau[ends]), strict=True)
                ]
            )
            shift[part], cubes, moved, third = _carry_cumulants(
                steps, p, slope, rebounds, moved, third, plain
            )
            cube = sd[part] * sd[part] * sd[part]
            np.divide(cubes, cube, out=skew[part], where=cube > SMALLEST_DIVISOR)
    return reached, shift, sd, skew, section, covariance


def _carry_cumulants(
    steps: Steps,
    p: Floats,
    slope: Floats,
    rebounds: Sequence[tuple[Floats, Floats, Floats]],
    moved: Floats,
    third: Floats,
    plain: int,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean shift and third cumulants of the section quantities at each impact; mean shift and third
    cumulants of the section state after the last one.

    `p`: Covariance of the section state before each flight. `slope`: See `noise_slope`. `rebounds`:
    Of each impact its matrix, and the mean shift and third cumulants that it makes. `moved`,
    `third`: Mean shift and third cumulants before the first flight. Shapes: `p` (n, d, d); result
    (n, 1 + plain), (n, 1 + plain), (d,), (d, d, d).
    """
    first = steps.first
    hessian = steps.hessian
    q = steps.noise
    count, d, _ = p.shape
    quantities = np.arange(plain)
    linear = first[:, :, :d]
    made = produce_cumulants(steps, p, slope)
    bent = 0.5 * (
        totals(hessian[:, :, :d, :d] * p[:, None]) + totals(hessian[:, :, d:, d:] * q[:, None])
    )
    shift = np.empty((count, plain + 1))
    cubes = np.empty((count, plain))
    thirds = np.empty((count, d, d, d))
    for n, (hit, bend, produced) in enumerate(rebounds):
        last = moved[0]
        moved = image(linear[n], moved)
        thirds[n] = third
        third = map_cumulants(linear[n], third, made[n])
        moved[steps.bent] += bent[n]
        shift[n] = np.insert(moved[:plain], 1, moved[0] - last)
        cubes[n] = third[quantities, quantities, quantities]
        moved = image(hit, moved) + bend
        third = map_cumulants(hit, third, produced)
    flight = flight_cumulants(first, hessian, p, q, slope, thirds)
    return shift, np.insert(cubes, 1, flight, axis=1), moved, third


def rebound_cumulants(
    c: Constants, mesh: int, before: Floats, hit: Floats, section: Floats
) -> tuple[Floats, Floats]:
    """Mean shift and third cumulants that a restitution makes which depends on the speed or is
    random.

    ``s+ = ... + epsilon(w) w axis``, w the impact speed; its covariance with what the linear map
    makes of the state is `along`.  Shapes: `hit`, `section` (d, d); result (d,) and (d, d, d).
    """
    d = len(hit)
    wheel = c.wheels[mesh - 1]
    if wheel.slowing == 0.0 and wheel.variance == 0.0:
        return np.zeros(d), np.zeros((d, d, d))
    w = before[2 * mesh - 1]
    axis = rebound_axis(c, mesh, d)
    along = image(hit, section[2 * mesh])
    bend = rebound_bend(c, mesh, w) * axis
    left = falloff(c, mesh - 1, w)
    scattered = 2.0 * wheel.variance * left * left * w * np.multiply.outer(axis, axis)
    produced = _over_pairs(np.multiply.outer(along, along)[None], bend[None])
    produced = produced + _over_pairs(scattered[None], along[None])
    return 0.5 * section[2 * mesh, 2 * mesh] * bend, produced[0]


@np.errstate(over="ignore", invalid="ignore")
def trace(scene: Scene, impacts: int, order: int) -> Trace:
    """Follow the saltation closure, as far as its covariance is a number; to second order from
    `order` 3 on."""
    c = scene.constants
    orbit = follow(scene, impacts).until_sticking
    reached, shift, sd, skew, section, after = propagate(
        c,
        Impacts.of(orbit),
        orbit.found,
        section_start(scene),
        redrawn_variances(scene),
        order >= 3,
    )
    stopped = orbit.stopped if reached == orbit.found else f"impact {reached + 1} grazes its wall"
    finite = np.isfinite(section[: reached + 1]).all(axis=(1, 2))
    if not finite.all():
        reached = int(finite.argmin()) - 1
        stopped = f"the covariance of impact {reached + 1} is larger than any number"
        shift[reached + 1 :] = sd[reached + 1 :] = skew[reached + 1 :] = np.nan
    known = Impacts.of(orbit).until(reached)
    mean = known.before + np.nan_to_num(shift[:, 2:])
    tau = known.tau + np.nan_to_num(shift[:, 0])
    states = orbit.before.shape[1]
    covariance = unknown(impacts + 1, states, states)
    for k in range(reached + 1):
        rate = field(c, orbit.tau[k], orbit.before[k]) if k else np.zeros(states)
        covariance[k] = _at_one_time(rate, section[k, : states + 1, : states + 1], np.eye(states))
    raw = gap_moments(covariance, order)

    at = partial(_in_flight, c, orbit, reached, after)
    return Trace(
        tau,
        known.mesh,
        known.side,
        mean,
        sd,
        skew,
        covariance,
        raw,
        at,
        reached,
        stopped,
        until=float(orbit.tau[reached]),
    )


def _in_flight(
    c: Constants, orbit: Orbit, found: int, after: Floats, time: float
) -> tuple[Floats, Floats]:
    """Mean and covariance of the state at a local time, from the covariance of the section state
    after each impact."""
    k = last_until(orbit.tau[: found + 1], time)
    begin = orbit.tau[k]
    rate = field(c, begin, orbit.after[k])
    t = time - begin
    known = np.arange(plain_size(c))
    if c.memory:
        known = np.append(known, len(after[k]) - 1)
        rate = np.append(rate, 0.0)
        flown = memory.propagator(c, begin, t)[0][:-1]
        noise = memory.covariance(c, begin, t)[0][:-1, :-1]
    else:
        flown = jacobian(c, t)
        noise = noise_covariance(c, begin, t)
    spread = _at_one_time(rate, after[k][np.ix_(known, known)], flown)
    return orbit.state(time), spread + noise


def _at_one_time(rate: Floats, section: Floats, flown: Floats) -> Floats:
    """Covariance of the state at one time: ``xi = delta s - F delta tau`` propagated by a flight.

    Shapes: `rate` (n,); `section` (n + 1, n + 1); `flown` (2 wheels, n), n = 2 wheels, or one more
    where the noise has a memory; result (2 wheels, 2 wheels).
    """
    fixed = product(flown, np.concatenate([-rate[:, None], np.eye(len(rate))], axis=1))
    sd = np.sqrt(np.maximum(np.diagonal(section), 0.0))
    return semidefinite(
        transform(fixed, section), image(np.abs(flown), sd[1:] + np.abs(rate) * sd[0])
    )


def produce_cumulants(steps: Steps, p: Floats, slope: Floats) -> Floats:
    """Third cumulants that the flights from an orbit's impacts produce in the next section states.

    Shapes: `p`, `slope` (n, d, d) and (n, m, m); result (n, d, d, d).
    """
    first = steps.first
    n, d, size = steps.first.shape
    spread = np.zeros((n, size, size))  # covariance of (s, n)
    spread[:, :d, :d] = p
    spread[:, d:, d:] = steps.noise
    reach = product(first, spread)  # cov(s', (s, n))
    # d cov(s' | s) / d tau_k
    varied = transform(first[:, :, d:], slope)
    since = reach[:, :, 0]
    late = product(reach[:, :1], first.mT)[:, 0] - since  # cov(delta, s'), delta = tau' - tau - t
    # bent[:, l, i, j]: contribution of the quadratic part of component l
    bent = np.zeros((n, d, d, d))
    bent[:, steps.bent] = transform(reach[:, None], steps.hessian)
    out = bent.transpose(0, 2, 3, 1) + bent.transpose(0, 2, 1, 3) + bent
    out = out + _over_pairs(varied, since)
    return out + _over_pairs(steps.kick, late)


def _over_pairs(pair: Floats, other: Floats) -> Floats:
    """``A_ij b_k + A_ik b_j + A_jk b_i``."""
    one = other[:, None, None]
    two = other[:, None, :, None]
    three = other[:, :, None, None]
    return pair[:, :, :, None] * one + pair[:, :, None] * two + pair[:, None] * three


def map_cumulants(linear: Floats, third: Floats, produced: Floats) -> Floats:
    """Third cumulants after a linear map, added to others; shapes (d, d), (d, d, d) and (d, d,
    d)."""
    along = product(linear, third.transpose(1, 0, 2).reshape(len(linear), -1))
    turned = product(along.reshape(third.shape), linear.T).transpose(1, 0, 2)
    return produced + product(linear, turned.reshape(len(linear), -1)).reshape(third.shape)


def flight_cumulants(
    first: Floats, hessian: Floats, p: Floats, q: Floats, slope: Floats, third: Floats
) -> Floats:
    """Third cumulants of the flight times, the difference of the next tau and the last one.

    Only the next tau is nonlinear.  The noise beyond the orbit's flight time does not enter,
    because it acts on velocities.

    Shapes: `p`, `q`, `slope` (n, d, d) and (n, m, m); `third` (n, d, d, d); result (n,).
    """
    d = p.shape[1]
    delay = first[:, 0].copy()  # derivative of the flight time with respect to (s, n)
    delay[:, 0] -= 1.0
    past = delay[:, :d]
    noise = delay[:, d:]
    reach = np.concatenate([image(p, past), image(q, noise)], axis=1)  # its covariance with (s, n)
    varied = total(noise * image(slope, noise))  # d var(flight | s) / d tau_k
    bent = 3.0 * total(reach * image(hessian[:, 0], reach)) + 3.0 * varied * reach[:, 0]
    carried = past * image(image(third, past[:, None]), past)
    return total(np.column_stack([bent, carried]))
