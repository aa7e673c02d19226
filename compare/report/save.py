"""Writes a report folder, whole or not at all: figures, tables as CSV or Parquet, page and
manifest."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.report import Page, style
from rattle.compare.report.folder import MANIFEST, whole_folder
from rattle.compare.report.json_text import json_text
from rattle.compare.report.manifest import seal
from rattle.compare.report.provenance import source_of
from rattle.compare.report.render import pages, write_page
from rattle.compare.report.texts import lay_out
from rattle.scene import harmless
from rattle.scene.files import read_regular
from rattle.scene.measured_drive import CHANCE, SMALL_ORDER, MeasuredDrive


def csv_text(table: pd.DataFrame, **options: Any) -> str:
    r"""A table as CSV."""
    texts = table.select_dtypes(exclude=["number", "bool"])
    plain = texts.map(lambda value: harmless(value, keep="") if isinstance(value, str) else value)
    return str(table.assign(**{str(name): plain[name] for name in plain}).to_csv(**options))


def contents(
    name: str, *, figures: Sequence[str] = (), tables: Sequence[str] = (), large: Sequence[str] = ()
) -> frozenset[str]:
    """Every file that a report folder may hold; a folder with any other file is not overwritten."""
    csv = (f"{t}.csv" for t in tables)
    parquet = (f"{t}.parquet" for t in large)
    svg = (f"{f}.svg" for f in figures)
    return frozenset({MANIFEST, *pages(name), *csv, *parquet, *svg})


def file_digest(path: Path) -> str | None:
    """Compute the digest of a file; None if there is none, or none that this project writes."""
    try:
        return hashlib.sha256(read_regular(path)).hexdigest()
    except OSError:
        return None


def save(out: Path, *content: Any, allowed: frozenset[str], overwrite: bool, **parts: Any) -> None:
    """Write a report folder by `write_files`; whatever ends it on the way, it is the earlier one or
    the new one."""
    with whole_folder(out, allowed, overwrite) as folder:
        write_files(folder, *content, allowed=allowed, **parts)


def save_report(
    out: Path,
    name: str,
    title: str,
    said: Sequence[str],
    record: Mapping[str, Any],
    parts: Mapping[str, Any],
    *,
    package: str = "",
    layout: str = "page.md",
    values: Mapping[str, Any] = MappingProxyType({}),
    more: Mapping[str, str] | None = None,
    **files: Any,
) -> list[str]:
    """Write the folder of a page that a Markdown file lays out; returns what the page says.

    `package`, `layout`: Folder of `rattle.compare` and name of that file; the folder is that of the
    name if not given. `parts`, `values`: See `rattle.compare.report.texts.lay_out`. `more`: Further
    facts of its source. `files`: `save`.
    """
    laid_out = lay_out(package or name, parts, files["figures"], layout, **values)
    save(
        out,
        name,
        Page(title, tuple(said), source_of(record, more=more), *laid_out),
        record,
        **files,
    )
    return list(said)


def write_files(
    folder: Path,
    name: str,
    page: Page,
    record: Mapping[str, Any],
    *,
    allowed: frozenset[str],
    figures: Mapping[str, Figure | bytes],
    tables: Mapping[str, pd.DataFrame],
    digits: str | None = None,
    digests: Sequence[str] = (),
) -> dict[str, Any]:
    """Write figures, tables, page and manifest into a folder; a table as CSV, Parquet or both, as
    `allowed` says.

    `figures`: SVG where they are drawn already. `digests`: Files whose digests the manifest holds,
    as ``files``. Returns the manifest.
    """
    for label, figure in figures.items():
        (folder / label).parent.mkdir(exist_ok=True)
        drawn = figure if isinstance(figure, bytes) else style.render(figure)
        (folder / f"{label}.svg").write_bytes(drawn)
    for label, table in tables.items():
        if f"{label}.parquet" in allowed:
            table.to_parquet(folder / f"{label}.parquet", index=False, compression="zstd")
        if f"{label}.csv" in allowed:
            text = csv_text(table, index=False, float_format=digits)
            (folder / f"{label}.csv").write_text(text, encoding="utf-8")
    write_page(page, folder, name)
    files = {"files": {file: file_digest(folder / file) for file in digests}} if digests else {}
    sealed = seal({**record, "answer": list(page.answer), **files})
    (folder / MANIFEST).write_text(json_text(sealed) + "\n", encoding="utf-8")
    return sealed


CONTENTS = contents("drive", figures=("drive",), tables=("orders",))
"""Names of all files in such a folder; a folder with any other file is not overwritten."""


def write_drive(out: Path, found: MeasuredDrive, record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a measured drive."""
    orders = pd.DataFrame(found.table)
    shown = {"orders": orders.assign(said=np.where(orders["kept"], "kept", "left out"))}
    names = (
        "amplitude",
        "omega",
        "periods",
        "sigma_ratio",
        "low",
        "high",
        "floor",
        "memory",
        "left_out",
    )
    title = f"The measured drive of {record['name']}"
    record = record | {name: getattr(found, name) for name in names}
    page: dict[str, Any] = {
        "package": "report",
        "layout": "drive.md",
        "values": {"small": SMALL_ORDER, "chance": CHANCE},
    }
    files: dict[str, Any] = {
        "figures": {"drive": found.plot()},
        "tables": {"orders": orders},
        "digits": "%.6g",
    }
    files |= {"allowed": CONTENTS, "overwrite": overwrite}
    save_report(out, "drive", title, found.answer, record, shown, **page, **files)
