"""Whether the files in a study's folder are complete and belong to the study as it is now."""

import hashlib
import json
from pathlib import Path
from typing import Any

from rattle.compare.report import pages
from rattle.compare.report.manifest import is_whole
from rattle.compare.study.design import Study
from rattle.compare.study.tables import MANIFEST, TABLES, find_damaged

FILES = (*(f"{name}.parquet" for name in TABLES), *pages("study"))
"""Files whose digests the manifest of a finished study of impacts holds."""


def files_of(study: Study) -> tuple[str, ...]:
    """Files whose digests the manifest of a finished study holds."""
    return (*(f"{name}.parquet" for name in study.tables), *pages("study"))


def is_current(study: Study, folder: Path) -> dict[str, Any] | None:
    """Read the manifest of a folder, if it belongs to this study and covers all of its cells.

    Returns: The manifest; None if the folder is missing, damaged, incomplete, or of another study or version.
    """
    try:
        record: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(record, dict) or not is_whole(record):
        return None
    if record.get("cells_sha256") != cells_digest(study) or not record.get("complete"):
        return None
    try:
        return record if not find_damaged(folder, record, files_of(study)) else None
    except OSError:  # a file that cannot be read is written again, from the cells
        return None


def cells_digest(study: Study) -> str:
    """Compute a digest of the study's file and of the keys of its cells."""
    keys = ",".join(sorted(cell.key for cell in study.cells))
    return hashlib.sha256(f"{study.digest} {keys}".encode()).hexdigest()
