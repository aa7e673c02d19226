"""The page of ``rattle check stability`` and its figures."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from rattle.compare.checks.check import Result
from rattle.compare.checks.stability.chart import (
    AXES,
    BIASED,
    CHART_UNDECIDED,
    COLLAPSING,
    UNBIASED,
    UNSTABLE,
    Chart,
)
from rattle.compare.report.report import Report
from rattle.compare.report.style import legend_above, new_figure
from rattle.compare.report.texts import SCHEME_TERMS, glossary
from rattle.compare.validation.verdict import Tolerances, join_words
from rattle.scene import Scene

CHART_MARKS: Any = {
    UNBIASED: {"color": "#0072B2", "marker": "o"},
    CHART_UNDECIDED: {"color": "#999999", "marker": "^"},
    BIASED: {"color": "#D55E00", "marker": "s"},
    UNSTABLE: {"color": "#000000", "marker": "X"},
    COLLAPSING: {"color": "#CC79A7", "marker": "D"},
}
"""Colours of Okabe and Ito's palette; markers distinguish the verdicts without colour as well."""
REFUSED_COLOUR = "#E8E8E8"
BESIDE = 0.28  # horizontal offset of the cell at the default step, in columns


def summary(table: pd.DataFrame) -> Drawing:
    """Draw how many cells with an admissible step have which verdict, at the default step and at
    all of them."""
    schemes = list(dict.fromkeys(table["scheme"]))
    cells = table[table["share"] <= 1.0]
    drawn, panels = new_figure(10.0, 0.42 * len(schemes) + 1.2, 1, 2)
    shown = (("at the default step", cells[cells["default"]]), ("at every admissible step", cells))
    for (title, part), ax in zip(shown, panels, strict=True):
        left = pd.Series(0, index=schemes)
        for verdict in [v for v in CHART_MARKS if v in set(cells["verdict"])]:
            counts = (
                part[part["verdict"] == verdict]["scheme"]
                .value_counts()
                .reindex(schemes, fill_value=0)
            )
            bars = ax.barh(
                schemes,
                counts,
                left=left,
                color=CHART_MARKS[verdict]["color"],
                height=0.7,
                label=verdict,
            )
            if counts.any():
                texts = [str(n) if n else "" for n in counts]
                ax.bar_label(bars, texts, label_type="center", color="white", fontsize=8)
            left = left + counts
        ax.invert_yaxis()
        ax.grid(visible=False)
        ax.set_title(title, loc="left")
        ax.set_xlabel("cells of the map")
    panels[1].set_yticklabels([])
    legend_above(drawn, panels[:1], len(CHART_MARKS))
    return drawn


def figure(table: pd.DataFrame) -> Drawing:
    """Draw the map."""
    schemes = list(dict.fromkeys(table["scheme"]))
    axes = list(dict.fromkeys(table["axis"]))
    drawn, panels = new_figure(
        2.9 * len(axes) + 0.8, 2.7 * len(schemes) + 0.9, len(schemes), len(axes)
    )
    for ax, (scheme, axis) in zip(panels, product(schemes, axes), strict=True):
        _draw_panel(ax, table[(table["scheme"] == scheme) & (table["axis"] == axis)])
        if axis == axes[0]:
            ax.set_ylabel(f"{scheme}\nstep dt")
        if scheme == schemes[-1]:
            ax.set_xlabel(AXES[axis].symbol)
    drawn.legend(
        handles=_legend(set(table["verdict"])),
        loc="outside upper center",
        ncols=round(1.25 * len(axes)),
    )
    return drawn


def _draw_panel(ax: Axes, part: pd.DataFrame) -> None:
    values = list(dict.fromkeys(part["value"]))
    longest = [
        float(group["dt"].iloc[0] / group["share"].iloc[0])
        for _, group in part.groupby("value", sort=False)
    ]
    ax.set_yscale("log")
    low = 0.4 * part["dt"].min()
    high = 2.5 * part["dt"].max()
    edges = [-0.5, *range(len(values)), len(values) - 0.5]
    line = [longest[0], *longest, longest[-1]]
    ax.fill_between(edges, line, high, color=REFUSED_COLOUR, lw=0)
    ax.plot(edges, line, color="k", lw=1.3)
    for _, cell in part.iterrows():
        style = CHART_MARKS[cell["verdict"]]
        x = values.index(cell["value"]) + (BESIDE if cell["default"] else 0.0)
        face = "white" if cell["diagnosed"] and cell["share"] <= 1.0 else style["color"]
        size = 4.0 if cell["default"] else 5.5
        ax.plot(
            x, cell["dt"], style["marker"], ms=size, mec=style["color"], mfc=face, mew=1.2, ls=""
        )
    ax.set(ylim=(low, high), xlim=(-0.5, len(values) - 0.5))
    ax.set_xticks(range(len(values)), [f"{v:g}" for v in values], fontsize=7.5)


