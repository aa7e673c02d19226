"""The figures of boundaries, maps, crossings and sensitivities."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from rattle.compare.parameters.finding import quantity_words, with_unit
from rattle.compare.parameters.search import Edge
from rattle.compare.report.style import legend_above, new_figure
from rattle.compare.study.parameters import PERCENT
from rattle.compare.validation.verdict import DECIDED, Verdict

COLOURS: dict[str, str] = {
    Verdict.ACCURATE: "#009E73",
    Verdict.INACCURATE: "#D55E00",
    Verdict.UNDECIDED: "#999999",
    "below": "#009E73",
    "above": "#D55E00",
}
LESS = "#0072B2"
MORE = "#D55E00"
BENT_COLOUR = "#999999"


def boundary_figure(over: str, unit: str, edges: Sequence[Edge], points: pd.DataFrame) -> Figure:
    """Draw the error of the worst row over its tolerance at every value, and the edges."""
    table = points[points["error"].notna()]
    # the axis ends below the least error; there is none where a budget ended before any value
    least = 0.5 * min([0.1, *table["error"]])
    figure, ax = _draw_values(table.assign(low=table["low"].clip(lower=least)), "error")
    for edge in edges:
        ax.axvspan(
            edge.accurate, edge.wrong, color="0.5", alpha=0.3, lw=0, label="where it stops holding"
        )
    ax.axhline(1.0, color="0.2", lw=0.8, ls="--", label="tolerance")
    ax.set(
        xscale="log", yscale="log", xlabel=with_unit(over, unit), ylabel="worst error / tolerance"
    )
    ax.set_ylim(bottom=least)
    legend_above(figure, [ax], 5)
    return figure


def _draw_values(table: pd.DataFrame, column: str) -> tuple[Figure, Axes]:
    """A figure of what was found at every value, with its interval."""
    figure, (ax,) = new_figure(7.4, 3.8, 1, 1)
    for verdict, rows in table.groupby("verdict"):
        ends = np.abs(rows[["low", "high"]].to_numpy().T - rows[column].to_numpy())
        style: dict[str, Any] = {"fmt": "o", "ms": 4, "capsize": 2, "color": COLOURS[str(verdict)]}
        ax.errorbar(rows["value"], rows[column], yerr=ends, label=str(verdict), **style)
    return figure, ax


def crossing_figure(
    level: float, edges: Sequence[Any], points: pd.DataFrame, across: str, up: str
) -> Figure:
    """Draw a quantity with its interval at every value, and the level."""
    table = points[points["estimate"].notna()]
    figure, ax = _draw_values(table, "estimate")
    for edge in edges:
        ax.axvspan(*sorted(edge), color="0.5", alpha=0.3, lw=0, label="where it crosses")
    ax.axhline(level, color="0.2", lw=0.8, ls="--", label="level")
    ax.set(xscale="log", xlabel=across, ylabel=up)
    ax.set_ylim(bottom=0.0 if (table["estimate"] >= 0.0).all() else None)
    legend_above(figure, [ax], 5)
    return figure


def map_figure(curve: pd.DataFrame, points: pd.DataFrame, across: str, up: str) -> Figure:
    """Draw a bar at each value of the second parameter: accurate, wrong, or in between; markers at
    the edges."""
    figure, (ax,) = new_figure(7.4, 4.2, 1, 1)
    places = sorted(curve["along"].unique())
    at = np.log(places)
    middle = 0.5 * (at[1:] + at[:-1])
    ends = np.exp([2.0 * at[0] - middle[0], *middle, 2.0 * at[-1] - middle[-1]])
    shown: dict[str, str] = {verdict: verdict for verdict in DECIDED}
    shown[Verdict.UNDECIDED] = "not decided between"
    for _, of in points.sort_values("value").groupby("along"):
        i = places.index(of["along"].iloc[0])
        for low, high in pairwise(of.to_dict("records")):
            same = low["verdict"] if low["verdict"] == high["verdict"] else Verdict.UNDECIDED
            size = (ends[i + 1] - ends[i], high["value"] - low["value"])
            corner = (ends[i], low["value"])
            label = shown.pop(same, None)
            ax.add_patch(
                Rectangle(corner, *size, color=COLOURS[same], alpha=0.45, lw=0, label=label)
            )
    edges = curve[curve["accurate"].notna() & curve["wrong"].notna()]
    for column, verdict, marker in zip(("accurate", "wrong"), DECIDED, "^v", strict=True):
        ax.plot(
            edges["along"],
            edges[column],
            marker,
            ms=5,
            color=COLOURS[verdict],
            label=f"edge: {verdict} here",
        )
    ax.set(
        xscale="log" if ends[-1] > 4.0 * ends[0] else "linear",
        yscale="log",
        xlabel=across,
        ylabel=up,
    )
    ax.set_xticks([], minor=True)
    ax.set_xticks(places, [f"{place:.3g}" for place in places])
    ax.set(xlim=(ends[0], ends[-1]), ylim=(points["value"].min(), points["value"].max()))
    legend_above(figure, [ax], 3)
    return figure


def tornado(table: pd.DataFrame, quantities: list[str]) -> Figure:
    """Draw the effects on every quantity as bars, the strongest first."""
    columns = min(len(quantities), 2)
    rows = -(-len(quantities) // columns)
    most = table.groupby("quantity")["effect"].count().max()
    figure, axes = new_figure(4.6 * columns, rows * (0.9 + 0.2 * most), rows, columns)
    for ax, quantity in zip(axes, quantities, strict=False):
        own = table[(table["quantity"] == quantity) & table["effect"].notna()]
        own = own.loc[own["effect"].abs().sort_values().index]
        value = 100.0 * own["effect"].to_numpy()
        y = np.arange(len(own))
        colours = np.where(
            ~own["linear"].astype(bool), BENT_COLOUR, np.where(value < 0.0, LESS, MORE)
        )
        errors = 100.0 * np.abs(own[["low", "high"]].to_numpy().T - own["effect"].to_numpy())
        ax.barh(
            y, value, color=list(colours), xerr=errors, error_kw={"elinewidth": 1.0, "capsize": 2.0}
        )
        ax.set_yticks(y, own["parameter"])
        ax.axvline(0.0, color="0.3", lw=0.8)
        ax.set_title(quantity_words(quantity).removeprefix("the ").replace("`", ""), loc="left")
        ax.set_xlabel(f"change (%) for {PERCENT} more of the parameter")
    for ax in axes[len(quantities) :]:
        ax.remove()
    return figure
