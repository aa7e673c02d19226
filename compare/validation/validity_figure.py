"""The figure that opens a report: range of validity of each closure over the noise intensity, and its cause."""

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from rattle.compare.report.style import STYLE, new_figure
from rattle.compare.validation.validity import CAUSES
from rattle.compare.validation.validity_range import ACCURATE, NOT_WRONG, UNDECIDED, WRONG

MARKER = {
    "undecided": "$?$",
    "fixed time": "o",
    "off itinerary": "X",
    "grazing": "^",
    "second order": "s",
    "mixture": "D",
    "not realizable": "v",
    "ended": "|",
}
"""Markers of the causes; a closure that is accurate to the last impact has none."""
VALIDITY = (
    (
        "Range of validity of each closure: the impact up to which every section mean and sd that it predicts is "
        "accurate (filled)",
        "",
    ),
    (f"; hatched, {UNDECIDED}, so {NOT_WRONG} its upper edge", NOT_WRONG),
    (".", ""),
    (" A marker says what limits it there.", WRONG),
)
"""The caption, for `rattle.compare.report.style.caption_of`."""
ROOM = 0.9  # height, in impacts, that a marker takes above the band that it explains


def validity_figure(table: pd.DataFrame, impacts: int) -> Figure:
    """Impact up to which each closure is accurate and not shown wrong, over sigma, a panel for each closure."""
    closures = list(table["closure"].unique())
    columns = min(len(closures), 2)
    rows = -(-len(closures) // columns)
    figure, axes = new_figure(4.7 * columns, 1.3 + 2.3 * rows, rows, columns)
    for number, (closure, ax) in enumerate(zip(closures, axes, strict=False)):
        _panel(ax, table[table["closure"] == closure].sort_values("sigma"), closure, impacts)
        if number % columns == 0:
            ax.set_ylabel("impact")
    for ax in axes[len(closures) :]:
        ax.set_visible(False)
    accurate, not_inaccurate = table["accurate"], table["not_inaccurate"]
    areas = [
        (accurate > 0, Patch(facecolor="0.35", label=f"{ACCURATE} here")),
        (not_inaccurate > accurate, Patch(facecolor="none", edgecolor="0.35", hatch="////", label=f"{NOT_WRONG} here")),
        (not_inaccurate < impacts, Patch(facecolor="none", edgecolor="0.6", label=WRONG)),
    ]
    handles: list[Artist] = [patch for drawn, patch in areas if drawn.any()]
    handles.append(Line2D([], [], color="k", ls=":", lw=1.4, label="99 % of the paths on its itinerary up to here"))
    handles += [
        Line2D([], [], ls="none", marker=marker, color="k", ms=6, label=CAUSES[cause])
        for cause, marker in MARKER.items()
        if (table["cause"] == cause).any()
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _panel(ax: Axes, rows: pd.DataFrame, closure: str, impacts: int) -> None:
    sigma = rows["sigma"].to_numpy()
    middle = np.sqrt(sigma[1:] * sigma[:-1])
    edges = np.concatenate([[sigma[0] ** 2 / middle[0]], middle, [sigma[-1] ** 2 / middle[-1]]])
    accurate, not_inaccurate = rows["accurate"].to_numpy(), rows["not_inaccurate"].to_numpy()
    colour = STYLE[closure]["color"]
    ax.stairs(
        not_inaccurate, edges, baseline=accurate, fill=True, facecolor="none", edgecolor=colour, hatch="////", lw=0
    )
    ax.stairs(accurate, edges, fill=True, color=colour)
    ax.stairs(not_inaccurate, edges, color=colour, lw=1.2)
    ax.stairs(rows["on_itinerary"].to_numpy(), edges, baseline=None, color="k", ls=":", lw=1.4)
    place = np.minimum(not_inaccurate + 0.5 * ROOM, impacts)
    for x, y, cause in zip(sigma, place, rows["cause"], strict=True):
        if cause in MARKER:
            ax.plot(x, y, ls="none", marker=MARKER[cause], color="k", ms=5, zorder=5)
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_axisbelow(True)
    ax.set_xlim(edges[0], edges[-1])
    ax.set_ylim(0.0, impacts + 0.5 * ROOM)
    ax.yaxis.set_major_locator(MaxNLocator(7, integer=True))
    ax.set_xlabel(r"noise intensity $\sigma$")
    ax.set_title(closure, loc="left", fontweight="bold", color=colour)
