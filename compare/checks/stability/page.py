"""The map as a report folder: page, figure, tables, manifest."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.chaos.page import source_of
from rattle.compare.checks.extremes.row import Extreme
from rattle.compare.checks.extremes.run import table
from rattle.compare.checks.stability.cell import BIASED, COLLAPSING, UNBIASED, UNDECIDED, UNSTABLE
from rattle.compare.checks.stability.chart import Chart
from rattle.compare.checks.stability.figure import figure
from rattle.compare.checks.stability.reference import IMPACTS
from rattle.compare.report import Cell, Column, Figure, Page, Row, Section, Table, Text, numbers
from rattle.compare.report.save import contents, save
from rattle.compare.validation.verdict import Tolerances

__all__ = ["CONTENTS", "answer", "write_stability"]

CONTENTS = contents("stability", figures=["stability"], tables=["stability", "covariance", "extremes"])
"""What such a folder holds; anything else in it is not ours."""

MARK = {UNBIASED: "good", BIASED: "bad", UNSTABLE: "bad", UNDECIDED: "open"}
DOOR = (
    "A step beyond the door is refused before any path has run, with the longest step that is let through and what "
    "limits it. A default step beyond the door is shortened to it, and the result says so. What the door lets through "
    "and may still be biased says so in the result: Ensemble.diagnostics, which rattle simulate prints."
)
TOLERANCE = (
    "A cell is unbiased if all section means are within {mean:.0%} and all sds within {sd:.0%} of an sd of the "
    "reference, with their intervals; biased if one of them is outside with its interval; undecided between. Where an "
    "sd is less than 1 % of the flight time, the half gap or the speed, that 1 % is the unit. Unstable is a run whose "
    "moments are not finite, whose speeds are ten times those of the reference, or that gives up paths which the "
    "reference does not. No limit: at restitution 0 noise shakes a path without end against its wall."
)
BESIDE = (
    "Reference: {impacts} impacts of exact flights at a quarter of their default step with other random numbers and "
    "four times the paths, or root finding along the orbit where σ = 0. Left out: the displacement at the mesh that "
    "most paths strike, and what less than about 3 % of the paths make the sd of; {fewest} to {most} moments are "
    "judged in a cell. Intervals of {z:.2f} standard errors: all hold together with 95 %, however often a cell was "
    "tried with more paths. Base scene: DAT21 at σ = 0.3, a start at τ = 1 whose speed suits gap and noise."
)
EXTREMES = "Extreme values are ordinary values: each row holds a part of the program against a truth of its own."
FLOATS = "All of it in double precision; single precision is not offered, neither on processors nor on a card."


def answer(found: Chart) -> list[str]:
    """What the map says, in sentences."""
    inside, untold = found.let_through, found.untold
    counts = {v: int((inside["verdict"] == v).sum()) for v in (UNBIASED, UNDECIDED, BIASED, UNSTABLE)}
    wrong = inside[inside["verdict"].isin((BIASED, UNSTABLE))]
    said = [
        f"Inside the door {counts[UNBIASED]} of {len(inside)} cells are unbiased, {counts[UNDECIDED]} undecided, "
        f"{counts[BIASED]} biased and {counts[UNSTABLE]} unstable; of those that are wrong "
        f"{int(wrong['told'].sum())} of {len(wrong)} say so themselves.",
    ]
    if len(untold):
        said.append(f"{len(untold)} cells are wrong inside the door and do not say so: a defect.")
    for scheme, part in found.table.groupby("scheme", sort=False):
        own = part[part["default"]]
        good, told = own["verdict"] == UNBIASED, own["told"].astype(bool)
        said.append(
            f"{scheme} at its default step: {int(good.sum())} of {len(own)} places shown to be unbiased, "
            f"{int((~good & told).sum())} others say that they may be off."
        )
    return said


def write_stability(
    out: Path, found: Chart, law: pd.DataFrame, tried: Sequence[Extreme], record: dict[str, Any], overwrite: bool
) -> list[str]:
    """Write the folder and return the answer.

    Parameters
    ----------
    out : Path
    found : Chart
    law : DataFrame
        Of `rattle.compare.checks.stability.free_flight.covariance_table`.
    tried : sequence of Extreme
        Of `rattle.compare.checks.extremes.run.extremes`; empty if they were not tried.
    record : dict
        Of the manifest.
    overwrite : bool

    Raises
    ------
    OutputError
        If the folder holds other things, or earlier ones that may not be replaced.
    """
    said = answer(found)
    if tried:
        said.append(f"{sum(row.holds for row in tried)} of {len(tried)} extremes of the formulas and samplers hold.")
    tolerance = TOLERANCE.format(**Tolerances()._asdict())
    moments = found.table["moments"]
    beside = BESIDE.format(impacts=IMPACTS, z=found.z, fewest=moments.min(), most=moments.max())
    caption = (
        "Every scheme (rows) over every axis (columns): a mark for each step that was tried. Grey: the door refuses it."
    )
    page = Page(
        "Where is each scheme stable and unbiased?", tuple(said), source_of(record),
        (Figure("stability.svg", caption, caption), Text(DOOR), Text(FLOATS)),
        (
            Section("The worst cell inside the door", (Text(tolerance, note=True), worst(found))),
            Section("At the default step", (_defaults(found),)),
            Section("How it was measured", (Text(beside),)),
            Section("Exact flights without walls against the exact covariance", (_law(law),)),
            *((Section("Extreme values", (Text(EXTREMES, note=True), _extremes(tried))),) if tried else ()),
        ),
    )  # fmt: skip
    tables = {"stability": found.table, "covariance": law} | ({"extremes": table(tried)} if tried else {})
    save(
        out, "stability", page, record, allowed=CONTENTS, figures={"stability": figure(found.table)}, tables=tables,
        digits="%.6g", overwrite=overwrite,
    )  # fmt: skip
    return said


def worst(found: Chart) -> Table:
    """The cell furthest beyond the tolerance inside the door, for each scheme and axis."""
    inside = found.let_through[found.let_through["verdict"] != COLLAPSING]
    chosen = inside.loc[inside.groupby(["scheme", "axis"], sort=False)["error"].idxmax()]
    return _table(chosen)


def _defaults(found: Chart) -> Table:
    return _table(found.table[found.table["default"]], "every place at its default step")


def _table(cells: pd.DataFrame, summary: str = "") -> Table:
    rows: list[Row] = [
        [
            c["scheme"], c["axis"], c["value"], c["dt"], Cell(c["verdict"], MARK.get(c["verdict"], "open")),
            Cell(f"{c['error']:.2g} ± {c['half']:.1g}"), c["where"], "yes" if c["told"] else "no",
        ]
        for _, c in cells.iterrows()
    ]  # fmt: skip
    heads: list[Column | str] = [
        "scheme",
        "axis",
        *numbers("at", "dt"),
        "verdict",
        *numbers("error in tolerances"),
        "of",
        "says so",
    ]
    return Table.of(heads, rows, summary)


def _extremes(tried: Sequence[Extreme]) -> Table:
    rows: list[Row] = [
        [
            row.name, row.field, row.tried, row.truth,
            Cell(f"{row.worst:.2f}" if row.unit == "z" else f"{row.worst:.1e}", "good" if row.holds else "bad"),
            row.allowed, "standard errors" if row.unit == "z" else row.unit,
        ]
        for row in tried
    ]  # fmt: skip
    heads: list[Column | str] = ["what", "field", "tried", "against", *numbers("worst error", "allowed"), "relative to"]
    return Table.of(heads, rows, "every row")


def _law(law: pd.DataFrame) -> Table:
    rows: list[Row] = [
        [
            r["beta"], r["dt"], Cell(f"{r['error']:+.2%} ± {r['half']:.1%}", "good" if r["holds"] else "bad"),
            r["quantity"],
        ]
        for _, r in law.iterrows()
    ]  # fmt: skip
    return Table.of([*numbers("β₁", "dt", "sd over the exact one's − 1"), "of"], rows)
