"""Bifurcation diagrams: the velocity before an impact over a field of the scene, as counts or as densities."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.chaos.record import (
    SILENT,
    STICKS_FOR_GOOD,
    STICKS_OFTEN,
    NoRecord,
    Regime,
    noisy_record,
    orbit_record,
)
from rattle.compare.chaos.section import NOISY, ORBIT
from rattle.compare.chaos.sweep import over_field
from rattle.montecarlo.long_run import AtRest, BurnInError, long_run
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import count

Floats = NDArray[np.float64]

BINS = 300  # of counts
WITHOUT_NOISE, WITH_NOISE = "without noise", "with noise"
DENSITY_BINS = 240
POINTS = 6000  # impacts of an orbit behind each density without noise
PATHS, PERIODS = 64, 64  # of the long run behind each density with noise


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
    scene: Scene,
    at: Sequence[float],
    *,
    field: str = "alpha",
    points: int = 10_000,
    noise: Callable[[Scene], Scene] | None = None,
    seed: int = 0,
    workers: int = 2,
) -> Bifurcation:
    """Count the velocity y1 before the impacts of the orbit and of the noisy system at both meshes.

    `noise`: Maps each scene to the same with its noise set; without it, the noise of `scene` is used.
    """

    def of(s: Scene) -> tuple[tuple[Floats, Regime], tuple[Floats, Regime]]:
        orbit, path = Regime(), Regime()
        found = [x.before[:, 1] for x in orbit_record(s, points, orbit, tangent=False)]
        noisy: list[Floats] = []
        for x, _ in noisy_record(s, 2**30, seed, path, tangent=False):
            noisy.append(x.before[:, 1])
            if path.impacts >= points:
                break
        return (_join(found if orbit.has_record else []), orbit), (_join(noisy)[:points], path)

    found = over_field(scene, at, field, noise, workers, of)
    every = np.concatenate([v for pair in found for v, _ in pair])
    if every.size == 0:
        raise NoRecord(f"the noisy path {found[0][1][1].brief}")
    low, high = np.quantile(every, [1e-4, 1.0 - 1e-4])
    edges = np.linspace(low, high, BINS + 1)
    cells, reasons = {}, {}
    for n, side in enumerate((ORBIT, NOISY)):
        cells[side] = np.array([np.histogram(pair[n][0], edges)[0] for pair in found])
        kinds = [pair[n][1].kind for pair in found]
        reasons[side] = [kind if kind in (STICKS_OFTEN, STICKS_FOR_GOOD, SILENT) else "" for kind in kinds]
    return Bifurcation(field, np.asarray(at, dtype=float), edges, cells, reasons, ("y1", "count"))


def stationary_bifurcation(
    scene: Scene, at: Sequence[float], *, field: str = "alpha", seed: int = 0, workers: int = 1
) -> Bifurcation:
    """Compute the density of the velocity y1 before the impacts at mesh 1, of the orbit and of the noisy long run."""
    count("workers", workers)

    def of(s: Scene) -> tuple[tuple[Floats, str], tuple[tuple[Floats, Floats] | None, str]]:
        regime = Regime()
        found = [x.before[np.abs(x.code) == 1, 1] for x in orbit_record(s, POINTS, regime, tangent=False)]
        orbit = (_join(found), "") if regime.has_record else (_join([]), regime.reason)
        return orbit, _density(s, seed)

    found = over_field(scene, at, field, None, workers, of)
    ends = [v for (orbit, _), _ in found if orbit.size for v in (orbit.min(), orbit.max())]
    ends += [edge for _, (noisy, _) in found if noisy for edge in noisy[0][[0, -1]]]
    if not ends:
        rest = "mesh 1 is not struck in the long run at any of these values; choose some at which it rattles"
        raise InputError("over", list(at), rest)
    edges = np.linspace(min(ends), max(ends), DENSITY_BINS + 1)
    width = edges[1] - edges[0]
    quiet = np.array([np.histogram(o, edges)[0] / max(o.size, 1) / width for (o, _), _ in found])
    noisy = np.array([_rebin(density, edges) for _, (density, _) in found])
    cells = {WITHOUT_NOISE: quiet, WITH_NOISE: noisy}
    reasons = {side: [pair[n][1] for pair in found] for n, side in enumerate(cells)}
    return Bifurcation(field, np.asarray(at, float), edges, cells, reasons, ("velocity", "density"))


def _join(parts: list[Floats]) -> Floats:
    return np.concatenate([np.empty(0), *parts])


def _density(scene: Scene, seed: int) -> tuple[tuple[Floats, Floats] | None, str]:
    """Edges and density of the velocity at mesh 1 in the long run, or the reason why there is none."""
    try:
        run = long_run(scene, periods=PERIODS, paths=PATHS, rng=seed)
    except (AtRest, BurnInError) as error:
        return None, str(error)
    density = next((d for d in run.densities if d.mesh == 1), None)
    if density is None:
        return None, "mesh 1 is not struck"
    return (density.velocity, run.velocity_density(1)[0]), ""


def _rebin(found: tuple[Floats, Floats] | None, edges: Floats) -> Floats:
    """A density over other cells, taken as constant within its own."""
    if found is None:
        return np.zeros(edges.size - 1)
    own, density = found
    below = np.concatenate([[0.0], np.cumsum(density * np.diff(own))])
    return np.asarray(np.diff(np.interp(edges, own, below)) / np.diff(edges))
