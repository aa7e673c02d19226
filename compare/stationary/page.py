"""The page and the folder of a long run."""

from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.chaos.bifurcation import Bifurcation
from rattle.compare.report import Figure, Page, PageSection, Table, TableCell, Text
from rattle.compare.report.content import Block
from rattle.compare.report.frames import Form, format_table, table_of
from rattle.compare.report.glossary import CLOSURE_TERMS, VERDICT_TERMS, glossary
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save
from rattle.compare.stationary.answer import answer
from rattle.compare.stationary.figures import bifurcation_figure, speed_unit
from rattle.compare.stationary.measure import Stationary
from rattle.compare.stationary.units import speed_text
from rattle.compare.stationary.verdicts import TOLERANCES

FIGURES = {
    "distribution": "Velocity just before an impact, with its 95 % interval, on a logarithmic scale: the stationary "
    "motion. Coloured lines: the mean speed that each closure gives; grey: impacts that count as slow.",
    "section": "The Poincaré section at the impacts: density over the phase of the excitation and the velocity before "
    "the impact, and its relative standard error in every cell.",
    "memory": "Autocorrelation time of each quantity, in impacts: right of 1 errors computed as if impacts were "
    "independent are too small, left of it too large.",
    "closures": "Errors of the closures relative to the tolerance, with intervals of 95 % simultaneous coverage.",
    "bifurcation": "Density of the velocity before an impact over a field of the scene: without noise and with it.",
}
"""Captions of the figures, by name."""

CONTENTS = contents(
    "stationary", figures=tuple(FIGURES), tables=("stationary", "physical", "verdicts", "sections", "bifurcation")
)
"""Files of such a folder; a folder with any other file is not overwritten."""

WORDS = (
    *CLOSURE_TERMS,
    *VERDICT_TERMS,
    "exact flight",
    "σ",
    "ε",
    "τ",
    "Δτ",
    "y1, y2",
    "E, sd",
    "orbit",
    "mean map",
    "sticking",
)

MEANING = (
    "`rate_above`, `speed_above`: impacts per unit of time, and speed just before them, of impacts at {slow} or "
    "faster. `rate`, `speed`: of all impacts, chatter included. `flight`: time since the last impact (with `_mesh1`, "
    "`_mesh2`: since the last one at that mesh). `energy`: lost at an impact, ½(1 − ε²) w y², w = 1 at mesh 1 "
    "and μ at mesh 2{mass}; "
    "`energy_per_period`, and `power` per unit of time. `slow_share`: share of impacts slower than {slow}. "
    "`contact_share`: share of the time in which a mesh is closed. `sd_`, `skew_`, `q05_`: standard deviation, "
    "skewness, 5 % quantile. `autocorrelation`: in impacts. `se_batches`: standard error from batch means. "
    "`effective_paths`: how many paths the standard error rests on."
)
MASS = ", in units of the mass of wheel 1 at its rim times the square of the unit of speed"


def stationary_page(found: Stationary, record: dict[str, Any], drawn: list[str]) -> Page:
    """Build the page of a long run."""
    figures = {name: Figure(f"{name}.svg", FIGURES[name], FIGURES[name]) for name in drawn}
    units = "dimensionless" if found.scene.gears is None else "physical"
    opening: list[Block] = [figures["distribution"]] if "distribution" in figures else []
    words = glossary(*WORDS, gears=found.scene.gears)
    slow = speed_text(found.slow, found.scene.gears, units)
    meaning = MEANING.format(slow=slow, mass=MASS if units == "dimensionless" else "")
    opening += [_quantities(found.table_in(units)), Text(meaning, note=True), words]
    sections = []
    if units == "physical":
        sections.append(PageSection("Dimensionless", (_quantities(found.table_in("dimensionless"), "All quantities"),)))
    if len(found.verdicts):
        blocks: list[Block] = [figures["closures"]] if "closures" in figures else []
        sections.append(
            PageSection("The closures", (*blocks, _verdicts(found.verdicts_in(units)), Text(TOLERANCES, note=True)))
        )
    if "section" in figures:
        sections.append(PageSection("The section", (figures["section"],)))
    if "bifurcation" in figures:
        sections.append(PageSection(f"Over {record['field']}", (figures["bifurcation"],)))
    if "memory" in figures:
        sections.append(PageSection("Autocorrelation", (figures["memory"],)))
    return Page(
        f"The long run of {record['name']}", tuple(answer(found)), source_of(record), tuple(opening), tuple(sections)
    )


def _quantities(table: pd.DataFrame, summary: str = "") -> Table:
    return table_of(table.reset_index(), ("quantity", "unit"), summary)


MARK = {"accurate": "good", "inaccurate": "bad", "undecided": "open"}


def _verdicts(verdicts: pd.DataFrame) -> Table:
    """The main quantities of each closure, and why it has none."""
    missing = verdicts["reason"] != ""
    alone = missing & ~verdicts["closure"].duplicated()
    nothing = {"quantity": "all", "unit": "", "simulated": np.nan, "low": np.nan, "high": np.nan}
    rows = verdicts.assign(**{name: verdicts[name].mask(alone, value) for name, value in nothing.items()})
    rows = rows[alone | (rows["verdict"] != "not predicted") & ~missing]
    columns: list[tuple[str, Form]] = [(n, f"{{{n}}}") for n in ("closure", "quantity", "unit")]
    columns += [(n, itemgetter(n)) for n in ("predicted", "simulated", "low", "high")]
    columns += [("verdict", lambda r: TableCell(r["verdict"], MARK.get(r["verdict"], ""))), ("why not", "{reason}")]
    texts = ("closure", "quantity", "unit", "verdict", "why not")
    return format_table(rows, columns, texts, "Every quantity" if len(rows) > 12 else "")


def write_stationary(
    out: Path, found: Stationary, view: Bifurcation | None, record: dict[str, Any], overwrite: bool
) -> list[str]:
    """Write the folder of a long run."""
    figures = found.figures()
    tables, units = {"stationary": found.table.reset_index()}, "dimensionless"
    if found.scene.gears is not None:
        units = "physical"
        tables["physical"] = found.table_in(units).reset_index()
    if len(found.verdicts):
        tables["verdicts"] = found.verdicts_in(units)
    if found.densities:
        tables["sections"] = pd.concat([d.table for d in found.densities], ignore_index=True)
    if view is not None:
        figures["bifurcation"], tables["bifurcation"] = (
            bifurcation_figure(view, *speed_unit(found.scene.gears)),
            view.table,
        )
    page = stationary_page(found, record, list(figures))
    save(
        out,
        "stationary",
        page,
        record | found.to_dict(),
        allowed=CONTENTS,
        figures=figures,
        tables=tables,
        digits="%.8g",
        overwrite=overwrite,
    )
    return list(page.answer)
