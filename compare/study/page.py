"""Writes the output of a study next to its cells: tables, figures, a page, and a manifest with their provenance."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure as Drawn

from rattle.compare.report import Code, Figure, Page, PageSection, Row, Table, Text, manifest, numbers
from rattle.compare.report.folder import scratch_folder, within
from rattle.compare.report.provenance import provenance, source_of
from rattle.compare.report.save import MANIFEST, contents, write_files
from rattle.compare.study.design import Study, kind_of, page_of
from rattle.compare.study.failures import group_failures
from rattle.compare.study.tables import FILE, PAGE, cells_digest, files_of
from rattle.compare.study.version import numerical_version
from rattle.scene.errors import OutputError


class Drawing(NamedTuple):
    """A figure of a study's page."""

    name: str  # of its file, without suffix
    figure: Drawn
    caption: str


def write_page(folder: Path, tables: Any, seconds: Mapping[str, float], facts: dict[str, Any]) -> dict[str, Any]:
    """Write tables, figures, the page and the manifest; each file is replaced atomically.

    `tables`: As `combine` gives them.  `seconds`: What each cell that is stored took, by key.  Returns the manifest.
    """
    try:
        with scratch_folder(folder, PAGE) as scratch:
            record = _write(scratch, tables, seconds, facts)
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


def _write(folder: Path, tables: Any, seconds: Mapping[str, float], facts: dict[str, Any]) -> dict[str, Any]:
    study: Study = tables.study
    kind, shown = kind_of(study.kind), page_of(study)
    (folder / FILE).write_text(study.text, encoding="utf-8")  # another process may have replaced the file meanwhile
    drawn: list[Drawing] = shown.draw(tables)
    figures = [Figure(f"{name}.svg", caption, caption) for name, _, caption in drawn]
    record = {
        "version": manifest.VERSION,
        "kind": "study",
        "tables": list(kind.tables),
        "title": study.title,
        "answer": shown.answer(tables),
        "complete": len(seconds) == len(study.cells),
        "points": len(study.points),
        "cells": len(study.cells),
        "cells_sha256": cells_digest(study),
        **shown.facts(tables),
        "study_sha256": study.digest,
        "numerical_version": numerical_version(),
        **provenance(),
        **facts,
    }
    opening, closing = shown.blocks(tables, record, seconds)
    sections = [PageSection("Figures", tuple(figures[1:]))] if figures[1:] else []
    if failures := group_failures(study.points, record.get("failed", {})):
        rows: list[Row] = [[failure.what, failure.points, failure.where, failure.why] for failure in failures]
        every = Text("All points: `reasons.csv`.", note=True)
        lost = Table.of(["what", *numbers("points"), "the first", "why"], rows)
        sections.append(PageSection("What could not be computed", (every, lost)))
    text = (Text("The study, `study.toml`:"), Code(study.text, "toml"))
    source = source_of(record, text, {"rows": "`rattle.load_study(FOLDER)` loads every one"})
    page = Page(study.title, tuple(record["answer"]), source, (*figures[:1], *opening), (*sections, *closing))
    return write_files(
        folder,
        "study",
        page,
        record,
        allowed=contents("study", tables=kind.small, large=kind.tables),
        figures={name: figure for name, figure, _ in drawn},
        tables={name: getattr(tables, name) for name in kind.tables},
        digits="%.9g",
        digests=files_of(study),
    )