def _legend(verdicts: set[str]) -> list[Line2D]:
    return [
        *(
            Line2D([], [], ls="", ms=6, label=name, **style)
            for name, style in CHART_MARKS.items()
            if name in verdicts
        ),
        Line2D(
            [], [], ls="", marker="s", ms=6, mfc="white", mec="k", label="hollow: with a diagnostic"
        ),
        Line2D([], [], color="k", lw=1.3, label="longest admissible step"),
        Line2D([], [], ls="", marker="s", ms=9, color=REFUSED_COLOUR, label="refused"),
        Line2D(
            [],
            [],
            ls="",
            marker="o",
            ms=4,
            mfc="k",
            mec="k",
            label="small, to the right: the default step",
        ),
    ]


MAP_TERMS = (
    "admissible step",
    "default step",
    "diagnostic",
    "unbiased",
    "biased",
    "unstable",
    "no limit",
)
STABILITY_WORDS = (
    *SCHEME_TERMS,
    *MAP_TERMS,
    "standard error",
    "σ",
    "ε",
    "E, sd",
    "impact",
    "sticking",
)
MARK = {UNBIASED: "good", BIASED: "bad", UNSTABLE: "bad", CHART_UNDECIDED: "open"}


def answer(found: Chart) -> list[str]:
    """Summarise the map in sentences."""
    cells = found.admissible
    undiagnosed = found.without_diagnostic
    counts = {verdict: (cells["verdict"] == verdict).sum() for verdict in CHART_MARKS}
    wrong = cells[cells["verdict"].isin((BIASED, UNSTABLE))]
    said = [
        _advice(found),
        f"With admissible steps {counts[UNBIASED]} of {len(cells)} cells are unbiased,"
        f" {counts[CHART_UNDECIDED]} undecided, {counts[BIASED]} biased and"
        f" {counts[UNSTABLE]} unstable;"
        f" diagnostics report {wrong['diagnosed'].sum()} of these {len(wrong)} biased and unstable"
        " cells.",
    ]
    if len(undiagnosed):
        said.append(
            f"{len(undiagnosed)} admissible cells are biased or unstable without a diagnostic: a"
            " defect."
        )
    for scheme, own in found.table[found.table["default"]].groupby("scheme", sort=False):
        good = own["verdict"] == UNBIASED
        diagnosed = own["diagnosed"].astype(bool)
        said.append(
            f"`{scheme}` at its default step: {good.sum()} of {len(own)} cells shown to be"
            f" unbiased, {(~good & diagnosed).sum()} others with a diagnostic."
        )
    return said


def _advice(found: Chart) -> str:
    """Which scheme to take, by the cells at the default step."""
    own = found.table[found.table["default"]]
    good = (
        (own["verdict"] == UNBIASED)
        .groupby(own["scheme"], sort=False)
        .sum()
        .sort_values(ascending=False)
    )
    wrong = own["verdict"].isin((BIASED, UNSTABLE)).groupby(own["scheme"], sort=False).sum()
    best = good.index[0]
    of = len(own) // len(good)
    others = [f"{n} for `{scheme}`" for scheme, n in good.iloc[1:].items()]
    beside = f" (unbiased: {join_words(others)})" if others else ""
    return (
        f"Take `{best}`: at its default step {good.iloc[0]} of {of} scenes, extreme ones among"
        f" them, are shown to be unbiased and {wrong[best] or 'none'} to be biased{beside}."
    )


def _extreme_row(result: Result) -> dict[str, Any]:
    """A check at extreme values as a row of the page's table."""
    about = result.subject
    return {
        "name": about.name,
        "field": result.worst.quantity,
        "tried": about.statement,
        "truth": about.reference,
        "worst": result.worst.found,
        "allowed": result.worst.slack,
        "unit": about.unit,
        "holds": result.holds,
    }


def make_report(found: Chart, tried: Sequence[Result], record: dict[str, Any]) -> Report:
    """The report on the map."""
    said = answer(found)
    if tried:
        said.append(
            f"{sum(row.holds for row in tried)} of {len(tried)} extremes of the formulas and"
            " samplers hold."
        )
    cells = found.admissible[found.admissible["verdict"] != COLLAPSING]
    table = found.table.assign(
        mark=[MARK.get(verdict, "open") for verdict in found.table["verdict"]],
        said=np.where(found.table["diagnosed"], "yes", "no"),
    )
    content: dict[str, Any] = {
        "found": found,
        "within": Tolerances(),
        "worst": table.loc[cells.groupby(["scheme", "axis"], sort=False)["error"].idxmax()],
        "defaults": table[table["default"]],
    }
    tables = {"stability": found.table}
    if tried:
        extremes = tables["extremes"] = pd.DataFrame([_extreme_row(result) for result in tried])
        content["extremes"] = extremes.assign(mark=np.where(extremes["holds"], "good", "bad"))
    return Report(
        "stability",
        "Where is each scheme stable and unbiased?",
        said,
        record,
        content,
        glossary(*STABILITY_WORDS, gears=Scene.from_dict(record["scene"]).gears),
        figures={"verdicts": summary(found.table), "stability": figure(found.table)},
        tables=tables,
        digits="%.6g",
        template="checks/stability/page.j2",
    )
