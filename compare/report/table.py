"""The tables of a page: their columns, their cells, and the marks of the verdicts in them."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

TEXT = "text"
NUMBER = "number"
"""Kinds of a column: text, aligned left and sorted alphabetically; numbers, aligned right and
sorted by value."""

SIGNS_OF_MARKS = {"": "", "good": "✓", "bad": "✗", "open": "?", "part": "◐"}
"""Marks of a cell for the verdict on it, and their signs."""

NO_VALUE = "–"  # shown in place of NaN


def leading_number(text: str) -> float | None:
    """The first number in a text, by which a column of numbers is sorted."""
    match = re.search(r"[-+]?\d[\d,]*(?:\.\d+)?(?:[eE][-+]?\d+)?", text)
    return float(match[0].replace(",", "")) if match else None


def align_columns(rows: Sequence[Sequence[str]], alignment: str) -> list[str]:
    """Rows of text as lines with aligned columns.

    `alignment`: Of each column, ``<`` or ``>``.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(f"{c:{a}{w}}" for c, a, w in zip(row, alignment, widths, strict=True)).rstrip()
        for row in rows
    ]


@dataclass(frozen=True)
class TableCell:
    """A cell of a table."""

    text: str
    mark: str = ""  # the verdict on it, a key of `SIGNS_OF_MARKS`
    value: float | None = None  # number by which it is sorted; finite

    @property
    def display(self) -> str:
        """The text, followed by the sign of its mark if it has one."""
        return f"{self.text} {SIGNS_OF_MARKS[self.mark]}" if self.mark else self.text

    @classmethod
    def of(cls, content: "TableCell | str | float", kind: str) -> "TableCell":
        """Make a cell: numbers are shown with four digits, NaN as a dash."""
        if isinstance(content, TableCell):
            cell = content
        elif isinstance(content, str):
            cell = cls(content)
        elif not math.isfinite(content):
            cell = cls(NO_VALUE if math.isnan(content) else f"{content:g}")
        else:
            whole = float(content).is_integer() and abs(content) < 1e9
            cell = cls(f"{int(content):,}" if whole else f"{content:.4g}", value=float(content))
        if kind == TEXT:
            return cls(cell.text, cell.mark)
        return (
            cell if cell.value is not None else cls(cell.text, cell.mark, leading_number(cell.text))
        )


@dataclass(frozen=True)
class Column:
    """A column of a table, and what its cells show of the row of a frame."""

    head: str
    form: str = ""  # column of the frame, or a format with such names; the head if not given
    mark: str = ""  # column of the frame with the marks of the cells
    kind: str = TEXT  # `TEXT` or `NUMBER`

    def show(self, row: Mapping[str, Any]) -> TableCell | str | float:
        """The content of its cell in a row."""
        form = self.form or self.head
        content = form.format_map(row) if "{" in form else row[form]
        if content == "nan":
            content = NO_VALUE
        if self.kind == TEXT:
            return TableCell(str(content), row[self.mark] if self.mark else "")
        return TableCell(content, row[self.mark]) if self.mark else content


of_numbers = partial(Column, kind=NUMBER)
"""Makes a column of numbers."""


@dataclass(frozen=True)
class Table:
    """A table."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[TableCell, ...], ...]  # each as long as ``columns``

    @classmethod
    def of(
        cls, columns: Iterable[Column | str], rows: Iterable[Iterable[TableCell | str | float]]
    ) -> "Table":
        """Make a table of plain values; a column of text is given by its head alone."""
        heads = tuple(c if isinstance(c, Column) else Column(c) for c in columns)
        made = (
            tuple(TableCell.of(content, c.kind) for content, c in zip(row, heads, strict=True))
            for row in rows
        )
        return cls(heads, tuple(made))

    @classmethod
    def of_frame(cls, frame: "pd.DataFrame", *columns: Column | str) -> "Table":
        """Make a table of these columns of a frame."""
        heads = [c if isinstance(c, Column) else Column(c) for c in columns]
        records: Any = frame.to_dict("records")
        return cls.of(heads, ([column.show(row) for column in heads] for row in records))

    @classmethod
    def whole(cls, frame: "pd.DataFrame", texts: Sequence[str] = ()) -> "Table":
        """Make a table of all columns of a frame as they are; those in `texts` are text."""
        names = map(str, frame.columns)
        return cls.of_frame(frame, *(name if name in texts else of_numbers(name) for name in names))
