"""JSON output: strict, so that any parser reads it, and without terminal control characters."""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from typing import Any

from rattle.scene.text import harmless


def plain(data: Any) -> Any:
    """Convert data to the types of JSON.

    Returns: Dicts, lists, Python numbers, text and None; NaN and infinities become None, paths text.

    Examples
    --------
    >>> import numpy as np
    >>> plain({"tau": np.float64("nan"), "mesh": np.arange(2), "made": (True, np.bool_(False))})
    {'tau': None, 'mesh': [0, 1], 'made': [True, False]}
    """
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
    r"""Data as strict JSON (RFC 8259); terminal control characters are escaped, other non-ASCII characters are not.

    Examples
    --------
    >>> print(json_text({"σ": float("inf"), "name": "\u202etxt\x9b1m"}, indent=None))
    {"σ": null, "name": "\u202etxt\u009b1m"}
    """
    text = json.dumps(plain(data), indent=indent, ensure_ascii=False, allow_nan=False)
    if harmless(text) == text:
        return text
    return "".join(c if harmless(c) == c else json.dumps(c)[1:-1] for c in text)


def json_digest(data: Any) -> str:
    """SHA-256 digest of data, independent of the order of keys.

    Examples
    --------
    >>> json_digest({"a": 1, "b": 2}) == json_digest({"b": 2, "a": 1})
    True
    """
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()
