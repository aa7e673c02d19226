"""Figures of a long run: distributions, the section with its errors, memories, and the closures'
errors."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rattle.closure.stationary import Law
from rattle.compare.chaos.figures import draw_cells, label_velocity, speed_unit
from rattle.compare.report.style import (
    ACCURATE_COLOUR,
    STYLE,
    error_bars,
    legend_above,
    new_figure,
    new_panels,
)
from rattle.compare.report.texts import wheel_label
from rattle.montecarlo.long_run import LongRun
from rattle.montecarlo.statistics.intervals import half_width
from rattle.scene import Floats

SIMULATED_COLOUR: Any = STYLE["monte carlo"]["color"]
DEEP = 1e-3  # lower end of the colours of a density, relative to its highest
LEGEND_WIDTH = 7.4  # inches, that the legend of a figure with one panel takes


def draw(found: Any, scatter: pd.DataFrame, sets: Mapping[str, Floats]) -> dict[str, Figure]:
    """All figures of a `Stationary` that was simulated.

    `scatter`, `sets`: Of the scatter between gear sets its quantiles, and the values of all sets by
    quantity.
    """
    run = found.run
    out = {"distribution": distribution_figure(run, found.laws), "section": section_figure(run)}
    if sets:
        out["scatter"] = scatter_figure(scatter, sets)
    if not run.is_scattered:
        out["memory"] = memory_figure(found.table)
    verdicts = found.verdicts
    if len(verdicts) and verdicts["predicted"].notna().any():
        out["closures"] = closure_figure(verdicts)
    return out


def distribution_figure(run: LongRun, laws: Mapping[str, Law | str]) -> Figure:
    """Draw the density of the velocity before an impact at each mesh with its 95 % band, and that
    of the closures."""
    t = half_width(run.paths)
    columns = min(len(run.densities), 2)
    figure, axes = new_panels(len(run.densities), 2, max(4.6, LEGEND_WIDTH / columns), 3.6)
    factor, unit = speed_unit(run.scene.gears)
    for ax, density in zip(axes, run.densities, strict=True):
        value, se = run.velocity_density(density.mesh) / np.array([[factor]])
        edges = factor * density.velocity
        top = float((value + t * se).max())
        least = max(0.3 * float(value[value > 0.0].min()), 1e-6 * top)
        low, middle, high = np.maximum([value - t * se, value, value + t * se], least)
        ax.stairs(middle, edges, baseline=least, color=SIMULATED_COLOUR, lw=1.2, label="simulation")
        ax.stairs(
            high,
            edges,
            baseline=low,
            color=SIMULATED_COLOUR,
            alpha=0.25,
            lw=0,
            fill=True,
            label="simulation: 95 % interval",
        )
        ax.set(yscale="log", ylim=(least, 2.0 * top))
        for closure, law in laws.items():
            if isinstance(law, Law):
                _speeds(ax, law, density.mesh, closure, edges, factor)
        slow = factor * run.slow
        ax.axvspan(-slow, slow, color="0.6", alpha=0.3, lw=0, label="slow impacts")
        ax.set_xlabel(rf"velocity before the impact $y_{density.mesh}$ ({unit})")
        ax.set_title(f"mesh {wheel_label(run.scene, density.mesh)}", loc="left")
    for ax in axes[::columns]:
        ax.set_ylabel(f"probability density (1 / ({unit}))")
    legend_above(figure, 3)
    return figure


def _speeds(ax: Axes, law: Law, mesh: int, closure: str, edges: Floats, factor: float) -> None:
    """Mean speed of a closure's law on both sides, as lines: its law is one of speeds."""
    part = law.mesh == mesh
    if not part.any():
        return
    mean = factor * np.average(law.speed[part], weights=law.weight[part])
    colour = STYLE[closure]["color"]
    for at in (-mean, mean):
        if edges[0] <= at <= edges[-1]:
            ax.axvline(at, ymax=0.12, color=colour, lw=2.0, label=f"{closure}: mean speed")


