"""The figures of boundaries, maps, crossings and sensitivities."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rattle.compare.judge.verdict import DECIDED, Verdict
from rattle.compare.parameters.finding import AlongParameter, quantity_words
from rattle.compare.report.style import (
    axis_label,
    cell_edges,
    error_bars,
    legend_above,
    new_figure,
    new_panels,
    plain_numbers,
)
from rattle.compare.report.texts import REPORT_TEXTS
from rattle.compare.study.parameters import PERCENT

COLOURS: dict[str, str] = REPORT_TEXTS["marks"]["searches"]
LESS = "#0072B2"
MORE = "#D55E00"
BENT_COLOUR = "#999999"
MOST_BARS = 16  # of a quantity: the figure shows those that matter, the table has all


def boundary_figure(found: AlongParameter) -> Figure:
    """Draw the error of the worst row over its tolerance at every value, and the edges."""
    table = found.points.dropna(subset="error")
    # the axis ends below the least error; there is none where a budget ended before any value
    least = 0.5 * min([0.1, *table["error"]])
    table["low"] = table["low"].clip(lower=least)
    figure, ax = _draw_search(found, table, "error", "where it stops holding", "tolerance", 1.0)
    ax.set(yscale="log", ylabel="worst error / tolerance", ylim=(least, None))
    return figure


def crossing_figure(found: AlongParameter, level: float, up: str) -> Figure:
    """Draw a quantity with its interval at every value, and the level."""
    table = found.points.dropna(subset="estimate")
    figure, ax = _draw_search(found, table, "estimate", "where it crosses", "level", level)
    least = 0.0 if (table["estimate"] >= 0.0).all() else None
    ax.set(ylabel=up, ylim=(least, None))
    return figure


def _draw_search(
    found: AlongParameter,
    table: pd.DataFrame,
    column: str,
    shaded: str,
    lined: str,
    level: float,
) -> tuple[Figure, Axes]:
    """Draw what was found at every value with its interval, where the verdict changes, and the
    level that decides it."""
    figure, (ax,) = new_figure(7.4, 3.8)
    for verdict, rows in table.groupby("verdict"):
        name = str(verdict)
        place = (rows["value"], rows[column], error_bars(rows, column))
        ax.errorbar(*place, fmt="o", ms=4, capsize=2, color=COLOURS[name], label=name)
    for edge in found.edges:
        ax.axvspan(*sorted(edge[:2]), color="0.5", alpha=0.3, lw=0, label=shaded)
    ax.axhline(level, color="0.2", lw=0.8, ls="--", label=lined)
    ax.set(xscale="log", xlabel=axis_label(found.over))
    plain_numbers(ax.xaxis, found.points["value"])
    legend_above(figure, 5)
    return figure, ax


def map_figure(curve: pd.DataFrame, points: pd.DataFrame, along: str, over: str) -> Figure:
    """Draw a bar at each value of the second parameter: accurate, wrong, or in between; markers at
    the edges."""
    figure, (ax,) = new_figure(7.4, 4.2)
    places = np.unique(curve["along"])
    ends = cell_edges(places)
    points = points.sort_values(["along", "value"])
    higher = points.groupby("along")[["value", "verdict"]].shift(-1)
    same = points["verdict"].where(points["verdict"] == higher["verdict"], Verdict.UNDECIDED)
    column = np.searchsorted(places, points["along"])
    bars = points.assign(
        verdict=same, high=higher["value"], left=ends[column], width=np.diff(ends)[column]
    )
    for between, rows in bars.dropna(subset="high").groupby("verdict"):
        ax.bar(
            rows["left"],
            rows["high"] - rows["value"],
            rows["width"],
            rows["value"],
            align="edge",
            color=COLOURS[str(between)],
            alpha=0.45,
            lw=0,
            label="not decided between" if between == Verdict.UNDECIDED else str(between),
        )
    edges = curve.dropna(subset=["accurate", "wrong"])
    for name, verdict, marker in zip(("accurate", "wrong"), DECIDED, "^v", strict=True):
        label = f"edge: {verdict} here"
        ax.plot(edges["along"], edges[name], marker, ms=5, color=COLOURS[verdict], label=label)
    ax.set(
        xscale="log" if ends[-1] > 4.0 * ends[0] else "linear",
        yscale="log",
        xlabel=axis_label(along),
        ylabel=axis_label(over),
    )
    plain_numbers(ax.yaxis, points["value"])
    ax.set_xticks([], minor=True)
    ax.set_xticks(places, [f"{place:.3g}" for place in places])
    ax.set(xlim=(ends[0], ends[-1]), ylim=(points["value"].min(), points["value"].max()))
    legend_above(figure, 3)
    return figure


def tornado(found: Any, quantities: list[str]) -> Figure:
    """Draw the effects of a `Sensitivity` on every quantity as bars, the strongest first."""
    table = found.table
    most = min(table.groupby("quantity")["effect"].count().max(), MOST_BARS)
    figure, axes = new_panels(len(quantities), 2, 4.6, 0.9 + 0.2 * most)
    for ax, quantity in zip(axes, quantities, strict=True):
        rows_shown = table[table["quantity"] == quantity].dropna(subset="effect")
        bars = rows_shown.sort_values("effect", key=abs).tail(MOST_BARS)
        effect = 100.0 * bars[["effect", "low", "high"]].to_numpy().T
        colours = np.where(effect[0] < 0.0, LESS, MORE)
        colours[~bars["linear"].to_numpy(bool)] = BENT_COLOUR
        y = np.arange(len(bars))
        ax.barh(
            y,
            effect[0],
            color=list(colours),
            xerr=np.abs(effect[1:] - effect[0]),
            error_kw={"elinewidth": 1.0, "capsize": 2.0},
        )
        ax.set_yticks(y, bars["parameter"])
        ax.axvline(0.0, color="0.3", lw=0.8)
        words = quantity_words(found.scene, quantity).removeprefix("the ").replace("`", "")
        ax.set_title(words.replace("dimensionless ", ""), loc="left")
        ax.set_xlabel(f"change (%) for {PERCENT} more of the parameter")
    return figure
