"""From impact to impact: noise, splitting, the mixture's flight, the restitution map, and merging.

Before the flight the component with the largest error is split first, while there is room.  A
component that reaches across a boundary between two next impacts has an image in two halves.
Before that, these are split off:

- a tail beyond a boundary, along the boundary's plane: a split in three first would lose it, and
  rare events with it;
- a component over which the section map is nonlinear, in three across the direction of largest
  curvature.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.closure.branching.mixture import Mixture, empty, reduce
from rattle.closure.branching.propagate import (
    THIRD_CENTRE,
    THIRD_WEIGHT,
    THIRD_WIDTH,
    Image,
    cut_plane,
    event,
    half,
    mark,
    own_spread,
    propagate,
    root,
)
from rattle.closure.section_map import column, plain_size, redrawn_variances, start_pieces
from rattle.scene import Constants, Floats, Ints, Scene
from rattle.scene.compiled import internal, jit, little_code, splice
from rattle.scene.flight import jacobian, noise_covariance, noise_rate
from rattle.scene.impact import add_scatter, contact_matrix, strike
from rattle.scene.linear_algebra import (
    add_outer,
    apply,
    beyond,
    congruence,
    dot,
    largest,
    norm,
    put,
    put_row,
    put_scaled,
)
from rattle.scene.orbit import Orbit
from rattle.scene.types import MOST_WHEELS

LEAST_WEIGHT_BEYOND = 1e-6  # weight beyond a boundary that need not be found
LIGHT = 1e-4  # weight of a component above which boundaries are searched for
TAIL_DISTANCE = 2.0  # distance to a boundary, in sds, from which what lies beyond is a tail
BRANCH = 0.03  # error of a boundary through the centre of a component, relative to its weight
DAMPED = 15.0  # damping times flight time above which a component is discarded
POWER = 0.35  # error of a component relative to its weight, as a power of the ratio of variances
# skewness of ``z + a z^2``, per its ratio of second-order to first-order sd
SKEWED = 3.0 * math.sqrt(2.0)
SHARE_LEFT_BY_SPLIT = 0.05  # share of the square of that ratio that a split in three leaves
EARLY = 0.6  # relative error of a weight, per logarithm of what the noise until then takes off it
MOST_DOUBT = 2.0  # largest relative error of a weight
# added to the label of a component whose itinerary is the orbit's; other labels are at most
# `MOST_WHEELS`
ON_ORBIT = 3 * MOST_WHEELS


class Level(NamedTuple):
    """A resolution of the closure."""

    components: int  # most components after an impact
    cut: int  # most components before an impact, not counting halves
    # ratio of second-order to first-order variance below which a component is not split
    flat: float
    worth: float  # error below which no component is split


class Buffers(NamedTuple):
    """Components at the start of a flight, their images, and how each would be split."""

    start: Mixture  # section states after the last impact, with the noise of the flight included
    image: Image  # component i has its image at 2 i and, where a boundary halves it, at 2 i + 1
    # by component
    ignored: Ints  # bit mask of impacts that were split off already
    beyond: Ints  # the impact (``mesh * side``) beyond the plane that splits a tail off
    parent: Ints  # the component after the last impact of which it is a part
    error: Floats  # what splitting a component is worth, weighted
    depth: Floats  # distance of the plane that splits a tail off, in sds; 0 for a split in three
    slow: Floats  # share of the squared impact speed that noise makes
    # of the flight of the component of that number after the last impact, whose noise was added; 0
    # if it does not end
    time: Floats
    halved: Floats  # distance of the boundary that halves it, in sds; 0 if none does
    # share of the weight beyond the plane that splits a tail off, and its relative error
    tail: Floats
    doubt: Floats
    axis: Floats  # one sd across the split; (components, d)
    plane: Floats  # one sd across the boundary that halves a component; (components, d)


def buffers(size: int, d: int) -> Buffers:
    """Empty arrays for the components of a flight."""
    image = Image(empty(2 * size, d), np.zeros((2 * size, 2)), np.zeros((2 * size, d)))
    codes = np.zeros((3, size), np.int64)
    numbers = np.zeros((7, size))
    axes = np.zeros((2, size, d))
    return Buffers(empty(size, d), image, *codes, *numbers, *axes)


@splice
def _slow(c: Constants, e: Floats, t: float, code: int, before: Floats) -> float:
    """Share of the squared impact speed that the noise of the flight makes; near 1 no Gaussian
    describes the return."""
    if code == 0:
        return 0.0
    i = abs(code) - 1
    rate = noise_rate(c, e[0] + t, i)
    speed = before[2 * i + 1]
    shaking = c.wheels[i].shaking
    square = c.sigma * c.sigma
    made = square * rate * rate * t + square * shaking * shaking * t
    return made / (made + speed * speed) if made > 0.0 else 0.0


@internal
def _weigh(depth: float, own: float, bent: float) -> tuple[float, float]:
    """Share of a component beyond a boundary `depth` sds away, and its relative error.

    The noise until the boundary is reached makes `own` of the sd across it
    (`own_spread`).  The error has two parts.  A component that is bent is taken as a
    Gaussian: by the first term of an Edgeworth series, with the skewness of what is bent so.  And
    that share of the noise is known at one point of the boundary only.
    """
    share, rate, _ = half(depth / own, False)
    skewed = SKEWED * math.sqrt(bent) / 6.0 * max(depth * depth - 1.0, 1.0) * rate
    early = EARLY * math.log(half(depth, False)[0] / share)
    return share, min(math.hypot(skewed, early), MOST_DOUBT)


@splice
def _find_boundary(
    c: Constants, b: Buffers, i: int, axes: Floats, code: int
) -> tuple[int, float, float, Floats, Floats]:
    """The next impact beyond the boundary that component `i` reaches across, and where that is.

    Returns: The impact; the distance of the boundary in sds, 0 if none is reached; the part of
    that sd that the noise until then makes (`own_spread`); one sd across the boundary, along the
    axes and in the state. Shapes: `axes` (d, rank); result (rank,), (d,).
    """
    start = b.start
    centre = start.mean[i]
    w = start.weight[i]
    reach = math.sqrt(2.0 * math.log(w / LEAST_WEIGHT_BEYOND) - 2.0)
    other, q = cut_plane(c, centre, axes, code, b.ignored[i], reach)
    n = np.zeros(q.size)
    if other == code:
        return other, 0.0, 1.0, n, apply(axes, n)
    length = norm(q)
    put_scaled(n, q, length)
    depth = 1.0 / length
    v = apply(axes, n)
    last = start.label[i]
    last -= ON_ORBIT if last > MOST_WHEELS else 0
    there = beyond(centre, 1.01 * depth, v)
    own = own_spread(c, centre, axes, there, b.time[b.parent[i]], last)
    if depth > reach * own:
        b.ignored[i] |= mark(c, other)  # the noise until that impact does not lead to it
        depth = 0.0
    return other, depth, own, n, v


@splice
def _examine(c: Constants, b: Buffers, i: int, level: Level) -> None:
    """Compute the image of component `i`, whole or in halves beside a boundary, and how it would
    best be split.

    Its error is what that split is worth.
    """
    start = b.start
    section = b.image.section
    w = start.weight[i]
    centre = start.mean[i]
    bent = start.bent[i]
    rank, full = root(start.covariance[i], plain_size(c))
    axes = full[:, :rank].copy()
    t, code, before = event(c, centre)
    b.slow[i] = _slow(c, centre, t, code, before)
    axis = b.axis[i]
    n = np.zeros(rank)
    v = n
    depth = 0.0
    own = 1.0
    if w > LIGHT and rank > 0 and code != 0:
        b.beyond[i], depth, own, n, v = _find_boundary(c, b, i, axes, code)
    cut = depth if depth > TAIL_DISTANCE else 0.0
    pieces = 2 if depth > cut else 1
    b.depth[i] = cut
    b.halved[i] = depth - cut
    b.tail[i] = b.doubt[i] = 0.0
    section.weight[2 * i + 1] = 0.0
    error = worst = most = 0.0
    for k in range(pieces):
        image = 2 * i + k
        share = 1.0
        narrow = 1.0
        at = centre
        across = axes
        if pieces == 2:
            _, rate, variance = half(depth, k == 0)
            share = half(depth / own, k == 0)[0]
            narrow = math.sqrt(variance)
            at = beyond(centre, rate, v)
            across = axes.copy()
            add_outer(across, narrow - 1.0, v, n)
        section.weight[image] = w * share
        bend, u = propagate(c, at, across, b.image, image)
        section.bent[image] = bent + bend
        section.doubt[image] = start.doubt[i]
        most = max(most, bend)
        worth = w * share * bend**POWER if bend > level.flat else 0.0
        error += worth
        if pieces == 1 or worth > worst:
            worst = worth
            if pieces == 2:
                shear = (1.0 / narrow - 1.0) * dot(u, n)
                for m in range(rank):
                    u[m] += shear * n[m]  # normal of the same planes, in sds of the whole component
                put_scaled(u, u, norm(u))
            put_row(axis, apply(axes, u))
    if cut > 0.0:
        error = w
        put_row(axis, v)
        b.tail[i], b.doubt[i] = _weigh(depth, own, bent + most)
    elif pieces == 2:
        put_row(b.plane[i], v)
        share, more = _weigh(depth, own, bent + most)
        doubt = start.doubt[i]
        section.doubt[2 * i] = math.hypot(doubt, more * share / (1.0 - share))
        section.doubt[2 * i + 1] = math.hypot(doubt, more)
        crossing = BRANCH * w * math.exp(-0.5 * depth * depth)
        if crossing > error:
            put_row(axis, v)
        error += crossing
    b.error[i] = error


@splice
def _doubles(c: Constants, ignored: int, centre: Floats, axis: Floats) -> bool:
    """Whether an outer third of a component would reach beyond a boundary whose tail was split off
    already.

    The rest of a Gaussian without its tail is a Gaussian again, and what it has beyond that
    boundary is not its own.
    """
    if ignored == 0:
        return False
    for side in (-1.0, 1.0):
        end = beyond(centre, side * THIRD_CENTRE, axis)
        if ignored & mark(c, event(c, end)[1]):
            return True
    return False


@splice
def _cut(c: Constants, b: Buffers, i: int, count: int) -> int:
    """Replace component `i` by two or three across its axis, the others from `count` on; returns
    the new count."""
    parts = b.start
    section = b.image.section
    ignored = b.ignored
    means = parts.mean
    spreads = parts.covariance
    doubts = parts.doubt
    v = b.axis[i]
    w = parts.weight[i]
    centre = means[i].copy()
    sigma = spreads[i].copy()
    depth = b.depth[i]
    seen = ignored[i]
    pieces = 2 if depth > 0.0 else 3
    bent = parts.bent[i]
    if pieces == 3:
        bent += SHARE_LEFT_BY_SPLIT * (section.bent[2 * i] - bent)
    for k in range(pieces):
        at = i if k == 0 else count + k - 1
        if pieces == 2:
            _, place, variance = half(depth, k == 0)
            share = 1.0 - b.tail[i] if k == 0 else b.tail[i]
        else:
            share = THIRD_WEIGHT if k > 0 else 1.0 - 2.0 * THIRD_WEIGHT
            place = 0.0 if k == 0 else (2 * k - 3) * THIRD_CENTRE
            variance = THIRD_WIDTH**2
        parts.weight[at] = w * share
        put_row(means[at], beyond(centre, place, v))
        put(spreads[at], sigma)
        add_outer(spreads[at], variance - 1.0, v, v)
        parts.label[at] = parts.label[i]
        b.parent[at] = b.parent[i]
        parts.bent[at] = bent
        doubts[at] = doubts[i]
        ignored[at] = seen
    if pieces == 2:
        doubts[count] = math.hypot(doubts[count], b.doubt[i])
        ignored[count] |= mark(c, section.label[2 * i])
        ignored[i] |= mark(c, b.beyond[i])
    return count + pieces - 1


@splice
def _add_noise(c: Constants, start: Mixture, live: int, flown: Floats) -> float:
    """Add the noise of the next flight to the components, at its start; returns the weight that is
    discarded.

    The displacement ``exp(-A t) n`` leads to the same state at the end of the flight.  A component
    whose flight is damped by more than ``exp(-DAMPED)`` is discarded: flown back, its noise has no
    digits left.

    `flown`: Takes the time of each component's flight; 0 if it does not end.
    """
    states = 2 * c.wheels.size
    fastest = 0.0
    for wheel in c.wheels:
        fastest = max(fastest, wheel.beta)
    discarded = 0.0
    for i in range(live):
        t, code, _ = event(c, start.mean[i])
        if code != 0 and t * fastest > DAMPED:
            discarded += start.weight[i]
            start.weight[i] = 0.0
        elif code != 0:
            noise = congruence(jacobian(c, -t), noise_covariance(c, start.mean[i, 0], t))
            for m in range(states):
                for n in range(states):
                    start.covariance[i, 1 + m, 1 + n] += noise[m, n]
        flown[i] = t if code != 0 else 0.0
    return discarded


@jit
def fly(c: Constants, live: int, b: Buffers, level: Level, whole: Mixture) -> tuple[int, float]:
    """Propagate components to their next impact, splitting them where that is worth it; returns
    their number after that, and the weight that is discarded.

    `b`: Components in ``b.start``; their images are written to ``b.image``. `whole`: Takes
    weight, mean and covariance of each component before it is split, with the noise of the flight.
    """
    little_code()
    discarded = _add_noise(c, b.start, live, b.time)
    for i in range(live):
        whole.weight[i] = b.start.weight[i]
        put_row(whole.mean[i], b.start.mean[i])
        put(whole.covariance[i], b.start.covariance[i])
    error = b.error
    # seen: components examined already, except the last one that was split
    count = live
    last = 0
    seen = 0
    while count > seen:
        for k in range(seen, count + (1 if seen > 0 else 0)):
            i = last if k == count else k
            _examine(c, b, i, level)
        seen = count
        splits = count + 2 <= level.cut
        while splits:
            last = largest(error, count)
            splits = error[last] >= level.worth
            if b.depth[last] > 0.0:
                break
            if not _doubles(c, b.ignored[last], b.start.mean[last], b.axis[last]):
                break
            error[last] = 0.0
        if splits:
            count = _cut(c, b, last, count)
    return count, discarded


@jit
def _strike(
    c: Constants,
    redrawn: Floats,
    itinerary: Ints,
    image: Image,
    count: int,
    own: int,
    after: Mixture,
) -> tuple[int, float]:
    """Apply the restitution map to all images, packed to the front; returns their number and the
    weight without impact.

    The labels of `after` are the impact, ``mesh * side``, plus `ON_ORBIT` if the `itinerary` of the
    component is still the orbit's, whose impact is `own`.  `redrawn` has the variances of the
    deviations of +1, -1, +2, -2, ... that contacts draw anew; it is empty if none are.
    """
    little_code()
    section = image.section
    means = section.mean
    spreads = section.covariance
    flight = image.flight
    kept = 0
    discarded = 0.0
    for i in range(2 * count):
        w = section.weight[i]
        code = section.label[i]
        if w == 0.0:
            continue
        if code == 0:
            discarded += w
            continue
        mesh = abs(code)
        place = 2 * mesh
        speed = means[i, place]
        hit = contact_matrix(c, mesh, speed, means.shape[1], 1)
        section.weight[kept] = w
        section.label[kept] = code
        put_row(flight[kept], flight[i])
        put_row(means[kept], means[i])
        put(spreads[kept], spreads[i])
        mean = after.mean[kept]
        spread = after.covariance[kept]
        put_row(mean, apply(hit, means[i]))
        if c.wheels[mesh - 1].slowing > 0.0:
            put_row(mean, means[i])
            strike(c, mesh, mean[1 : plain_size(c)])
        put(spread, congruence(hit, spreads[i]))
        add_scatter(c, mesh, speed, spreads[i, place, place], spread)
        if redrawn.size > 0:
            flank = column(c.wheels.size, mesh, -code)
            mean[flank] = 0.0
            for k in range(mean.size):  # nothing is known of a deviation that is drawn anew
                spread[flank, k] = spread[k, flank] = 0.0
            spread[flank, flank] = redrawn[flank - plain_size(c)]
        after.weight[kept] = w
        after.bent[kept] = section.bent[i]
        after.doubt[kept] = section.doubt[i]
        after.label[kept] = code + (
            ON_ORBIT if itinerary[i // 2] > MOST_WHEELS and code == own else 0
        )
        kept += 1
    return kept, discarded


class Advance:
    """The mixture on its way; each impact is a call of `fly`, one of `strike`, and one of `merge`.

    `buffers`: components in flight, and their images. `after`: components after the impact, not
    merged yet. `most`: how many may be left after merging. `live, flown, kept`: number of
    components after merging, after splitting, and after the impact. `struck, merged`: number of
    impacts so far, and of those after which components were merged. `discarded`: probability
    discarded so far.
    """

    def __init__(self, scene: Scene, orbit: Orbit, level: Level) -> None:
        """Begin at the start of an orbit."""
        self.constants = scene.constants
        self.level = level
        self.discarded = 0.0
        self.redrawn = redrawn_variances(scene)
        first = start_pieces(scene)
        self.live, d = first.mean.shape
        self.flown = self.kept = self.struck = self.merged = 0
        plain = plain_size(self.constants)
        # after an impact there are at most so many labels: mesh * side, and the orbit's
        self.most = max(level.components, plain)
        size = max(level.cut, self.live, self.most)
        self.buffers, self.after = buffers(size, d), empty(2 * size, d)
        start = self.buffers.start
        start.weight[: self.live] = first.weight
        start.label[: self.live] = ON_ORBIT
        start.mean[: self.live] = first.mean
        start.mean[: self.live, :plain] += np.array([orbit.tau[0], *orbit.after[0]])
        start.covariance[: self.live] = first.variance

    def fly(self) -> Mixture:
        """Fly to the next impact; returns the components before they were split, with the noise of
        the flight."""
        b = self.buffers
        n = self.live
        b.ignored[:n] = 0
        b.parent[:n] = np.arange(n)
        whole = empty(n, b.start.mean.shape[1])
        self.flown, endless = fly(self.constants, n, b, self.level, whole)
        self.discarded += endless
        return whole

    def strike(self, own: int) -> None:
        """Apply the restitution map; `own` is the orbit's impact, ``mesh * side``."""
        b = self.buffers
        self.kept, endless = _strike(
            self.constants, self.redrawn, b.start.label, b.image, self.flown, own, self.after
        )
        self.discarded += endless
        self.struck += 1

    def merge(self) -> None:
        """Merge the components that lie together after the impact."""
        self.live = reduce(self.after, self.kept, self.most, self.buffers.start)
        self.merged += 1
