"""What changes over a field of the scene: the largest exponent with its sign, and bifurcation
diagrams.

A bifurcation diagram has the velocity before the impacts alone, as counts or as densities.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.closure import closures_for, mean_map
from rattle.compare.chaos.exponents import LONGEST_RECORD, drift_exponents, lyapunov
from rattle.compare.chaos.record import NoRecord, Regime, in_threads, noisy_record, orbit_record
from rattle.compare.chaos.section import (
    NOISY,
    ORBIT_SECTION,
    SECTION_BINS,
    middles,
    tabulate_cells,
)
from rattle.compare.engine.run import obtain_all
from rattle.compare.engine.store import Cell, Content
from rattle.compare.report.json_text import Facts
from rattle.montecarlo.kernel.blocks import Blocks, Budget
from rattle.montecarlo.long_run import AtRest, BurnInError, long_run
from rattle.montecarlo.looks import order_ends_first
from rattle.scene import Floats, InputError, Scene
from rattle.scene.changes import change, find_value

SWEEP_COLUMNS = ("largest", "low", "high", "rate", "sum_error", "impacts", "regime", "reason")
PUBLISHED_IMPACTS = 30  # impacts through which the published map is followed at each value
WITHOUT_NOISE = "without noise"
WITH_NOISE = "with noise"
DENSITY_BINS = 240
DENSITY_POINTS = 6000  # impacts of an orbit behind each density without noise
# of the long run behind each density with noise
SWEEP_PATHS = 64
SWEEP_PERIODS = 64


def paper_noise(scene: Scene) -> Scene:
    """Return the scene with the paper's noise intensity, ``sigma = sqrt(alpha)``."""
    return scene.with_sigma(math.sqrt(scene.alpha))


def vary(
    scene: Scene,
    field: str,
    at: Iterable[float],
    noise: Callable[[Scene], Scene] = lambda scene: scene,
) -> dict[float, Scene]:
    """The same scene at each value of a field, or of a value of its gears.

    `noise`: Maps each scene to the same with its noise set, such as `paper_noise`.
    """
    find_value(scene, field, "field")  # there is one
    return {value: noise(change(scene, {field: value})) for value in at}


@dataclass(frozen=True)
class AtValue(Cell):
    """What is measured at one value of the field."""

    packages = ("closure", "montecarlo", "compare/chaos")

    scene: Scene
    value: float
    seed: int

    @property
    def settings(self) -> Facts:
        """Everything that determines the result besides the scene."""
        return {"kind": self.group} | self.list_fields("value")

    @property
    def label(self) -> str:
        """Short description for the progress line."""
        return f"{self.group} at {self.value:.3g}"


@dataclass(frozen=True)
class ExponentsAt(AtValue):
    """The largest exponents: a row for each linearised system."""

    group = "exponents"

    width: float
    longest: int  # impacts of a record

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, Facts]:
        """Measure them."""
        scene = self.scene
        orbit = lyapunov(scene, width=self.width, longest=self.longest).table[:1]
        path = drift_exponents(scene, width=self.width, longest=self.longest, seed=self.seed)
        rows = [orbit, orbit.assign(of="mean map (corrected, saltation)"), path.table[:1]]
        if scene.sigma > 0.0 and "published" in closures_for(scene):
            m = mean_map(scene, impacts=PUBLISHED_IMPACTS, closure="published")
            how = "realizable throughout"
            if m.breakdown:
                how = f"not realizable from impact {m.breakdown.impact}"
            end = m.stopped or f"followed through {PUBLISHED_IMPACTS} impacts"
            published = {
                "of": "mean map (published)",
                "impacts": m.trace.found,
                "regime": "breaks down",
                "reason": f"{how}; {end}",
            }
            rows.append(pd.DataFrame([published]))
        table = pd.concat(rows, ignore_index=True).rename(columns={"value": "largest"})
        return table[["of", *SWEEP_COLUMNS]], {}


