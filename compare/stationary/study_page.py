"""The page and the figures of a study of the long run."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from rattle.compare.report import (
    Block,
    Code,
    Column,
    Figure,
    Page,
    PageSection,
    Row,
    Table,
    Text,
    manifest,
    numbers,
)
from rattle.compare.report import write_page as write_views
from rattle.compare.report.csv_text import write_csv
from rattle.compare.report.glossary import CLOSURE_TERMS, VERDICT_TERMS, glossary
from rattle.compare.report.json_text import json_text
from rattle.compare.report.provenance import provenance, source_of
from rattle.compare.report.style import STYLE, new_figure, save
from rattle.compare.stationary.judged import TOLERANCES
from rattle.compare.stationary.study import TABLES, LongResults, LongTables, shares
from rattle.compare.study.current import cells_digest, files_of
from rattle.compare.study.figures import axis_label
from rattle.compare.study.lacking import lacking
from rattle.compare.study.tables import FILE, MANIFEST, file_digest
from rattle.compare.study.version import numerical_version
from rattle.compare.validation.validity_range import span

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
SMALL = ("cost", "reasons")
"""Small tables, written as CSV in addition to Parquet."""
COLOURS = ("#000000", "#0072B2", "#D55E00")
MARKERS = ("D", "o", "s")
CAPTION = (
    "The long run over the field that varies, with 95 % intervals: impacts, energy lost, speeds, slow impacts, and the "
    "share of its quantities that each closure has right (no curve where it predicts none). Units: the drive's angular "
    "frequency ω, the backlash ν₁ of mesh 1, inertia I₁ and radius R₁ of wheel 1."
)


def study_figure(r: LongResults | LongTables) -> Drawing:
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


def answer(r: LongResults) -> list[str]:
    """Summarise a study of the long run in a few sentences."""
    if r.empty:
        return ["No point could be computed; the command says why."]
    name, said = r.study.along or "the points", []
    for quantity, words in (("rate", "impacts per unit of time"), ("energy_per_period", "energy lost per period")):
        rows = r.quantities[r.quantities["quantity"] == quantity]
        rows = rows.sort_values("value")
        ends = [f"{row['value']:.4g}" for row in (rows.iloc[0], rows.iloc[-1])]
        if ends[0] == ends[1]:
            said.append(f"{words}: {ends[0]}")
            continue
        if r.study.along:
            ends = [f"{e} (at {name} = {rows[r.study.along].iloc[i]:.4g})" for e, i in zip(ends, (0, -1), strict=True)]
        said.append(f"{words}: from {' to '.join(ends)}")
    sentences = [f"In the long run, {said[0]}.", f"{said[1][0].upper()}{said[1][1:]}."]
    if r.study.along and not r.verdicts.empty:
        good = shares(r.verdicts, r.study.along)
        for closure in r.study.closures:
            own = good[closure].dropna() if closure in good else pd.Series(dtype=float)
            if own.empty:
                why = r.verdicts[r.verdicts["closure"] == closure]["reason"].iloc[0]
                sentences.append(f"`{closure}` predicts nothing of the long run at any value: {why}.")
                continue
            whole = own[own == 1.0]
            right = f"fully accurate at {len(whole)}" if len(whole) else "fully accurate at none"
            sentences.append(
                f"`{closure}` predicts the long run at {len(own)} of {len(good)} values of {name}, and is {right} of "
                f"them; {span(own, '.0%')} of its quantities are accurate."
            )
    other = r.cost[r.cost["kind"] != "simulated"]
    if len(other):
        sentences.append(f"At {len(other)} of {len(r.cost)} points nothing is random and the values are exact.")
    return sentences


def write_page(folder: Path, r: LongResults, facts: dict[str, Any]) -> dict[str, Any]:
    """Write tables, figure, page and manifest of a study of the long run into a scratch folder."""
    for name in TABLES:
        table = getattr(r, name)
        table.to_parquet(folder / f"{name}.parquet", compression="zstd")
        if name in SMALL:
            write_csv(table, folder / f"{name}.csv", index=False, float_format="%.9g")
    (folder / FILE).write_text(r.study.text, encoding="utf-8")
    drawn: list[Block] = []
    if r.study.along and not r.empty:
        (folder / "figures").mkdir()
        save(study_figure(r), folder / "figures/long-run.svg")
        drawn.append(Figure("figures/long-run.svg", CAPTION, CAPTION))
    record = {
        "version": manifest.VERSION,
        "kind": "study",
        "tables": list(TABLES),
        "title": r.study.title,
        "answer": answer(r),
        "complete": all(f is not None for f, p in zip(r.found, r.study.points, strict=True) if p.sample),
        "points": len(r.study.points),
        "cells": len(r.study.cells),
        "cells_sha256": cells_digest(r.study),
        "study_sha256": r.study.digest,
        "numerical_version": numerical_version(),
        **provenance(),
        **facts,
    }
    write_views(_page(r, record, drawn), folder, "study")
    record = manifest.seal(record | {"files": {file: file_digest(folder / file) for file in files_of(r.study)}})
    (folder / MANIFEST).write_text(json_text(record) + "\n", encoding="utf-8")
    return record


def _page(r: LongResults, record: dict[str, Any], drawn: list[Block]) -> Page:
    words = glossary(*CLOSURE_TERMS, *VERDICT_TERMS, "exact flight", "σ", "ε", "orbit", gears=r.study.gears)
    opening: tuple[Block, ...] = (*drawn, _main(r), Text(TOLERANCES, note=True), words)
    sections = []
    if lacks := lacking(r.study.points, record.get("failed", {})):
        rows: list[Row] = [[lack.what, lack.points, lack.where, lack.why] for lack in lacks]
        sections.append(
            PageSection(
                "What could not be computed", (Table.of(["what", *numbers("points"), "the first", "why"], rows),)
            )
        )
    text = (Text("The study, `study.toml`:"), Code(r.study.text, "toml"))
    source = source_of(record, text, {"rows": "`rattle.compare.stationary.study.load(FOLDER)` loads every one"})
    return Page(r.study.title, tuple(record["answer"]), source, opening, tuple(sections))


def _main(r: LongResults) -> Table:
    """The main quantities at every point, with half widths of their intervals."""
    names = r.study.names
    shown = ("rate", "speed", "energy_per_period", "slow_share")
    heads = [Column(n) for n in names] + list(numbers(*(x for n in shown for x in (n, "±")), "burn-in", "periods"))
    rows = []
    for point, found in zip(r.study.points, r.found, strict=True):
        if found is None:
            continue
        row: list[Any] = [f"{point.coordinates[n]}" for n in names]
        for name in shown:
            own = found.table.loc[name] if name in found.table.index else None
            row += [np.nan, np.nan] if own is None else [own["value"], 0.5 * (own["high"] - own["low"])]
        rows.append([*row, float(found.facts["burn_in"]), float(found.facts["periods"])])
    return Table.of(heads or ["the only point"], rows, "Every point" if len(rows) > 12 else "")
