"""The figures of a trade-off: error against processor time of all schemes and closures; error
against the step."""

from itertools import cycle, product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from rattle.compare.report.style import (
    OWN_COLORS,
    STYLE,
    SYMBOL,
    error_bars,
    legend_above,
    new_figure,
)
from rattle.compare.report.texts import REPORT_TEXTS
from rattle.montecarlo.settings import EXACT_SCHEME
from rattle.scene.types import MOST_WHEELS

SCHEME_STYLES: Any = REPORT_TEXTS["marks"]["schemes"]
POINT_STYLES: Any = REPORT_TEXTS["marks"]["tradeoff"]


def tradeoff_figure(
    points: pd.DataFrame, slopes: dict[str, float], means_alone: pd.DataFrame
) -> Figure:
    """Error against processor time of all methods in one panel.

    `slopes`: Exponent with which the cost of each scheme grows with the accuracy; NaN if unknown.
    """
    # low enough for the first screen, its legend beside it
    figure, (ax,) = new_figure(10.6, 4.9)
    schemes = points.query("kind == 'scheme'").groupby("method", sort=False)
    handles: list[Artist] = [
        _scheme(ax, str(name), rows, slopes[str(name)]) for name, rows in schemes
    ]
    multilevel = points.query("kind == 'multilevel'").groupby("method", sort=False)
    for method, rows in [*multilevel, (EXACT_SCHEME, means_alone)]:
        handles += ax.plot(
            "core_seconds",
            "error",
            data=rows,
            ls="-.",
            lw=1.1,
            color=SCHEME_STYLES[method.removeprefix("multilevel ")]["color"],
            label=f"{method}: means",
        )
    handles += [_closure(ax, row) for _, row in points.query("kind == 'closure'").iterrows()]
    low = points[["error", "median_error"]].min().min()
    high = points["error"].max()
    ax.set(
        xscale="log",
        yscale="log",
        ylim=(0.6 * low, 2.0 * high),
        xlabel="processor time (core-seconds)",
        ylabel="error of the section means and sds / sd of each quantity",
    )
    handles += [Line2D([], [], label=label, **style) for label, style in POINT_STYLES.items()]
    figure.legend(handles=handles, loc="outside right upper", fontsize=8.0, frameon=False)
    return figure


QUANTITY_STYLES: Any = {
    "tau": {"color": "#000000", "marker": "o"},
    "flight": {"color": "#999999", "marker": "v"},
}
WHEEL_COLOURS = [
    ("#56B4E9", "#0072B2"),
    ("#E69F00", "#D55E00"),
    *((one, one) for one in OWN_COLORS),
]
"""Of x and of y of the wheels, one after the other, and again from the first."""
QUANTITY_STYLES |= {
    f"{letter}{wheel}": {"color": colour, "marker": marker}
    for wheel, colours in zip(range(1, MOST_WHEELS + 1), cycle(WHEEL_COLOURS), strict=False)
    for letter, colour, marker in zip("xy", colours, "sD", strict=True)
}
MOMENT_NAMES = {"mean": "section means", "sd": "section sds", "itinerary": "itinerary"}


def order_figure(changes: pd.DataFrame) -> Figure:
    """Change against the step: a row of panels for each noise intensity and scheme, a panel for
    each kind of moment."""
    runs = changes.groupby(["sigma", "scheme"], sort=False)
    figure, axes = new_figure(9.6, 2.7 * len(runs), len(runs), len(MOMENT_NAMES))
    for ax, (((sigma, scheme), rows), moment) in zip(
        axes, product(runs, MOMENT_NAMES), strict=True
    ):
        _changes(ax, rows[rows["moment"] == moment].dropna(subset=["change"]))
        title = rf"{scheme}: {MOMENT_NAMES[moment]}, $\sigma$ = {sigma:.3g}"
        ax.set_title(title, fontsize=8.0)
        label = "error" if moment == "itinerary" else "change from dt to dt / 2 (sds)"
        ax.set_xlabel("dt")
        ax.set_ylabel(label, fontsize=8.0)
    legend_above(figure, 7)
    return figure


def _changes(ax: Axes, changes: pd.DataFrame) -> None:
    """A line for each quantity with its intervals, and slope 1 through the largest change; what
    does not change, or is not known at all, has no place on a logarithmic axis."""
    changes = changes[(changes["change"] > 0.0) & np.isfinite(changes["high"])]
    ax.set_xscale("log", base=2)
    ax.set_yscale("log")
    for quantity, rows in changes.groupby("quantity", sort=False):
        away = error_bars(rows, "change")
        style = QUANTITY_STYLES.get(str(quantity), {"color": "k", "marker": "o"})
        label = SYMBOL.get(str(quantity), "itinerary")
        ax.errorbar(rows["dt"], rows["change"], away, ms=4, lw=1.1, capsize=2, label=label, **style)
    if len(changes):
        ends = np.array([changes["dt"].min(), changes["dt"].max()])
        first = changes["change"].max()
        ax.plot(ends, first * ends / ends[1], color="0.7", lw=1.0, zorder=0, label="slope 1")
        bottom = np.floor(np.log10(0.5 * changes["change"].min()))
        top = np.ceil(np.log10(changes["high"].max()))
        ax.set_ylim(10.0**bottom, 10.0**top)
    steps = sorted(changes["dt"].unique())
    ax.set_xticks(steps, [f"{step:g}" for step in steps], minor=False)
    ax.yaxis.set_minor_formatter(NullFormatter())


def _scheme(ax: Axes, scheme: str, rows: pd.DataFrame, slope: float) -> Artist:
    """A line through the points of a scheme, solid where measured; points that missed their
    accuracy stand alone."""
    style = SCHEME_STYLES[scheme]
    missed = rows[rows["missed"]]
    reached = rows[~rows["missed"]]
    x = reached["core_seconds"].to_numpy()
    y = reached["error"].to_numpy()
    measured = reached["measured"].to_numpy(bool)
    ax.plot(x, y, ls="--", lw=1.3, color=style["color"])
    for i in np.flatnonzero(measured[:-1] & measured[1:]):
        ax.plot(x[i : i + 2], y[i : i + 2], ls="-", lw=1.8, color=style["color"])
    for points, face in ((measured, style["color"]), (~measured, "white")):
        ax.plot(x[points], y[points], ls="none", ms=7, mfc=face, **style)
    ax.plot(missed["core_seconds"], missed["error"], ls="none", ms=7, alpha=0.35, **style)
    grows = "" if np.isnan(slope) else rf", cost $\propto$ error$^{{{slope:.1f}}}$"
    return Line2D([], [], ms=7, lw=1.8, label=scheme + grows, **style)


def _closure(ax: Axes, row: pd.Series) -> Artist:
    """Worst error of a closure (filled) and median (open); an arrow where the worst is only an
    upper bound."""
    style = STYLE[row["method"]]
    x = row["core_seconds"]
    ax.plot([x, x], [row["median_error"], row["error"]], lw=1.0, color=style["color"])
    ax.plot(x, row["median_error"], ls="none", ms=6, mfc="white", **style)
    ax.plot(x, row["error"], ls="none", ms=9, **style)
    if not row["resolved"]:
        arrow = {"arrowstyle": "->", "color": style["color"]}
        ax.annotate("", (x, 0.6 * row["error"]), (x, row["error"]), arrowprops=arrow)
    return Line2D([], [], ls="none", ms=8, label=f"{row['method']}: worst, median (open)", **style)
