"""The sums that a long run keeps of each path: their size does not depend on how long it is.

Impacts are counted in groups: all, and with two stages those at mesh 1 and at mesh 2.  The flight of a group is the
time since the last impact of that group.  Distributions are histograms over edges that a pilot run has set, with power
sums about its mean; those of the speed are the same for all groups, so that all impacts are the sum of both meshes and
are not counted again.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.scene.compiled import inline, internal
from rattle.scene.constants import Constants
from rattle.scene.impact import energy_loss

Floats = NDArray[np.float64]
Counts = NDArray[np.uint32]

GROUPS = 3
"""All impacts, those at mesh 1, those at mesh 2."""
NUMBER, SPEED, ENERGY, SLOW = range(4)
"""Columns of a group in `Sums.main`: number of impacts, sums of speed and of energy lost, number of slow impacts."""
CONTACT = 4 * GROUPS
"""Columns of `Sums.main` from here: samples at which mesh 1, and mesh 2, is closed."""
WORK = CONTACT + 2
"""Columns of `Sums.main` from here: sums over the samples of y1^2, v2^2, m1 y1 and m2 v2 (docs/model.md section 10)."""
NOISE = WORK + 4
"""Columns of `Sums.main` from here: the control variates of `rattle.montecarlo.long_run.noise_work`."""
MAIN = NOISE + CONTROLS
FLIGHT, ABOVE, KINDS = 0, 2, 3
"""Distributions: flight, `SPEED` (1 there too), and the speed of impacts that are not slow; how many these are."""
TURN = 2.0 * math.pi
POWERS = 7  # power sums of order 0 to 6
BINS = 400
CELLS = 2048
"""Of equal width between the outermost edges; a bin is searched only among those that begin in the value's cell."""
PHASES, VELOCITIES = 64, 64
"""Cells of the section along the phase and along the velocity."""


class Scales(NamedTuple):
    """What a pilot run sets."""

    centre: Floats  # centre, scale: of the power sums of flight and speeds; (GROUPS, KINDS)
    scale: Floats
    edges: Floats  # inner edges of the bins, ascending; the first and the last bin are open; (GROUPS, KINDS, BINS - 1)
    first: NDArray[np.int16]  # number of edges in lower cells; (GROUPS, KINDS, CELLS + 1)
    low: Floats  # low, high: velocities between which the section of each mesh is counted; (2,)
    high: Floats
    slow: float  # speed below which an impact is slow


class Sums(NamedTuple):
    """The sums of a block of paths."""

    main: Floats  # sums in each batch of time; (paths, batches, MAIN)
    batch: NDArray[np.int64]  # the batch that is being filled; (1,)
    power: Floats  # power sums of flight and speeds; (paths, GROUPS, KINDS, POWERS)
    # sums of the squared energy loss, of the energy loss times the flight, and of flights to impacts that are not
    # slow; (paths, GROUPS, 3)
    products: Floats
    # counts of flight and speeds, of `together` successive paths each.  With two stages the speeds, and the squared
    # energy loss, are counted for each mesh only (also in `power` and `products`); (units, GROUPS, KINDS, BINS)
    histogram: Counts
    section: Counts  # impacts at each mesh by phase and velocity before them; (units, 2, PHASES, VELOCITIES)
    together: int  # paths that share a unit: counts of fewer units stay in the cache of a core
    scales: Scales  # set by the pilot run


