"""Poincaré sections in the paper's coordinates (Fig. 2) as histograms; fields that vary, and bifurcation diagrams.

The section is at the impacts: a point is the flight time since the last impact and the velocity just before this one.
Points are counted as they come, so memory does not grow with their number.  A bifurcation diagram has the velocity
alone, as counts or as densities.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.closure import mean_map
from rattle.compare.chaos.record import NoRecord, Regime, in_threads, leave_out, noisy_record, orbit_record
from rattle.montecarlo.long_run import AtRest, BurnInError, long_run
from rattle.scene import Floats, InputError, Ints, Scene, Start, choice, count, finite
from rattle.scene.scene import SWEPT

ORBIT, MAP, NOISY = "orbit", "mean map (corrected)", "noisy system"
WITHOUT_NOISE, WITH_NOISE = "without noise", "with noise"
BINS = 300  # of counts, along either axis
PILOT = 20_000  # points of the pilot run that sets the axes
PARTS = 8  # noisy paths among which the points are shared, whatever the number of workers
MARGIN = 0.05  # added to the axes at each end, relative to their length
MAPPED = 4000  # points of the mean map, which propagates moments as well
ALPHAS = "0.05:2.5:100"
DENSITY_BINS = 240
DENSITY_POINTS = 6000  # impacts of an orbit behind each density without noise
PATHS, PERIODS = 64, 64  # of the long run behind each density with noise


@dataclass(frozen=True)
class Section:
    """A Poincare section as counts."""

    side: str  # ``orbit``, ``mean map (corrected)`` or ``noisy system``
    flight: Floats  # flight, velocity: edges of the bins; (bins + 1,)
    velocity: Floats
    counts: Ints  # impacts by flight time and by the velocity of each stage before the impact; (stages, bins, bins)
    points: int  # all impacts, those outside the edges too

    @property
    def table(self) -> pd.DataFrame:
        """Bins that are not empty: ``side, stage, flight, velocity`` (middles of the bin), ``count``."""
        stage, i, j = np.nonzero(self.counts)
        flight, velocity = (0.5 * (edges[1:] + edges[:-1]) for edges in (self.flight, self.velocity))
        found = {"stage": stage + 1, "flight": flight[i], "velocity": velocity[j], "count": self.counts[stage, i, j]}
        return pd.DataFrame({"side": self.side, **found})


def _section(side: str, stages: int, edges: tuple[Floats, Floats], found: Iterable[tuple[Floats, Floats]]) -> Section:
    """Count points, given as flight times and states before the impact, as they come."""
    counts, points = np.zeros((stages, *(edge.size - 1 for edge in edges)), np.int64), 0
    for flight, before in found:
        points += flight.size
        for stage in range(stages):
            counts[stage] += np.histogram2d(flight, before[:, 2 * stage + 1], edges)[0].astype(np.int64)
    return Section(side, *edges, counts, points)


def _orbit_points(scene: Scene, points: int) -> Iterator[tuple[Floats, Floats]]:
    regime = Regime()
    for s in orbit_record(scene, points, regime, tangent=False):
        yield s.flight, s.before
    if regime.impacts == 0 or not regime.has_record:
        raise NoRecord(f"the orbit {regime.brief}")


def _noisy_points(scene: Scene, points: int, seed: int, path: int) -> Iterator[tuple[Floats, Floats]]:
    regime = Regime()
    for s, _ in noisy_record(scene, 2**30, seed, regime, path=path, tangent=False):
        yield s.flight[:points], s.before[:points]
        points -= s.flight.size
        if points <= 0:
            return
    raise NoRecord(f"the noisy path {regime.brief}")


def frame(scene: Scene, seed: int) -> tuple[Floats, Floats]:
    """Choose the edges of bins that cover the orbit and the noisy system, by a pilot run of each that has a section.

    Shapes: result (bins + 1,).
    """
    found: list[tuple[Floats, Floats]] = []
    with suppress(NoRecord):
        found += _orbit_points(scene, PILOT)
    try:
        found += _noisy_points(scene, PILOT, seed, PARTS)
    except NoRecord:
        if not found:
            raise
    flight = np.concatenate([f for f, _ in found])
    velocity = np.concatenate([b[:, 1 : 2 * scene.stages : 2].ravel() for _, b in found])
    low, high = np.quantile(velocity, [1e-4, 1.0 - 1e-4])
    room = MARGIN * (high - low)
    longest = (1.0 + MARGIN) * float(np.quantile(flight, 1.0 - 1e-4))
    return np.linspace(0.0, longest, BINS + 1), np.linspace(low - room, high + room, BINS + 1)


def sections(
    scene: Scene, *, points: int = 1_000_000, seed: int = 0, workers: int = 2, missing: dict[str, str] | None = None
) -> dict[str, Section]:
    """Compute the sections of the orbit, of the corrected mean map and of the noisy system, on the same axes.

    Returns: By side; without the orbit and the mean map if the orbit has no section, and without the noisy system if
    its path has none.
    """

    def part(p: int) -> Section:
        share = points // PARTS + (p < points % PARTS)
        return _section(NOISY, scene.stages, edges, _noisy_points(scene, share, seed, p))

    found: dict[str, Section] = {}
    with leave_out(missing, "the Poincaré sections"):
        edges = frame(scene, seed)
        with leave_out(missing, "the Poincaré section of the orbit"):
            found[ORBIT] = _section(ORBIT, scene.stages, edges, _orbit_points(scene, points))
            if scene.sigma > 0.0:
                t = mean_map(scene, impacts=MAPPED, closure="corrected").trace
                mapped = np.diff(t.tau[: t.found + 1]), t.mean[1 : t.found + 1]
                found[MAP] = _section(MAP, scene.stages, edges, [mapped])
        with leave_out(missing, "the Poincaré section of the noisy system"):
            counts = np.sum([s.counts for s in in_threads(workers, part, range(PARTS))], axis=0)
            found[NOISY] = Section(NOISY, *edges, counts, points)
    return found


def values(name: str, text: str) -> tuple[float, ...]:
    """Read evenly spaced values from ``LOW:HIGH:POINTS``."""
    words = text.split(":")
    try:
        low, high, points = float(words[0]), float(words[1]), int(words[2])
    except (ValueError, IndexError):
        raise InputError(name, text, f"give LOW:HIGH:POINTS, as in {ALPHAS}") from None
    if len(words) > 3 or not finite(f"{name} LOW", low) < finite(f"{name} HIGH", high):
        raise InputError(name, text, f"give LOW:HIGH:POINTS with LOW below HIGH, as in {ALPHAS}")
    count(f"{name} POINTS", points, least=2)
    return tuple(float(v) for v in np.linspace(low, high, points))


def paper_noise(scene: Scene) -> Scene:
    """Return the scene with the paper's noise intensity, ``sigma = sqrt(alpha)``."""
    return scene.with_sigma(math.sqrt(scene.alpha))


