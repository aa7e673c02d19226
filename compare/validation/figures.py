"""Figures of a validation: errors, correlation, section histograms, agreement, ranges of
validity."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from rattle.compare.judge.figures import PANELS_IN_A_ROW, error_panel, offsets
from rattle.compare.judge.verdict import ACCURATE_UP_TO, NOT_WRONG, WRONG
from rattle.compare.report.style import (
    FORBIDDEN,
    STYLE,
    SYMBOL,
    VALUE_LABELS,
    cell_edges,
    legend_above,
    new_figure,
    new_panels,
    whole_impacts,
)
from rattle.compare.report.texts import read_texts, wheel_label
from rattle.compare.validation.comparison import CAUSES, Comparison
from rattle.scene import Scene

# the outermost bins of a histogram that are drawn have at least this share of the highest
VISIBLE = 2e-3
LARGEST_RHO = 1.9  # correlations beyond it are drawn at the edge


def error_figure(v: Comparison) -> Figure:
    """Errors of section means and sds per impact and closure, in units of the quantity's sd, with
    intervals."""
    quantities = ["tau", *(f"y{i}" for i in v.meshes)]
    columns = min(len(quantities), PANELS_IN_A_ROW)
    figure, axes = new_panels(2 * len(quantities), columns, 3.4, 2.7)
    section = v.table.query("kind == 'section' and verdict != 'not predicted' and unit > 0.0")
    accurate = (
        f"accurate: means within {v.tolerances.mean:.0%}, sds within {v.tolerances.sd:.0%} of an sd"
    )
    panels = [(moment, quantity) for moment in ("mean", "sd") for quantity in quantities]
    section = section.assign(at=section["impact"])
    for number, (ax, panel) in enumerate(zip(axes, panels, strict=True)):
        error_panel(ax, section, panel, v.closure_names, v.tolerances, accurate)
        unit = "" if number % columns else "error / sd of the quantity"
        ax.set(xlim=(0.5, len(v.run.section) + 0.5), xlabel="impact", ylabel=unit)
        whole_impacts(ax)
    legend_above(figure, 5)
    return figure


def correlation_figure(v: Comparison) -> Figure | None:
    """Correlation of displacement and velocity per stage: closures before impacts, all of them
    mid-flight.

    None without closures but `branching`: a mixture has no moments of a perturbation, hence no
    correlation.
    """
    closures = [
        name for name, prediction in v.predictions.items() if prediction.trace.parts is None
    ]
    if not closures:
        return None
    figure, axes = new_panels(v.scene.stages, 2, 5.2, 3.9)
    mid_flight = v.table[v.table["kind"] == "fixed time"]
    for stage, ax in zip(v.meshes, axes, strict=True):
        for sign in (-1.0, 1.0):
            impossible = r"impossible: $|\rho| > 1$"
            edge = sign * LARGEST_RHO
            ax.axhspan(sign, edge, color=FORBIDDEN, alpha=0.22, lw=0, label=impossible)
        before = v.correlation[v.correlation["stage"] == stage]
        for closure, shift in offsets(closures).items():
            _draw_before_impacts(ax, before[before["closure"] == closure], closure, shift)
        fixed = mid_flight[mid_flight["quantity"] == f"rho{stage}"]
        _draw_mid_flight(ax, fixed.assign(at=fixed["impact"] - 0.5), closures[0], v.z)
        ax.set(
            ylim=(-LARGEST_RHO, LARGEST_RHO),
            xlim=(0.0, len(v.run.section) + 0.5),
            xlabel="impact (mid-flight: in the flight before it)",
            ylabel=SYMBOL[f"rho{stage}"],
        )
        whole_impacts(ax)
        ax.set_title(f"stage {wheel_label(v.scene, stage)}", loc="left")
    legend_above(figure, 4)
    return figure


def _draw_before_impacts(ax: Axes, rows: pd.DataFrame, closure: str, shift: float) -> None:
    """Correlations of a closure just before its impacts, and crosses where there is none."""
    style = STYLE[closure]
    at = rows["impact"] + shift
    rho = rows["rho"].clip(-LARGEST_RHO + 0.12, LARGEST_RHO - 0.12)
    if rho.notna().any():
        ax.plot(at, rho, ls="none", ms=5, label=f"{closure}, before impact", **style)
    broken = at[rows["rho"].isna() & ~rows["realizable"]]
    if len(broken):
        crosses: Any = {"marker": "x", "color": style["color"], "ms": 6, "mew": 1.6}
        height = np.full(len(broken), LARGEST_RHO - 0.25)
        ax.plot(broken, height, ls="none", label=f"{closure}: negative variance", **crosses)


def _draw_mid_flight(ax: Axes, fixed: pd.DataFrame, first: str, z: float) -> None:
    """Correlations of all closures at fixed times, and those of the simulation.

    `first`: The closure beside whose rows those of the simulation stand.
    """
    for name, rows in fixed.dropna(subset=["predicted"]).groupby("closure", sort=False):
        rho = rows["predicted"].clip(-LARGEST_RHO, LARGEST_RHO)
        style = {"mfc": "none", **STYLE[str(name)]}
        ax.plot(rows["at"], rho, ls="none", ms=5, label=f"{name}, mid-flight", **style)
    rows = fixed[fixed["closure"] == first]
    if len(rows):
        mean = rows["simulated"]
        low = mean - (rows["predicted"] - rows["high"])
        high = rows["predicted"] - rows["low"] - mean
        bars = np.abs(np.where(rows["predicted"].notna(), [low, high], z * rows["se"]))
        style = {"label": "Monte Carlo, mid-flight", **STYLE["monte carlo"]}
        ax.errorbar(rows["at"], mean, bars, ls="none", ms=3.5, capsize=2, **style)


def section_figure(v: Comparison) -> Figure:
    """Histogram of the velocities before each path's own impact, with the densities that the
    closures predict."""
    impacts = sorted(set(np.linspace(1, len(v.run.section), 4).round().astype(int).tolist()))
    velocities = [f"y{i}" for i in v.meshes]
    figure, axes = new_figure(
        3.0 * len(impacts), 2.7 * len(velocities), len(velocities), len(impacts)
    )
    assert v.run.histograms is not None
    panels = [(quantity, impact) for quantity in velocities for impact in impacts]
    for ax, (quantity, impact) in zip(axes, panels, strict=True):
        edges, density = v.run.histograms.density(impact, quantity)
        ax.stairs(density, edges, fill=True, color="0.75", label="Monte Carlo, own impact")
        shown = np.flatnonzero(density >= VISIBLE * density.max())
        y = np.linspace(edges[shown[0]], edges[shown[-1] + 1], 600)
        for closure, prediction in v.predictions.items():
            curve = prediction.density(impact, quantity, y)
            if curve is not None:
                kind = "Edgeworth" if prediction.trace.parts is None else "mixture"
                dashes = "--" if closure == "published" else "-"
                colour = STYLE[closure]["color"]
                ax.plot(y, curve, color=colour, lw=1.4, ls=dashes, label=f"{closure}, {kind}")
        if y[0] < y[-1]:  # the edges of very narrow bins may be the same float
            ax.set_xlim(y[0], y[-1])
        ax.xaxis.set_major_locator(MaxNLocator(4))
        ax.set_title(f"impact {impact}", loc="left")
        ax.set(
            ylim=(0.0, 1.25 * max(density.max(), 1e-12)),
            xlabel=rf"{SYMBOL[quantity]} before impact ($\nu_1\omega$)",
            ylabel=r"density ($1/\nu_1\omega$)" if impact == 1 else "",
        )
    legend_above(figure, 4)
    return figure


def agreement_figure(validations: Sequence[Comparison]) -> Figure:
    """Share of paths on an itinerary so far, per noise intensity; dashed: as `branching` predicts
    it."""
    first = validations[0]
    closures_by_itinerary: dict[tuple[int, ...], list[str]] = {}  # at the first noise intensity
    for closure, prediction in first.predictions.items():
        closures_by_itinerary.setdefault(prediction.itinerary, []).append(closure)
    figure, axes = new_figure(4.6 * len(closures_by_itinerary), 3.3, 1, len(closures_by_itinerary))
    shades = mpl.colormaps["cividis"](np.linspace(0.0, 0.8, len(validations)))
    for closures, ax in zip(closures_by_itinerary.values(), axes, strict=True):
        for v, shade, marker in zip(validations, shades, "osD^vP*X" * 8, strict=False):
            share = v.run.agreement[closures[0]]
            label = rf"$\sigma$ = {v.scene.sigma:.4g}"
            ax.plot(share, marker=marker, ms=4, lw=1.2, color=shade, label=label)
            if "branching" in closures:
                predicted: Any = v.predictions["branching"].section.get("agreement", [])
                ax.plot(share.index[: len(predicted)], predicted, color=shade, ls="--", lw=1.0)
        ax.set(ylim=(-0.03, 1.05), xlabel="impact", ylabel="share of paths on it")
        whole_impacts(ax)
        ax.set_title("itinerary of " + ", ".join(closures), loc="left")
    axes[0].legend(loc="best")
    return figure


VALIDATION_FIGURES = {
    "errors": error_figure,
    "correlation": correlation_figure,
    "section": section_figure,
}
"""Figures of one validation, by name."""

MARKER: dict[str, str] = read_texts("validation")["markers"]
"""Markers of the causes; a closure that is accurate to the last impact has none."""
MARKER_HEIGHT = 0.9  # height, in impacts, that a marker takes above the band that it explains


def validity_figure(table: pd.DataFrame, impacts: int) -> Figure:
    """Impact up to which each closure is accurate and not shown wrong, over sigma, a panel for each
    closure."""
    closures = list(table["closure"].unique())
    figure, axes = new_panels(len(closures), 2, 4.7, 2.3, above=1.3)
    for number, (closure, ax) in enumerate(zip(closures, axes, strict=True)):
        _panel(ax, table[table["closure"] == closure].sort_values("sigma"), closure, impacts)
        ax.set_ylabel("" if number % 2 else "impact")
    accurate = table["accurate"]
    not_inaccurate = table["not_inaccurate"]
    open_area: Any = {"facecolor": "none", "edgecolor": "0.35", "hatch": "////"}
    areas = [
        (accurate > 0, Patch(facecolor="0.35", label=f"{ACCURATE_UP_TO} here")),
        (not_inaccurate > accurate, Patch(label=f"{NOT_WRONG} here", **open_area)),
        (not_inaccurate < impacts, Patch(facecolor="none", edgecolor="0.6", label=WRONG)),
    ]
    lines: dict[str, Any] = {
        "99 % of the paths on its itinerary up to here": {"ls": ":", "lw": 1.4},
        f"on its itinerary: {ACCURATE_UP_TO} here": {"lw": 1.0},
    }
    for cause, marker in MARKER.items():
        if (table["cause"] == cause).any():
            lines[CAUSES[cause]] = {"ls": "none", "marker": marker, "ms": 6}
    handles = [
        *(patch for drawn, patch in areas if drawn.any()),
        *(Line2D([], [], color="k", label=label, **style) for label, style in lines.items()),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _panel(ax: Axes, rows: pd.DataFrame, closure: str, impacts: int) -> None:
    sigma = rows["sigma"].to_numpy()
    edges = cell_edges(sigma)
    accurate = rows["accurate"].to_numpy()
    not_inaccurate = rows["not_inaccurate"].to_numpy()
    colour = STYLE[closure]["color"]
    hatched: Any = {
        "fill": True,
        "facecolor": "none",
        "edgecolor": colour,
        "hatch": "////",
        "lw": 0,
    }
    ax.stairs(not_inaccurate, edges, baseline=accurate, **hatched)
    ax.stairs(accurate, edges, fill=True, color=colour)
    ax.stairs(not_inaccurate, edges, color=colour, lw=1.2)
    for name, dashes, width in (("on_itinerary", ":", 1.4), ("itinerary_accurate", "-", 1.0)):
        ax.stairs(rows[name], edges, baseline=None, color="k", ls=dashes, lw=width)
    place = np.minimum(not_inaccurate + 0.5 * MARKER_HEIGHT, impacts)
    for x, y, cause in zip(sigma, place, rows["cause"], strict=True):
        if cause in MARKER:
            ax.plot(x, y, ls="none", marker=MARKER[cause], color="k", ms=5, zorder=5)
    ax.set(
        xscale="log",
        xlim=(edges[0], edges[-1]),
        ylim=(0.0, impacts + 0.5 * MARKER_HEIGHT),
        axisbelow=True,
        xlabel=VALUE_LABELS["sigma"],
    )
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_locator(MaxNLocator(7, integer=True))
    ax.set_title(closure, loc="left", fontweight="bold", color=colour)


def drive_figure(scene: Scene) -> Figure:
    """Speed and acceleration of the driver over a period, and those of each order."""
    figure, axes = new_figure(8.0, 2.8, 1, 2)
    tau = np.linspace(0.0, 2.0 * np.pi, 400)
    for ax, power, name in zip(axes, (1, 2), ("speed $f'$", "acceleration $f''$"), strict=True):
        parts = [
            o.amplitude * o.order**power * np.sin(o.order * tau + o.phase + 0.5 * np.pi * power)
            for o in scene.drive
        ]
        ax.plot(tau, np.sum(parts, axis=0), color="#0072B2", lw=2.0, label="the driver")
        for one, part in zip(scene.drive, parts, strict=True):
            ax.plot(tau, part, lw=0.9, color="0.6")
            peak = (tau[part.argmax()], part.max())
            ax.annotate(str(one.order), peak, fontsize=7, color="0.3", ha="center")
        ax.plot([], [], lw=0.9, color="0.6", label="each order")
        ax.set(xlabel=SYMBOL["tau"], ylabel=name)
    legend_above(figure, 2)
    return figure
