"""The sentences and the figures of a boundary and of a crossing."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.boundary.search import ACCURATE, UNDECIDED, WRONG, Edge
from rattle.compare.report.style import legend_above, new_figure

COLOURS = {ACCURATE: "#009E73", WRONG: "#D55E00", UNDECIDED: "#999999", "below": "#009E73", "above": "#D55E00"}


def boundary_sentences(
    closure: str, over: str, unit: str, edges: Sequence[Edge], table: pd.DataFrame, path_steps: int
) -> list[str]:
    """The edges of the range of validity in words, and what stays undecided."""
    unit = f" {unit}" if unit else ""
    low, high = (f"{value:.4g}" for value in (table["value"].min(), table["value"].max()))
    said = []
    for edge in edges:
        way = "up to" if edge.accurate < edge.wrong else "down to"
        said.append(
            f"`{closure}` is accurate {way} {over} = {edge.accurate:.4g}{unit} and shown wrong at "
            f"{edge.wrong:.4g} ({edge.why})."
        )
    if len(edges) > 1:
        said.append("Its range of validity is not one interval.")
    if not edges:
        verdicts = set(table["verdict"])
        if verdicts == {ACCURATE}:
            said.append(f"`{closure}` is accurate from {over} = {low} to {high}{unit}: no boundary in there.")
        elif verdicts == {WRONG}:
            said.append(f"`{closure}` is nowhere accurate from {over} = {low} to {high}{unit}.")
        else:
            best = table[table["verdict"] != UNDECIDED]
            also = f"; it is {best['verdict'].iloc[0]} at {_list(best['value'])}{unit}" if len(best) else ""
            said.append(f"No boundary of `{closure}` was decided from {over} = {low} to {high}{unit}{also}.")
    doubt = table[table["verdict"] == UNDECIDED]
    if len(doubt):
        why = ", ".join(dict.fromkeys(doubt["remark"]))
        said.append(f"Undecided at {over} = {_list(doubt['value'])}{unit}: {why}.")
    said.append(f"{len(table)} values were judged, with {path_steps:.3g} path-steps.")
    return said


def _list(values: Any) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


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