def vary(
    scene: Scene, field: str, at: Iterable[float], noise: Callable[[Scene], Scene] = lambda scene: scene
) -> dict[float, Scene]:
    """The same scene at each value of a field; a default start is adapted to new gaps.

    `noise`: Maps each scene to the same with its noise set, such as `paper_noise`.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> [s.alpha for s in vary(Scene.from_gears(DAT21), "alpha", (0.5, 1.0)).values()]
    [0.5, 1.0]
    """
    choice("field", field, SWEPT)
    usual = scene.start == Start(0.0, scene.gap1, 2.0, scene.gap2, 2.0, mesh=1)
    fresh: dict[str, Any] = {"start": None} if usual else {}
    return {value: noise(replace(scene, **(fresh | {field: value}))) for value in at}


@dataclass(frozen=True)
class Bifurcation:
    """A histogram of the velocity before an impact for each value of a field, of the orbit and with noise."""

    field: str
    at: Floats  # values of the field; (values,)
    edges: Floats  # of the velocity; (bins + 1,)
    cells: dict[str, NDArray[Any]]  # counts or densities by side; zero where there is nothing; (values, bins)
    reasons: dict[str, list[str]]  # by side and value: why there is nothing; empty where there is something
    columns: tuple[str, str]  # names of the velocity and of the cells in `table`

    @property
    def table(self) -> pd.DataFrame:
        """Cells that are not empty: ``side``, the field, the velocity (middle of the bin), the count or density."""
        velocity, name = self.columns
        middle, parts = 0.5 * (self.edges[1:] + self.edges[:-1]), []
        for side, cells in self.cells.items():
            i, j = np.nonzero(cells)
            part = {"side": side, self.field: self.at[i], velocity: middle[j], name: cells[i, j]}
            parts.append(pd.DataFrame(part))
        return pd.concat(parts, ignore_index=True)