def section_figure(run: LongRun) -> Figure:
    """Draw the density of the section over phase and velocity, and its relative error in every
    cell."""
    densities = run.densities
    rows = len(densities)
    factor, unit = speed_unit(run.scene.gears)
    figure, axes = new_figure(9.2, 0.6 + 2.9 * rows, rows, 2)
    for d, left, right in zip(densities, axes[::2], axes[1::2], strict=True):
        edges = d.phase / math.pi, factor * d.velocity
        density = d.density / factor
        highest = float(density.max())
        with np.errstate(invalid="ignore", divide="ignore"):
            relative = d.se / d.density
        image = draw_cells(left, *edges, density, DEEP * highest, highest)
        error = draw_cells(right, *edges, relative, 0.01, 1.0, "magma_r")
        for ax, what in ((left, "density"), (right, "standard error / density")):
            ax.set_xlabel(r"phase of the excitation ($\pi$ rad)")
            ax.set_title(f"mesh {wheel_label(run.scene, d.mesh)}: {what}", loc="left")
        label_velocity(left, d.mesh, unit)
        figure.colorbar(image, ax=left, pad=0.01, label=f"1 / (rad · {unit})")
        figure.colorbar(error, ax=right, pad=0.01, label="share of the density")
    return figure


def memory_figure(table: pd.DataFrame) -> Figure:
    """Draw the autocorrelation time of each quantity, and the standard error from batch means
    beside it."""
    rows = table[table["autocorrelation"] > 0.0]
    rows = rows[[not name.startswith("contact") for name in rows.index]][::-1]
    figure, (ax,) = new_figure(7.0, 1.0 + 0.16 * len(rows))
    at = np.arange(len(rows))
    ax.plot(np.array([np.ones(len(rows)), rows["autocorrelation"]]), [at, at], color="0.75", lw=1.0)
    colour = STYLE["corrected"]["color"]
    ax.plot(rows["autocorrelation"], at, ls="none", marker="o", ms=4, color=colour)
    ax.axvline(1.0, color="k", lw=0.9)
    ax.set_yticks(at, rows.index, fontsize=7)
    name = "autocorrelation time (impacts); 1: as if impacts were independent"
    ax.set(xscale="log", ylim=(-1.0, len(rows)), xlabel=name)
    return figure


def scatter_figure(scatter: pd.DataFrame, sets: Mapping[str, Floats]) -> Figure:
    """Draw the distribution of each quantity over gear sets, with its quantiles and their
    intervals."""
    figure, axes = new_figure(3.1 * len(sets), 3.4, 1, len(sets))
    for ax, (quantity, values) in zip(axes, sets.items(), strict=True):
        rows: Any = scatter[scatter["quantity"] == quantity].dropna(subset="low")
        steps = np.sort(values)
        share = 100.0 * np.arange(1, len(steps) + 1) / len(steps)
        ax.step(steps, share, where="post", color=SIMULATED_COLOUR, lw=1.0, label="gear sets")
        ax.errorbar(
            "value",
            "percent",
            data=rows,
            xerr=error_bars(rows),
            label="quantile with 95 % interval",
            fmt="o",
            ms=4,
            capsize=3,
            color=STYLE["saltation"]["color"],
        )
        unit = scatter.loc[scatter["quantity"] == quantity, "unit"].iloc[0]
        ax.set(xlabel=f"{quantity} ({unit})" if unit else quantity, ylim=(0.0, 100.0))
    axes[0].set_ylabel("share of gear sets below (%)")
    legend_above(figure, 2)
    return figure


def closure_figure(verdicts: pd.DataFrame) -> Figure:
    """Draw the errors of the closures in units of what is admissible."""
    rows = verdicts[verdicts["predicted"].notna() & (verdicts["tolerance"] > 0.0)]
    names = list(dict.fromkeys(rows["quantity"]))[::-1]
    closures = rows["closure"].unique()
    figure, (ax,) = new_figure(7.4, 1.2 + 0.17 * len(names))
    ax.axvspan(-1.0, 1.0, color=ACCURATE_COLOUR, alpha=0.3, lw=0, label="accurate")
    for i, closure in enumerate(closures):
        errors = rows[rows["closure"] == closure].set_index("quantity")
        at = [names.index(name) + 0.25 * (i - 0.5 * (len(closures) - 1)) for name in errors.index]
        share = errors["error"] / errors["tolerance"]
        half = 0.5 * (errors["high"] - errors["low"]) / errors["tolerance"]
        ax.errorbar(
            share,
            at,
            xerr=half,
            label=closure,
            ls="none",
            ms=3.5,
            capsize=1.5,
            lw=0.8,
            **STYLE[closure],
        )
    ax.set_xscale("symlog", linthresh=1.0)
    ax.set_yticks(range(len(names)), names, fontsize=7)
    ax.set(ylim=(-1.0, len(names)), xlabel="error of the closure / tolerance")
    legend_above(figure, 4)
    return figure
