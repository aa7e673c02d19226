"""What a pilot run sets: where distributions are counted, and about which mean."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from rattle.montecarlo.long_run.sums import ABOVE, BINS, CELLS, FLIGHT, GROUPS, KINDS, SPEED, Scales, cell_of
from rattle.scene.compiled import jit

Floats = NDArray[np.float64]

TAILS = 8.0  # outermost edges at the probabilities expit(+-8), 3e-4, of the pilot run
MARGIN = 0.05  # of the range of velocities, at each end of the section


def no_scales(slow: float) -> Scales:
    """Scales before there is a pilot run: nothing but means can be summed by them."""
    shape = (GROUPS, KINDS)
    edges = np.zeros((*shape, BINS - 1))
    first = np.zeros((*shape, CELLS + 1), np.int16)
    return Scales(np.zeros(shape), np.ones(shape), edges, first, np.zeros(2), np.ones(2), slow)


@jit
def impacts_of(rows: Floats, impacts: NDArray[np.int64], struck: Floats) -> Floats:
    """The impacts of a stretch one below the other.

    Returns: Mesh, time since the last impact and since the last one at this mesh, velocity at this mesh. Shapes:
    result (impacts, 4).
    """
    total = 0
    for p in range(len(rows)):
        total += impacts[p]
    out, n = np.empty((total, 4)), 0
    for p in range(len(rows)):
        for k in range(impacts[p]):
            mesh, tau = int(abs(rows[p, k, 6])), rows[p, k, 0]
            out[n, 0], out[n, 3] = mesh, rows[p, k, 2 * mesh + 1]
            out[n, 1] = tau - max(struck[p, 0], struck[p, 1])
            out[n, 2] = tau - struck[p, mesh - 1]
            struck[p, mesh - 1] = tau
            n += 1
    return out


def scales_of_pilot(seen: Floats, slow: float) -> Scales:
    """Scales from the impacts of a pilot run.

    The edges of the bins are quantiles of the pilot run, densest in the tails, so that every quantile that is asked for
    lies among bins of little probability, whatever the distribution looks like.

    Shapes: `seen` (impacts, 4).

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> s = scales_of_pilot(np.column_stack([np.ones(1000), *rng.uniform(1.0, 2.0, (3, 1000))]), 0.1)
    >>> s.edges.shape, bool(abs(s.centre[0, FLIGHT] - 1.5) < 0.05)
    ((3, 3, 399), True)
    """
    s = no_scales(slow)
    share = expit(np.linspace(-TAILS, TAILS, BINS - 1))
    for g in range(GROUPS):
        own = seen if g == 0 else seen[seen[:, 0] == g]
        if len(own) == 0:
            continue
        speed = np.abs(own[:, 3])
        for i, values in ((FLIGHT, own[:, 1 if g == 0 else 2]), (SPEED, speed), (ABOVE, speed[speed >= slow])):
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
            room = MARGIN * (high - low) + 1e-9 * max(abs(low), abs(high), 1e-30)
            s.low[g - 1], s.high[g - 1] = low - room, high + room
    return s
