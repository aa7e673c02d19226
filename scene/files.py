"""Reading of text, TOML and JSON files of bounded size and depth, with errors that name the
file."""

import errno
import io
import json
import os
import re
import select
import stat
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rattle.scene.errors import FileError, InputError
from rattle.scene.types import Facts

TABLE = re.compile(r"\s*\[+([^\[\]]+)\]")
KEY_PATTERN = re.compile(r"""\s*["']?([\w.-]+)["']?\s*=""")
OF_PART = re.compile(r"(wheel|body)\.")
PLACE = re.compile(r"\(at line (\d+),")
COMMA = re.compile(r"=\s*([-+]?\d+),(\d+)")
MOST_BYTES = 2**28
"""Most bytes of a file that is read as a whole; the largest in reports/ has less than 2**20."""
MOST_TOML = 1_000_000
"""Most characters of a TOML text: fifty thousand numbers, which are parsed in about a second."""
MOST_DEPTH = 32
"""Most levels of nested tables and lists, and most parts of a dotted key; a page has 12."""
LONG_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{MOST_DEPTH}}}"""
)
MOST_BITS = 1000
"""Most bits of an integer: any seed has fewer, and a floating-point number holds it."""
PIPE_PATIENCE = 5.0  # seconds in which somebody has to open a pipe for writing


def read_text(what: str, path: str | Path, give: str = "a TOML file") -> str:
    """Read a UTF-8 text file, with a byte-order mark or without; it may be a pipe."""
    try:
        content = _read(Path(path))
        if len(content) > MOST_BYTES:
            raise FileError(what, str(path), f"has more than {MOST_BYTES:,} bytes; give {give}")
        return io.StringIO(content.decode("utf-8-sig"), newline=None).read()
    except FileError:
        raise
    except UnicodeDecodeError:
        raise FileError(what, str(path), f"is not UTF-8 text; give {give} saved as UTF-8") from None
    except OSError as error:
        raise FileError(
            what, str(path), f"cannot be read ({error.strerror}); give {give}"
        ) from None
    except (TypeError, ValueError):  # not a path, or one with a null character in it
        raise FileError(what, path, f"is no path; give that of {give}") from None


def _read(path: Path) -> bytes:
    """Read at most `MOST_BYTES` and one more; a pipe into which nobody writes is an error, where it
    would block."""
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        first: bytes | None = None
        if (
            stat.S_ISFIFO(os.fstat(file.fileno()).st_mode)
            and not select.select([file], [], [], PIPE_PATIENCE)[0]
        ):
            # None while somebody who has opened it has written nothing yet
            first = file.raw.read(1)
            if first == b"":
                raise OSError(errno.EPIPE, "nobody writes into this pipe")
        os.set_blocking(file.fileno(), True)
        return (first or b"") + file.read(MOST_BYTES + 1)


def read_regular(path: Path) -> bytes:
    """Read a file of this project's own; OSError where it is of another kind or size, for it might
    have no end."""
    if not path.is_file():
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    if path.stat().st_size > MOST_BYTES:
        raise OSError(errno.EFBIG, "is too large", str(path))
    return path.read_bytes()


def read_json(what: str, path: str | Path, give: str) -> Any:
    """Read the data of a JSON file that rattle wrote; ValueError where it is no JSON."""
    return parse_json(read_text(what, path, give))


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON text; ValueError where it is none, or nested too deep."""
    return _parse(json.loads, text, json.JSONDecodeError)


def parse_toml(text: str) -> Facts:
    """Parse a TOML text; ValueError where it is none, or too large or too deep."""
    if len(text) > MOST_TOML:
        raise ValueError(f"the text has {len(text):,} characters, more than {MOST_TOML:,}")
    if LONG_KEY.search(text):
        raise ValueError(f"a key has more than {MOST_DEPTH} parts")
    data: Facts = _parse(tomllib.loads, text, tomllib.TOMLDecodeError)
    return data


TOO_DEEP = f"tables or lists are nested more than {MOST_DEPTH} deep"
TOO_LARGE = "an integer is larger than any number here"


def _parse(loads: Callable[[Any], Any], text: str | bytes, error: type[ValueError]) -> Any:
    """The data of a text by a parser that raises `error` where it is none; checks how deep they are
    nested, and their integers."""
    try:
        data = loads(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    except error:
        raise
    except ValueError:  # of Python, about a setting of its own
        raise ValueError(TOO_LARGE) from None
    level = [data]
    for _ in range(MOST_DEPTH + 1):
        if any(isinstance(item, int) and item.bit_length() > MOST_BITS for item in level):
            raise ValueError(TOO_LARGE)
        nested = [
            item.values() if isinstance(item, dict) else item
            for item in level
            if isinstance(item, dict | list)
        ]
        level = [item for items in nested for item in items]
        if not nested:
            return data
    raise ValueError(TOO_DEEP)


def read_toml(text: str) -> Facts:
    """Parse a TOML text."""
    if not isinstance(text, str):
        raise FileError("TOML", text, "give text")
    try:
        return parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise FileError("TOML", str(error), _remedy(text, str(error))) from None
    except ValueError as error:
        raise FileError(
            "TOML", str(error), "no scene or study needs that; correct the file"
        ) from None


def _remedy(text: str, error: str) -> str:
    """What to do about a text that is not TOML: two common slips are named."""
    place = PLACE.search(error)
    row = text.split("\n")[int(place[1]) - 1] if place else ""
    if comma := COMMA.search(row):
        return f"use a decimal point: {comma[1]}.{comma[2]}"
    if row and "=" not in row and re.search("[,;\t]", row):
        return (
            "this looks like a table (CSV): write each value on a line as name = value, with a"
            " decimal point"
        )
    return "correct the file at that place"


@contextmanager
def in_file(path: str | Path, text: str) -> Iterator[None]:
    """Errors about the content of a TOML file name the file, and the line of the key where that can
    be found."""
    try:
        yield
    except InputError as error:
        number = None if error.where or isinstance(error, FileError) else _line_of(text, error)
        where = error.where or str(path) + (f", line {number}" if number else "")
        raise type(error)(error.field, error.value, error.remedy, where) from None


def _line_of(text: str, error: InputError) -> int | None:
    """The first line whose key is the field of an error, or, of a table with an unknown key, that
    key."""
    of_part = OF_PART.match(error.field)
    part = of_part[1] if of_part else ""
    field = _by_number(text, error.field) if part else error.field
    wanted = [f".{field}"]
    if isinstance(error.value, str):
        wanted.append(f".{field}.{error.value}")
    if field.startswith("noise."):  # of a table in one line
        wanted.append(".noise")
    table = ""
    tables = 0
    for number, line in enumerate(text.splitlines(), start=1):
        if match := TABLE.match(line):
            table = match[1].strip()
            if table == part:
                tables += 1
                table = f"{part}.{tables}"
        match = KEY_PATTERN.match(line)
        if match and f".{table}.{match[1]}".endswith(tuple(wanted)):
            return number
    return None


def _by_number(text: str, field: str) -> str:
    """The field of a wheel or body, ``wheel.third.torque``, with its number in place of its
    name."""
    part, label, *rest = field.split(".")
    tables = parse_toml(text).get(part, [])
    names = [table.get("name") if isinstance(table, dict) else None for table in tables]
    number = str(1 + names.index(label)) if label in names else label
    return ".".join([part, number, *rest])
