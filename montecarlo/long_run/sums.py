"""The sums that a long run keeps of each path: their size does not depend on how long it is.

Impacts are counted in groups: all, and with two stages those at mesh 1 and at mesh 2.  The flight of a group is the
time since the last impact of that group.  Distributions are histograms over edges that a pilot run has set, with power
sums about its mean.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.scene.compiled import inlined, jit
from rattle.scene.constants import Constants
from rattle.scene.impact import energy_loss

__all__ = [
    "BINS", "CELLS", "CONTACT", "ENERGY", "FLIGHT", "GROUPS", "MAIN", "NOISE", "NUMBER", "PHASES", "SLOW", "SPEED",
    "VELOCITIES", "WORK", "Scales", "Sums", "add_stretch", "bin_of", "new_sums",
]  # fmt: skip

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
FLIGHT = 0  # index of the flight in distributions; `SPEED` is 1 there too
POWERS = 7  # power sums of order 0 to 6
BINS = 400
CELLS = 1024
"""Of equal width between the outermost edges; a bin is searched only among those that begin in the value's cell."""
PHASES, VELOCITIES = 64, 64
"""Cells of the section along the phase and along the velocity."""


class Scales(NamedTuple):
    """What a pilot run sets.

    Attributes
    ----------
    centre, scale : ndarray, shape (GROUPS, 2)
        Of the power sums of flight and speed.
    edges : ndarray, shape (GROUPS, 2, BINS - 1)
        Inner edges of the bins, ascending; the first and the last bin are open.
    first : ndarray of int, shape (GROUPS, 2, CELLS + 1)
        Number of edges below each cell.
    low, high : ndarray, shape (2,)
        Velocities between which the section of each mesh is counted.
    slow : float
        Speed below which an impact is slow.
    """

    centre: Floats
    scale: Floats
    edges: Floats
    first: NDArray[np.int16]
    low: Floats
    high: Floats
    slow: float


class Sums(NamedTuple):
    """The sums of a block of paths.

    Attributes
    ----------
    main : ndarray, shape (paths, batches, MAIN)
        Sums in each batch of time.
    batch : ndarray of int, shape (1,)
        The batch that is being filled.
    power : ndarray, shape (paths, GROUPS, 2, POWERS)
        Power sums of flight and speed.
    energy : ndarray, shape (paths, GROUPS, 2)
        Sums of the squared energy loss, and of the energy loss times the flight.
    histogram : ndarray of uint32, shape (units, GROUPS, 2, BINS)
        Counts of flight and speed, of `together` successive paths each.
    section : ndarray of uint32, shape (units, 2, PHASES, VELOCITIES)
        Impacts at each mesh by phase and velocity before them.
    together : int
        Paths that share a unit: counts of fewer units stay in the cache of a core.
    scales : Scales
        Set by the pilot run.
    """

    main: Floats
    batch: NDArray[np.int64]
    power: Floats
    energy: Floats
    histogram: Counts
    section: Counts
    together: int
    scales: Scales


