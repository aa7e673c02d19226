"""The figure of a study of the long run."""

from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.report.style import STYLE, new_figure
from rattle.compare.study.figures import label_field
from rattle.compare.validation.verdict import JUDGED

PANELS = (
    ("impacts", r"per $1/\omega$", ("rate", "rate_mesh1", "rate_mesh2")),
    (
        "energy lost",
        r"$I_1/R_1^2\,(\nu_1\omega)^2$ per period",
        ("energy_per_period", "energy_per_period_mesh1", "energy_per_period_mesh2"),
    ),
    ("speed: 5, 50 and 95 %", r"$\nu_1\omega$", ("q05_speed", "q50_speed", "q95_speed")),
    ("slow impacts", "share", ("slow_share", "slow_share_mesh1", "slow_share_mesh2")),
)
AVERAGES = ("speed", "slow_share", "energy_per_period")
"""Quantities whose autocorrelation is drawn."""
STYLES: Any = [
    {"color": color, "marker": marker, "ms": 3, "lw": 1.0}
    for color, marker in (("#000000", "D"), ("#0072B2", "o"), ("#D55E00", "s"))
]


def study_figure(along: str, quantities: pd.DataFrame, verdicts: pd.DataFrame) -> Figure:
    """Draw rates, losses, speeds, slow shares and the closures' verdicts over the first field that varies."""
    figure, axes = new_figure(10.0, 6.0, 2, 3)
    of = dict(iter(quantities.groupby("quantity")))
    for ax, (title, unit, names) in zip(axes, PANELS, strict=False):
        for name, style in zip(names, STYLES, strict=True):
            if name in of:
                rows = of[name].sort_values(along)
                ax.fill_between(rows[along], rows["low"], rows["high"], color=style["color"], alpha=0.25, lw=0)
                ax.plot(rows[along], rows["value"], label=name, **style)
        ax.set_title(title, loc="left")
        ax.set_ylabel(unit)
    memory, shown = axes[4:]
    averages = [name for name in quantities["quantity"].unique() if name in AVERAGES]
    for name, style in zip(averages, STYLES, strict=False):
        memory.plot(of[name][along], of[name]["autocorrelation"], label=name, **style)
    memory.set(yscale="log", ylabel="impacts")
    memory.set_title("autocorrelation time", loc="left")
    good = shares(verdicts, along).dropna(axis="columns", how="all")
    for closure in good:
        shown.plot(good.index, good[closure], lw=1.2, ms=4, label=str(closure), **STYLE[str(closure)])
    shown.set(ylabel="share", ylim=(-0.05, 1.05), visible=not good.empty)
    shown.set_title("accurate quantities", loc="left")
    for ax in axes:
        label_field(ax, along, quantities[along])
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize=6)
    return figure


def shares(verdicts: pd.DataFrame, along: str) -> pd.DataFrame:
    """How many quantities of each closure are accurate at each value of a field.

    Returns: Index the field; for each closure the share of its judged quantities that are accurate, NaN without
    any.
    """
    if verdicts.empty:
        return pd.DataFrame()
    judged = verdicts[verdicts["verdict"].isin(JUDGED)]
    good = judged.assign(good=judged["verdict"] == "accurate").groupby([along, "closure"])["good"].mean().unstack()
    return good.reindex(sorted(verdicts[along].unique()))
