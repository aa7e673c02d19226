"""JSON files: strict, without terminal control characters."""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rattle.scene import FileError, harmless
from rattle.scene.types import Facts as Facts


def plain(data: Any) -> Any:
    """Convert data to the types of JSON; NaN and infinities become None, paths text."""
    if isinstance(data, float):
        return float(data) if math.isfinite(data) else None
    if isinstance(data, Mapping):
        return {str(key): plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [plain(item) for item in data]
    if isinstance(data, os.PathLike):
        return os.fspath(data)
    if hasattr(data, "tolist"):  # an array, or a scalar of numpy
        return plain(data.tolist())
    return data


def json_text(data: Any, indent: int | None = 2) -> str:
    r"""Data as strict JSON (RFC 8259); terminal control characters are escaped, other non-ASCII
    characters are not."""
    text = json.dumps(plain(data), indent=indent, ensure_ascii=False, allow_nan=False)
    if harmless(text) == text:
        return text
    return "".join(c if harmless(c) == c else json.dumps(c)[1:-1] for c in text)


def json_digest(data: Any) -> str:
    """SHA-256 digest of data, independent of the order of keys."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def check_not_newer(what: str, version: Any, newest: int, path: Path) -> None:
    """Check that a file was not written by a newer version of this program."""
    if type(version) is int and version > newest:
        why = (
            f"comes from a newer version of rattle ({what} {version}; this one reads {newest});"
            " update rattle"
        )
        raise FileError(what, str(path), why)
