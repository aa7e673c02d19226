"""The section state, random backlash in it, and the map from a path's own impact to its own next
one.

The section state at the k-th impact is ``s = (tau, x1, y1, x2, y2)``, followed by the deviations of
four flanks where they vary, in the order +1, -1, +2, -2; flank ``side`` of a mesh stands at ``side
(g + c)``, c its deviation. ``s' = H(s, n)``: let the path fly for the orbit's flight time, add the
flight's noise ``n ~ N(0, Q)``, and continue (or go back) without noise to the path's own wall.

A deviation that is drawn once per path is `PIECES` Gaussians for the branching closure, each with
the mean and variance of the distribution in one cell of ``[-c_max, c_max]``: the tails of a single
one reach events that no gear has (the means of DAT21 without noise are wrong by 0.2 sds with one,
by 0.02 with six).  One that is drawn anew at each contact is one Gaussian: several would use up
mixture components that the itineraries need.
"""

import math
from typing import NamedTuple, TypeVar

import numpy as np

from rattle.scene import Constants, Floats, Ints, Scene, Tolerance
from rattle.scene.compiled import internal, shared, splice
from rattle.scene.elementary import each, exponentials, gauss_legendre
from rattle.scene.flight import field, field_rate, jacobian, system_matrix
from rattle.scene.impact import contact_matrix
from rattle.scene.linear_algebra import apply, times, transform
from rattle.scene.types import CUT

Number = TypeVar("Number", int, Ints)

PLAIN = 5  # components of the section state where no flank varies
# smallest half gap, as a share of the nominal one: the tail of a Gaussian must not close the gap
NARROWEST = 0.01
PIECES = 6  # Gaussians for the distribution of a deviation that is drawn once per path
NODES = 20  # of the quadrature over a cell


class Pieces(NamedTuple):
    """A mixture of Gaussians, over one deviation or over the section state."""

    weight: Floats  # probabilities; their sum is 1; (components,)
    mean: Floats  # of each component; (components,) or (components, d)
    # variances of one deviation, or covariances; (components,) or (components, d, d)
    variance: Floats


def random_tolerance(scene: Scene) -> Tolerance | None:
    """The tolerance of a scene if a flank is random."""
    tolerance = scene.tolerance
    return tolerance if tolerance is not None and any(tolerance.variances[: scene.stages]) else None


def pieces(distribution: str) -> Pieces:
    """A random deviation as a mixture, one Gaussian for each of `PIECES` cells that are narrower
    towards the ends."""
    edges = -each(math.cos, np.linspace(0.0, np.pi, PIECES + 1))
    node, share = gauss_legendre(NODES)
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
    shape (9, 4)."""
    out = np.zeros((9, 4))
    out[5:] = np.eye(4)
    for row, x, gap, flank in (
        (1, scene.start.x1, scene.gap1, 0),
        (3, scene.start.x2, scene.gap2, 2),
    ):
        if abs(x) == gap:  # the start lies on each path's own flank
            out[row, flank + (0 if x > 0.0 else 1)] = np.sign(x)
    return out


def start_covariance(scene: Scene) -> Floats:
    """Covariance of the section state after the start, which only random flanks give it.

    Returns: Of ``(tau, x1, y1, x2, y2)`` and the deviations of +1, -1, +2, -2. Shapes: result (9,
    9), or (5, 5) where no flank varies.
    """
    tolerance = random_tolerance(scene)
    if tolerance is None:
        return np.zeros((PLAIN, PLAIN))
    variance = np.repeat(tolerance.variances, 2)
    if scene.stages == 1:
        variance[2:] = 0.0
    flanks = np.diag(variance)
    if tolerance.draw == "path":  # both flanks of a mesh have one deviation
        flanks[[0, 1], [1, 0]] = variance[0]
        flanks[[2, 3], [3, 2]] = variance[2]
    return transform(_place(scene), flanks)


def redrawn_variances(scene: Scene) -> Floats:
    """Variances of the deviations of +1, -1, +2, -2 that contacts draw anew, shape (4,); empty if
    none are."""
    tolerance = random_tolerance(scene)
    return (
        np.repeat(tolerance.variances, 2)
        if tolerance and tolerance.draw == "contact"
        else np.zeros(0)
    )


def start_pieces(scene: Scene) -> Pieces:
    """The section state after the start relative to the orbit's, as a mixture over the deviations
    drawn once per path.

    Returns: Over 9 quantities, or 5 where no flank varies; one component if deviations are drawn
    per contact.
    """
    tolerance = random_tolerance(scene)
    if tolerance is None or tolerance.draw == "contact":
        whole = start_covariance(scene)
        return Pieces(np.ones(1), np.zeros((1, len(whole))), whole[None])
    cut = pieces(tolerance.distribution)
    to = _place(scene)
    weight = np.ones(1)
    mean = np.zeros((1, 9))
    variance = np.zeros((1, 9, 9))
    for i, size in enumerate((tolerance.c1_max, tolerance.c2_max)[: scene.stages]):
        if size > 0.0:
            # both flanks of a mesh have one deviation
            by = size * (to[:, 2 * i] + to[:, 2 * i + 1])
            weight = (weight[:, None] * cut.weight).ravel()
            mean = (mean[:, None] + cut.mean[:, None] * by).reshape(-1, 9)
            variance = (variance[:, None] + cut.variance[:, None, None] * np.outer(by, by)).reshape(
                -1, 9, 9
            )
    return Pieces(weight, mean, variance)


@shared
def column(mesh: Number, side: Number) -> Number:
    """Index of a flank's deviation in the section state; of arrays, one by one."""
    return 3 + 2 * mesh + (side < 0)


