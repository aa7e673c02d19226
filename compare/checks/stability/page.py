"""The page and the folder of ``rattle check stability``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.checks.check import Result
from rattle.compare.checks.stability.cell import BIASED, COLLAPSING, UNBIASED, UNDECIDED, UNSTABLE
from rattle.compare.checks.stability.chart import Chart
from rattle.compare.checks.stability.figure import figure, summary
from rattle.compare.checks.stability.reference import IMPACTS
from rattle.compare.checks.table import extreme_record, worst_error
from rattle.compare.report import Figure, Page, PageSection, Row, Table, TableCell, Text, numbers
from rattle.compare.report.frames import Form, format_table
from rattle.compare.report.glossary import SCHEME_TERMS, glossary
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save
from rattle.compare.validation.validity_range import join_words
from rattle.compare.validation.verdict import Tolerances
from rattle.scene import Scene

CONTENTS = contents("stability", figures=["verdicts", "stability"], tables=["stability", "covariance", "extremes"])
"""Files of such a folder; a folder with any other file is not overwritten."""

WORDS = (
    *SCHEME_TERMS,
    "admissible step",
    "default step",
    "diagnostic",
    "unbiased",
    "biased",
    "unstable",
    "no limit",
    "standard error",
    "σ",
    "ε",
    "E, sd",
    "impact",
    "sticking",
)
KEY = (
    "Verdicts on the cells of the map: scenes from the mildest to the most extreme damping, gap, noise and "
    "restitution, at steps that input validation admits."
)
MARK = {UNBIASED: "good", BIASED: "bad", UNSTABLE: "bad", UNDECIDED: "open"}
STEPS = (
    "Input validation refuses a step longer than the longest admissible one before any path is simulated, and names "
    "that step and what limits it. A longer default step is shortened to it, which the result reports. Admissible runs "
    "that may be biased carry diagnostics: Ensemble.diagnostics, which rattle simulate prints."
)
TOLERANCE = (
    "The section is the Poincaré section at the impacts: moments are taken over each path's own k-th impact. "
    "A cell is unbiased if all section means are within {mean:.0%} and all sds within {sd:.0%} of an sd of the "
    "reference, intervals included; biased if one of them is outside, interval included; undecided otherwise. If an "
    "sd is less than 1 % of the flight time, the half gap or the speed, that 1 % is the unit. A run is unstable if its "
    "moments are not finite, its speeds are ten times those of the reference, or it abandons paths that the "
    "reference does not. No limit: at restitution 0 noise makes infinitely many impacts in a finite time."
)
REFERENCE = (
    "Reference: {impacts} impacts of exact flights at a quarter of their default step with other random numbers and "
    "four times the paths, or root finding along the orbit where σ = 0. Not judged: the displacement at the mesh that "
    "most paths strike, and quantities whose variance comes from less than about 3 % of the paths; {fewest} to {most} "
    "moments are judged in a cell. Intervals of {z:.2f} standard errors: 95 % simultaneous coverage, including "
    "repeated attempts with more paths. Base scene: DAT21 at σ = 0.3, with a start at τ = 1 whose speed matches gap "
    "and noise."
)
EXTREMES = "Each row compares a part of the program with an independent reference at extreme values."
FLOATS = "All computations are in double precision; single precision is not offered, neither on CPUs nor on GPUs."


def answer(found: Chart) -> list[str]:
    """Summarise the map in sentences."""
    cells, undiagnosed = found.admissible, found.without_diagnostic
    counts = {v: int((cells["verdict"] == v).sum()) for v in (UNBIASED, UNDECIDED, BIASED, UNSTABLE)}
    wrong = cells[cells["verdict"].isin((BIASED, UNSTABLE))]
    said = [
        _advice(found),
        f"With admissible steps {counts[UNBIASED]} of {len(cells)} cells are unbiased, {counts[UNDECIDED]} undecided, "
        f"{counts[BIASED]} biased and {counts[UNSTABLE]} unstable; diagnostics report "
        f"{int(wrong['diagnosed'].sum())} of these {len(wrong)} biased and unstable cells.",
    ]
    if len(undiagnosed):
        said.append(f"{len(undiagnosed)} admissible cells are biased or unstable without a diagnostic: a defect.")
    for scheme, part in found.table.groupby("scheme", sort=False):
        own = part[part["default"]]
        good, diagnosed = own["verdict"] == UNBIASED, own["diagnosed"].astype(bool)
        said.append(
            f"`{scheme}` at its default step: {int(good.sum())} of {len(own)} cells shown to be unbiased, "
            f"{int((~good & diagnosed).sum())} others with a diagnostic."
        )
    return said


def _advice(found: Chart) -> str:
    """Which scheme to take, by the cells at the default step."""
    own = found.table[found.table["default"]]
    good = (own["verdict"] == UNBIASED).groupby(own["scheme"], sort=False).sum().sort_values(ascending=False)
    wrong = own["verdict"].isin((BIASED, UNSTABLE)).groupby(own["scheme"], sort=False).sum()
    best, of = good.index[0], len(own) // len(good)
    others = [f"{n} for `{scheme}`" for scheme, n in good.iloc[1:].items()]
    return (
        f"Take `{best}`: at its default step {good.iloc[0]} of {of} scenes, extreme ones among them, are shown to be "
        f"unbiased and {wrong[best] or 'none'} to be biased{f' (unbiased: {join_words(others)})' if others else ''}."
    )


def write_stability(
    out: Path, found: Chart, covariance: pd.DataFrame, tried: Sequence[Result], record: dict[str, Any], overwrite: bool
) -> list[str]:
    """Write the folder of the map atomically."""
    said = answer(found)
    if tried:
        said.append(f"{sum(row.holds for row in tried)} of {len(tried)} extremes of the formulas and samplers hold.")
    tolerance = TOLERANCE.format(**Tolerances()._asdict())
    moments = found.table["moments"]
    reference = REFERENCE.format(impacts=IMPACTS, z=found.z, fewest=moments.min(), most=moments.max())
    caption = (
        "Every scheme (rows) over every axis (columns): a mark for each time step. Grey: longer than the longest "
        "admissible step, refused by input validation."
    )
    page = Page(
        "Where is each scheme stable and unbiased?",
        tuple(said),
        source_of(record),
        (
            Figure("verdicts.svg", KEY, KEY),
            Text("The worst cell with an admissible step, for each scheme and axis:", note=True),
            worst(found),
            glossary(*WORDS, gears=Scene.from_dict(record["scene"]).gears),
        ),
        (
            PageSection(
                "How long may a step be?", (Figure("stability.svg", caption, caption), Text(STEPS), Text(FLOATS))
            ),
            PageSection("At the default step", (_defaults(found),)),
            PageSection("Method", (Text(tolerance), Text(reference))),
            PageSection("Exact flights without walls compared with the exact covariance", (_covariance(covariance),)),
            *((PageSection("Extreme values", (Text(EXTREMES, note=True), _extremes(tried))),) if tried else ()),
        ),
    )
    tables = {"stability": found.table, "covariance": covariance}
    if tried:
        tables["extremes"] = pd.DataFrame([extreme_record(row) for row in tried])
    save(
        out,
        "stability",
        page,
        record,
        allowed=CONTENTS,
        tables=tables,
        digits="%.6g",
        overwrite=overwrite,
        figures={"verdicts": summary(found.table), "stability": figure(found.table)},
    )
    return said


def worst(found: Chart) -> Table:
    """The admissible cell with the largest error, for each scheme and axis."""
    cells = found.admissible[found.admissible["verdict"] != COLLAPSING]
    chosen = cells.loc[cells.groupby(["scheme", "axis"], sort=False)["error"].idxmax()]
    return _table(chosen)


def _defaults(found: Chart) -> Table:
    return _table(found.table[found.table["default"]], "all cells at the default step")


def _table(cells: pd.DataFrame, summary: str = "") -> Table:
    columns: list[tuple[str, Form]] = [
        ("scheme", "{scheme}"),
        ("axis", "{axis}"),
        ("at", lambda c: c["value"]),
        ("dt", lambda c: c["dt"]),
        ("verdict", lambda c: TableCell(c["verdict"], MARK.get(c["verdict"], "open"))),
        ("error in tolerances", "{error:.2g} ± {half:.1g}"),
        ("of", "{where}"),
        ("diagnosed", lambda c: "yes" if c["diagnosed"] else "no"),
    ]
    return format_table(cells, columns, ("scheme", "axis", "verdict", "of", "diagnosed"), summary)


def _extremes(tried: Sequence[Result]) -> Table:
    texts = ("what", "field", "range", "reference")
    rows: list[Row] = []
    for result in tried:
        error, _, unit = worst_error(result)
        worst = TableCell(error, "good" if result.holds else "bad")
        named = (result.name, result.worst.quantity, result.statement, result.reference)
        rows.append([*named, worst, result.allowed, unit])
    return Table.of([*texts, *numbers("worst error", "allowed"), "relative to"], rows, "every row")


def _covariance(table: pd.DataFrame) -> Table:
    def error(row: dict[str, Any]) -> TableCell:
        return TableCell(f"{row['error']:+.2%} ± {row['half']:.1%}", "good" if row["holds"] else "bad")

    columns: list[tuple[str, Form]] = [
        ("β₁", lambda r: r["beta"]),
        ("dt", lambda r: r["dt"]),
        ("relative error of the sd", error),
        ("of", "{quantity}"),
    ]
    return format_table(table, columns, ("of",))