@dataclass(frozen=True)
class VelocitiesAt(AtValue):
    """Velocities y1 before the impacts of the orbit and of a noisy path, at all meshes."""

    group = "velocities"

    points: int

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, Facts]:
        """Record them; the facts say why there are none."""
        path = Regime()
        record = noisy_record(self.scene, self.seed, path, impacts=self.points, tangent=False)
        noisy = np.concatenate([np.empty(0), *(s.before[:, 1] for s, _ in record)])
        orbit, regime = _orbit_velocities(self.scene, self.points, range(1, 1 + self.scene.stages))
        velocities = {ORBIT_SECTION: orbit, NOISY: noisy[: self.points]}
        table = pd.concat([pd.DataFrame({"side": s, "y1": y1}) for s, y1 in velocities.items()])
        reasons = {
            side: "" if r.unfollowed else r.end
            for side, r in ((ORBIT_SECTION, regime), (NOISY, path))
        }
        return table.reset_index(drop=True), {"reasons": reasons, "brief": path.brief}


@dataclass(frozen=True)
class Bifurcation:
    """A histogram of the velocity before an impact for each value of a field, of the orbit and with
    noise."""

    field: str
    at: Floats  # values of the field; (values,)
    edges: Floats  # of the velocity; (bins + 1,)
    # counts or densities by side; zero where there is nothing; (values, bins)
    cells: dict[str, NDArray[Any]]
    # by side and value: why there is nothing; empty where there is something
    reasons: dict[str, list[str]]
    columns: tuple[str, str]  # names of the velocity and of the cells in `table`

    @property
    def table(self) -> pd.DataFrame:
        """Cells that are not empty: ``side``, the field, the velocity (middle of the bin), the
        count or density."""
        velocity, name = self.columns
        axes = {self.field: self.at, velocity: middles(self.edges)}
        parts = [tabulate_cells(side, cells, name, axes) for side, cells in self.cells.items()]
        return pd.concat(parts, ignore_index=True)


@dataclass(frozen=True)
class FieldSweep:
    """What is measured over a field: both ends first, the other values as long as a budget
    allows."""

    scenes: Mapping[float, Scene]  # by value of the field, as of `vary`
    field: str = "alpha"
    seed: int = 0
    workers: int = 2
    folder: Path | None = None  # where results are stored
    limit: Budget | None = None  # time after which no further value is begun

    def exponents(self, width: float = 0.01, longest: int = LONGEST_RECORD) -> pd.DataFrame:
        """Compute the largest exponent of the orbit, the mean maps, and the drift along a noisy
        path.

        `width`: Required width of the interval of each largest exponent; wider ones are reported as
        they are, as after `longest` impacts. Returns: Columns: the field, ``of`` (the linearised
        system), ``largest, low, high`` (largest exponent and its 95 % interval; NaN where there is
        no record), ``rate, sum_error, impacts`` as of `Exponents`, and ``regime, reason`` as of
        `Regime`.
        """
        done = self._obtain(lambda at, scene: ExponentsAt(scene, at, self.seed, width, longest))
        tables = {at: content.table for at, content in done.items()}
        table: pd.DataFrame = pd.concat(tables, names=[self.field]).reset_index(self.field)
        return table.reset_index(drop=True)

    def bifurcation(self, points: int = 10_000) -> Bifurcation:
        """Count the velocity y1 before the impacts of the orbit and of the noisy system at both
        meshes."""
        done = self._obtain(lambda at, scene: VelocitiesAt(scene, at, self.seed, points))
        contents = list(done.values())
        velocities = np.concatenate([content.table["y1"] for content in contents])
        if velocities.size == 0:
            raise NoRecord(f"the noisy path {contents[0].facts['brief']}")
        low, high = np.quantile(velocities, [1e-4, 1.0 - 1e-4])
        edges = np.linspace(low, high, SECTION_BINS + 1)
        counts = {}
        reasons = {}
        for side in (ORBIT_SECTION, NOISY):
            tables = (content.table for content in contents)
            counts[side] = np.array(
                [np.histogram(table["y1"][table["side"] == side], edges)[0] for table in tables]
            )
            reasons[side] = [content.facts["reasons"][side] for content in contents]
        at = np.array(list(done))
        return Bifurcation(self.field, at, edges, counts, reasons, ("y1", "count"))

    def _obtain(self, cell_at: Callable[[float, Scene], Cell]) -> dict[float, Content]:
        """The results by value, in the order of the values."""
        order = order_ends_first(list(self.scenes))
        contents: dict[float, Content] = {}
        at_once = len(order) if self.limit is None else 2 * self.workers
        for first in range(0, len(order), at_once):
            if contents and self.limit is not None and self.limit.remaining <= 0.0:
                break
            part = order[first : first + at_once]
            cells = [cell_at(at, self.scenes[at]) for at in part]
            contents |= zip(part, obtain_all(cells, self.folder, self.workers), strict=True)
        return {at: contents[at] for at in self.scenes if at in contents}


