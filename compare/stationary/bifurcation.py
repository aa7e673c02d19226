"""Bifurcation diagrams with noise: the density of the velocity before an impact over a field of the scene."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rattle.compare.chaos.figures import NAMES
from rattle.compare.chaos.over_field import cells_table, over_field
from rattle.compare.chaos.record import Regime, orbit_record
from rattle.compare.report.style import new_figure
from rattle.montecarlo.long_run import AtRest, BurnInError, long_run
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import count

Floats = NDArray[np.float64]

NOISE_FREE, NOISY = "without noise", "with noise"
BINS = 240
POINTS = 6000  # impacts of an orbit at each value
PATHS, PERIODS = 64, 64  # of the long run at each value
DEEP = 1e-3  # lower end of the colours, relative to the highest density


@dataclass(frozen=True)
class Bifurcation:
    """Densities of the velocity before an impact at a mesh, one for each value of a field."""

    field: str
    mesh: int
    at: Floats  # values of the field; (values,)
    edges: Floats  # of the velocity; (bins + 1,)
    density: dict[str, Floats]  # `NOISE_FREE` and `NOISY`; 0 where there is no stationary motion; (values, bins)
    reasons: dict[str, list[str]]  # of each side and value: why there is none, or an empty string

    @property
    def table(self) -> pd.DataFrame:
        """Cells that are not empty: ``side``, the field, ``velocity`` (middle), ``density``."""
        parts = [
            cells_table(side, self.field, self.at, self.edges, "velocity", cells, "density")
            for side, cells in self.density.items()
        ]
        return pd.concat(parts, ignore_index=True)


def bifurcation(
    scene: Scene,
    at: Sequence[float],
    *,
    field: str = "alpha",
    mesh: int = 1,
    noise: Callable[[Scene], Scene] | None = None,
    seed: int = 0,
    workers: int = 1,
) -> Bifurcation:
    """Compute the density of the section over a field of the scene, without noise and with it.

    `noise`: Maps each scene to the same with its noise set; without it, the noise of `scene` is used.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> view = bifurcation(Scene.from_gears(DAT21, sigma=0.3), (0.5, 1.5))
    >>> view.density[NOISY].shape
    (2, 240)
    """
    count("mesh", mesh, least=1, most=scene.stages)
    count("workers", workers)

    def of(s: Scene) -> tuple[tuple[Floats, str], tuple[tuple[Floats, Floats] | None, str]]:
        regime = Regime()
        seen = [x.before[np.abs(x.code) == mesh, 2 * mesh - 1] for x in orbit_record(s, POINTS, regime, tangent=False)]
        ends = not regime.has_record
        orbit = (np.concatenate([np.empty(0), *([] if ends else seen)]), regime.reason if ends else "")
        return orbit, _noisy(s, mesh, seed)

    found = over_field(scene, at, field, noise, workers, of)
    ends = [v for orbit, _ in found for v in (orbit[0].min(initial=np.inf), orbit[0].max(initial=-np.inf))]
    ends += [float(edge) for _, (noisy, _) in found if noisy for edge in noisy[0][[0, -1]]]
    finite = [v for v in ends if np.isfinite(v)]
    if not finite:
        raise InputError("over", list(at), f"mesh {mesh} is not struck in the long run at any of these values")
    edges = np.linspace(min(finite), max(finite), BINS + 1)
    width = edges[1] - edges[0]
    quiet = np.array([np.histogram(o[0], edges)[0] / max(o[0].size, 1) / width for o, _ in found])
    noisy = np.array([_rebin(n[0], edges) for _, n in found])
    reasons = {NOISE_FREE: [o[1] for o, _ in found], NOISY: [n[1] for _, n in found]}
    return Bifurcation(field, mesh, np.asarray(at, float), edges, {NOISE_FREE: quiet, NOISY: noisy}, reasons)


def _noisy(scene: Scene, mesh: int, seed: int) -> tuple[tuple[Floats, Floats] | None, str]:
    """Edges and density of the velocity at a mesh, or the reason why there is none."""
    try:
        run = long_run(scene, periods=PERIODS, paths=PATHS, rng=seed)
    except (AtRest, BurnInError) as error:
        return None, str(error)
    density = next((d for d in run.densities if d.mesh == mesh), None)
    if density is None:
        return None, f"mesh {mesh} is not struck"
    return (density.velocity, run.velocity_density(mesh)[0]), ""


def _rebin(found: tuple[Floats, Floats] | None, edges: Floats) -> Floats:
    """A density over other cells, taken as constant within its own."""
    if found is None:
        return np.zeros(edges.size - 1)
    own, density = found
    below = np.concatenate([[0.0], np.cumsum(density * np.diff(own))])
    return np.asarray(np.diff(np.interp(edges, own, below)) / np.diff(edges))


def bifurcation_figure(view: Bifurcation, factor: float, unit: str) -> Figure:
    """Draw both densities side by side, velocities times a factor in a unit."""
    figure, axes = new_figure(10.4, 4.4, 1, 2)
    half = 0.5 * float(np.diff(view.at).min()) if view.at.size > 1 else 0.5
    x = np.concatenate([[view.at[0] - half], 0.5 * (view.at[1:] + view.at[:-1]), [view.at[-1] + half]])
    for ax, (side, density) in zip(axes, view.density.items(), strict=True):
        top = np.maximum(density.max(axis=1, keepdims=True), 1e-300)
        shown = np.ma.masked_less(density / top, DEEP)
        ax.grid(False)
        image = ax.pcolormesh(
            x, factor * view.edges, np.sqrt(shown.T), cmap="magma_r", vmin=0.0, vmax=1.0, rasterized=True
        )
        ax.set_title(side, loc="left", fontweight="bold")
        ax.set_xlabel(NAMES.get(view.field, view.field))
        lost = [a for a, why in zip(view.at, view.reasons[side], strict=True) if why]
        for n, value in enumerate(lost):
            ax.axvspan(value - half, value + half, color="0.85", lw=0, label="no stationary motion" if n == 0 else None)
        if lost:
            ax.legend(loc="lower left", fontsize=7)
    axes[0].set_ylabel(rf"velocity before the impact $y_{view.mesh}$ ({unit})")
    figure.colorbar(image, ax=axes, label="root of the density / its highest at this value", pad=0.01)
    return figure