def bifurcation(
    scenes: Mapping[float, Scene], field: str = "alpha", *, points: int = 10_000, seed: int = 0, workers: int = 2
) -> Bifurcation:
    """Count the velocity y1 before the impacts of the orbit and of the noisy system at both meshes.

    `scenes`: By value of the field, as of `vary`.
    """

    def of(s: Scene) -> tuple[tuple[Floats, Regime], tuple[Floats, Regime]]:
        path, noisy = Regime(), np.empty(0)
        for x, _ in noisy_record(s, 2**30, seed, path, tangent=False):
            noisy = np.concatenate([noisy, x.before[:, 1]])
            if path.impacts >= points:
                break
        return _orbit_velocities(s, points, (1, 2)), (noisy[:points], path)

    orbits, paths = zip(*in_threads(workers, of, scenes.values()), strict=True)
    found = {ORBIT: orbits, NOISY: paths}
    every = np.concatenate([v for side in found.values() for v, _ in side])
    if every.size == 0:
        raise NoRecord(f"the noisy path {paths[0][1].brief}")
    low, high = np.quantile(every, [1e-4, 1.0 - 1e-4])
    edges = np.linspace(low, high, BINS + 1)
    cells = {side: np.array([np.histogram(v, edges)[0] for v, _ in own]) for side, own in found.items()}
    reasons = {side: ["" if r.unfollowed else r.end for _, r in own] for side, own in found.items()}
    return Bifurcation(field, np.array(list(scenes)), edges, cells, reasons, ("y1", "count"))


def stationary_bifurcation(
    scenes: Mapping[float, Scene], field: str = "alpha", *, seed: int = 0, workers: int = 1
) -> Bifurcation:
    """Compute the density of the velocity y1 before the impacts at mesh 1, of the orbit and of the noisy long run."""

    def of(s: Scene) -> tuple[tuple[Floats, str], tuple[tuple[Floats, Floats], str]]:
        velocity, regime = _orbit_velocities(s, DENSITY_POINTS, (1,))
        return (velocity, "" if regime.has_record else regime.reason), _density(s, seed)

    orbits, runs = zip(*in_threads(workers, of, scenes.values()), strict=True)
    ends = np.concatenate([*(velocity for velocity, _ in orbits), *(own for (own, _), _ in runs)])
    if ends.size == 0:
        rest = "mesh 1 is not struck in the long run at any of these values; choose some at which it rattles"
        raise InputError("over", list(scenes), rest)
    edges = np.linspace(ends.min(), ends.max(), DENSITY_BINS + 1)
    width = edges[1] - edges[0]
    quiet = np.array([np.histogram(velocity, edges)[0] / max(velocity.size, 1) / width for velocity, _ in orbits])
    noisy = np.array([_rebin(density, edges) for density, _ in runs])
    cells = {WITHOUT_NOISE: quiet, WITH_NOISE: noisy}
    reasons = {side: [why for _, why in own] for side, own in zip(cells, (orbits, runs), strict=True)}
    return Bifurcation(field, np.array(list(scenes)), edges, cells, reasons, ("velocity", "density"))


def _orbit_velocities(scene: Scene, impacts: int, meshes: tuple[int, ...]) -> tuple[Floats, Regime]:
    """Velocities y1 before the impacts of the orbit at some meshes; none without a record."""
    regime = Regime()
    record = orbit_record(scene, impacts, regime, tangent=False)
    found = [np.empty(0), *(s.before[np.isin(np.abs(s.code), meshes), 1] for s in record)]
    return np.concatenate(found if regime.has_record else found[:1]), regime


def _density(scene: Scene, seed: int) -> tuple[tuple[Floats, Floats], str]:
    """Edges and density of the velocity at mesh 1 in the long run, or nothing and the reason why."""
    nothing = np.empty(0), np.empty(0)
    try:
        run = long_run(scene, periods=PERIODS, paths=PATHS, rng=seed)
    except (AtRest, BurnInError) as error:
        return nothing, str(error)
    density = next((d for d in run.densities if d.mesh == 1), None)
    if density is None:
        return nothing, "mesh 1 is not struck"
    return (density.velocity, run.velocity_density(1)[0]), ""


def _rebin(density: tuple[Floats, Floats], edges: Floats) -> Floats:
    """A density over other cells, taken as constant within its own."""
    own, height = density
    if own.size == 0:
        return np.zeros(edges.size - 1)
    below = np.concatenate([[0.0], np.cumsum(height * np.diff(own))])
    return np.asarray(np.diff(np.interp(edges, own, below)) / np.diff(edges))
