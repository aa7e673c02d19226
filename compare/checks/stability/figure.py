"""The figures of the map: how many cells have which verdict, and every cell of every scheme over every axis."""

from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rattle.compare.checks.stability.axes import AXES
from rattle.compare.checks.stability.cell import BIASED, COLLAPSING, UNBIASED, UNDECIDED, UNSTABLE
from rattle.compare.report.style import legend_above, new_figure

MARKS: Any = {
    UNBIASED: {"color": "#0072B2", "marker": "o"},
    UNDECIDED: {"color": "#999999", "marker": "^"},
    BIASED: {"color": "#D55E00", "marker": "s"},
    UNSTABLE: {"color": "#000000", "marker": "X"},
    COLLAPSING: {"color": "#CC79A7", "marker": "D"},
}
"""Colours of Okabe and Ito's palette; markers distinguish the verdicts without colour as well."""
REFUSED = "#E8E8E8"
BESIDE = 0.28  # horizontal offset of the cell at the default step, in columns


def summary(table: pd.DataFrame) -> Figure:
    """Draw how many cells with an admissible step have which verdict, at the default step and at all of them."""
    schemes, cells = list(dict.fromkeys(table["scheme"])), table[table["share"] <= 1.0]
    drawn, panels = new_figure(10.0, 0.42 * len(schemes) + 1.2, 1, 2)
    shown = (("at the default step", cells[cells["default"]]), ("at every admissible step", cells))
    for (title, part), ax in zip(shown, panels, strict=True):
        left = pd.Series(0, index=schemes)
        for verdict in [v for v in MARKS if v in set(cells["verdict"])]:
            counts = part[part["verdict"] == verdict]["scheme"].value_counts().reindex(schemes, fill_value=0)
            bars = ax.barh(schemes, counts, left=left, color=MARKS[verdict]["color"], height=0.7, label=verdict)
            if counts.any():
                ax.bar_label(
                    bars, [str(n) if n else "" for n in counts], label_type="center", color="white", fontsize=8
                )
            left = left + counts
        ax.invert_yaxis()
        ax.grid(visible=False)
        ax.set_title(title, loc="left")
        ax.set_xlabel("cells of the map")
    panels[1].set_yticklabels([])
    legend_above(drawn, panels[:1], len(MARKS))
    return drawn


def figure(table: pd.DataFrame) -> Figure:
    """Draw the map."""
    schemes, axes = list(dict.fromkeys(table["scheme"])), list(dict.fromkeys(table["axis"]))
    drawn, panels = new_figure(2.9 * len(axes) + 0.8, 2.7 * len(schemes) + 0.9, len(schemes), len(axes))
    for i, scheme in enumerate(schemes):
        for j, axis in enumerate(axes):
            ax = panels[i * len(axes) + j]
            part = table[(table["scheme"] == scheme) & (table["axis"] == axis)]
            _panel(ax, part)
            if j == 0:
                ax.set_ylabel(f"{scheme}\nstep dt")
            if i == len(schemes) - 1:
                ax.set_xlabel(AXES[axis].symbol)
    drawn.legend(handles=_legend(set(table["verdict"])), loc="outside upper center", ncols=5)
    return drawn


def _panel(ax: Axes, part: pd.DataFrame) -> None:
    values = list(dict.fromkeys(part["value"]))
    longest = [float(group["dt"].iloc[0] / group["share"].iloc[0]) for _, group in part.groupby("value", sort=False)]
    ax.set_yscale("log")
    low, high = 0.4 * part["dt"].min(), 2.5 * part["dt"].max()
    edges = [-0.5, *range(len(values)), len(values) - 0.5]
    line = [longest[0], *longest, longest[-1]]
    ax.fill_between(edges, line, high, color=REFUSED, lw=0)
    ax.plot(edges, line, color="k", lw=1.3)
    for _, cell in part.iterrows():
        style = MARKS[cell["verdict"]]
        x = values.index(cell["value"]) + (BESIDE if cell["default"] else 0.0)
        face = "white" if cell["diagnosed"] and cell["share"] <= 1.0 else style["color"]
        ax.plot(
            x,
            cell["dt"],
            style["marker"],
            ms=4.0 if cell["default"] else 5.5,
            mec=style["color"],
            mfc=face,
            mew=1.2,
            ls="",
        )
    ax.set_ylim(low, high)
    ax.set_xlim(-0.5, len(values) - 0.5)
    ax.set_xticks(range(len(values)), [f"{v:g}" for v in values], fontsize=7.5)


def _legend(verdicts: set[str]) -> list[Line2D]:
    marks = [
        Line2D([], [], ls="", ms=6, label=verdict, **style) for verdict, style in MARKS.items() if verdict in verdicts
    ]
    return [
        *marks,
        Line2D([], [], ls="", marker="s", ms=6, mfc="white", mec="k", label="hollow: with a diagnostic"),
        Line2D([], [], color="k", lw=1.3, label="longest admissible step"),
        Line2D([], [], ls="", marker="s", ms=9, color=REFUSED, label="refused"),
        Line2D([], [], ls="", marker="o", ms=4, mfc="k", mec="k", label="small, to the right: the default step"),
    ]
