"""The sums that a long run keeps of each path: their size does not depend on how long it is.

Impacts are counted in groups: all, and with two stages those at mesh 1 and at mesh 2; the flight of
a group is the time since its last impact.  Distributions are histograms over edges that a pilot run
has set, with power sums about its mean; those of the speed are the same for all groups, so that all
impacts are the sum of both meshes.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.scene import Constants, Floats, Ints
from rattle.scene.compiled import inline, internal
from rattle.scene.drive import velocity_acceleration
from rattle.scene.impact import energy_loss

Counts = NDArray[np.uint32]

MESH_GROUPS = 3
"""All impacts, those at mesh 1, those at mesh 2."""
NUMBER, SPEED, ENERGY, SLOW = range(4)
"""Columns of a group in `Sums.main`: number of impacts, sums of speed and of energy lost, number of
slow impacts."""
CONTACT = 4 * MESH_GROUPS
"""Columns of `Sums.main` from here: samples at which mesh 1, and mesh 2, is closed."""
OPEN = CONTACT + 2
"""Columns of `Sums.main` from here: samples at which mesh 1, and mesh 2, is open: no flank is as
near as `NEAR_FLANK`."""
NEAR_FLANK = 0.01  # of the backlash
WORK = OPEN + 2
"""Columns of `Sums.main` from here: sums over the samples of y1^2, v2^2, m1 y1 and m2 v2
(docs/model.md section 10)."""
NOISE = WORK + 4
"""Columns of `Sums.main` from here: the control variates of
`rattle.montecarlo.long_run.noise_work`."""
ABOVE_SPEED = NOISE + CONTROLS
"""Columns of `Sums.main` from here: speed of impacts that are not slow, of each group."""
LEFT_OUT = ABOVE_SPEED + MESH_GROUPS
"""Columns of `Sums.main` from here: what impacts that are not followed lose at closed meshes, how
long meshes are closed for them, and the most of them that are not slow."""
MAIN = LEFT_OUT + 3
FLIGHT = 0
ABOVE = 2
DISTRIBUTION_KINDS = 3
"""Distributions: flight, `SPEED` (1 there too), and the speed of impacts that are not slow; how
many these are."""
PERIOD = 2.0 * math.pi
SAMPLES = 64
"""Instants of a period at which states are taken for averages over time."""
POWER_SUMS = 7  # power sums of order 0 to 6
SUM_BINS = 400
CELLS = 2048
"""Of equal width between the outermost edges; a bin is searched only among those that begin in the
value's cell."""
PHASES = 64
VELOCITY_CELLS = 64
"""Cells of the section along the phase and along the velocity."""
TAILS = 8.0  # outermost edges at the probabilities expit(+-8), 3e-4, of the pilot run
VELOCITY_MARGIN = 0.05  # of the range of velocities, at each end of the section


class Scales(NamedTuple):
    """What a pilot run sets."""

    # centre, scale: of the power sums of flight and speeds; (MESH_GROUPS, DISTRIBUTION_KINDS)
    centre: Floats
    scale: Floats
    # inner edges of the bins, ascending; the first and the last bin are open; (MESH_GROUPS,
    # DISTRIBUTION_KINDS, SUM_BINS
    # - 1)
    edges: Floats
    # number of edges in lower cells; (MESH_GROUPS, DISTRIBUTION_KINDS, CELLS + 1)
    first: NDArray[np.int16]
    low: Floats  # low, high: velocities between which the section of each mesh is counted; (2,)
    high: Floats
    slow: float  # speed below which an impact is slow


class Sums(NamedTuple):
    """The sums of a block of paths; all but `main` are empty before a pilot run has set what they
    need."""

    main: Floats  # sums in each batch of time; (paths, batches, MAIN)
    batch: Ints  # the batch that is being filled; (1,)
    # power sums of flight and speeds; (paths, MESH_GROUPS, DISTRIBUTION_KINDS, POWER_SUMS)
    power: Floats
    # sums of the squared energy loss, of the energy loss times the flight, and of flights to
    # impacts that are not slow; (paths, MESH_GROUPS, 3)
    products: Floats
    # counts of flight and speeds, of `together` successive paths each.  With two stages the speeds,
    # and the squared energy loss, are counted for each mesh only (also in `power` and `products`);
    # (units, MESH_GROUPS, DISTRIBUTION_KINDS, SUM_BINS)
    histogram: Counts
    # impacts at each mesh by phase and velocity before them; (units, 2, PHASES, VELOCITY_CELLS)
    section: Counts
    together: int  # paths that share a unit: counts of fewer units stay in the cache of a core
    scales: Scales  # set by the pilot run


