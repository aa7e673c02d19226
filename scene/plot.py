"""Figures of section moments, predicted or sampled, and of an orbit between its walls."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from rattle.scene.constants import Constants
from rattle.scene.errors import choice
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene
from rattle.scene.shown_figure import ShownFigure
from rattle.scene.types import Floats, Ints
from rattle.scene.units import units_of

if TYPE_CHECKING:
    import pandas as pd


def plot_section(
    columns: "Mapping[str, Any] | pd.DataFrame", scene: Scene, quantity: str, units: str, title: str
) -> ShownFigure:
    """Draw mean and sd of a quantity just before each impact, with the standard error of the mean where there is one.

    `columns` are dimensionless, of shape (impacts,), by their names in a section table.
    """
    choice("quantity", quantity, SECTION[: 2 + 2 * scene.stages])
    unit, factor = units_of(units, scene.gears)[quantity]
    mean, sd = factor * columns[quantity], factor * columns["sd_" + quantity]
    impact = range(1, len(mean) + 1)
    figure = ShownFigure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    axes.fill_between(impact, mean - sd, mean + sd, alpha=0.2, lw=0.0, label="mean ± sd")
    if "se_" + quantity in columns:
        se, label = factor * columns["se_" + quantity], "mean, with its standard error"
        axes.errorbar(impact, mean, se, fmt="o-", ms=4, lw=1.2, capsize=2, label=label)
    else:
        axes.plot(impact, mean, "o-", ms=4, lw=1.2, label="mean")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("impact")
    axes.set_ylabel(f"{quantity} before the impact in {unit}")
    axes.set_title(f"{title}, sigma = {scene.sigma:.4g}", loc="left")
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    return figure


def plot_orbit(
    c: Constants,
    times: Floats,
    states: Floats,
    tau: Floats,
    mesh: Ints,
    before: Floats,
    sticking: Sequence[tuple[int, int, float, float, int]],
) -> ShownFigure:
    """Draw displacements over time, the walls, the impacts at each mesh, and the times in which a mesh sticks.

    Shapes: `times` (n,) with `states` (n, 4); `tau` and `mesh` (impacts,) with the states `before` (impacts, 4);
    `sticking` as `rattle.closure.orbit.StickingPhase`.
    """
    figure = ShownFigure(figsize=(7.0, 0.6 + 1.8 * c.stages), layout="constrained")
    panels = figure.subplots(c.stages, 1, sharex=True, squeeze=False)[:, 0]
    for i, (ax, wall) in enumerate(zip(panels, (c.wall1, c.wall2), strict=False)):
        here = np.flatnonzero(mesh == i + 1)
        ax.plot(times, states[:, 2 * i], color="#0072B2", lw=1.2)
        ax.plot(tau[here], before[here, 2 * i], "o", color="#D55E00", ms=4, label=f"impact at mesh {i + 1}")
        for side in (-1, 1):
            ax.axhline(side * wall, color="0.4", lw=1.0)
        phases = [(a, b) for stuck, _, a, b, _ in sticking if stuck == i + 1 and a < times[-1]]
        for number, (closed, opened) in enumerate(phases):
            label = "_" * (number > 0) + f"mesh {i + 1} sticks"
            ax.axvspan(closed, min(opened, times[-1]), color="#E69F00", alpha=0.3, lw=0, label=label)
        ax.set_ylabel(f"$x_{i + 1}$ in backlash1")
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    panels[-1].set_xlabel(r"time $\tau = \omega t$")
    return figure
