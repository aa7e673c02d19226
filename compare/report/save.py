"""Writes a report folder, whole or not at all: figures, tables as CSV or Parquet, page and
manifest."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.report import style
from rattle.compare.report.folder import MANIFEST, report_files, whole_folder
from rattle.compare.report.json_text import Facts, json_text
from rattle.compare.report.manifest import seal
from rattle.compare.report.render import write_page
from rattle.compare.report.report import Report
from rattle.scene import harmless
from rattle.scene.files import read_regular


def csv_text(table: pd.DataFrame, **options: Any) -> str:
    r"""A table as CSV."""
    texts = table.select_dtypes(exclude=["number", "bool"])
    plain = texts.map(lambda value: harmless(value, keep="") if isinstance(value, str) else value)
    return str(table.assign(**{str(name): plain[name] for name in plain}).to_csv(**options))


def file_digest(path: Path) -> str | None:
    """Compute the digest of a file; None if there is none, or none that this project writes."""
    try:
        return hashlib.sha256(read_regular(path)).hexdigest()
    except OSError:
        return None


def save(out: Path, report: Report, overwrite: bool) -> None:
    """Write the folder of a report; whatever ends it on the way, it is the earlier one or the new
    one."""
    with whole_folder(out, report_files(report.name), overwrite) as folder:
        write_files(folder, report)


def write_files(folder: Path, report: Report, digests: Sequence[str] = ()) -> Facts:
    """Write figures, tables, page and manifest into a folder.

    `digests`: Files whose digests the manifest holds, as ``files``. Returns the manifest.
    """
    for label, figure in report.figures.items():
        (folder / label).parent.mkdir(exist_ok=True)
        drawn = figure if isinstance(figure, bytes) else style.render(figure, report.words_of_scene)
        (folder / f"{label}.svg").write_bytes(drawn)
    for label, table in report.large.items():
        table.to_parquet(folder / f"{label}.parquet", index=False, compression="zstd")
    for label, table in report.tables.items():
        text = csv_text(table, index=False, float_format=report.digits)
        (folder / f"{label}.csv").write_text(text, encoding="utf-8")
    write_page(report, folder)
    files = {"files": {file: file_digest(folder / file) for file in digests}} if digests else {}
    sealed = seal({**report.record, "answer": report.answer, **files})
    (folder / MANIFEST).write_text(json_text(sealed) + "\n", encoding="utf-8")
    return sealed
