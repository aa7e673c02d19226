"""Whether what lies in a study's folder is of the study as it is now."""

import hashlib
import json
from pathlib import Path
from typing import Any

from rattle.compare.report import pages
from rattle.compare.report.manifest import is_whole
from rattle.compare.study.design import Study
from rattle.compare.study.tables import MANIFEST, TABLES, damaged

__all__ = ["FILES", "cells_digest", "is_current"]

FILES = (*(f"{name}.parquet" for name in TABLES), *pages("study"))
"""What a finished study's manifest vouches for."""


def is_current(study: Study, folder: Path) -> dict[str, Any] | None:
    """The record of what is in a folder, if it is of this study and all of its cells; else None."""
    try:
        record: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(record, dict) or not is_whole(record):
        return None
    if record.get("cells_sha256") != cells_digest(study) or not record.get("complete"):
        return None
    try:
        return record if not damaged(folder, record, FILES) else None
    except OSError:  # what cannot be read is written again, from the cells
        return None


def cells_digest(study: Study) -> str:
    """Digest of the study's file and of the keys of its cells."""
    keys = ",".join(sorted(cell.key for cell in study.cells))
    return hashlib.sha256(f"{study.digest} {keys}".encode()).hexdigest()
