"""JSON files: strict, without terminal control characters; and ``page.json``, which is read back with validation."""

import dataclasses
import hashlib
import json
import math
import os
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rattle.compare.report import BLOCKS, Block, Page
from rattle.scene.errors import FileError, InputError
from rattle.scene.files import read_json
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


NAME = "page.json"
FORMAT, VERSION = "rattle page", 2
KINDS = {kind: name for name, kind in BLOCKS.items()}


def page_text(page: Page) -> str:
    """A page as JSON, without fields that have their default.

    Examples
    --------
    >>> from rattle.compare.report import Page, Source
    >>> import json
    >>> json.loads(page_text(Page("t", ("a",), Source("again"))))["page"]
    {'title': 't', 'answer': ['a'], 'source': {'repeat': 'again'}}
    """
    plain = _plain(page)
    data = {"format": FORMAT, "version": VERSION, "sha256": json_digest(plain), "page": plain}
    return json_text(data, indent=None) + "\n"


def check_not_newer(what: str, version: Any, newest: int, path: Path) -> None:
    """Check that a file was not written by a newer version of this program."""
    if type(version) is int and version > newest:
        why = f"comes from a newer version of rattle ({what} {version}; this one reads {newest}); update rattle"
        raise FileError(what, str(path), why)


def read_page(path: Path) -> Page:
    """Read a page from its file.

    Examples
    --------
    >>> read_page(Path("no.json"))
    Traceback (most recent call last):
    ...
    rattle.scene.errors.FileError: page = 'no.json': cannot be read (No such file or directory); give a page.json
    """
    try:
        data = read_json("page", path, "a page.json")
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise _refusal("format", f"is not {FORMAT!r}")
        if type(data.get("version")) is not int or data["version"] < 1:
            raise _refusal("version", "is no version")
        check_not_newer("page", data["version"], VERSION, path)
        page: Page = _read(Page, data.get("page"), "page")
        if "sha256" in data and data["sha256"] != json_digest(data["page"]):  # an earlier version wrote none
            raise _refusal("sha256", "the page was changed after it was written")
    except FileError:
        raise
    except (ValueError, OverflowError, RecursionError) as error:
        raise FileError("page", str(path), f"is no page of a report ({error})") from None
    return page


def _refusal(where: str, why: str) -> ValueError:
    """The data are not a page: the place in them, and why."""
    return ValueError(f"{where}: {why}")


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if not dataclasses.is_dataclass(value):
        return value
    named = {"kind": KINDS[type(value)]} if type(value) in KINDS else {}
    fields = ((f.name, f.default, getattr(value, f.name)) for f in dataclasses.fields(value))
    return named | {name: _plain(found) for name, default, found in fields if found != default}


def _read(kind: Any, data: Any, where: str) -> Any:
    """Convert plain data to a type: a string, a number, a tuple, a block, or a dataclass of these."""
    if kind is Block:
        name = data.get("kind") if isinstance(data, dict) else None
        if not isinstance(name, str) or name not in BLOCKS:
            raise _refusal(where, f"is none of {', '.join(BLOCKS)}")
        return _make(BLOCKS[name], {k: v for k, v in data.items() if k != "kind"}, where)
    if typing.get_origin(kind) is tuple:
        return _tuple(typing.get_args(kind), data, where)
    if isinstance(kind, types.UnionType):  # float | None
        if type(data) not in (int, float, types.NoneType):
            raise _refusal(where, "is no number")
        return None if data is None else float(data)
    if dataclasses.is_dataclass(kind):
        return _make(kind, data, where)
    if type(data) is not kind:
        raise _refusal(where, f"is not of type {kind.__name__}")
    return data


def _tuple(kinds: tuple[Any, ...], data: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(data, list):
        raise _refusal(where, "is no list")
    if kinds[-1] is ...:
        kinds = (kinds[0],) * len(data)
    if len(data) != len(kinds):
        raise _refusal(where, f"has {len(data)} entries in place of {len(kinds)}")
    return tuple(_read(kind, item, f"{where}[{i}]") for i, (kind, item) in enumerate(zip(kinds, data, strict=True)))


def _make(kind: Any, data: Any, where: str) -> Any:
    """Make a dataclass from a mapping of its fields."""
    if not isinstance(data, dict):
        raise _refusal(where, "is no object")
    fields = {field.name: field for field in dataclasses.fields(kind)}
    for name in data:
        if name not in fields:
            raise _refusal(f"{where}.{name}", "is unknown")
    for name, field in fields.items():
        if name not in data and field.default is dataclasses.MISSING:
            raise _refusal(f"{where}.{name}", "is missing")
    hints = typing.get_type_hints(kind)
    try:
        return kind(**{name: _read(hints[name], item, f"{where}.{name}") for name, item in data.items()})
    except InputError as error:
        raise _refusal(where, str(error)) from None
