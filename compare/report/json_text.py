"""JSON files: strict, without terminal control characters; and ``page.json``, which is read back
with validation."""

import dataclasses
import hashlib
import json
import math
import os
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rattle.compare.report import BLOCKS, Block, Page
from rattle.scene import FileError, harmless
from rattle.scene.files import read_json


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


NAME = "page.json"
FORMAT = "rattle page"
VERSION = 2
KINDS = {kind: name for name, kind in BLOCKS.items()}


def page_text(page: Page) -> str:
    """A page as JSON, without fields that have their default."""
    plain = _plain(page)
    data = {"format": FORMAT, "version": VERSION, "sha256": json_digest(plain), "page": plain}
    return json_text(data, indent=None) + "\n"


def check_not_newer(what: str, version: Any, newest: int, path: Path) -> None:
    """Check that a file was not written by a newer version of this program."""
    if type(version) is int and version > newest:
        why = (
            f"comes from a newer version of rattle ({what} {version}; this one reads {newest});"
            " update rattle"
        )
        raise FileError(what, str(path), why)


def read_page(path: Path) -> Page:
    """Read a page from its file."""
    try:
        data = read_json("page", path, "a page.json")
        if data["format"] != FORMAT:
            raise ValueError(f"its format is not {FORMAT!r}")
        check_not_newer("page", data["version"], VERSION, path)
        if data["sha256"] != json_digest(data["page"]):
            raise ValueError("it was changed after it was written")
        page: Page = _read(Page, data["page"])
    except FileError:
        raise
    except (ValueError, LookupError, TypeError) as error:
        raise FileError("page", str(path), f"is no page of a report ({error})") from None
    return page


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if not dataclasses.is_dataclass(value):
        return value
    named = {"kind": KINDS[type(value)]} if type(value) in KINDS else {}
    fields = ((f.name, f.default, getattr(value, f.name)) for f in dataclasses.fields(value))
    return named | {name: _plain(found) for name, default, found in fields if found != default}


def _read(kind: Any, data: Any) -> Any:
    """Plain data as a tuple, a block, or another dataclass of these; others as they are."""
    if typing.get_origin(kind) is tuple:
        return tuple(_read(typing.get_args(kind)[0], item) for item in data)
    if kind is Block:
        kind = BLOCKS[data["kind"]]
        data = {name: value for name, value in data.items() if name != "kind"}
    if not hasattr(kind, "__dataclass_fields__"):
        return data
    hints = typing.get_type_hints(kind)
    return kind(**{name: _read(hints[name], value) for name, value in data.items()})
