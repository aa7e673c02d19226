"""The section state, random backlash in it, and the map from a path's own impact to its own next
one.

The section state at the k-th impact is ``s = (tau, x1, y1, x2, y2, ...)``, followed by the
deviations of two flanks of each mesh where they vary, in the order +1, -1, +2, -2, ...; flank
``side`` of a mesh stands at ``side (g + c)``, c its deviation. ``s' = H(s, n)``: let the path fly
for the orbit's flight time, add the flight's noise ``n ~ N(0, Q)``, and continue (or go back)
without noise to the path's own wall.

A deviation that is drawn once per path is up to `DEVIATION_PIECES` Gaussians for the branching
closure, each with the mean and variance of the distribution in one cell of ``[-c_max, c_max]``: the
tails of a single one reach events that no gear has (the means of DAT21 without noise are wrong by
0.2 sds with one, by 0.02 with six).  One that is drawn anew at each contact is one Gaussian:
several would use up mixture components that the itineraries need.
"""

import math
from typing import NamedTuple, TypeVar

import numpy as np

from rattle.closure.exponentials import exponentials
from rattle.scene import Constants, Floats, Ints, Scene, Tolerance, memory
from rattle.scene.compiled import internal, jit, little_code
from rattle.scene.elementary import each, gauss_legendre
from rattle.scene.flight import field, field_rate, jacobian, system_matrix
from rattle.scene.linear_algebra import add_outer, apply, put_scaled, times, transform
from rattle.scene.orbit import Impacts
from rattle.scene.parts import UNIT_VARIANCE
from rattle.scene.tangent import land
from rattle.scene.types import CUT
from rattle.scene.wheel import with_wheels

Number = TypeVar("Number", int, Ints)

# smallest half gap, as a share of the nominal one: the tail of a Gaussian must not close the gap
NARROWEST = 0.01
DEVIATION_PIECES = 6  # Gaussians for the distribution of a deviation that is drawn once per path
# most combinations of them, over all meshes: with more random meshes each has fewer Gaussians
MOST_COMBINATIONS = 36
CELL_NODES = 20  # of the quadrature over a cell


class Pieces(NamedTuple):
    """A mixture of Gaussians, over one deviation or over the section state."""

    weight: Floats  # probabilities; their sum is 1; (components,)
    mean: Floats  # of each component; (components,) or (components, d)
    # variances of one deviation, or covariances; (components,) or (components, d, d)
    variance: Floats


@internal
def plain_size(c: Constants) -> int:
    """Components of the section state where no flank varies: tau, and x and y of every gap."""
    size: int = 1 + 2 * c.wheels.size
    return size


def random_tolerance(scene: Scene) -> Tolerance | None:
    """The tolerance of a scene if a flank is random."""
    return scene.tolerance if flank_variances(scene).any() else None


def flank_variances(scene: Scene) -> Floats:
    """Variances of the deviations of both flanks of each mesh, shape (2 wheels,)."""
    widths = np.array([wheel.tolerance for wheel in scene.tree])
    unit = UNIT_VARIANCE[scene.tolerance.distribution] if scene.tolerance is not None else 0.0
    return np.repeat(widths**2 * unit, 2)


def pieces(distribution: str, count: int) -> Pieces:
    """A random deviation as a mixture, one Gaussian for each of `count` cells that are narrower
    towards the ends."""
    edges = -each(math.cos, np.linspace(0.0, np.pi, count + 1))
    node, share = gauss_legendre(CELL_NODES)
    c = 0.5 * (edges[:-1, None] + edges[1:, None] + np.diff(edges)[:, None] * node)
    mass = share * np.diff(edges)[:, None]
    if distribution == "normal":
        mass = mass * exponentials(-0.5 * (CUT * c) ** 2)
    weight = mass.sum(axis=1)
    mean = (mass * c).sum(axis=1) / weight
    variance = (mass * (c - mean[:, None]) ** 2).sum(axis=1) / weight
    return Pieces(weight / weight.sum(), mean, variance)


def _place(scene: Scene) -> Floats:
    """Derivative of the section state after the start with respect to the deviations of the flanks,
    shape (1 + 4 wheels, 2 wheels)."""
    flanks = 2 * len(scene.tree)
    out = np.eye(1 + 2 * flanks, flanks, -1 - flanks)
    for i, (wheel, x) in enumerate(zip(scene.tree, scene.start.values[::2], strict=False)):
        side = wheel.side_of(x)
        if side != 0:  # the start lies on each path's own flank
            out[1 + 2 * i, 2 * i + (side < 0)] = side
    return out