def new_sums(paths: int, batches: int, scales: Scales, detail: bool = True, together: int = 1) -> Sums:
    """Empty sums.

    Parameters
    ----------
    paths, batches : int
        Number of paths, and of batches.
    scales : Scales
        From the pilot run.
    detail : bool
        Whether there is space for distributions and the section.
    together : int
        Paths that share counts of distributions and section.

    Returns
    -------
    Sums
    """
    n = paths if detail else 0
    units = -(-n // together)
    return Sums(
        np.zeros((paths, batches, MAIN)), np.zeros(1, np.int64), np.zeros((n, GROUPS, 2, POWERS)),
        np.zeros((n, GROUPS, 2)), np.zeros((units, GROUPS, 2, BINS), np.uint32),
        np.zeros((units, 2, PHASES, VELOCITIES), np.uint32), together, scales,
    )  # fmt: skip


@inlined
def bin_of(edges: Floats, first: NDArray[np.int16], value: float) -> int:
    """Number of edges at or below a value.

    Parameters
    ----------
    edges : ndarray
        Ascending.
    first : ndarray of int, shape (CELLS + 1,)
        Number of edges below each of the cells of equal width between the outermost edges.
    value : float
        What is looked up.

    Returns
    -------
    int
    """
    n = edges.size
    if value < edges[0]:
        return 0
    if value >= edges[n - 1]:
        return n
    cell = min(int((value - edges[0]) / (edges[n - 1] - edges[0]) * CELLS), CELLS - 1)
    low, high = (
        int(first[cell]),
        int(first[cell + 1]) + 1,
    )  # one more: rounding may put a value into the cell before its own
    low, high = max(low - 1, 0), min(high, n)
    while low < high:
        middle = (low + high) // 2
        if edges[middle] <= value:
            low = middle + 1
        else:
            high = middle
    return low


@jit
def _add_group(s: Sums, p: int, b: int, g: int, flight: float, speed: float, lost: float, detail: bool) -> None:
    """Add an impact to a group."""
    s.main[p, b, 4 * g + NUMBER] += 1.0
    s.main[p, b, 4 * g + SPEED] += speed
    s.main[p, b, 4 * g + ENERGY] += lost
    s.main[p, b, 4 * g + SLOW] += speed < s.scales.slow
    if not detail:
        return
    for i in range(2):
        value = flight if i == FLIGHT else speed
        u, power = (value - s.scales.centre[g, i]) / s.scales.scale[g, i], 1.0
        for k in range(POWERS):
            s.power[p, g, i, k] += power
            power *= u
        s.histogram[p // s.together, g, i, bin_of(s.scales.edges[g, i], s.scales.first[g, i], value)] += np.uint32(1)
    s.energy[p, g, 0] += lost * lost
    s.energy[p, g, 1] += lost * flight


@jit
def add_stretch(
    c: Constants, rows: Floats, impacts: NDArray[np.int64], struck: Floats, states: Floats, tau: float, apart: float,
    s: Sums, detail: bool,
) -> None:  # fmt: skip
    """Add the impacts and the states of a stretch to the sums of each path.

    Parameters
    ----------
    c : Constants
        Of the scene.
    rows : ndarray, shape (paths, impacts or more, COLUMNS)
        Impacts, as the kernel records them.
    impacts : ndarray of int, shape (paths or more,)
        Number of impacts of each path.
    struck : ndarray, shape (paths, 2)
        Time of the last impact at each mesh; brought up to date.
    states : ndarray, shape (paths, samples, 4)
        States at equal distances.
    tau, apart : float
        Time of the first sample, and between two samples.
    s : Sums
        Added to.
    detail : bool
        Whether distributions and the section are counted too.
    """
    b, turn, n = s.batch[0], 2.0 * math.pi, states.shape[1]
    sine, cosine = np.sin(tau + apart * np.arange(n)), np.cos(tau + apart * np.arange(n))
    for p in range(len(rows)):
        for k in range(impacts[p]):
            code = int(rows[p, k, 6])
            mesh = abs(code)
            y = rows[p, k, 2 * mesh + 1]
            lost = energy_loss(c, mesh, rows[p, k, 3], rows[p, k, 5])
            last = max(struck[p, 0], struck[p, 1])
            _add_group(s, p, b, 0, rows[p, k, 0] - last, abs(y), lost, detail)
            if c.stages == 2:
                _add_group(s, p, b, mesh, rows[p, k, 0] - struck[p, mesh - 1], abs(y), lost, detail)
            struck[p, mesh - 1] = rows[p, k, 0]
            if detail:
                turns = rows[p, k, 0] / turn
                phase = int((turns - math.floor(turns)) * PHASES)
                low, high = s.scales.low[mesh - 1], s.scales.high[mesh - 1]
                place = (y - low) / (high - low)
                if 0.0 <= place < 1.0:
                    s.section[p // s.together, mesh - 1, min(phase, PHASES - 1), int(place * VELOCITIES)] += np.uint32(
                        1
                    )
        for k in range(n):
            y1, y2 = states[p, k, 1], states[p, k, 3]
            v = y2 - y1
            s.main[p, b, CONTACT] += y1 == 0.0  # in flight with probability 0
            s.main[p, b, WORK] += y1 * y1
            s.main[p, b, WORK + 2] += (c.beta1 * cosine[k] - sine[k]) * y1
            if c.stages == 2:
                s.main[p, b, CONTACT + 1] += y2 == 0.0
                s.main[p, b, WORK + 1] += v * v
                s.main[p, b, WORK + 3] += (c.beta2 * cosine[k] - sine[k]) * v
