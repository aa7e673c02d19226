"""The figure of a judgement: errors of all moments with their intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rattle.compare.judge.verdict import JUDGED, Tolerances
from rattle.compare.report.style import (
    ACCURATE_COLOUR,
    STYLE,
    SYMBOL,
    error_bars,
    legend_above,
    new_panels,
)

LINEAR_ERRORS = 0.1  # the axis of errors is linear up to this many sds, logarithmic beyond
PANELS_IN_A_ROW = 4
FEW_IN_A_ROW = 2  # of no more panels than one row could have: a square is read on a phone too


def offsets(names: Sequence[str]) -> dict[str, float]:
    """Small sideways shifts, so that markers of one row stand side by side."""
    return dict(
        zip(names, np.linspace(-0.13, 0.13, len(names)) if len(names) > 1 else [0.0], strict=True)
    )


def error_panel(
    ax: Axes,
    table: pd.DataFrame,
    panel: tuple[str, str],
    closures: Sequence[str],
    tolerances: Tolerances,
    accurate: str,
) -> None:
    """Errors of a moment of a quantity with their intervals over ``at``, in units of the quantity,
    and the band of what is accurate."""
    moment, quantity = panel
    rows = table.query("moment == @moment and quantity == @quantity")
    name = SYMBOL.get(quantity, quantity)
    ax.set_title(name if moment == "rho" else f"{moment} of {name}", loc="left")
    tolerance = getattr(tolerances, moment)
    ax.axhspan(-tolerance, tolerance, color=ACCURATE_COLOUR, alpha=0.18, lw=0, label=accurate)
    ax.axhline(0.0, color="0.4", lw=0.8)
    for closure, shift in offsets(closures).items():
        of_closure = rows[rows["closure"] == closure]
        scaled = of_closure[["error", "low", "high"]].div(of_closure["unit"], axis="index")
        at = of_closure["at"] + shift
        style = {"label": closure, "ms": 4, **STYLE[closure]}
        bars = error_bars(scaled, "error")
        ax.errorbar(at, scaled["error"], bars, ls="none", capsize=2, **style)
    if rows.empty:
        place = ax.transAxes
        ax.text(0.5, 0.75, "no closure predicts it", transform=place, ha="center", color="0.35")
    ax.set_yscale("symlog", linthresh=LINEAR_ERRORS)
    limit = max(10.0, *(abs(t) for t in ax.get_ylim()))
    ax.set_ylim(-limit, limit)


def draw_errors(found: Any) -> Figure:
    """A panel for each quantity and moment of a `rattle.compare.Judgement`."""
    table = found.table[found.table["verdict"].isin(JUDGED) & (found.table["unit"] > 0.0)]
    labels = list(dict.fromkeys(found.table[found.label]))
    numbers = {label: number for number, label in enumerate(labels, start=1)}
    table = table.assign(at=table[found.label].map(numbers).astype(float))
    panels = list(dict.fromkeys(zip(table["moment"], table["quantity"], strict=True)))
    in_a_row = PANELS_IN_A_ROW if len(panels) > PANELS_IN_A_ROW else FEW_IN_A_ROW
    figure, axes = new_panels(max(len(panels), 1), in_a_row, 3.4, 2.5, beside=0.6, above=1.0)
    axes[0].set_visible(bool(panels))
    for ax, panel in zip(axes, panels, strict=False):
        error_panel(ax, table, panel, found.closures, found.tolerances, "counts as accurate")
        unit = "error / sd" if panel[0] in ("mean", "sd") else "error"
        ax.set(xlim=(0.5, len(labels) + 0.5), xlabel=found.label, ylabel=unit)
        shown = range(0, len(labels), max(len(labels) // 6, 1))
        ax.set_xticks([at + 1 for at in shown], [_short(labels[at]) for at in shown])
    legend_above(figure, 5)
    return figure


def _short(label: object) -> str:
    return f"{label:.3g}" if isinstance(label, float) else str(label)
