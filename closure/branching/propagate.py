"""A Gaussian component: its axes, the boundary to another next impact, and its image there, to
second order.

The next impact is a function of a point ``e = (tau, x1, y1, x2, y2, ...)``, with the deviations of
the flanks where they vary, d numbers in all; a Gaussian component is a centre and a square root of
its covariance, the `axes`.
"""

import math
from typing import NamedTuple, cast

import numpy as np

from rattle.closure.branching.mixture import Mixture
from rattle.closure.section_map import (
    between,
    column,
    derivatives,
    linearise_flight,
    plain_size,
)
from rattle.scene import Constants, Floats
from rattle.scene.compiled import internal, jit, little_code, splice
from rattle.scene.flight import field, flow, jacobian, noise_covariance
from rattle.scene.impact import next_impact
from rattle.scene.linear_algebra import (
    add_outer,
    apply,
    beyond,
    congruence,
    dot,
    eigen,
    inner,
    norm,
    put,
    put_row,
    put_scaled,
    quadratic,
    times,
    times_transposed,
)

NO_IMPACTS = cast(int, np.int64(0))
"""Bit mask of no impacts, of a non-literal type: numba compiles a function again for a literal."""
BISECTIONS = 6  # steps to locate a boundary, and as many again for the nearest one
NEWTON_RETURNS = 8  # Newton steps back to a wall, from beyond it: each squares the relative error
LONGEST_FLIGHT = 100.0  # longest flight; a component without an impact by then is discarded
# A standard normal approximated by three Gaussians of equal width: weight of the outer ones, width,
# and their distance.
THIRD_WEIGHT = 0.2252246249
THIRD_WIDTH = 0.6715662887
THIRD_CENTRE = math.sqrt(0.5 * (1.0 - THIRD_WIDTH**2) / THIRD_WEIGHT)
# ratio of second-order to first-order sd from which two sigma points replace the Taylor expansion
SIGMA_POINT_RATIO = 0.1
# slowest impact at which derivatives are taken, in units of the speed that the Gaussian's spread
# allows
SLOWEST_IN_SPREADS = 2.0
# the same of a wall that stands alone, to which a body comes back: grazes are rarer there
SLOWEST_ALONE = 1.0


@splice
def _return(
    c: Constants, e: Floats, start: Floats, mesh: int, side: int, late: float, before: Floats
) -> tuple[float, Floats]:
    """When a flight that begins beyond a wall is back at it, and the state then, from a time by
    which it is and the state then.

    Noise that is moved back to the start of a flight puts it on either side of the wall that was
    just left, and `next_impact` takes what is beyond a wall as if it were at it.

    Shapes: `e` (d,); `start`, `before` (2 wheels,).
    """
    i = 2 * mesh - 2
    wall = c.wheels[mesh - 1].wall
    t = late
    for _ in range(NEWTON_RETURNS):
        state = flow(c, e[0], start, t)
        beyond = side * state[i] - wall
        speed = side * state[i + 1]
        if speed <= 0.0:  # it turns around beyond the wall
            break
        before = state
        before[i] = side * wall
        late = t
        t = t - beyond / speed
        if t <= 0.0 or t == late:
            break
    return late, before


@internal
def event(c: Constants, e: Floats) -> tuple[float, int, Floats]:
    """The next impact from a point: its time, ``mesh * side`` or 0 for none, and the state just
    before it.

    Shapes: `e` (d,); result (2 wheels,).
    """
    little_code()
    middle = np.zeros(c.wheels.size)
    if e.size > plain_size(c):
        c = between(c, e, middle)
    start = e[1 : plain_size(c)].copy()
    for i in range(middle.size):
        start[2 * i] -= middle[i]
    t, mesh, side, before = next_impact(c, e[0], start, LONGEST_FLIGHT)
    if t > 0.0 and mesh > 0 and side * start[2 * mesh - 2] > c.wheels[mesh - 1].wall:
        t, before = _return(c, e, start, mesh, side, t, before)
    for i in range(middle.size):
        before[2 * i] += middle[i]
    return t, (mesh * side if mesh > 0 else 0), before


