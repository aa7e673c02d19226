"""A file of a measured motion of the driver: two columns of numbers, as other programs write
them."""

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rattle.scene.errors import InputError
from rattle.scene.files import read_text
from rattle.scene.types import Floats, Ints

DEGREE = math.pi / 180.0
RPM = 2.0 * math.pi / 60.0
STEP_UNITS = {"time": {"s": 1.0, "ms": 1e-3}, "angle": {"rad": 1.0, "deg": DEGREE, "°": DEGREE}}
VALUES = {
    "displacement": {"rad": 1.0, "deg": DEGREE, "°": DEGREE, "mm": 1.0},
    "speed": {"rad/s": 1.0, "rpm": RPM, "1/min": RPM, "deg/s": DEGREE, "mm/s": 1.0},
    "acceleration": {
        "rad/s^2": 1.0,
        "rad/s2": 1.0,
        "rad/s²": 1.0,
        "mm/s^2": 1.0,
        "mm/s2": 1.0,
        "mm/s²": 1.0,
    },
}
"""What a column may hold, by its name, and the factor of each unit to s, rad or mm."""
HEADER = re.compile(r"(?:crank )?(\w+)\s*[\[(]\s*([^\])]+?)\s*[\])]", flags=re.I)
CLOCK = re.compile(r"\d:\d\d|\d{4}-\d\d-\d\d|\d{1,2}\.\d{1,2}\.\d{4}")
LEAST_ROWS = 128  # of 8 periods with 16 samples each
FILE_EXAMPLE = "time [ms], speed [rpm]"
MISSING = ("", "nan", "inf", "-inf", "na", "n/a", "null", "none")


@dataclass(frozen=True)
class Measurement:
    """The two columns of a file, in s, rad and mm, with the number of the line of each row."""

    along: str
    at: Floats
    quantity: str
    unit: str
    values: Floats
    written: Floats  # the values as they stand in the file
    lines: Ints

    @property
    def power(self) -> int:
        """How often a displacement is differentiated to what was measured."""
        return list(VALUES).index(self.quantity)

    @property
    def factor(self) -> float:
        """Of the unit to rad, mm and s."""
        return VALUES[self.quantity][self.unit]

    @property
    def is_angular(self) -> bool:
        """Whether the motion is the rotation of the driver, not a path on its circle."""
        return not self.unit.startswith("mm")


def read_measurement(file: str | Path) -> Measurement:
    """Read a measured motion from a CSV file, or from its text."""
    text = str(file) if "\n" in str(file) else read_text("drive.file", file, "a CSV file")
    rows = _rows(text.removeprefix("\ufeff"))
    try:
        _, head, _, names = next(rows)
    except StopIteration:
        raise InputError("drive.file", text, "is empty; give a CSV file with two columns") from None
    (along, step), (quantity, unit) = _read_header(head, names)
    read = [(number, *_read_pair(number, line, mark, cells)) for number, line, mark, cells in rows]
    if not read:
        raise InputError("drive.file", head, "has no rows below its header")
    if len(read) < LEAST_ROWS:
        raise InputError(
            "drive.file", f"{len(read)} samples", f"is too short: {LEAST_ROWS} rows are the least"
        )
    lines, at, written = (np.array(column) for column in zip(*read, strict=True))
    at = at * STEP_UNITS[along][step]
    values = written * VALUES[quantity][unit]
    if along == "angle":
        at = np.unwrap(at)
        if at[-1] < at[0]:  # the driver turns the other way: both columns count against its turning
            at = -at
            values = -values
    if quantity == "displacement" and not unit.startswith("mm"):
        values = np.unwrap(values)
    _check_rise(along, step, at, lines)
    if np.ptp(written) == 0.0:
        raise InputError(
            f"drive.file, {quantity}", float(written[0]), "is the same in all rows; give a motion"
        )
    return Measurement(along, at - at[0], quantity, unit, values, written, lines)


def _rows(text: str) -> Iterator[tuple[int, str, str, list[str]]]:
    """Number, text, separator and cells of each line that has any, the header first."""
    mark = ""
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        mark = mark or next((m for m in (";", "\t") if m in line), ",")
        if line.count('"') % 2 or len(line) > csv.field_size_limit():
            why = "has a quotation mark that is not closed, or too much in one cell"
            raise InputError(f"drive.file, line {number}", line, why)
        cells = [
            cell.strip() for cell in next(csv.reader([line], delimiter=mark, skipinitialspace=True))
        ]
        while len(cells) > 2 and not cells[-1]:  # separators at the end of a line
            cells.pop()
        yield number, line.strip(), mark, cells


def _read_header(head: str, names: list[str]) -> list[tuple[str, str]]:
    """Name and unit of both columns."""
    if len(names) != 2:
        why = f"has {len(names)} column{'s' * (len(names) != 1)}; keep two, as in: {FILE_EXAMPLE}"
        raise InputError("drive.file", head, why)
    columns = []
    for name, known in zip(names, (STEP_UNITS, VALUES), strict=True):
        parts = HEADER.fullmatch(name)
        if parts is None:
            why = f"name two columns with their units in its first line, as in: {FILE_EXAMPLE}"
            raise InputError("drive.file", head, why)
        column = parts[1].lower()
        unit = parts[2]
        if column not in known:
            raise InputError(
                "drive.file",
                parts[1],
                f"is no such column; give {' or '.join(known)}, as in: {FILE_EXAMPLE}",
            )
        if unit not in known[column]:
            why = f"has an unknown unit; give {', '.join(known[column])}"
            raise InputError("drive.file", f"{column} [{unit}]", why)
        columns.append((column, unit))
    return columns


def _read_pair(number: int, line: str, mark: str, cells: list[str]) -> list[float]:
    """Both numbers of a row."""
    if mark != ",":
        cells = [cell.replace(",", ".") if "." not in cell else cell for cell in cells]
    try:
        pair = [float(cell) for cell in cells]
    except ValueError:
        pair = []
    if len(pair) == 2 and all(map(math.isfinite, pair)):
        return pair
    if CLOCK.search(cells[0]):
        why = "has a time of day or a date; give seconds from the first row"
    elif any(cell.lower() in MISSING for cell in cells):
        why = "needs two numbers; leave out a row without a value"
    elif mark == "," and len(cells) == 4:
        why = (
            "has 4 columns, not two numbers; put semicolons between columns where commas are"
            " decimal"
        )
    elif len(cells) != 2:
        why = f"needs two numbers, and has {len(cells)} column{'s' * (len(cells) != 1)}"
    else:
        why = "needs two numbers, such as 0.25 or 2.5e-4"
    raise InputError(f"drive.file, line {number}", line, why)


def _check_rise(along: str, step: str, at: Floats, lines: Ints) -> None:
    """Refuse times or angles that do not rise from row to row."""
    still = np.flatnonzero(np.diff(at) <= 0.0)
    if not len(still):
        return
    k = int(still[0]) + 1
    before, after = at[k - 1 : k + 1] / STEP_UNITS[along][step]
    why = f"is that of line {lines[k - 1]} again"
    if after < before:
        why = f"is another step than the others, back from {before:g} of line {lines[k - 1]}"
    why += f"; each row needs a later {along}: leave this one out, or write more digits"
    raise InputError(f"drive.file, line {lines[k]}", f"{along} = {after:g}", why)
