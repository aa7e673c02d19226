"""Reading of text, TOML and JSON files, with errors that name the file."""

import json
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rattle.scene.errors import FileError, InputError

TABLE = re.compile(r"\s*\[+\s*([^\[\]]+?)\s*\]")
KEY = re.compile(r"""\s*["']?([\w-]+)["']?\s*=""")
PLACE = re.compile(r"\(at line (\d+),")
COMMA = re.compile(r"=\s*([-+]?\d+),(\d+)")


def read_text(what: str, path: str | Path, give: str = "a TOML file") -> str:
    """Read a UTF-8 text file, with a byte-order mark or without."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise FileError(what, str(path), f"is not UTF-8 text; give {give} saved as UTF-8") from None
    except OSError as error:
        raise FileError(what, str(path), f"cannot be read ({error.strerror}); give {give}") from None
    except (TypeError, ValueError):  # not a path, or one with a null character in it
        raise FileError(what, path, f"is no path; give that of {give}") from None


def read_json(what: str, path: str | Path, give: str) -> Any:
    """Read the data of a JSON file that rattle wrote; ValueError where it is no JSON."""
    return json.loads(read_text(what, path, give))


def read_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text."""
    if not isinstance(text, str):
        raise FileError("TOML", text, "give text")
    try:
        return tomllib.loads(text)
    except ValueError as error:  # includes TOMLDecodeError; an integer of too many digits raises a plain ValueError
        raise FileError("TOML", str(error), _remedy(text, str(error))) from None


def _remedy(text: str, error: str) -> str:
    """What to do about a text that is not TOML: two common slips are named."""
    place = PLACE.search(error)
    row = text.split("\n")[int(place[1]) - 1] if place else ""
    if comma := COMMA.search(row):
        return f"use a decimal point: {comma[1]}.{comma[2]}"
    if row and "=" not in row and re.search("[,;\t]", row):
        return "this looks like a table (CSV): write each value on a line as name = value, with a decimal point"
    return "correct the file at that place"


@contextmanager
def in_file(path: str | Path, text: str) -> Iterator[None]:
    """Errors about the content of a TOML file name the file, and the line of the key where that can be found."""
    try:
        yield
    except InputError as error:
        number = None if error.where or isinstance(error, FileError) else _line_of(text, error)
        where = error.where or str(path) + (f", line {number}" if number else "")
        raise type(error)(error.field, error.value, error.remedy, where) from None


def _line_of(text: str, error: InputError) -> int | None:
    """The first line whose key is the field of an error, or, of a table with an unknown key, that key."""
    *tables, key = error.field.split(".")
    wanted = [(".".join(tables), key)]
    if isinstance(error.value, str):
        wanted.append((error.field, error.value))
    table = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if found := TABLE.match(line):
            table = found[1]
        found = KEY.match(line)
        if found and any(found[1] == name and (not of or f".{table}".endswith(f".{of}")) for of, name in wanted):
            return number
    return None
