"""Writes the output of a study next to its cells: tables, figures, a page, and a manifest with their provenance."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.report import Block, Code, Figure, Page, PageSection, Row, Table, TableCell, Text, manifest, numbers
from rattle.compare.report import write_page as write_views
from rattle.compare.report.csv_text import write_csv
from rattle.compare.report.folder import scratch_folder, within
from rattle.compare.report.glossary import CLOSURE_TERMS, SECTION_TERMS, VERDICT_TERMS, glossary
from rattle.compare.report.json_text import json_text
from rattle.compare.report.provenance import provenance, source_of
from rattle.compare.report.style import save
from rattle.compare.study.current import FILES, cells_digest
from rattle.compare.study.estimate import scaling
from rattle.compare.study.figures import FIGURES, panels
from rattle.compare.study.lacking import lacking
from rattle.compare.study.results import Results
from rattle.compare.study.tables import FILE, MANIFEST, PAGE, TABLES, file_digest
from rattle.compare.study.version import numerical_version
from rattle.compare.validation.validity_range import in_words, join_words, span, want
from rattle.compare.validation.verdict import RULE, VERDICTS
from rattle.scene.errors import OutputError

SMALL = ("correlation", "validity", "cost", "reasons")
"""Small tables, written as CSV in addition to Parquet."""

WORDS = (
    *CLOSURE_TERMS,
    *SECTION_TERMS,
    *VERDICT_TERMS,
    "exact flight",
    "σ",
    "α",
    "ε",
    "ρ1, ρ2",
    "orbit",
    "agreement",
)
FEW = 4  # up to so many different ranges of validity of a closure are listed one by one in the answer


def _digest(table: pd.DataFrame) -> str:
    return hashlib.sha256(pd.util.hash_pandas_object(table, index=False).to_numpy().tobytes()).hexdigest()


def answer(r: Results) -> list[str]:
    """Summarise a study in a few sentences.

    Returns: Advice, the range of validity of each closure over all impacts, and the itinerary agreement after the
    last.
    """
    sentences = []
    table, impacts = r.validity, r.study.impacts
    if not table.empty:
        last, name = table[table["impact"] == impacts], r.study.along
        values = r.errors[name]
        sentences = [
            _advice(last, impacts, name, values.max()),
            f"Every section mean and sd of {impacts} impacts, {name} = {span(values, '.4g')}:",
            *(f"`{closure}`: {_range_in_words(r, rows)}." for closure, rows in last.groupby("closure", sort=False)),
        ]
    reached = r.sections[(r.sections["quantity"] == "tau") & (r.sections["moment"] == "mean")]
    shares = reached[reached["impact"] == impacts]["agreement"]
    if len(shares):
        sentences.append(f"After {impacts} impacts {span(shares, '.1%')} of the paths are on the noise-free itinerary.")
    return sentences or ["No point could be computed; the command says why."]


def _advice(last: pd.DataFrame, impacts: int, name: str, largest: float) -> str:
    """Which closure is accurate furthest, wherever the other fields of the study lie."""
    accurate, open_to = (_everywhere(last, column) for column in ("accurate", "not_inaccurate"))
    shown, over = name if name != "sigma" else "σ", f"over {impacts} impacts"
    if accurate.empty and not open_to.empty:
        each = join_words([f"`{c}` up to {shown} = {x:.4g}" for c, x in open_to.items()])
        return (
            f"Undecided: no closure is shown to be accurate {over} in every row of this study. Not shown to be wrong: "
            f"{each}. More paths would settle it; until then simulate."
        )
    if accurate.empty:
        some = [f"`{c}`" for c in last[last["accurate"].notna()]["closure"].unique()]
        where = f"; {join_words(some)} {'is' if len(some) == 1 else 'are'} at some" if some else ""
        return f"Simulate: no closure is accurate {over} in every row of this study{where}."
    best = [f"`{closure}`" for closure in accurate.index[accurate == accurate.max()]]
    take = f"Take {' or '.join(best)} up to {shown} = {accurate.max():.4g}"
    if accurate.max() >= largest:
        return f"{take}, the largest of this study: all means and sds {over} are accurate there."
    return f"{take}; beyond it simulate: no closure is shown to be accurate {over} everywhere there."


def _everywhere(last: pd.DataFrame, column: str) -> pd.Series:
    """The least range of each closure over the other fields; without those that have none somewhere."""
    return last.groupby("closure", sort=False)[column].agg(lambda limits: limits.min(skipna=False)).dropna()


def _range_in_words(r: Results, rows: pd.DataFrame) -> str:
    """A closure's range of validity at each value of the other fields; of many, only the smallest and the largest."""
    found: dict[str, list[str]] = {}  # values of the other fields, by the sentence that holds there
    for row in rows.sort_values(["accurate", "not_inaccurate"], na_position="first").to_dict("records"):
        own = r.errors[(r.errors["closure"] == row["closure"]) & r.errors["judged"]]
        for name in r.study.others:
            own = own[own[name] == row[name]]
        values = sorted(own[r.study.along].unique())
        said = in_words(
            r.study.along,
            values,
            row["accurate"],
            row["not_inaccurate"],
            ended=row["ended"],
            undecided=want(own[own[r.study.along] <= row["not_inaccurate"]]),
        )
        found.setdefault(said, []).append(", ".join(f"{name} = {row[name]}" for name in r.study.others))
    if len(found) == 1:
        return next(iter(found))
    if len(found) <= FEW:
        return "; ".join(f"{said} (at {' and '.join(where)})" for said, where in found.items())
    (least, low), *_, (most, high) = found.items()
    return f"from {least} (at {low[0]}) to {most} (at {high[-1]})"


