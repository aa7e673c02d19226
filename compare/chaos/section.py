"""Poincaré sections in the paper's coordinates (Fig. 2) as histograms.

The section is at the impacts: a point is the flight time since the last impact and the velocity
just before this one. Points are counted as they come, so memory does not grow with their number.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pandas as pd

from rattle.closure import mean_map
from rattle.compare.chaos.record import (
    NoRecord,
    Regime,
    in_threads,
    leave_out,
    noisy_record,
    orbit_record,
)
from rattle.scene import Floats, Ints, Scene

ORBIT_SECTION = "orbit"
MAP = "mean map (corrected)"
NOISY = "noisy system"
SECTION_BINS = 300  # of counts, along either axis
AXIS_POINTS = 20_000  # points of the pilot run that sets the axes
NOISY_PATHS = 8  # noisy paths among which the points are shared, whatever the number of workers
AXIS_MARGIN = 0.05  # added to the axes at each end, relative to their length
MAP_POINTS = 4000  # points of the mean map, which propagates moments as well


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
        stage, i, j = np.nonzero(self.counts)
        flight, velocity = (
            0.5 * (edges[1:] + edges[:-1]) for edges in (self.flight, self.velocity)
        )
        found = {
            "stage": stage + 1,
            "flight": flight[i],
            "velocity": velocity[j],
            "count": self.counts[stage, i, j],
        }
        return pd.DataFrame({"side": self.side, **found})


def _section(
    side: str, stages: int, edges: tuple[Floats, Floats], found: Iterable[tuple[Floats, Floats]]
) -> Section:
    """Count points, given as flight times and states before the impact, as they come."""
    counts = np.zeros((stages, *(edge.size - 1 for edge in edges)), np.int64)
    points = 0
    for flight, before in found:
        points += flight.size
        for stage in range(stages):
            counts[stage] += np.histogram2d(flight, before[:, 2 * stage + 1], edges)[0].astype(
                np.int64
            )
    return Section(side, *edges, counts, points)


def _orbit_points(scene: Scene, points: int) -> Iterator[tuple[Floats, Floats]]:
    regime = Regime()
    for s in orbit_record(scene, points, regime, tangent=False):
        yield s.flight, s.before
    if regime.impacts == 0 or not regime.has_record:
        raise NoRecord(f"the orbit {regime.brief}")


def _noisy_points(
    scene: Scene, points: int, seed: int, path: int
) -> Iterator[tuple[Floats, Floats]]:
    regime = Regime()
    for s, _ in noisy_record(scene, 2**30, seed, regime, path=path, tangent=False):
        yield s.flight[:points], s.before[:points]
        points -= s.flight.size
        if points <= 0:
            return
    raise NoRecord(f"the noisy path {regime.brief}")


def frame(scene: Scene, seed: int) -> tuple[Floats, Floats]:
    """Choose the edges of bins that cover the orbit and the noisy system, by a pilot run of each
    that has a section.

    Shapes: result (bins + 1,).
    """
    found: list[tuple[Floats, Floats]] = []
    with suppress(NoRecord):
        found += _orbit_points(scene, AXIS_POINTS)
    try:
        found += _noisy_points(scene, AXIS_POINTS, seed, NOISY_PATHS)
    except NoRecord:
        if not found:
            raise
    flight = np.concatenate([f for f, _ in found])
    velocity = np.concatenate([b[:, 1 : 2 * scene.stages : 2].ravel() for _, b in found])
    low, high = np.quantile(velocity, [1e-4, 1.0 - 1e-4])
    room = AXIS_MARGIN * (high - low)
    longest = (1.0 + AXIS_MARGIN) * float(np.quantile(flight, 1.0 - 1e-4))
    return np.linspace(0.0, longest, SECTION_BINS + 1), np.linspace(
        low - room, high + room, SECTION_BINS + 1
    )


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

    def part(p: int) -> Section:
        share = points // NOISY_PATHS + (p < points % NOISY_PATHS)
        return _section(NOISY, scene.stages, edges, _noisy_points(scene, share, seed, p))

    found: dict[str, Section] = {}
    with leave_out(missing, "the Poincaré sections"):
        edges = frame(scene, seed)
        with leave_out(missing, "the Poincaré section of the orbit"):
            found[ORBIT_SECTION] = _section(
                ORBIT_SECTION, scene.stages, edges, _orbit_points(scene, points)
            )
            if scene.sigma > 0.0:
                t = mean_map(scene, impacts=MAP_POINTS, closure="corrected").trace
                mapped = np.diff(t.tau[: t.found + 1]), t.mean[1 : t.found + 1]
                found[MAP] = _section(MAP, scene.stages, edges, [mapped])
        with leave_out(missing, "the Poincaré section of the noisy system"):
            counts = np.sum(
                [s.counts for s in in_threads(workers, part, range(NOISY_PATHS))], axis=0
            )
            found[NOISY] = Section(NOISY, *edges, counts, points)
    return found
