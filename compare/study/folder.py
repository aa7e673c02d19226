"""The folder of a finished study of any kind: tables, figures, a page and a manifest beside its
cells."""

import hashlib
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure as Drawn

from rattle.compare.engine.run import check_cells, has_cells
from rattle.compare.engine.store import Facts, numerical_version
from rattle.compare.judge.verdict import Verdict
from rattle.compare.report import manifest
from rattle.compare.report.folder import (
    FIGURES_FOLDER,
    MANIFEST,
    page_files,
    read_own_manifest,
    refuse_foreign,
    report_files,
    scratch_folder,
)
from rattle.compare.report.json_text import check_not_newer
from rattle.compare.report.provenance import provenance
from rattle.compare.report.report import Report
from rattle.compare.report.save import file_digest, write_files
from rattle.compare.report.texts import glossary, name_wheels
from rattle.compare.study.design import STUDY_KINDS, Coordinates, Point, Study, kind_of, page_of
from rattle.scene import FileError, OutputError, RattleError
from rattle.scene.files import read_text
from rattle.scene.numpy_errors import numpy_defaults

FILE = "study.toml"
"""Names in a study's folder: the folder of results, and the study file."""

BROKEN = "is damaged; run rattle study again: it rewrites the tables from the stored cells"
SCRATCH_PART = "page"
"""Part of the name of scratch folders, in which the output is written before it is moved to its
place."""


def check_folder(study: Study, folder: Path, overwrite: bool) -> None:
    """Check before any work that a folder holds nothing of others where the files of a study will
    be.

    `overwrite`: Whether it may hold the tables of another study, which has no result in common with
    this one.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise OutputError(f"out = {str(folder)!r}: exists and is not a folder; choose another name")
    check_cells(folder)
    kinds = [kind_of(name) for name in STUDY_KINDS]
    small = {f"{name}.csv" for kind in kinds for name in kind.SMALL}
    large = {f"{name}.parquet" for kind in kinds for name in kind.TABLES}
    files = {FILE, FIGURES_FOLDER, *report_files("study"), *small, *large}
    inside = {path for path in folder.iterdir() if path.name in files}
    record = read_own_manifest(folder)
    current = is_current_file(study, folder)
    if record["kind"] == "study" if record and "kind" in record else has_cells(folder):
        refuse_foreign(
            folder, {path.name for path in inside if path.is_dir() != (path.name == FIGURES_FOLDER)}
        )
    else:
        refuse_foreign(folder, {path.name for path in inside} - ({FILE} if current else set()))
    if record and not overwrite and not current and not shares_results(study, folder / FILE):
        why = (
            f"holds another study ({record['title']}); choose another folder, or overwrite it"
            " (--overwrite)"
        )
        raise OutputError(f"out = {str(folder)!r}: {why}")


def is_current_file(study: Study, folder: Path) -> bool:
    """Whether the study file in a folder is that of a study."""
    return file_digest(folder / FILE) == study.digest


def shares_results(study: Study, file: Path) -> bool:
    """Whether the study of a file has a result in common with a study, as after an edit."""
    try:
        earlier = Study.from_toml(read_text("study file", file))
        return not {cell.key for cell in earlier.cells}.isdisjoint(cell.key for cell in study.cells)
    except RattleError:  # of another version
        return False


@numpy_defaults
def load_study(folder: str | Path) -> Any:
    """Load the tables of a study from a folder that ``rattle study`` has written.

    Parameters
    ----------
    folder : str or Path
        The folder.

    Returns
    -------
    Tables
        Of a study of the long run, an object with ``study, record, quantities, verdicts, cost,
        reasons``, `plot` and `to_xarray`.

    Raises
    ------
    FileError
        If the folder holds no finished study, or a file in it is damaged or cannot be read.

    Examples
    --------
    >>> load_study("nowhere")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    rattle.scene.errors.FileError: study folder = 'nowhere': holds no finished study; ...
    """
    if not isinstance(folder, str | Path):
        raise FileError(
            "study folder", folder, "is no path; give the folder that rattle study wrote"
        )
    place = Path(folder)
    record = _read_record(place)
    study = Study.load(place / FILE)
    if record.get("study_sha256") != study.digest:
        why = "is not the study of these tables; run rattle study with it again"
        raise FileError("study file", str(place / FILE), why)
    kind = kind_of(study.kind)
    _check_files(place, record, [f"{name}.parquet" for name in kind.TABLES])
    return kind.RESULT(
        study, record, **{name: _read_table(place / f"{name}.parquet") for name in kind.TABLES}
    )


def _read_table(path: Path) -> pd.DataFrame:
    """Read a table, with the verdicts of one that is older in the words of today."""
    return pd.read_parquet(path).replace({"verdict": {"not judged": str(Verdict.EXCLUDED)}})


def _read_record(folder: Path) -> Facts:
    """Read the manifest of a finished study."""
    record = read_own_manifest(folder)
    if record is None:
        raise FileError(
            "study folder", str(folder), "holds no finished study; give the folder of one"
        )
    check_not_newer("manifest", record.get("version"), manifest.VERSION, folder / MANIFEST)
    if not manifest.is_whole(record):
        raise FileError("study folder", str(folder), f"{MANIFEST} {BROKEN}")
    return record


def _check_files(folder: Path, record: Facts, files: Iterable[str]) -> None:
    """Refuse a folder in which a file is missing or has changed since it was written."""
    written = record.get("files")
    for file in files:
        if not isinstance(written, dict) or written.get(file) != file_digest(folder / file):
            raise FileError("study folder", str(folder), f"{file} {BROKEN}")


def files_of(study: Study) -> tuple[str, ...]:
    """Files whose digests the manifest of a finished study holds."""
    return (*(f"{name}.parquet" for name in kind_of(study.kind).TABLES), *page_files("study"))


def is_current(study: Study, folder: Path) -> Facts | None:
    """Read the manifest of a folder, if it belongs to this study and covers all of its cells.

    Returns: The manifest; None if the folder is missing, damaged, incomplete, or of another study
    or version.
    """
    with suppress(FileError):  # what cannot be read is written again, from the cells
        record = _read_record(folder)
        if record.get("cells_sha256") == cells_digest(study) and record.get("complete"):
            _check_files(folder, record, files_of(study))
            return record
    return None


def cells_digest(study: Study) -> str:
    """Compute a digest of the study's file and of the keys of its cells."""
    keys = ",".join(sorted(cell.key for cell in study.cells))
    return hashlib.sha256(f"{study.digest} {keys}".encode()).hexdigest()