@internal
def root(sigma: Floats, plain: int) -> tuple[int, Floats]:
    """Square root of a covariance by its principal axes.

    Components of the flanks are scaled differently before the eigendecomposition: two flanks of
    equal variance have no unique principal axes, and rounding would choose them.  The sign of each
    axis is fixed too.

    `plain`: Components that are not of the flanks. Shapes: `sigma` (d, d); `axes` (d, d).
    """
    little_code()
    d = sigma.shape[0]
    weight = np.ones(d)
    weighed = sigma
    if d > plain:
        weighed = np.empty((d, d))
        for i in range(plain, d):
            weight[i] += (i - plain) / 8.0
        for i in range(d):
            for k in range(d):
                weighed[i, k] = weight[i] * sigma[i, k] * weight[k]
    values, vectors = eigen(weighed)
    columns = np.zeros((d, d))
    rank = 0
    for i in range(d - 1, -1, -1):
        if values[i] > 1e-14 * values[d - 1] and values[i] > 0.0:
            sense = 0.0
            for k in range(d):
                sense += (k + 1) * vectors[k, i]
            for k in range(d):
                columns[k, rank] = (
                    math.copysign(math.sqrt(values[i]), sense) * vectors[k, i] / weight[k]
                )
            rank += 1
    return rank, columns


@internal
def mark(c: Constants, code: int) -> int:
    """The bit of an impact, ``mesh * side`` or 0 for none, in a mask of impacts."""
    bit: int = 1 << (code + c.wheels.size)
    return bit


@internal
def _boundary(
    c: Constants,
    centre: Floats,
    axes: Floats,
    u: Floats,
    code: int,
    ignored: int,
    near: float,
    far: float,
) -> tuple[float, int]:
    """Distance (in sds) along a unit vector at which the next impact changes from `code`, and to
    which.

    It is searched for from `near`, where the next impact is `code`, to `far`.
    """
    little_code()
    direction = apply(axes, u)
    other = event(c, beyond(centre, far, direction))[1]
    if other == code:
        return np.inf, code
    low = near
    high = far
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        met = event(c, beyond(centre, middle, direction))[1]
        if met == code:
            low = middle
        else:
            high = middle
            other = met
    if ignored & mark(c, other):
        return np.inf, code
    return max(high, 1e-3), other


