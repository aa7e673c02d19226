"""The sentences and the figures of a boundary and of a crossing."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

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
            said.append(_side(over, unit, table, accurate=True))
        elif verdicts == {WRONG}:
            said.append(f"`{closure}` is nowhere accurate from {over} = {low} to {high}{unit}.")
            said.append(_side(over, unit, table, accurate=False))
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


def _side(over: str, unit: str, table: pd.DataFrame, accurate: bool) -> str:
    """On which side of the range to look for a boundary that is not in it."""
    first, last = table.iloc[0], table.iloc[-1]
    grows, falls = last["low"] > first["high"], first["low"] > last["high"]
    if not falls and over == "sigma":
        grows = True  # where the intervals do not tell it: more noise never helps
    if not grows and not falls:
        return f"If there is one, it lies below {first['value']:.4g} or above {last['value']:.4g}{unit}."
    above = grows == accurate
    return f"If there is one, it lies {'above' if above else 'below'} {(last if above else first)['value']:.4g}{unit}."


def map_sentences(
    names: tuple[str, str, str, tuple[str, str]], curve: pd.DataFrame, points: pd.DataFrame, path_steps: int
) -> list[str]:
    """The curve of a map in words: its extremes, where it has no edge or several, and what it cost."""
    closure, over, along, units = names
    first, second = (f" {unit}" if unit else "" for unit in units)
    edges = curve[curve["accurate"].notna() & curve["wrong"].notna()]
    said = []
    if len(edges):
        up = edges["accurate"] < edges["wrong"]
        way = "up to" if up.all() else "down to" if not up.any() else "up or down to"
        ordered = edges.sort_values("accurate").to_dict("records")
        low, high = ordered[0], ordered[-1]
        said.append(f"`{closure}` is accurate {way} {over} = {low['accurate']:.4g}{first}")
        if low["accurate"] < high["accurate"]:
            said[0] += (
                f" at {along} = {low['along']:.4g}{second} and {way} {high['accurate']:.4g} at {high['along']:.4g}"
            )
        same = low["accurate"] == high["accurate"]
        said[0] += f" at every value of {along} with an edge." if same else "; all other edges lie between."
    several = edges["along"][edges["along"].duplicated()].unique()
    if len(several):
        said.append(f"Its range of validity is not one interval at {along} = {_list(several)}{second}.")
    for why, rows in curve.drop(edges.index).groupby("why", sort=False):
        said.append(f"At {along} = {_list(rows['along'])}{second}: {why}.")
    said.append(
        f"{len(points)} values were judged at {curve['along'].nunique()} of {along}, with {path_steps:.3g} path-steps; "
        "all that is said holds together with 95 % probability."
    )
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
    ax.set_xlim(ends[0], ends[-1])
    ax.set_ylim(points["value"].min(), points["value"].max())
    ax.set_xlabel(across)
    ax.set_ylabel(up)
    legend_above(figure, [ax], 3)
    return figure
