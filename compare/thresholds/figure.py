"""The figure that a failed test writes: the error of each row with its interval and the admissible range."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from rattle.compare.report.style import ACCURATE, STYLE, SYMBOL, new_figure
from rattle.scene.text import line

MARKS = {"pass": ("#009E73", "o"), "fail": ("#D55E00", "X"), "undecided": ("#000000", "$?$")}
MOST = 60
"""Largest number of rows in the figure; the worst are shown."""
WIDE = 12.0  # ratio of the largest error to the admissible one above which the axis is logarithmic


def error_figure(table: pd.DataFrame, model: str) -> Figure:
    """Draw the errors of a claim's rows, in sds of each quantity."""
    excess = (table["error"] / table["tolerance"]).abs()
    rows = table.loc[excess.nlargest(MOST).index.sort_values()]
    unit = rows["unit"].to_numpy()
    error, low, high, allowed = (rows[c].to_numpy() / unit for c in ("error", "low", "high", "tolerance"))
    place = np.arange(len(rows))[::-1]
    figure, (ax,) = new_figure(6.4, 1.5 + 0.2 * len(rows), 1, 1)
    ax.barh(place, 2.0 * allowed, left=-allowed, height=0.9, color=ACCURATE, alpha=0.35, lw=0)
    for outcome, (colour, marker) in MARKS.items():
        own = (rows["outcome"] == outcome).to_numpy()
        ax.hlines(place[own], low[own], high[own], color=colour, lw=1.6)
        ax.plot(error[own], place[own], ls="none", marker=marker, ms=6, color=colour)
    reach = float(np.nanmax(np.abs([low, high, allowed])))
    far = reach > WIDE * allowed.min()
    if far:
        ax.set_xscale("symlog", linthresh=2.0 * float(allowed.max()), linscale=2.0)
    room = 2.0 if far else 1.15
    ax.set_xlim(-room * reach, room * reach)
    ax.axvline(0.0, color="0.3", lw=0.8)
    names = [
        rf"{'E' if r.moment == 'mean' else 'sd'} {SYMBOL[str(r.quantity)]}, impact {r.impact}"
        for r in rows.itertuples()
    ]
    ax.set_yticks(place, names)
    ax.set_ylim(-0.7, len(rows) - 0.3)
    ax.grid(False, axis="y")
    ax.set_xlabel("error and its interval, in sds of the quantity")
    worst = f" (the worst {MOST} of {len(table)} rows)" if len(table) > MOST else ""
    colour = STYLE.get(model, {"color": "k"})["color"]
    ax.set_title(f"{line(model)[:60]}{worst}", loc="left", fontweight="bold", parse_math=False, color=colour)
    shown = [o for o in MARKS if (rows["outcome"] == o).any()]
    handles = [Line2D([], [], color=MARKS[o][0], marker=MARKS[o][1], ms=6, label=o) for o in shown]
    figure.legend(
        handles=[*handles, Patch(color=ACCURATE, alpha=0.35, lw=0, label="allowed")],
        loc="outside upper center",
        ncols=4,
        frameon=False,
    )
    return figure