def write_page(
    folder: Path,
    r: Any,
    facts: dict[str, Any],
    written: Callable[[Path, Any, dict[str, Any]], dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """Write tables, figures, the page and the manifest; each file is replaced atomically.

    `written`: Writes the files of another kind of study into a scratch folder, from the same arguments.
    """
    try:
        with scratch_folder(folder, PAGE) as scratch:
            record = (written or _write)(scratch, r, facts)
            files = [path.relative_to(scratch) for path in scratch.rglob("*") if path.is_file()]
            within(folder, *{str(file.parent) for file in files})
            (folder / MANIFEST).unlink(missing_ok=True)  # holds the digests of the others: removed first, written last
            for file in sorted(files, key=lambda f: f.name == MANIFEST):
                (folder / file).parent.mkdir(exist_ok=True)
                os.replace(scratch / file, folder / file)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"out = {str(folder)!r}: the page cannot be written ({error.strerror}); all results stored: make room and "
            "repeat the command"
        ) from None
    return record


def _write(folder: Path, r: Results, facts: dict[str, Any]) -> dict[str, Any]:
    tables = {name: getattr(r, name) for name in TABLES}
    for name, table in tables.items():
        table.to_parquet(folder / f"{name}.parquet", compression="zstd")
        if name in SMALL:
            write_csv(table, folder / f"{name}.csv", index=False, float_format="%.9g")
    (folder / FILE).write_text(r.study.text, encoding="utf-8")  # another process may have replaced the file meanwhile
    (folder / "figures").mkdir()
    drawn = []
    for name, (draw, table_name, title) in FIGURES.items():
        table = tables[table_name]
        for number, (fixed, part) in enumerate(panels(r, table) if len(table) and r.study.along else ()):
            file = f"figures/{name}.svg" if not fixed else f"figures/{name}-{number + 1}.svg"
            save(draw(r, part), folder / file)
            at = ", ".join(f"{name} = {v}" for name, v in fixed.items())
            caption = f"{title} ({at})." if at else f"{title}."
            drawn.append(Figure(file, caption, caption))
    taken = _seconds(r)
    record = {
        "version": manifest.VERSION,
        "kind": "study",
        "title": r.study.title,
        "answer": answer(r),
        "complete": len(taken) == len(r.study.cells),
        "points": len(r.study.points),
        "cells": len(r.study.cells),
        "cells_sha256": cells_digest(r.study),
        "errors_sha256": _digest(r.errors),
        "sections_sha256": _digest(r.sections),
        "z": r.z,
        "study_sha256": r.study.digest,
        "numerical_version": numerical_version(),
        **provenance(),
        **facts,
    }
    write_views(_page(r, record, drawn, tables["cost"], taken), folder, "study")
    record = manifest.seal(record | {"files": {file: file_digest(folder / file) for file in FILES}})
    (folder / MANIFEST).write_text(json_text(record) + "\n", encoding="utf-8")
    return record


def _page(
    r: Results, record: dict[str, Any], figures: list[Figure], cost: pd.DataFrame, taken: dict[str, float]
) -> Page:
    """The page, from the results and the manifest."""
    method = (
        f"{record['points']} points, intervals of {record['z']:.2f} standard errors (95 % simultaneous coverage over "
        f"the study), tolerance {r.study.within.mean:.0%} of an sd for means and {r.study.within.sd:.0%} for sds. "
        f"{RULE} All rows: `errors.parquet`."
    )
    more = (
        "Estimate for more cores, from these times and 3.5 ms of a Dask scheduler for each task of at most 65 536 "
        "paths:"
    )
    words = glossary(*WORDS, gears=r.study.gears)
    opening: tuple[Block, ...] = (*figures[:1], _counts(r), Text(method, note=True), words)
    sections = [PageSection("Figures", tuple(figures[1:]))] if figures[1:] else []
    if lacks := lacking(r.study.points, record.get("failed", {})):
        rows: list[Row] = [[lack.what, lack.points, lack.where, lack.why] for lack in lacks]
        every = Text("All points: `reasons.csv`.", note=True)
        lost = Table.of(["what", *numbers("points"), "the first", "why"], rows)
        sections.append(PageSection("What could not be computed", (every, lost)))
    sections.append(PageSection("Cost", (_cost(cost), Text(more), _scaling(r, taken))))
    text = (Text("The study, `study.toml`:"), Code(r.study.text, "toml"))
    source = source_of(record, text, {"rows": "`rattle.load_study(FOLDER)` loads every one"})
    return Page(r.study.title, tuple(record["answer"]), source, opening, tuple(sections))


def _counts(r: Results) -> Table:
    groups = r.errors.groupby(["closure", "moment"], sort=False)["verdict"] if len(r.errors) else ()
    rows: list[Row] = [[str(key[0]), f"{key[1]}s", *(int((said == v).sum()) for v in VERDICTS)] for key, said in groups]
    return Table.of(["closure", "moments", *numbers(*VERDICTS)], rows)


def _cost(table: pd.DataFrame) -> Table:
    seconds = table.groupby("what", sort=False)["seconds"]
    rows: list[Row] = [
        [str(what), len(s), TableCell(f"{s.median():.3g}"), TableCell(f"{s.sum():.3g}")] for what, s in seconds
    ]
    return Table.of(["what", *numbers("cells", "median seconds", "all seconds")], rows)


def _scaling(r: Results, taken: dict[str, float]) -> Table:
    rows = (
        [str(row["cores"]), f"{row['wall_seconds']:.3g}", f"{row['efficiency']:.0%}", str(row["limit"])]
        for row in scaling(r.study.cells, taken).to_dict("records")
    )
    return Table.of([*numbers("cores", "seconds", "efficiency"), "limited by"], rows)


def _seconds(r: Results) -> dict[str, float]:
    """Measured seconds of each cell, by key."""
    found = {}
    for point, run, predictions in zip(r.study.points, r.samples, r.predictions, strict=True):
        if point.sample and run:
            found[point.sample.key] = run.facts["seconds"]
        by_closure = {c.closure: c.facts["seconds"] for c in predictions}
        found |= {p.key: by_closure[p.closure] for p in point.predictions if p.closure in by_closure}
    return found
