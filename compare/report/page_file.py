"""The file ``page.json``: a page as data, read back with validation of its structure and digest."""

import dataclasses
import types
import typing
from pathlib import Path
from typing import Any

from rattle.compare.report.content import Block, Code, Figure, Glossary, Page, Table, Text
from rattle.compare.report.json_text import json_digest, json_text
from rattle.scene.errors import FileError, InputError
from rattle.scene.files import read_json

NAME = "page.json"
FORMAT, VERSION = "rattle page", 2
BLOCKS = {"text": Text, "table": Table, "figure": Figure, "code": Code, "glossary": Glossary}
"""Types of blocks by their name in the file."""


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
        version = data.get("version")
        if type(version) is not int or version < 1:
            raise _refusal("version", "is no version")
        if version > VERSION:
            why = f"comes from a newer version of rattle (page {version}; this one reads {VERSION}); update rattle"
            raise FileError("page", str(path), why)
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
    kinds = {kind: name for name, kind in BLOCKS.items()}
    named = {"kind": kinds[type(value)]} if type(value) in kinds else {}
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
    found = {name: _read(hints[name], item, f"{where}.{name}") for name, item in data.items()}
    try:
        return kind(**found)
    except InputError as error:
        raise _refusal(where, str(error)) from None
