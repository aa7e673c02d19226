"""Poincaré sections in the paper's coordinates (Fig. 2) as histograms.

The section is at the impacts: a point is the flight time since the last impact and the velocity just before this one.
Points are counted as they come, so memory does not grow with their number.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.closure import mean_map
from rattle.compare.chaos.record import NoRecord, Regime, noisy_record, orbit_record
from rattle.scene.scene import Scene
from rattle.scene.validate import count

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ORBIT, MAP, NOISY = "orbit", "mean map (corrected)", "noisy system"
BINS = 300  # along either axis
PILOT = 20_000  # points of the pilot run that sets the axes
PARTS = 8  # noisy paths among which the points are shared, whatever the number of workers
MARGIN = 0.05  # added to the axes at each end, relative to their length
MAPPED = 4000  # points of the mean map, which propagates moments as well


@dataclass(frozen=True)
class Section:
    """A Poincare section as counts."""

    side: str  # ``orbit``, ``mean map (corrected)`` or ``noisy system``
    flight: Floats  # flight, velocity: edges of the bins; (bins + 1,)
    velocity: Floats
    counts: Ints  # impacts by flight time and by the velocity of each stage before the impact; (stages, bins, bins)
    outside: Ints  # impacts outside the edges; (stages,)
    points: int  # all impacts: the sum of each stage's counts and `outside`
    reason: str  # what the orbit or path did, see `Regime.reason`

    @property
    def table(self) -> pd.DataFrame:
        """Bins that are not empty: ``side, stage, flight, velocity`` (middles of the bin), ``count``."""
        stage, i, j = np.nonzero(self.counts)
        middle = [0.5 * (edges[1:] + edges[:-1]) for edges in (self.flight, self.velocity)]
        return pd.DataFrame(
            {
                "side": self.side,
                "stage": stage + 1,
                "flight": middle[0][i],
                "velocity": middle[1][j],
                "count": self.counts[stage, i, j],
            }
        )


class _Counter:
    """Histogram of a section, filled in as points come."""

    def __init__(self, edges: tuple[Floats, Floats], stages: int) -> None:
        self.flight, self.velocity = edges
        self.stages = stages
        self.counts = np.zeros((stages, edges[0].size - 1, edges[1].size - 1), np.int64)
        self.outside = np.zeros(stages, np.int64)
        self.points = 0

    def add(self, flight: Floats, before: Floats) -> None:
        rows, columns = self.flight.size - 1, self.velocity.size - 1
        i = np.floor((flight - self.flight[0]) * (rows / (self.flight[-1] - self.flight[0]))).astype(np.int64)
        for stage in range(self.stages):
            y = before[:, 2 * stage + 1]
            j = np.floor((y - self.velocity[0]) * (columns / (self.velocity[-1] - self.velocity[0]))).astype(np.int64)
            inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
            found = np.bincount(i[inside] * columns + j[inside], minlength=rows * columns)
            self.counts[stage] += found.reshape(rows, columns)
            self.outside[stage] += int((~inside).sum())
        self.points += flight.size

    def join(self, other: "_Counter") -> None:
        self.counts += other.counts
        self.outside += other.outside
        self.points += other.points

    def section(self, side: str, reason: str) -> Section:
        return Section(side, self.flight, self.velocity, self.counts, self.outside, self.points, reason)


def _orbit_points(scene: Scene, points: int, regime: Regime) -> Iterator[tuple[Floats, Floats]]:
    for s in orbit_record(scene, points, regime, tangent=False):
        yield s.flight, s.before
    if regime.impacts == 0 or not regime.has_record:
        raise NoRecord(f"the orbit {regime.brief}")


def _noisy_points(scene: Scene, points: int, seed: int, path: int, regime: Regime) -> Iterator[tuple[Floats, Floats]]:
    left = points
    for s, _ in noisy_record(scene, 2**30, seed, regime, path=path, tangent=False):
        yield s.flight[:left], s.before[:left]
        left -= s.flight[:left].size
        if left <= 0:
            return
    raise NoRecord(f"the noisy path {regime.brief}")


def frame(scene: Scene, seed: int = 0, points: int = PILOT) -> tuple[Floats, Floats]:
    """Choose the edges of bins that cover the orbit and the noisy system, by a pilot run of each that has a section.

    Shapes: result (bins + 1,).
    """
    found: list[tuple[Floats, Floats]] = []
    with suppress(NoRecord):
        found += _orbit_points(scene, points, Regime())
    try:
        found += _noisy_points(scene, points, seed, PARTS, Regime())
    except NoRecord:
        if not found:
            raise
    flight = np.concatenate([f for f, _ in found])
    velocity = np.concatenate([b[:, 1 : 2 * scene.stages : 2].ravel() for _, b in found])
    low, high = np.quantile(velocity, [1e-4, 1.0 - 1e-4])
    room = MARGIN * (high - low)
    longest = (1.0 + MARGIN) * float(np.quantile(flight, 1.0 - 1e-4))
    return np.linspace(0.0, longest, BINS + 1), np.linspace(low - room, high + room, BINS + 1)


def orbit_section(scene: Scene, points: int, edges: tuple[Floats, Floats]) -> Section:
    """Compute the section of the noise-free orbit."""
    counter, regime = _Counter(edges, scene.stages), Regime()
    for flight, before in _orbit_points(scene, points, regime):
        counter.add(flight, before)
    return counter.section(ORBIT, regime.reason)


def _noisy_section(scene: Scene, points: int, edges: tuple[Floats, Floats], seed: int, workers: int) -> Section:
    shares = [points // PARTS + (p < points % PARTS) for p in range(PARTS)]

    def part(p: int) -> tuple[_Counter, Regime]:
        counter, regime = _Counter(edges, scene.stages), Regime()
        if shares[p]:
            for flight, before in _noisy_points(scene, shares[p], seed, p, regime):
                counter.add(flight, before)
        return counter, regime

    whole, sticking, computed = _Counter(edges, scene.stages), 0, 0
    with ThreadPoolExecutor(workers) as pool:
        for counter, regime in pool.map(part, range(PARTS)):
            whole.join(counter)
            sticking, computed = sticking + regime.sticking_steps, computed + regime.computed
    return whole.section(NOISY, f"{PARTS} paths with {computed:,} impacts, {sticking} sticking steps")


def _map_section(scene: Scene, edges: tuple[Floats, Floats]) -> Section:
    """The section of the corrected mean map, followed from the start of the orbit."""
    t = mean_map(scene, impacts=MAPPED, closure="corrected").trace
    counter = _Counter(edges, scene.stages)
    counter.add(np.diff(t.tau[: t.found + 1]), t.mean[1 : t.found + 1])
    return counter.section(MAP, t.stopped or f"followed through {MAPPED:,} impacts from the start")


def sections(
    scene: Scene, *, points: int = 1_000_000, seed: int = 0, workers: int = 2, missing: dict[str, str] | None = None
) -> dict[str, Section]:
    """Compute the sections of the orbit, of the corrected mean map and of the noisy system, on the same axes.

    Returns: By side; without the orbit and the mean map if the orbit has no section (see `orbit_section`), and
    without the noisy system if its path has none.
    """
    count("points", points, least=100)
    count("workers", workers)
    missing = {} if missing is None else missing
    found: dict[str, Section] = {}
    try:
        edges = frame(scene, seed)
    except NoRecord as reason:
        missing["the Poincaré sections"] = str(reason)
        return found
    try:
        found[ORBIT] = orbit_section(scene, points, edges)
        if scene.sigma > 0.0:
            found[MAP] = _map_section(scene, edges)
    except NoRecord as reason:
        missing["the Poincaré section of the orbit"] = str(reason)
    try:
        found[NOISY] = _noisy_section(scene, points, edges, seed, workers)
    except NoRecord as reason:
        missing["the Poincaré section of the noisy system"] = str(reason)
    return found