def new_sums(
    paths: int, batches: int, scales: Scales, detail: bool = True, together: int = 1
) -> Sums:
    """Sums of nothing yet; `detail`: whether distributions are counted too."""
    n = paths if detail else 0
    main = np.zeros((paths, batches, MAIN))
    batch = np.zeros(1, np.int64)
    units = -(-n // together)
    power = np.zeros((n, MESH_GROUPS, DISTRIBUTION_KINDS, POWER_SUMS))
    products = np.zeros((n, MESH_GROUPS, 3))
    histogram = np.zeros((units, MESH_GROUPS, DISTRIBUTION_KINDS, SUM_BINS), np.uint32)
    section = np.zeros((units, 2, PHASES, VELOCITY_CELLS), np.uint32)
    return Sums(main, batch, power, products, histogram, section, together, scales)


@inline
def cell_of(edges: Floats, value: float) -> int:
    """The cell of a value between the outermost edges; values in order are in cells in order,
    whatever is rounded."""
    return min(int((value - edges[0]) / (edges[edges.size - 1] - edges[0]) * CELLS), CELLS - 1)


@inline
def bin_of(edges: Floats, first: NDArray[np.int16], value: float) -> int:
    """Number of edges at or below a value.

    `first`: Number of edges in lower cells (`cell_of`), for each of the cells of equal width
    between the outermost edges. Shapes: `first` (CELLS + 1,).
    """
    n = edges.size
    if value < edges[0]:
        return 0
    if value >= edges[n - 1]:
        return n
    cell = cell_of(edges, value)
    low = int(first[cell])
    high = int(first[cell + 1])
    while low < high:
        middle = (low + high) // 2
        if edges[middle] <= value:
            low = middle + 1
        else:
            high = middle
    return low


@inline
def _add_value(s: Sums, p: int, g: int, i: int, value: float) -> None:
    """Add the flight or the speed of an impact to a distribution of a group."""
    scales = s.scales
    power = s.power[p, g, i]
    u = (value - scales.centre[g, i]) / scales.scale[g, i]
    square = u * u
    cube = square * u
    power[0] += 1.0
    power[1] += u
    power[2] += square
    power[3] += cube
    power[4] += square * square
    power[5] += cube * square
    power[6] += cube * cube
    at = g if i == FLIGHT else 0  # speeds have the same edges in all groups
    s.histogram[p // s.together, g, i, bin_of(scales.edges[at, i], scales.first[at, i], value)] += (
        np.uint32(1)
    )


@inline
def _add_to_section(s: Sums, p: int, mesh: int, tau: float, y: float) -> None:
    """Count an impact by the phase and the velocity before it."""
    turns = tau / PERIOD
    phase = min(int((turns - math.floor(turns)) * PHASES), PHASES - 1)
    low = s.scales.low[mesh - 1]
    high = s.scales.high[mesh - 1]
    place = (y - low) / (high - low)
    if 0.0 <= place < 1.0:
        s.section[p // s.together, mesh - 1, phase, int(place * VELOCITY_CELLS)] += np.uint32(1)


@inline
def _add_wheel(
    i: int,
    wall: float,
    beta: float,
    states: Floats,
    sine: Floats,
    cosine: Floats,
    walls: Floats,
    p: int,
    main: Floats,
) -> None:
    """Add the states of a wheel, the first or the second, and their work."""
    near = 2.0 * NEAR_FLANK * wall
    closed = is_open = squared = moved = 0.0
    for k in range(len(states)):
        x = states[k, 2 * i]
        y = states[k, 2 * i + 1]
        v = y if i == 0 else y - states[k, 1]  # seen from the driver
        closed += y == 0.0  # in flight with probability 0
        is_open += near - walls[2 * i + 1, p] < x < walls[2 * i, p] - near
        squared += v * v
        moved += (beta * cosine[k] - sine[k]) * v
    main[CONTACT + i] += closed
    main[OPEN + i] += is_open
    main[WORK + i] += squared
    main[WORK + 2 + i] += moved


@internal
def _phases(drive: Any, tau: float, apart: float, n: int) -> tuple[Floats, Floats]:
    """Sine and cosine of n times, or ``-f''`` and ``f'`` of several orders."""
    if len(drive) == 0:
        return np.sin(tau + apart * np.arange(n)), np.cos(tau + apart * np.arange(n))
    sine = np.empty(n)
    cosine = np.empty(n)
    for k in range(n):
        cosine[k], second = velocity_acceleration(drive, tau + apart * k)
        sine[k] = -second
    return sine, cosine


@internal
def add_stretch(
    c: Constants,
    rows: Floats,
    impacts: Ints,
    struck: Floats,
    states: Floats,
    walls: Floats,
    tau: float,
    apart: float,
    s: Sums,
) -> None:
    """Add the impacts and the states of a stretch to the sums of each path.

    Shapes: `rows` (paths, impacts or more, COLUMNS); `impacts` (paths or more,); `struck` (paths,
    2); `states` (paths, samples, 4); `walls` (4, paths or more), as they are at its end.
    """
    n = states.shape[1]
    two = c.stages == 2
    detail = len(s.power) > 0
    sine, cosine = _phases(c.drive, tau, apart, n)
    for p in range(len(rows)):
        main = s.main[p, s.batch[0]]
        last = struck[p]
        for k in range(impacts[p]):
            now = rows[p, k, 0]
            mesh = abs(int(rows[p, k, 6]))
            y = rows[p, k, 2 * mesh + 1]
            slow = abs(y) < s.scales.slow
            lost = energy_loss(c, mesh, rows[p, k, 3], rows[p, k, 5])
            g = mesh if two else 0
            main[4 * g + NUMBER] += 1.0
            main[4 * g + SPEED] += abs(y)
            main[4 * g + ENERGY] += lost
            main[4 * g + SLOW] += slow
            if not slow:
                main[ABOVE_SPEED + g] += abs(y)
            if detail:
                flight = rows[p, k, 1]
                own = now - last[mesh - 1]
                _add_value(s, p, 0, FLIGHT, flight)
                s.products[p, 0, 1] += lost * flight
                if two:
                    _add_value(s, p, g, FLIGHT, own)
                    s.products[p, g, 1] += lost * own
                _add_value(s, p, g, SPEED, abs(y))
                s.products[p, g, 0] += lost * lost
                if not slow:
                    _add_value(s, p, g, ABOVE, abs(y))
                    s.products[p, 0, 2] += flight
                    if two:
                        s.products[p, g, 2] += own
                _add_to_section(s, p, mesh, now, y)
            last[mesh - 1] = now
        if two:
            for column in range(4):
                main[column] = main[4 + column] + main[8 + column]
            main[ABOVE_SPEED] = main[ABOVE_SPEED + 1] + main[ABOVE_SPEED + 2]
        for i in range(c.stages):
            wall = c.wall2 if i else c.wall1
            beta = c.beta2 if i else c.beta1
            _add_wheel(i, wall, beta, states[p], sine, cosine, walls, p, main)


@internal
def add_left_out(c: Constants, closed: Floats, s: Sums) -> None:
    """Add what is not followed at closed meshes to the sums of each path.

    Shapes: `closed` (4, paths or more), see `rattle.montecarlo.schemes.lanes.Room`.
    """
    for p in range(len(s.main)):
        main = s.main[p, s.batch[0]]
        lost1 = closed[0, p]
        lost2 = closed[1, p]
        main[ENERGY] += lost1 + lost2
        if c.stages == 2:
            main[4 + ENERGY] += lost1
            main[8 + ENERGY] += lost2
        main[LEFT_OUT] += lost1 + lost2
        main[LEFT_OUT + 1] += closed[2, p]
        main[LEFT_OUT + 2] += closed[3, p]


def no_scales(slow: float) -> Scales:
    """Scales before there is a pilot run: nothing but means can be summed by them."""
    shape = (MESH_GROUPS, DISTRIBUTION_KINDS)
    edges = np.zeros((*shape, SUM_BINS - 1))
    first = np.zeros((*shape, CELLS + 1), np.int16)
    return Scales(np.zeros(shape), np.ones(shape), edges, first, np.zeros(2), np.ones(2), slow)


def scales_of_pilot(seen: Floats, slow: float) -> Scales:
    """Scales from the impacts of a pilot run.

    The edges of the bins are quantiles of the pilot run, densest in the tails, so that every
    quantile that is asked for lies among bins of little probability, whatever the distribution
    looks like.

    Shapes: `seen` (impacts, 4).
    """
    s = no_scales(slow)
    share = expit(np.linspace(-TAILS, TAILS, SUM_BINS - 1))
    for g in range(MESH_GROUPS):
        own = seen if g == 0 else seen[seen[:, 0] == g]
        if len(own) == 0:
            continue
        speed = np.abs(own[:, 3])
        for i, values in (
            (FLIGHT, own[:, 1 if g == 0 else 2]),
            (SPEED, speed),
            (ABOVE, speed[speed >= slow]),
        ):
            if values.size == 0:
                continue
            if g > 0 and i != FLIGHT:  # as for all impacts, which are the sum of both meshes
                s.centre[g, i], s.scale[g, i] = s.centre[0, i], s.scale[0, i]
                s.edges[g, i], s.first[g, i] = s.edges[0, i], s.first[0, i]
                continue
            s.centre[g, i], spread = values.mean(), values.std()
            s.scale[g, i] = spread if spread > 0.0 else max(abs(s.centre[g, i]), 1.0)
            edges = np.quantile(values, share)
            s.edges[g, i] = edges
            if edges[-1] > edges[0]:
                cells = [cell_of(edges, edge) for edge in edges]
                s.first[g, i] = np.searchsorted(cells, np.arange(CELLS + 1))
        if g > 0:
            low, high = np.quantile(own[:, 3], [1e-4, 1.0 - 1e-4])
            room = VELOCITY_MARGIN * (high - low) + 1e-9 * max(abs(low), abs(high), 1e-30)
            s.low[g - 1] = low - room
            s.high[g - 1] = high + room
    return s


class Collected(NamedTuple):
    """The sums of all paths."""

    main: Floats  # as of `Sums`, over the batches that are full; (paths, batches, MAIN)
    periods: int  # of each path
    power: Floats  # power, products, histogram, section, together: as of `Sums`, of all paths
    products: Floats
    histogram: Counts
    section: Counts
    together: int
    scales: Scales  # of the pilot run
    stages: int  # of the scene

    @property
    def paths(self) -> int:
        """Number of paths."""
        return len(self.main)

    @property
    def time(self) -> float:
        """Duration of each path."""
        return PERIOD * self.periods

    @property
    def samples(self) -> float:
        """Number of samples of the state of each path."""
        return float(SAMPLES * self.periods)

    def impacts_at(self, mesh: int) -> Floats:
        """Impacts at a mesh of the paths that share a unit of the distributions, shape (units,)."""
        of_paths = self.main[:, :, 4 * (mesh if self.stages == 2 else 0) + NUMBER].sum(axis=1)
        return np.asarray(np.add.reduceat(of_paths, np.arange(0, self.paths, self.together)))


def collect(parts: list[Sums], batches: int, periods: int, stages: int) -> Collected:
    """Join the sums of all blocks of paths."""
    names = ("main", "power", "products", "histogram", "section")
    main, power, products, *counts = (
        np.concatenate([getattr(part, name) for part in parts]) for name in names
    )
    if stages == 2:  # all impacts: those at either mesh
        for sums in (power[:, :, SPEED:], products[:, :, 0], counts[0][:, :, SPEED:]):
            sums[:, 0] = sums[:, 1] + sums[:, 2]
    together = parts[0].together
    scales = parts[0].scales
    return Collected(
        main[:, :batches], periods, power, products, counts[0], counts[1], together, scales, stages
    )
