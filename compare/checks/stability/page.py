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
    CHART_IMPACTS,
    CHART_UNDECIDED,
    COLLAPSING,
    UNBIASED,
    UNSTABLE,
    Chart,
)
from rattle.compare.judge.verdict import Tolerances
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.report.report import Report
from rattle.compare.report.style import legend_above, new_figure
from rattle.compare.report.texts import REPORT_TEXTS, glossary
from rattle.scene import Scene

CHART_MARKS: Any = REPORT_TEXTS["marks"]["stability"]
OTHER_MARKS: Any = REPORT_TEXTS["marks"]["map"]
DEFAULT_OFFSET = 0.28  # horizontal offset of the cell at the default step, in columns


def summary(table: pd.DataFrame) -> Drawing:
    """Draw how many cells with an admissible step have which verdict, at the default step and at
    all of them."""
    schemes = table["scheme"].unique()
    cells = table[table["share"] <= 1.0]
    drawn, panels = new_figure(10.0, 0.42 * len(schemes) + 1.2, 1, 2)
    shown = (("at the default step", cells[cells["default"]]), ("at every admissible step", cells))
    verdicts = [v for v in CHART_MARKS if v in set(cells["verdict"])]
    colours = [CHART_MARKS[v]["color"] for v in verdicts]
    for (title, part), ax in zip(shown, panels, strict=True):
        counts = pd.crosstab(part["scheme"], part["verdict"])
        counts = counts.reindex(index=schemes, columns=verdicts, fill_value=0)
        counts.plot.barh(stacked=True, ax=ax, color=colours, width=0.7, legend=False)
        containers: Any = ax.containers
        for bars in containers:
            ax.bar_label(bars, fmt=_nonzero, label_type="center", color="white", fontsize=8)
        ax.invert_yaxis()
        ax.grid(visible=False)
        ax.set_title(title, loc="left")
        ax.set(ylabel="", xlabel="cells of the map")
    panels[1].set_yticklabels([])
    legend_above(drawn, len(CHART_MARKS), panels[:1])
    return drawn


def _nonzero(number: float) -> str:
    """A number of cells as the label of a bar; none if there is no bar."""
    return f"{number:.0f}" if number else ""


def figure(table: pd.DataFrame) -> Drawing:
    """Draw the map."""
    schemes = table["scheme"].unique()
    axes = table["axis"].unique()
    drawn, panels = new_figure(
        2.9 * len(axes) + 0.8, 2.7 * len(schemes) + 0.9, len(schemes), len(axes)
    )
    for ax, (scheme, axis) in zip(panels, product(schemes, axes), strict=True):
        _draw_panel(ax, table.query("scheme == @scheme and axis == @axis"))
        if axis == axes[0]:
            ax.set_ylabel(f"{scheme}\nstep dt")
        if scheme == schemes[-1]:
            ax.set_xlabel(AXES[axis][0])
    drawn.legend(
        handles=_legend(set(table["verdict"])),
        loc="outside upper center",
        ncols=round(1.25 * len(axes)),
    )
    return drawn


def _draw_panel(ax: Axes, part: pd.DataFrame) -> None:
    longest = part["dt"] / part["share"]
    longest = longest.groupby(part["value"], sort=False).first()
    values = list(longest.index)
    low = 0.4 * part["dt"].min()
    high = 2.5 * part["dt"].max()
    edges = [-0.5, *range(len(values)), len(values) - 0.5]
    line = longest.iloc[[0, *range(len(values)), -1]]
    ax.fill_between(edges, line, high, color=OTHER_MARKS["refused"]["color"], lw=0)
    ax.plot(edges, line, color="k", lw=1.3)
    cells: Any = part.itertuples()
    for cell in cells:
        style = CHART_MARKS[cell.verdict]
        x = values.index(cell.value) + (DEFAULT_OFFSET if cell.default else 0.0)
        face = "white" if cell.diagnosed and cell.share <= 1.0 else style["color"]
        size = 4.0 if cell.default else 5.5
        edge: Any = {"mec": style["color"], "mew": 1.2, "ls": ""}
        ax.plot(x, cell.dt, style["marker"], ms=size, mfc=face, **edge)
    ax.set(yscale="log", ylim=(low, high), xlim=(-0.5, len(values) - 0.5))
    ax.set_xticks(range(len(values)), [f"{v:g}" for v in values], fontsize=7.5)


def _legend(verdicts: set[str]) -> list[Line2D]:
    """The handles of the legend."""
    marks: dict[str, Facts] = {
        name: {"ms": 6, **style} for name, style in CHART_MARKS.items() if name in verdicts
    }
    marks |= OTHER_MARKS
    return [Line2D([], [], label=label, **{"ls": "", **style}) for label, style in marks.items()]


MARK = {UNBIASED: "good", BIASED: "bad", UNSTABLE: "bad", CHART_UNDECIDED: "open"}


def answer(found: Chart, tried: Sequence[Result] = ()) -> list[str]:
    """Summarise the map, and the checks at extreme values, in sentences."""
    cells = found.admissible
    wrong = cells[cells["verdict"].isin((BIASED, UNSTABLE))]
    default = found.table[found.table["default"]]
    good = default["verdict"] == UNBIASED
    by_scheme = pd.DataFrame(
        {
            "cells": 1,
            "good": good,
            "wrong": default["verdict"].isin((BIASED, UNSTABLE)),
            "diagnosed": ~good & default["diagnosed"].astype(bool),
        }
    )
    by_scheme = by_scheme.groupby(default["scheme"], sort=False).sum()
    best = by_scheme.sort_values("good", ascending=False, kind="stable")
    return render_sentences(
        "checks/stability/answer.j2",
        UNBIASED=UNBIASED,
        UNDECIDED=CHART_UNDECIDED,
        BIASED=BIASED,
        UNSTABLE=UNSTABLE,
        best=list(best.itertuples()),
        schemes=list(by_scheme.itertuples()),
        counts=cells["verdict"].value_counts().reindex(CHART_MARKS, fill_value=0),
        cells=len(cells),
        wrong=len(wrong),
        diagnosed=wrong["diagnosed"].sum(),
        undiagnosed=len(found.without_diagnostic),
        tried=tried,
    )


def _extreme_row(result: Result) -> Facts:
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


def make_report(found: Chart, tried: Sequence[Result], record: Facts) -> Report:
    """The report on the map."""
    cells = found.admissible[found.admissible["verdict"] != COLLAPSING]
    table = found.table.assign(
        mark=found.table["verdict"].map(MARK).fillna("open"),
        said=np.where(found.table["diagnosed"], "yes", "no"),
    )
    content: Facts = {
        "found": found,
        "impacts": CHART_IMPACTS,
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
        answer(found, tried),
        record,
        content,
        glossary("stability", gears=Scene.from_dict(record["scene"]).gears),
        figures={"verdicts": summary(found.table), "stability": figure(found.table)},
        tables=tables,
        digits="%.6g",
        template="checks/stability/page.j2",
    )