@splice
def cut_plane(
    c: Constants,
    centre: Floats,
    axes: Floats,
    code: int,
    ignored: int,
    reach: float,
) -> tuple[int, Floats]:
    """The nearest boundary to another next impact, as a plane ``q z = 1`` with z along the
    principal axes.

    The nearest point of the boundary is searched for as in the first-order reliability method
    (Hasofer and Lind 1974): from the best axis, along the normal of the plane through nearby points
    of the boundary.

    Shapes: `centre` (d,); `axes` (d, rank); `q` (rank,).
    """
    rank = axes.shape[1]
    far = 1.6 * reach  # a slanted plane within reach cuts one of the axes there
    nearest = np.inf
    other = code
    u = np.zeros(rank)
    trial = np.zeros(rank)
    for ray in range(2 * rank):
        trial[:] = 0.0
        trial[ray // 2] = 1.0 if ray % 2 == 0 else -1.0
        distance, met = _boundary(c, centre, axes, trial, code, ignored, 0.0, far)
        if distance < nearest:
            nearest = distance
            other = met
            put_row(u, trial)
    if other == code:
        return code, u
    for _ in range(2):
        q = np.zeros(rank)
        for i in range(rank):
            put_row(trial, u)
            trial[i] += 0.5
            length = norm(trial)
            put_scaled(trial, trial, length)
            distance, met = _boundary(c, centre, axes, trial, code, ignored, 0.0, far)
            q[i] = 2.0 * ((length / distance if met == other else 0.0) - 1.0 / nearest)
        length = norm(q)
        if length == 0.0:
            break
        put_scaled(trial, q, length)
        distance, met = _boundary(c, centre, axes, trial, code, ignored, 0.0, far)
        if not (met == other and distance < nearest):
            break
        nearest = distance
        put_row(u, trial)
    # a step of the search is 0.1 sds, and so much further off the weight beyond is smaller by a
    # third
    near = max(nearest - far / 2.0**BISECTIONS, 0.0)
    nearest = _boundary(c, centre, axes, u, code, NO_IMPACTS, near, nearest)[0]
    if nearest > reach:
        return code, u
    put_scaled(u, u, nearest)
    return other, u


@jit
def half(depth: float, inner: bool) -> tuple[float, float, float]:
    """Moments of a standard normal restricted to one side of a plane."""
    beyond = 0.5 * math.erfc(depth / math.sqrt(2.0))
    weight = 1.0 - beyond if inner else beyond
    rate = (
        math.exp(-0.5 * depth * depth)
        / math.sqrt(2.0 * math.pi)
        / weight
        * (-1.0 if inner else 1.0)
    )
    return weight, rate, 1.0 + depth * rate - rate * rate


@internal
def _passing(
    c: Constants, code: int, centre: Floats, axes: Floats, t: float, before: Floats
) -> Floats:
    """Derivatives along the axes of the distance by which a flight of time `t`, to a state
    `before`, passes a wall.

    Shapes: `centre` (d,); `axes` (d, rank); `before` (2 wheels,); result (rank,).
    """
    little_code()
    mesh = abs(code)
    side = 1 if code > 0 else -1
    i = 2 * mesh - 2
    flown = jacobian(c, t)[i]
    plain = plain_size(c)
    early = before[i + 1] - dot(flown, field(c, centre[0], centre[1:plain]))
    passing = np.zeros(axes.shape[1])
    for k in range(passing.size):
        for m in range(flown.size):
            passing[k] += flown[m] * axes[1 + m, k]
        passing[k] += early * axes[0, k]
        if centre.size > plain:
            passing[k] -= side * axes[column(c.wheels.size, mesh, side), k]
    return passing


@splice
def own_spread(
    c: Constants, centre: Floats, axes: Floats, there: Floats, t: float, last: int
) -> float:
    """Sd of the distance to a wall by the noise until it is met, over that by the noise of the
    whole flight.

    1 where it is met later than that, and for the wall just left: no plane divides the paths that
    leave it slowly into those that return at once and the others.

    `there`: A point from which that wall is met. `t`: Time of the flight whose noise was added.
    `last`: The wall just left.

    Shapes: `centre`, `there` (d,); `axes` (d, rank).
    """
    early, code, before = event(c, there)
    if code == 0 or code == last or early >= t:
        return 1.0
    whole = norm(_passing(c, code, centre, axes, early, before))
    late = congruence(jacobian(c, early - t), noise_covariance(c, centre[0] + early, t - early))
    i = 2 * abs(code) - 2
    return math.sqrt(max(1.0 - late[i, i] / (whole * whole), 0.0)) if whole > 0.0 else 1.0


class Image(NamedTuple):
    """Images of Gaussian components just before their next impact."""

    section: Mixture  # section states; the label is ``mesh * side`` of the impact, 0 for none
    flight: Floats  # mean and variance of the flight time; (components, 2)
    # covariance of the section state at the start of the flight, its noise included, with the time
    # of the impact; (components, d)
    crossing: Floats


@splice
def _derivatives(
    c: Constants, code: int, centre: Floats, axes: Floats, t: float, before: Floats
) -> tuple[Floats, Floats]:
    """Derivatives of the section map along the axes; near a graze, those at a slightly faster
    impact.

    Near a graze the impact speed is proportional to the square root of the distance by which the
    flight would pass the wall, and its derivative is unbounded.  So the impact speed is bounded
    below by what the Gaussian's own sd of that distance produces.
    """
    mesh = abs(code)
    side = 1 if code > 0 else -1
    d = centre.size
    i = 2 * mesh - 2
    passing = _passing(c, code, centre, axes, t, before)
    pull = field(c, centre[0] + t, before)[i + 1]
    spreads = SLOWEST_IN_SPREADS if c.wheels[mesh - 1].low < math.inf else SLOWEST_ALONE
    slowest = spreads * math.sqrt(2.0 * abs(pull) * norm(passing)) + 1e-9
    regular = before.copy()
    regular[i + 1] = side * max(slowest, side * before[i + 1])
    plain = plain_size(c)
    flight = linearise_flight(c, centre[0], centre[1:plain], t, regular)
    first, second = derivatives(flight, mesh, side, d)
    linear = times(first[:, :d].copy(), axes)
    curve = np.zeros((plain, axes.shape[1], axes.shape[1]))
    for j in range(plain):
        put(curve[j], quadratic(second[j, :d, :d].copy(), axes))
    return linear, curve


@splice
def _most_bent(linear: Floats, curve: Floats) -> tuple[float, Floats]:
    """Largest ratio of second-order to first-order variance over the outputs, and the direction of
    that curvature."""
    u = np.zeros(linear.shape[1])
    worst = 0.0
    at = 0
    for j in range(curve.shape[0]):
        variance = inner(linear[j : j + 1], linear[j : j + 1])
        if variance > 1e-24:
            bend = 0.5 * inner(curve[j], curve[j]) / variance
            if bend > worst:
                worst = bend
                at = j
    if worst > 0.0:
        values, vectors = eigen(curve[at])
        most = values.size - 1 if values[-1] > -values[0] else 0
        for k in range(u.size):
            u[k] = vectors[k, most]
    return worst, u


@splice
def propagate(
    c: Constants, centre: Floats, axes: Floats, to: Image, at: int
) -> tuple[float, Floats]:
    """Propagate a Gaussian to its next impact, to second order in its spread.

    Shapes: `centre` (d,); `axes` (d, rank); `u` (rank,).
    """
    t, code, before = event(c, centre)
    section = to.section
    section.label[at] = code
    d, rank = axes.shape
    plain = plain_size(c)
    mean = section.mean[at]
    spread = section.covariance[at]
    flight = to.flight[at]
    put_row(mean, centre)
    put_row(mean[1:], before)
    mean[0] += t
    spread[:] = 0.0
    to.crossing[at] = 0.0
    flight[0] = t
    flight[1] = 0.0
    if code == 0 or rank == 0:
        return 0.0, np.zeros(rank)
    linear, curve = _derivatives(c, code, centre, axes, t, before)
    bend, u = _most_bent(linear, curve)
    straight = bend < SIGMA_POINT_RATIO**2
    # delay: derivative of the flight time
    delay = np.empty(rank)
    image = apply(linear, u)
    # treat the most curved direction by two sigma points, at one sd to either side
    if not straight:
        add_outer(linear, -1.0, image, u)
    tilt = dot(axes[0], u)
    v = apply(axes, u)
    for k in range(rank):
        delay[k] = linear[0, k] - axes[0, k] + (0.0 if straight else tilt * u[k])
    put(spread, times_transposed(linear, linear))
    put_row(to.crossing[at], apply(axes, linear[0]))
    flight[1] = dot(delay, delay)
    if straight:
        for j in range(plain):
            trace = 0.0
            for k in range(rank):
                trace += curve[j, k, k]
            mean[j] += 0.5 * trace
            for k in range(plain):
                spread[j, k] += 0.5 * inner(curve[j], curve[k])
            if j == 0:
                flight[0] += 0.5 * trace
                flight[1] += 0.5 * inner(curve[0], curve[0])
        return bend, u
    ends = np.empty((2, d))
    flights = np.empty(2)
    met = 0
    for k in range(2):
        end = ends[k]
        put_row(end, beyond(centre, 1.0 - 2.0 * k, v))
        flights[k], there, before = event(c, end)
        met += there == code
        end[0] += flights[k]
        put_row(end[1:], before)
    if met == 2:
        for j in range(d):
            mean[j] = 0.5 * (ends[0, j] + ends[1, j])
        apart = beyond(ends[0], -1.0, ends[1])
        add_outer(spread, 0.25, apart, apart)
        flight[0] = 0.5 * (flights[0] + flights[1])
        flight[1] += 0.25 * (flights[0] - flights[1]) ** 2
        for j in range(d):
            to.crossing[at, j] += 0.5 * apart[0] * v[j]
    return bend, u
