"""Poincaré sections in the paper's coordinates (Fig. 2) as histograms.

The section is at the impacts: a point is the flight time since the last impact and the velocity
just before this one. Points are counted as they come, so memory does not grow with their number.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.closure import closures_for, mean_map
from rattle.compare.chaos.record import NoRecord, in_threads, leave_out, read_orbit, read_path
from rattle.scene import Floats, Ints, Scene
from rattle.scene.tangent import Stretch

ORBIT_SECTION = "orbit"
MAP = "mean map (corrected)"
NOISY = "noisy system"
SECTION_BINS = 300  # of counts, along either axis
AXIS_POINTS = 20_000  # points of the pilot run that sets the axes
NOISY_PATHS = 8  # noisy paths among which the points are shared, whatever the number of workers
AXIS_MARGIN = 0.05  # added to the axes at each end, relative to their length
MAP_POINTS = 4000  # points of the mean map, which propagates moments as well


def middles(edges: Floats) -> Floats:
    """Middle of each bin."""
    return 0.5 * (edges[1:] + edges[:-1])


def tabulate_cells(
    side: str, cells: NDArray[Any], name: str, axes: Mapping[str, NDArray[Any]]
) -> pd.DataFrame:
    """A row for each cell of a histogram that is not empty: its side, its place along each axis,
    and what it holds."""
    filled = np.nonzero(cells)
    places = {
        axis: values[index] for (axis, values), index in zip(axes.items(), filled, strict=True)
    }
    return pd.DataFrame({"side": side, **places, name: cells[filled]})


@dataclass(frozen=True)
class Section:
    """A Poincare section as counts."""

    side: str  # ``orbit``, ``mean map (corrected)`` or ``noisy system``
    flight: Floats  # flight, velocity: edges of the bins; (bins + 1,)
    velocity: Floats
    # impacts by flight time and by the velocity of each stage before the impact; (stages, bins,
    # bins)
    counts: Ints
    points: int  # all impacts, those outside the edges too

    @property
    def table(self) -> pd.DataFrame:
        """Bins that are not empty: ``side, stage, flight, velocity`` (middles of the bin),
        ``count``."""
        axes = {
            "stage": np.arange(1, len(self.counts) + 1),
            "flight": middles(self.flight),
            "velocity": middles(self.velocity),
        }
        return tabulate_cells(self.side, self.counts, "count", axes)


def _noisy_points(scene: Scene, points: int, seed: int, path: int) -> Iterator[Stretch]:
    """Points of a noisy path."""
    for stretch, _ in read_path(scene, seed, path, impacts=points):
        yield stretch.first(points)
        points -= stretch.flight.size


def frame(scene: Scene, seed: int) -> tuple[Floats, Floats]:
    """Choose the edges of bins that cover the orbit and the noisy system, by a pilot run of each
    that has a section.

    Shapes: result (bins + 1,).
    """
    pilot: list[Stretch] = []
    with suppress(NoRecord):
        pilot += read_orbit(scene, AXIS_POINTS)
    try:
        pilot += _noisy_points(scene, AXIS_POINTS, seed, NOISY_PATHS)
    except NoRecord:
        if not pilot:
            raise
    flight = np.concatenate([s.flight for s in pilot])
    velocity = np.concatenate([s.before[:, 1::2].ravel() for s in pilot])
    low, high = np.quantile(velocity, [1e-4, 1.0 - 1e-4])
    room = AXIS_MARGIN * (high - low)
    longest = (1.0 + AXIS_MARGIN) * np.quantile(flight, 1.0 - 1e-4)
    flight_edges, velocity_edges = np.linspace(
        [0.0, low - room], [longest, high + room], SECTION_BINS + 1, axis=1
    )
    return flight_edges, velocity_edges


def sections(
    scene: Scene,
    *,
    points: int = 1_000_000,
    seed: int = 0,
    workers: int = 2,
    missing: dict[str, str] | None = None,
) -> dict[str, Section]:
    """Compute the sections of the orbit, of the corrected mean map and of the noisy system, on the
    same axes.

    Returns: By side; without the orbit and the mean map if the orbit has no section, and without
    the noisy system if its path has none.
    """

    def count(side: str, record: Iterable[Stretch]) -> Section:
        """Count points as they come."""
        counts = np.zeros((scene.stages, SECTION_BINS, SECTION_BINS), np.int64)
        points = 0
        for stretch in record:
            points += stretch.flight.size
            for cells, velocity in zip(counts, stretch.before.T[1::2], strict=True):
                cells += np.histogram2d(stretch.flight, velocity, edges)[0].astype(np.int64)
        return Section(side, *edges, counts, points)

    def count_path(path: int) -> Ints:
        share = points // NOISY_PATHS + (path < points % NOISY_PATHS)
        return count(NOISY, _noisy_points(scene, share, seed, path)).counts

    drawn: dict[str, Section] = {}
    with leave_out(missing, "the Poincaré sections"):
        edges = frame(scene, seed)
        with leave_out(missing, "the Poincaré section of the orbit"):
            drawn[ORBIT_SECTION] = count(ORBIT_SECTION, read_orbit(scene, points))
            if scene.sigma > 0.0 and "corrected" in closures_for(scene):
                with leave_out(missing, "the Poincaré section of the corrected mean map"):
                    t = mean_map(scene, impacts=MAP_POINTS, closure="corrected").trace
                    means = t.mean[1 : t.found + 1]
                    empty = Stretch.empty(0, scene.stages)
                    mapped = empty._replace(flight=np.diff(t.tau[: t.found + 1]), before=means)
                    drawn[MAP] = count(MAP, [mapped])
        with leave_out(missing, "the Poincaré section of the noisy system"):
            counts = np.sum(in_threads(workers, count_path, range(NOISY_PATHS)), axis=0)
            drawn[NOISY] = Section(NOISY, *edges, counts, points)
    return drawn
