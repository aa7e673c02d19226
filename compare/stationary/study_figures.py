"""The figure of a study of the long run."""

from typing import Protocol

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rattle.compare.report.style import STYLE, new_figure
from rattle.compare.study.design import Study
from rattle.compare.study.figures import axis_label
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
COLOURS = ("#000000", "#0072B2", "#D55E00")
MARKERS = ("D", "o", "s")


class LongRuns(Protocol):
    """A study of the long run with its tables."""

    @property
    def study(self) -> Study:
        """What was asked for."""
        ...

    @property
    def quantities(self) -> pd.DataFrame:
        """Every quantity at every point."""
        ...

    @property
    def verdicts(self) -> pd.DataFrame:
        """The closures against the simulation at every point."""
        ...


def study_figure(r: LongRuns) -> Figure:
    """Draw rates, losses, speeds, slow shares and the closures' verdicts over the first field that varies."""
    figure, axes = new_figure(10.0, 6.0, 2, 3)
    log = _is_log(r.quantities[r.study.along])
    for ax, (title, unit, names) in zip(axes, PANELS, strict=False):
        for name, colour, marker in zip(names, COLOURS, MARKERS, strict=True):
            _curve(ax, r.quantities[r.quantities["quantity"] == name], r.study.along, name, colour, marker)
        ax.set_title(title, loc="left")
        ax.set_ylabel(unit)
    memory = r.quantities[r.quantities["quantity"].isin(["speed", "slow_share", "energy_per_period"])]
    for (quantity, own), ink, sign in zip(memory.groupby("quantity", sort=False), COLOURS, MARKERS, strict=False):
        axes[4].plot(
            own[r.study.along], own["autocorrelation"], color=ink, marker=sign, ms=3, lw=1.0, label=str(quantity)
        )
    axes[4].set_yscale("log")
    axes[4].set_title("autocorrelation time", loc="left")
    axes[4].set_ylabel("impacts")
    good = shares(r.verdicts, r.study.along).dropna(axis="columns", how="all")
    for closure in good:
        axes[5].plot(good.index, good[closure], lw=1.2, ms=4, label=str(closure), **STYLE[str(closure)])
    axes[5].set_title("accurate quantities", loc="left")
    axes[5].set_ylabel("share")
    axes[5].set_ylim(-0.05, 1.05)
    axes[5].set_visible(not good.empty)
    for ax in axes:
        ax.set_xlabel(axis_label(r.study.along))
        if log:
            ax.set_xscale("log")
    for ax in axes:
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize=6)
    return figure


def _is_log(values: pd.Series) -> bool:
    return bool(values.min() > 0.0 and values.max() / values.min() > 10.0)


def _curve(ax: Axes, rows: pd.DataFrame, along: str, name: str, colour: str, marker: str) -> None:
    if rows.empty:
        return
    rows = rows.sort_values(along)
    ax.fill_between(rows[along], rows["low"], rows["high"], color=colour, alpha=0.25, lw=0)
    ax.plot(rows[along], rows["value"], color=colour, marker=marker, ms=3, lw=1.0, label=name)


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