def stationary_bifurcation(
    scenes: Mapping[float, Scene], field: str, *, seed: int, workers: int
) -> Bifurcation:
    """Compute the density of the velocity y1 before the impacts at mesh 1, of the orbit and of the
    noisy long run."""

    follow_orbit = partial(_orbit_velocities, impacts=DENSITY_POINTS, meshes=(1,))
    orbits = in_threads(workers, follow_orbit, scenes.values())
    runs = in_threads(workers, partial(_density, seed=seed), scenes.values())
    ends = np.concatenate([*(velocity for velocity, _ in orbits), *(run[0] for run in runs)])
    if ends.size == 0:
        rest = (
            "mesh 1 is not struck in the long run at any of these values; choose some at which it"
            " rattles"
        )
        raise InputError("over", list(scenes), rest)
    edges = np.linspace(ends.min(), ends.max(), DENSITY_BINS + 1)
    width = edges[1] - edges[0]
    cells = {
        WITHOUT_NOISE: np.array(
            [np.histogram(v, edges)[0] / max(v.size, 1) / width for v, _ in orbits]
        ),
        WITH_NOISE: np.array([_rebin(own, density, edges) for own, density, _ in runs]),
    }
    reasons = {
        WITHOUT_NOISE: ["" if regime.has_record else regime.reason for _, regime in orbits],
        WITH_NOISE: [why for *_, why in runs],
    }
    return Bifurcation(
        field, np.array(list(scenes)), edges, cells, reasons, ("velocity", "density")
    )


def _orbit_velocities(scene: Scene, impacts: int, meshes: Sequence[int]) -> tuple[Floats, Regime]:
    """Velocities y1 before the impacts of the orbit at some meshes; none without a record."""
    regime = Regime()
    record = orbit_record(scene, impacts, regime, tangent=False)
    parts = [s.before[np.isin(np.abs(s.code), meshes), 1] for s in record]
    velocity = np.concatenate([np.empty(0), *parts])
    return velocity if regime.has_record else np.empty(0), regime


def _density(scene: Scene, seed: int) -> tuple[Floats, Floats, str]:
    """Edges and density of the velocity at mesh 1 in the long run, or nothing and the reason
    why."""
    why = "mesh 1 is not struck"
    try:
        run = long_run(scene, periods=SWEEP_PERIODS, paths=SWEEP_PATHS, rng=seed)
        for density in run.densities:
            if density.mesh == 1:
                return density.velocity, run.velocity_density(1)[0], ""
    except (AtRest, BurnInError) as error:
        why = str(error)
    return np.empty(0), np.empty(0), why


def _rebin(cells: Floats, density: Floats, edges: Floats) -> Floats:
    """A density over other cells, taken as constant within its own."""
    if cells.size == 0:
        return np.zeros(edges.size - 1)
    below = np.append(0.0, np.cumsum(density * np.diff(cells)))
    return np.asarray(np.diff(np.interp(edges, cells, below)) / np.diff(edges))
