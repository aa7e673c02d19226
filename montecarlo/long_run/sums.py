"""The sums that a long run keeps of each path: their size does not depend on how long it is.

Impacts are counted in groups: all, and those at each mesh; the flight of a group is the time since
its last impact.  Distributions are histograms over edges that a pilot run
has set, with power sums about its mean; those of the speed are the same for all groups, so that all
impacts are the sum of those at the meshes.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.scene import Constants, Floats, Ints
from rattle.scene.compiled import inline, internal, splice
from rattle.scene.drive import PERIOD, velocity_acceleration
from rattle.scene.impact import energy_loss

Counts = NDArray[np.uint32]

NOISE = 0
"""Columns of `Sums.main` from here: the control variates of
`rattle.montecarlo.long_run.noise_work`."""
LEFT_OUT = NOISE + CONTROLS
"""Columns of `Sums.main` from here: what impacts that are not followed lose at closed meshes, how
long meshes are closed for them, and the most of them that are not slow."""
NUMBER, SPEED, ENERGY, SLOW = range(LEFT_OUT + 3, LEFT_OUT + 7)
"""Columns of all impacts in `Sums.main`: their number, sums of speed and of energy lost, number of
slow impacts; those of a mesh are 4 times its number further on."""
NEAR_FLANK = 0.01  # of the backlash
FLIGHT = 0
OF_SPEED = 1
ABOVE = 2
DISTRIBUTION_KINDS = 3
"""Distributions: flight, speed, and the speed of impacts that are not slow; how many these are."""
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


class Columns(NamedTuple):
    """Columns of `Sums.main` from which on there is one for each mesh, or for each group."""

    contact: int  # samples at which a mesh is closed
    open: int  # samples at which it is open: no flank is as near as `NEAR_FLANK`
    # squared and work: sums over the samples of v^2 and n v, v the deviation of the speed of a
    # wheel and n the modulation of its noise (docs/model.md section 10)
    squared: int
    work: int
    above_speed: int  # speed of impacts that are not slow; of each group
    total: int


def columns_of(wheels: int) -> Columns:
    """The columns of `Sums.main` for so many wheels."""
    contact = NUMBER + 4 * (wheels + 1)
    above_speed = contact + 4 * wheels
    return Columns(
        contact=contact,
        open=contact + wheels,
        squared=contact + 2 * wheels,
        work=contact + 3 * wheels,
        above_speed=above_speed,
        total=above_speed + wheels + 1,
    )


class Scales(NamedTuple):
    """What a pilot run sets."""

    # centre, scale: of the power sums of flight and speeds; (groups, DISTRIBUTION_KINDS)
    centre: Floats
    scale: Floats
    # inner edges of the bins, ascending; the first and the last bin are open; (groups,
    # DISTRIBUTION_KINDS, SUM_BINS - 1)
    edges: Floats
    # number of edges in lower cells; (groups, DISTRIBUTION_KINDS, CELLS + 1)
    first: NDArray[np.int16]
    low: (
        Floats  # low, high: velocities between which the section of each mesh is counted; (wheels,)
    )
    high: Floats
    slow: float  # speed below which an impact is slow


class Sums(NamedTuple):
    """The sums of a block of paths; all but `main` are empty before a pilot run has set what they
    need."""

    main: Floats  # sums in each batch of time; (paths, batches, `Columns.total`)
    columns: Columns  # of them
    batch: Ints  # the batch that is being filled; (1,)
    # power sums of flight and speeds; (paths, groups, DISTRIBUTION_KINDS, POWER_SUMS)
    power: Floats
    # sums of the squared energy loss, of the energy loss times the flight, and of flights to
    # impacts that are not slow; (paths, groups, 3)
    products: Floats
    # counts of flight and speeds, of `together` successive paths each.  Speeds, and the squared
    # energy loss, are counted for each mesh only (also in `power` and `products`);
    # (units, groups, DISTRIBUTION_KINDS, SUM_BINS)
    histogram: Counts
    # impacts at each mesh by phase and velocity before them; (units, wheels, PHASES,
    # VELOCITY_CELLS)
    section: Counts
    together: int  # paths that share a unit: counts of fewer units stay in the cache of a core
    scales: Scales  # set by the pilot run
    periods: int = 0  # of each path, of the sums of all paths together

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return self.scales.low.size

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
        of_paths = self.main[:, :, 4 * mesh + NUMBER].sum(axis=1)
        return np.asarray(np.add.reduceat(of_paths, np.arange(0, self.paths, self.together)))


def new_sums(
    paths: int, batches: int, scales: Scales, detail: bool = True, together: int = 1
) -> Sums:
    """Sums of nothing yet; `detail`: whether distributions are counted too."""
    n = paths if detail else 0
    wheels = scales.low.size
    groups = wheels + 1
    columns = columns_of(wheels)
    main = np.zeros((paths, batches, columns.total))
    batch = np.zeros(1, np.int64)
    units = -(-n // together)
    power = np.zeros((n, groups, DISTRIBUTION_KINDS, POWER_SUMS))
    products = np.zeros((n, groups, 3))
    histogram = np.zeros((units, groups, DISTRIBUTION_KINDS, SUM_BINS), np.uint32)
    section = np.zeros((units, wheels, PHASES, VELOCITY_CELLS), np.uint32)
    return Sums(main, columns, batch, power, products, histogram, section, together, scales)


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


@splice
def _add_states(
    c: Constants, states: Floats, modulated: Floats, walls: Floats, p: int, v: Floats, s: Sums
) -> None:
    """Add the states of the wheels of a path, and their work.

    `v`: Room for the deviations of the speeds. Shapes: `states` (samples, 2 wheels); `modulated`,
    `v` (wheels, samples).
    """
    main = s.main[p, s.batch[0]]
    columns = s.columns
    for i in range(c.wheels.size):
        wheel = c.wheels[i]
        near = 2.0 * NEAR_FLANK * wheel.wall
        closed = is_open = squared = moved = 0.0
        for k in range(len(states)):
            x = states[k, 2 * i]
            y = states[k, 2 * i + 1]
            carried = wheel.ratio * v[wheel.parent, k] if wheel.parent >= 0 else 0.0
            speed = wheel.sign * y + carried
            v[i, k] = speed
            closed += y == 0.0  # in flight with probability 0
            is_open += near - walls[2 * i + 1, p] < x < walls[2 * i, p] - near
            squared += speed * speed
            moved += modulated[i, k] * speed
        main[columns.contact + i] += closed
        main[columns.open + i] += is_open
        main[columns.squared + i] += squared
        main[columns.work + i] += moved


@internal
def _modulations(c: Constants, tau: float, apart: float, n: int) -> Floats:
    """The modulation ``kappa (f'' + beta f')`` of the noise of each wheel, at n times.

    Shapes: result (wheels, n).
    """
    out = np.empty((c.wheels.size, n))
    for k in range(n):
        first, second = velocity_acceleration(c.drive, tau + apart * k)
        for i in range(c.wheels.size):
            wheel = c.wheels[i]
            out[i, k] = wheel.turn * (wheel.beta * first + second)
    return out


@splice
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

    Shapes: `rows` (paths, impacts or more, columns); `impacts` (paths or more,); `struck` (paths,
    wheels); `states` (paths, samples, 2 wheels); `walls` (2 wheels, paths or more), as they are at
    its end.
    """
    n = states.shape[1]
    wheels = c.wheels.size
    above_speed = s.columns.above_speed
    detail = len(s.power) > 0
    modulated = _modulations(c, tau, apart, n)
    v = np.empty((wheels, n))
    code = 2 + 2 * wheels
    for p in range(len(rows)):
        main = s.main[p, s.batch[0]]
        last = struck[p]
        for k in range(impacts[p]):
            now = rows[p, k, 0]
            mesh = abs(int(rows[p, k, code]))
            y = rows[p, k, 2 * mesh + 1]
            slow = abs(y) < s.scales.slow
            lost = energy_loss(c, mesh, y)
            main[4 * mesh + NUMBER] += 1.0
            main[4 * mesh + SPEED] += abs(y)
            main[4 * mesh + ENERGY] += lost
            main[4 * mesh + SLOW] += slow
            if not slow:
                main[above_speed + mesh] += abs(y)
            if detail:
                flight = rows[p, k, 1]
                own = now - last[mesh - 1]
                _add_value(s, p, 0, FLIGHT, flight)
                _add_value(s, p, mesh, FLIGHT, own)
                _add_value(s, p, mesh, OF_SPEED, abs(y))
                s.products[p, 0, 1] += lost * flight
                s.products[p, mesh, 1] += lost * own
                s.products[p, mesh, 0] += lost * lost
                if not slow:
                    _add_value(s, p, mesh, ABOVE, abs(y))
                    s.products[p, 0, 2] += flight
                    s.products[p, mesh, 2] += own
                _add_to_section(s, p, mesh, now, y)
            last[mesh - 1] = now
        _add_meshes(main, NUMBER, 4, 4, wheels)
        _add_meshes(main, above_speed, 1, 1, wheels)
        _add_states(c, states[p], modulated, walls, p, v, s)


@inline
def _add_meshes(main: Floats, first: int, columns: int, apart: int, wheels: int) -> None:
    """Fill the columns of all impacts with the sums of those of the meshes."""
    for column in range(first, first + columns):
        total = 0.0
        for mesh in range(1, wheels + 1):
            total += main[column + apart * mesh]
        main[column] = total


@splice
def add_left_out(closed: Floats, s: Sums) -> None:
    """Add what is not followed at closed meshes to the sums of each path.

    Shapes: `closed` (wheels + 2, paths or more), see `rattle.montecarlo.schemes.lanes.Room`.
    """
    wheels = len(closed) - 2
    for p in range(len(s.main)):
        main = s.main[p, s.batch[0]]
        total = 0.0
        for i in range(wheels):
            total += closed[i, p]
            main[4 * (i + 1) + ENERGY] += closed[i, p]
        main[ENERGY] += total
        main[LEFT_OUT] += total
        main[LEFT_OUT + 1] += closed[wheels, p]
        main[LEFT_OUT + 2] += closed[wheels + 1, p]


def no_scales(wheels: int, slow: float) -> Scales:
    """Scales before there is a pilot run: nothing but means can be summed by them."""
    shape = (wheels + 1, DISTRIBUTION_KINDS)
    edges = np.zeros((*shape, SUM_BINS - 1))
    first = np.zeros((*shape, CELLS + 1), np.int16)
    low = np.zeros(wheels)
    high = np.ones(wheels)
    return Scales(np.zeros(shape), np.ones(shape), edges, first, low, high, slow)


def scales_of_pilot(wheels: int, seen: Floats, slow: float) -> Scales:
    """Scales from the impacts of a pilot run.

    The edges of the bins are quantiles of the pilot run, densest in the tails, so that every
    quantile that is asked for lies among bins of little probability, whatever the distribution
    looks like.  At a mesh those of a speed are as for all impacts, which are the sum of the meshes;
    where the pilot run saw no impact, those of the flight too.

    Shapes: `seen` (impacts, 4).
    """
    s = no_scales(wheels, slow)
    speed = np.abs(seen[:, 3])
    _put_scales(s, 0, FLIGHT, seen[:, 1])
    _put_scales(s, 0, OF_SPEED, speed)
    _put_scales(s, 0, ABOVE, speed[speed >= slow])
    for of in (s.centre, s.scale, s.edges, s.first):
        of[1:] = of[0]
    for g in range(1, wheels + 1):
        own = seen[seen[:, 0] == g]
        if len(own) == 0:
            continue
        _put_scales(s, g, FLIGHT, own[:, 2])
        low, high = np.quantile(own[:, 3], [1e-4, 1.0 - 1e-4])
        room = VELOCITY_MARGIN * (high - low) + 1e-9 * max(abs(low), abs(high), 1e-30)
        s.low[g - 1] = low - room
        s.high[g - 1] = high + room
    return s


def _put_scales(s: Scales, g: int, i: int, values: Floats) -> None:
    """Write the scales of a distribution of a group, if the pilot run saw any of its values."""
    if values.size == 0:
        return
    s.centre[g, i] = values.mean()
    spread = values.std()
    s.scale[g, i] = spread if spread > 0.0 else max(abs(s.centre[g, i]), 1.0)
    share = expit(np.linspace(-TAILS, TAILS, SUM_BINS - 1))
    edges = np.quantile(values, share)
    s.edges[g, i] = edges
    if edges[-1] > edges[0]:
        cells = [cell_of(edges, edge) for edge in edges]
        s.first[g, i] = np.searchsorted(cells, np.arange(CELLS + 1))


def collect(parts: list[Sums], batches: int, periods: int) -> Sums:
    """Join the sums of all blocks of paths, over the batches that are full."""
    names = ("main", "power", "products", "histogram", "section")
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in names
    }
    sums = parts[0]._replace(periods=periods, **joined)
    # all impacts: those at any mesh
    speeds = slice(OF_SPEED, None)
    for of in (sums.power[:, :, speeds], sums.products[:, :, 0], sums.histogram[:, :, speeds]):
        of[:, 0] = of[:, 1:].sum(axis=1)
    return sums._replace(main=sums.main[:, :batches])
