"""The figures of boundaries, maps, crossings and sensitivities."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from rattle.compare.parameters.search import ACCURATE, UNDECIDED, WRONG, Edge
from rattle.compare.parameters.sentences import quantity_words
from rattle.compare.report.style import legend_above, new_figure
from rattle.compare.study.parameters import PERCENT

COLOURS = {ACCURATE: "#009E73", WRONG: "#D55E00", UNDECIDED: "#999999", "below": "#009E73", "above": "#D55E00"}
LESS, MORE, BENT = "#0072B2", "#D55E00", "#999999"


def boundary_figure(over: str, unit: str, edges: Sequence[Edge], points: pd.DataFrame) -> Figure:
    """Draw the error of the worst row over its tolerance at every value, and the edges."""
    figure, (ax,) = new_figure(7.4, 3.8, 1, 1)
    table = points[points["error"].notna()]
    least = 0.5 * min(float(table["error"].min()), 0.1)
    for verdict, rows in table.groupby("verdict"):
        error = rows["error"].to_numpy()
        ends = np.abs(np.array([rows["low"].clip(lower=least), rows["high"]]) - error)
        colour = COLOURS[str(verdict)]
        ax.errorbar(rows["value"], error, yerr=ends, fmt="o", ms=4, capsize=2, color=colour, label=str(verdict))
    for edge in edges:
        ax.axvspan(edge.accurate, edge.wrong, color="0.5", alpha=0.3, lw=0, label="where it stops holding")
    ax.axhline(1.0, color="0.2", lw=0.8, ls="--", label="tolerance")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(bottom=least)
    ax.set_xlabel(f"{over} ({unit})" if unit else over)
    ax.set_ylabel("worst error / tolerance")
    legend_above(figure, [ax], 5)
    return figure


def crossing_figure(level: float, edges: Sequence[Any], points: pd.DataFrame, labels: tuple[str, str]) -> Figure:
    """Draw a quantity with its interval at every value, and the level."""
    figure, (ax,) = new_figure(7.4, 3.8, 1, 1)
    table = points[points["estimate"].notna()]
    for verdict, rows in table.groupby("verdict"):
        ends = np.array([rows["estimate"] - rows["low"], rows["high"] - rows["estimate"]])
        style: dict[str, Any] = {"fmt": "o", "ms": 4, "capsize": 2, "color": COLOURS[str(verdict)]}
        ax.errorbar(rows["value"], rows["estimate"], yerr=ends, label=str(verdict), **style)
    for edge in edges:
        ax.axvspan(*sorted(edge), color="0.5", alpha=0.3, lw=0, label="where it crosses")
    ax.axhline(level, color="0.2", lw=0.8, ls="--", label="level")
    ax.set_xscale("log")
    ax.set_ylim(bottom=0.0 if (table["estimate"] >= 0.0).all() else None)
    ax.set_xlabel(labels[0])
    ax.set_ylabel(labels[1])
    legend_above(figure, [ax], 5)
    return figure


def map_figure(curve: pd.DataFrame, points: pd.DataFrame, across: str, up: str) -> Figure:
    """Draw a bar at each value of the second parameter: accurate, wrong, or in between; markers at the edges."""
    figure, (ax,) = new_figure(7.4, 4.2, 1, 1)
    places = sorted(curve["along"].unique())
    at = np.log(places)
    middle = 0.5 * (at[1:] + at[:-1])
    ends = np.exp([2.0 * at[0] - middle[0], *middle, 2.0 * at[-1] - middle[-1]])
    shown: dict[str, str] = {ACCURATE: ACCURATE, WRONG: WRONG, UNDECIDED: "not decided between"}
    for _, of in points.sort_values("value").groupby("along"):
        i = places.index(of["along"].iloc[0])
        for low, high in pairwise(of.to_dict("records")):
            same = low["verdict"] if low["verdict"] == high["verdict"] else UNDECIDED
            size = (ends[i + 1] - ends[i], high["value"] - low["value"])
            corner, label = (ends[i], low["value"]), shown.pop(same, None)
            ax.add_patch(Rectangle(corner, *size, color=COLOURS[same], alpha=0.45, lw=0, label=label))
    edges = curve[curve["accurate"].notna() & curve["wrong"].notna()]
    for name, marker in (("accurate", "^"), ("wrong", "v")):
        ax.plot(edges["along"], edges[name], marker, ms=5, color=COLOURS[name], label=f"edge: {name} here")
    ax.set_xscale("log" if ends[-1] > 4.0 * ends[0] else "linear")
    ax.set_yscale("log")
    ax.set_xticks([], minor=True)
    ax.set_xticks(places, [f"{place:.3g}" for place in places])
    ax.set_xlim(ends[0], ends[-1])
    ax.set_ylim(points["value"].min(), points["value"].max())
    ax.set_xlabel(across)
    ax.set_ylabel(up)
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
        value, y = 100.0 * own["effect"].to_numpy(), np.arange(len(own))
        colours = np.where(~own["linear"].astype(bool), BENT, np.where(value < 0.0, LESS, MORE))
        errors = 100.0 * np.abs(own[["low", "high"]].to_numpy().T - own["effect"].to_numpy())
        ax.barh(y, value, color=list(colours), xerr=errors, error_kw={"elinewidth": 1.0, "capsize": 2.0})
        ax.set_yticks(y, own["parameter"])
        ax.axvline(0.0, color="0.3", lw=0.8)
        ax.set_title(quantity_words(quantity).removeprefix("the ").replace("`", ""), loc="left")
        ax.set_xlabel(f"change (%) for {PERCENT} more of the parameter")
    for ax in axes[len(quantities) :]:
        ax.remove()
    return figure