def start_covariance(scene: Scene) -> Floats:
    """Covariance of the section state after the start, which only random flanks give it.

    Returns: Of ``(tau, x1, y1, ...)``, and of the deviations of +1, -1, +2, -2, ... where flanks
    vary. Shapes: result (1 + 4 wheels, 1 + 4 wheels), or (1 + 2 wheels, 1 + 2 wheels).
    """
    tolerance = random_tolerance(scene)
    if tolerance is None:
        return np.zeros((1 + 2 * len(scene.tree),) * 2)
    variance = flank_variances(scene)
    flanks = np.diag(variance)
    if tolerance.draw == "path":  # both flanks of a mesh have one deviation
        for plus in range(0, len(variance), 2):
            flanks[plus, plus + 1] = flanks[plus + 1, plus] = variance[plus]
    return transform(_place(scene), flanks)


def redrawn_variances(scene: Scene) -> Floats:
    """Variances of the deviations of +1, -1, +2, -2, ... that contacts draw anew, shape
    (2 wheels,); empty if none are."""
    tolerance = random_tolerance(scene)
    return flank_variances(scene) if tolerance and tolerance.draw == "contact" else np.zeros(0)


def start_pieces(scene: Scene) -> Pieces:
    """The section state after the start relative to the orbit's, as a mixture over the deviations
    drawn once per path.

    Returns: Over 1 + 4 wheels quantities, or 1 + 2 wheels where no flank varies; one component if
    deviations are drawn per contact.
    """
    tolerance = random_tolerance(scene)
    if tolerance is None or tolerance.draw == "contact":
        whole = start_covariance(scene)
        return Pieces(np.ones(1), np.zeros((1, len(whole))), whole[None])
    widths = {i: wheel.tolerance for i, wheel in enumerate(scene.tree) if wheel.tolerance > 0.0}
    most = int(MOST_COMBINATIONS ** (1.0 / len(widths)) + 1e-9)
    cut = pieces(tolerance.distribution, min(DEVIATION_PIECES, most))
    to = _place(scene)
    d = len(to)
    weight = np.ones(1)
    mean = np.zeros((1, d))
    variance = np.zeros((1, d, d))
    for i, width in widths.items():
        # both flanks of a mesh have one deviation
        by = width * (to[:, 2 * i] + to[:, 2 * i + 1])
        weight = (weight[:, None] * cut.weight).ravel()
        mean = (mean[:, None] + cut.mean[:, None] * by).reshape(-1, d)
        spread = cut.variance[:, None, None] * np.outer(by, by)
        variance = (variance[:, None] + spread).reshape(-1, d, d)
    return Pieces(weight, mean, variance)


@internal
def column(wheels: int, mesh: Number, side: Number) -> Number:
    """Index of a flank's deviation in the section state; of arrays, one by one."""
    return 2 * (wheels + mesh) - 1 + (side < 0)


@internal
def between(c: Constants, e: Floats, middle: Floats) -> Constants:
    """A scene with given flank deviations, in its half gaps; the centres of the gaps are written to
    `middle`.

    Shapes: `e` (1 + 4 wheels,); `middle` (wheels,).
    """
    wheels = c.wheels.copy()
    for i, wheel in enumerate(wheels):
        plus = column(wheels.size, i + 1, 1)
        wall = wheel.wall
        wheel.wall = max(wall + 0.5 * (e[plus] + e[plus + 1]), NARROWEST * wall)
        wheel.low = wheel.wall if wheel.low < math.inf else math.inf
        middle[i] = 0.5 * (e[plus] - e[plus + 1])
    return with_wheels(c, wheels)


class LinearFlight(NamedTuple):
    """A flight linearised along the orbit, in k components: those of the state, and a noise's
    memory where it has one."""

    propagator: Floats  # derivative of the end by the start; (k, k)
    matrix: Floats  # of the linear flight, at its end; (k, k)
    # drift at the start and at the end of the flight; (k,)
    begun: Floats
    rate: Floats
    # partial derivatives by time of the drift at the start and at the end; (k,)
    initial: Floats
    explicit: Floats
    turned: Floats  # derivative by the time of the start of the effect of the memory; (k,)


@jit
def linearise_flight(
    c: Constants, tau: float, after: Floats, t: float, before: Floats
) -> LinearFlight:
    """Linearise a flight of time `t` under white noise, from a state `after` an impact to one
    `before` the next."""
    return LinearFlight(
        jacobian(c, t),
        system_matrix(c),
        field(c, tau, after),
        field(c, tau + t, before),
        field_rate(c, tau),
        field_rate(c, tau + t),
        np.zeros(before.size),
    )