def new_sums(paths: int, batches: int, scales: Scales, detail: bool = True, together: int = 1) -> Sums:
    """Empty sums."""
    n = paths if detail else 0
    units = -(-n // together)
    return Sums(
        np.zeros((paths, batches, MAIN)),
        np.zeros(1, np.int64),
        np.zeros((n, GROUPS, KINDS, POWERS)),
        np.zeros((n, GROUPS, 3)),
        np.zeros((units, GROUPS, KINDS, BINS), np.uint32),
        np.zeros((units, 2, PHASES, VELOCITIES), np.uint32),
        together,
        scales,
    )


@inline
def cell_of(edges: Floats, value: float) -> int:
    """The cell of a value between the outermost edges; values in order are in cells in order, whatever is rounded."""
    return min(int((value - edges[0]) / (edges[edges.size - 1] - edges[0]) * CELLS), CELLS - 1)


@inline
def bin_of(edges: Floats, first: NDArray[np.int16], value: float) -> int:
    """Number of edges at or below a value.

    `first`: Number of edges in lower cells (`cell_of`), for each of the cells of equal width between the
    outermost edges. Shapes: `first` (CELLS + 1,).
    """
    n = edges.size
    if value < edges[0]:
        return 0
    if value >= edges[n - 1]:
        return n
    cell = cell_of(edges, value)
    low, high = int(first[cell]), int(first[cell + 1])
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
    scales, power = s.scales, s.power[p, g, i]
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
    s.histogram[p // s.together, g, i, bin_of(scales.edges[at, i], scales.first[at, i], value)] += np.uint32(1)


@inline
def _add_to_section(s: Sums, p: int, mesh: int, tau: float, y: float) -> None:
    """Count an impact by the phase and the velocity before it."""
    turns = tau / TURN
    phase = min(int((turns - math.floor(turns)) * PHASES), PHASES - 1)
    low, high = s.scales.low[mesh - 1], s.scales.high[mesh - 1]
    place = (y - low) / (high - low)
    if 0.0 <= place < 1.0:
        s.section[p // s.together, mesh - 1, phase, int(place * VELOCITIES)] += np.uint32(1)


@inline
def _add_states(c: Constants, states: Floats, sine: Floats, cosine: Floats, main: Floats) -> None:
    """Add the states of a path, and their work."""
    closed1 = closed2 = squared1 = squared2 = moved1 = moved2 = 0.0
    for k in range(len(states)):
        y1 = states[k, 1]
        closed1 += y1 == 0.0  # in flight with probability 0
        squared1 += y1 * y1
        moved1 += (c.beta1 * cosine[k] - sine[k]) * y1
    if c.stages == 2:
        for k in range(len(states)):
            y2 = states[k, 3]
            v = y2 - states[k, 1]
            closed2 += y2 == 0.0
            squared2 += v * v
            moved2 += (c.beta2 * cosine[k] - sine[k]) * v
    main[CONTACT] += closed1
    main[CONTACT + 1] += closed2
    main[WORK] += squared1
    main[WORK + 1] += squared2
    main[WORK + 2] += moved1
    main[WORK + 3] += moved2


@internal
def add_stretch(
    c: Constants,
    rows: Floats,
    impacts: NDArray[np.int64],
    struck: Floats,
    states: Floats,
    tau: float,
    apart: float,
    s: Sums,
    detail: bool,
) -> None:
    """Add the impacts and the states of a stretch to the sums of each path.

    Shapes: `rows` (paths, impacts or more, COLUMNS); `impacts` (paths or more,); `struck` (paths, 2); `states`
    (paths, samples, 4).
    """
    n, two = states.shape[1], c.stages == 2
    sine, cosine = np.sin(tau + apart * np.arange(n)), np.cos(tau + apart * np.arange(n))
    for p in range(len(rows)):
        main, last = s.main[p, s.batch[0]], struck[p]
        for k in range(impacts[p]):
            now, mesh = rows[p, k, 0], abs(int(rows[p, k, 6]))
            y = rows[p, k, 2 * mesh + 1]
            slow = abs(y) < s.scales.slow
            lost = energy_loss(c, mesh, rows[p, k, 3], rows[p, k, 5])
            g = mesh if two else 0
            main[4 * g + NUMBER] += 1.0
            main[4 * g + SPEED] += abs(y)
            main[4 * g + ENERGY] += lost
            main[4 * g + SLOW] += slow
            if detail:
                flight, own = now - max(last[0], last[1]), now - last[mesh - 1]
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
        _add_states(c, states[p], sine, cosine, main)