NUMBER_PATTERN = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
REASON_NAMES = {"scene": "the scene", "sample": "the simulation"}
"""Names for readers of those keys of `Point.reasons` that are not closures."""


class FailedPoints(NamedTuple):
    """Something that cannot be computed at some points; their error messages differ at most in
    numbers."""

    what: str  # the scene, the simulation, or a closure
    why: str  # error message at the first of the points: field, value and remedy
    points: int  # points, of: number of points concerned, and number of all points
    of: int
    where: str  # coordinates of the first point concerned

    def __str__(self) -> str:
        """Describe the failure in one sentence."""
        return (
            f"{self.what} cannot be computed at {self.points} of {self.of} points, first at"
            f" {self.where}: {self.why}"
        )


def group_failures(points: Sequence[Point], failed: Mapping[str, str]) -> list[FailedPoints]:
    """Group the error messages of a study's points by their reason."""
    groups: dict[tuple[str, str], list[tuple[Coordinates, str]]] = {}
    for point in points:
        lost = {
            getattr(cell, "closure", "sample"): failed[cell.key]
            for cell in point.cells
            if cell.key in failed
        }
        for what, why in (point.reasons | lost).items():
            alike = groups.setdefault((what, NUMBER_PATTERN.sub("", why)), [])
            alike.append((point.coordinates, why))
    failures = []
    for (what, _), alike in groups.items():
        first, why = alike[0]
        what = REASON_NAMES.get(what, what)
        where = ", ".join(f"{name} = {value}" for name, value in first.items())
        of = len(points)
        failures.append(FailedPoints(what, why, len(alike), of, where or "the only point"))
    return failures


class Drawing(NamedTuple):
    """A figure of a study's page."""

    name: str  # of its file, without suffix
    figure: Drawn
    caption: str


def write_page(folder: Path, tables: Any, seconds: Mapping[str, float], facts: Facts) -> Facts:
    """Write tables, figures, the page and the manifest; each file is replaced atomically.

    `tables`: As `combine` gives them.  `seconds`: What each cell that is stored took, by key.
    Returns the manifest.
    """
    try:
        with scratch_folder(folder, SCRATCH_PART) as scratch:
            record = _write(scratch, tables, seconds, facts)
            files = [path.relative_to(scratch) for path in scratch.rglob("*") if path.is_file()]
            # holds the digests of the others: removed first, written last
            (folder / MANIFEST).unlink(missing_ok=True)
            for file in sorted(files, key=lambda f: f.name == MANIFEST):
                (folder / file).parent.mkdir(exist_ok=True)
                os.replace(scratch / file, folder / file)
    except OutputError:
        raise
    except OSError as error:
        why = (
            f"the page cannot be written ({error.strerror}); all results stored: make room and"
            " repeat the command"
        )
        raise OutputError(f"out = {str(folder)!r}: {why}") from None
    return record


def _write(folder: Path, tables: Any, seconds: Mapping[str, float], facts: Facts) -> Facts:
    """Write all files of a study into a scratch folder."""
    study: Study = tables.study
    kind = kind_of(study.kind)
    page = page_of(study)
    # another process may have replaced the file meanwhile
    (folder / FILE).write_text(study.text, encoding="utf-8")
    drawn: list[Drawing] = page.draw(tables)
    answer = [*page.answer(tables), *name_wheels(study.scene)]
    record = {
        "version": manifest.VERSION,
        "kind": "study",
        "tables": kind.TABLES,
        "title": study.title,
        "answer": answer,
        "complete": len(seconds) == len(study.cells),
        "points": len(study.points),
        "cells": len(study.cells),
        "cells_sha256": cells_digest(study),
        **tables.record,
        "study_sha256": study.digest,
        "numerical_version": numerical_version(),
        **provenance(),
        **facts,
    }
    failures = group_failures(study.points, record.get("failed", {}))
    rows = pd.DataFrame(failures, columns=FailedPoints._fields)
    content = {"study": study, "drawn": drawn, "failures": rows}
    report = Report(
        "study",
        study.title,
        answer,
        record,
        content | page.content(tables, seconds),
        glossary(f"study of {study.kind}", gears=study.shown_gears),
        figures={drawing.name: drawing.figure for drawing in drawn},
        tables={name: getattr(tables, name) for name in kind.SMALL},
        large={name: getattr(tables, name) for name in kind.TABLES},
        digits="%.9g",
        template=page.TEMPLATE,
        spoken=study.scene.words,
        more={"rows": "`rattle.load_study(FOLDER)` loads every one"},
    )
    return write_files(folder, report, digests=files_of(study))