def _linearise_with_memory(
    c: Constants, tau: float, after: Floats, t: float, before: Floats
) -> LinearFlight:
    """The same where the noise has a memory, which is 0 on the orbit."""
    white = linearise_flight(c, tau, after, t, before)
    begun, rate, initial, explicit = (np.append(drift, 0.0) for drift in white[2:6])
    propagator, turned = memory.propagator(c, tau, t)
    matrix = memory.matrix(c, tau + t)
    return LinearFlight(propagator, matrix, begun, rate, initial, explicit, turned[:, -1].copy())


def section_derivatives(c: Constants, at: Impacts, d: int) -> tuple[Floats, Floats, Ints]:
    """`derivatives` of each flight between impacts.

    Returns: First and second derivatives, and the components that the second are of.  Shapes: (n,
    d, d + k); (n, 1 + k, d + k, d + k); (1 + k,).
    """
    linearise = _linearise_with_memory if c.memory else linearise_flight
    of_flights = [
        derivatives(linearise(c, tau, after, t, before), mesh, side, d)
        for tau, after, t, before, mesh, side in zip(
            at.tau, at.after, np.diff(at.tau), at.before[1:], at.mesh[1:], at.side[1:], strict=False
        )
    ]
    first, second = (np.array(derivative) for derivative in zip(*of_flights, strict=True))
    states = second.shape[1] - 1
    bent = [0, *(section_index(k, states, d) for k in range(states))]
    return first, second, np.array(bent)


@internal
def section_index(k: int, states: int, d: int) -> int:
    """Index of component k of the state in the section state; a memory, which makes their number
    odd, is the last of both."""
    return d - 1 if k + 1 == states and states % 2 == 1 else 1 + k


@jit
def derivatives(flight: LinearFlight, mesh: int, side: int, d: int) -> tuple[Floats, Floats]:
    """First and second derivatives of the section map with respect to ``(s, n)``, exact.

    The flight is linear except in the phase of its start; the other nonlinearity is the time at
    which it ends.  A memory is the last component of the section state.  Second derivatives are
    those of tau and of the k components of the flight; the flanks have none.

    Shapes: `first` (d, d + k); `second` (1 + k, d + k, d + k).
    """
    little_code()
    drift_rate = flight.rate
    explicit = flight.explicit
    propagator = flight.propagator
    states = drift_rate.size
    size = d + states
    has_memory = states % 2 == 1
    i = 2 * mesh - 1  # place of the struck displacement
    flank = column(states // 2, mesh, side)
    varies = d > states + 1
    # of the section state at the orbit's impact time, later on its wall; its drift, and how that
    # changes
    flown = np.zeros((d, size))
    rate = np.zeros(d)
    matrix = np.zeros((d, d))
    flown[0, 0] = 1.0
    rate[0] = 1.0
    for k in range(1 + states - has_memory, d):
        flown[k, k] = 1.0
    begun = apply(propagator, flight.begun)
    for k in range(states):
        at = section_index(k, states, d)
        rate[at] = drift_rate[k]
        flown[at, 0] = rate[at] - begun[k]
        flown[at, d + k] = 1.0
        for m in range(states):
            flown[at, section_index(m, states, d)] = propagator[k, m]
            matrix[at, section_index(m, states, d)] = flight.matrix[k, m]
    drift = times(matrix, flown)
    bend = apply(matrix, rate)  # second time derivative along the flight
    if varies:
        flown[i, flank] -= side  # the wall moves
    late = land(rate, i, flown)
    for m in range(size):  # the struck displacement is on its wall
        flown[i, m] = 0.0
    if varies:
        flown[i, flank] = side
    second = np.zeros((1 + states, size, size))
    start_term = apply(propagator, flight.initial)
    for k in range(states):
        at = section_index(k, states, d)
        drift[at, 0] += explicit[k]
        bend[at] += explicit[k]
        curve = second[1 + k]
        add_outer(curve, 1.0, drift[at], late)
        add_outer(curve, 1.0, late, drift[at])
        add_outer(curve, bend[at], late, late)
        curve[0, 0] += drift[at, 0] - start_term[k]
        if has_memory:
            curve[0, d - 1] += flight.turned[k]
            curve[d - 1, 0] += flight.turned[k]
    for m in range(size):
        put_scaled(second[0, m], second[i, m], -rate[i])
        for k in range(states):
            for n in range(size):
                second[1 + k, m, n] += drift_rate[k] * second[0, m, n]
        for n in range(size):
            second[i, m, n] = 0.0
    return flown, second