@internal
def between(c: Constants, e: Floats) -> tuple[Constants, float, float]:
    """A scene with given flank deviations: its half gaps, and the centres of the gaps.

    Shapes: `e` (9,).
    """
    wall1 = max(c.wall1 + 0.5 * (e[5] + e[6]), NARROWEST * c.wall1)
    wall2 = max(c.wall2 + 0.5 * (e[7] + e[8]), NARROWEST * c.wall2)
    beta1 = c.beta1
    beta2 = c.beta2
    gamma1 = c.gamma1
    gamma2 = c.gamma2
    drive = c.drive
    own = Constants(
        c.alpha,
        c.epsilon,
        beta1,
        beta2,
        gamma1,
        gamma2,
        c.mu,
        wall1,
        wall2,
        c.sigma,
        c.stages,
        drive,
        c.memory,
    )
    return own, 0.5 * (e[5] - e[6]), 0.5 * (e[7] - e[8])


@splice
def derivatives(
    c: Constants, mesh: int, side: int, tau: float, after: Floats, t: float, before: Floats, d: int
) -> tuple[Floats, Floats]:
    """First and second derivatives of the section map with respect to ``(s, n)``, exact.

    The flight is linear except in the phase of its start; the other nonlinearity is the time at
    which it ends.

    Shapes: `tau`, `after` (4,); `t`, `before` (4,); `first` (d, d + 4); `second` (5, d + 4, d + 4).
    """
    size = d + 4
    i = 0 if mesh == 1 else 2
    y = before[i + 1]
    j = jacobian(c, t)
    a = system_matrix(c)
    rate = field(c, tau + t, before[1], before[3])
    explicit = field_rate(c, tau + t)
    bend = apply(a, rate)  # second time derivative along the flight
    flown = np.zeros((4, size))  # derivative of the state after a flight of time t, noise added
    begun = apply(j, field(c, tau, after[1], after[3]))
    first_rate = np.zeros(4)
    for k in range(4):
        bend[k] += explicit[k]
        first_rate[k] = flown[k, 0] = rate[k] - begun[k]
        flown[k, d + k] = 1.0
        for m in range(4):
            flown[k, 1 + m] = j[k, m]
    flank = column(mesh, side)
    late = np.zeros(size)  # derivative of the remaining time to the wall
    for m in range(size):
        late[m] = -flown[i, m] / y
    if d > 5:
        late[flank] += side / y
    first = np.zeros((d, size))
    for m in range(size):
        first[0, m] = late[m]
        for k in range(4):
            if k != i:  # the struck displacement is on its wall: derivative 0
                first[1 + k, m] = flown[k, m] + rate[k] * late[m]
    first[0, 0] += 1.0
    for k in range(5, d):
        first[k, k] = 1.0
    if d > 5:
        first[1 + i, flank] = side
    drift = times(a, flown)
    end_term = apply(a, first_rate)
    start_term = apply(j, field_rate(c, tau))
    for k in range(4):
        drift[k, 0] += explicit[k]  # derivative of the rate at the end of the flight
    second = np.zeros((5, size, size))
    for m in range(size):
        for n in range(size):
            for k in range(4):
                second[1 + k, m, n] = (
                    drift[k, m] * late[n] + late[m] * drift[k, n] + bend[k] * (late[m] * late[n])
                )
    for k in range(4):
        second[1 + k, 0, 0] += explicit[k] + end_term[k] - start_term[k]
    for m in range(size):
        for n in range(size):
            second[0, m, n] = -second[1 + i, m, n] / y
            for k in range(4):
                second[1 + k, m, n] += rate[k] * second[0, m, n]
            second[1 + i, m, n] = 0.0
    return first, second


@shared
def hit_matrix(c: Constants, mesh: int, d: int) -> Floats:
    """The restitution map on the section state ``(tau, x1, y1, x2, y2, ...)``.

    Shapes: result (d, d).
    """
    contact = contact_matrix(c, mesh)
    out = np.zeros((d, d))
    for i in range(d):
        out[i, i] = 1.0
    for i in range(4):
        for j in range(4):
            out[1 + i, 1 + j] = contact[i, j]
    return out
