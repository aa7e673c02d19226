"""The content of a page as data: a title, the answer, sections of blocks, and its source.

Texts are plain: between two backticks stands code, everything else is shown literally in every
view.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

TEXT = "text"
NUMBER = "number"
"""Kinds of a column: text, aligned left and sorted alphabetically; numbers, aligned right and
sorted by value."""

MARKS = {"": "", "good": "✓", "bad": "✗", "open": "?", "part": "◐"}
"""Marks of a cell for the verdict on it, and their signs."""

NOTHING = "–"  # shown in place of NaN
CODE = re.compile(r"`([^`\n]+)`")


def leading_number(text: str) -> float | None:
    """The first number in a text, by which a column of numbers is sorted."""
    found = re.search(r"[-+]?\d[\d,]*(?:\.\d+)?(?:[eE][-+]?\d+)?", text)
    return float(found[0].replace(",", "")) if found else None


def parts(text: str) -> list[tuple[str, bool]]:
    """Split a text at its backticks."""
    pieces = CODE.split(text)
    return [(piece, bool(i % 2)) for i, piece in enumerate(pieces) if piece]


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    note: bool = False  # whether it explains the block beside it, and is set in smaller type


@dataclass(frozen=True)
class TableCell:
    """A cell of a table."""

    text: str
    mark: str = ""  # the verdict on it, a key of `MARKS`
    value: float | None = None  # number by which it is sorted; finite

    @property
    def display(self) -> str:
        """The text, followed by the sign of its mark if it has one."""
        return f"{self.text} {MARKS[self.mark]}" if self.mark else self.text

    @classmethod
    def of(cls, content: "TableCell | str | float", kind: str) -> "TableCell":
        """Make a cell: numbers are shown with four digits, NaN as a dash."""
        if isinstance(content, TableCell):
            cell = content
        elif isinstance(content, str):
            cell = cls(content)
        elif not math.isfinite(content):
            cell = cls(NOTHING if math.isnan(content) else f"{content:g}")
        else:
            whole = float(content).is_integer() and abs(content) < 1e9
            cell = cls(f"{int(content):,}" if whole else f"{content:.4g}", value=float(content))
        if kind == TEXT:
            return cls(cell.text, cell.mark)
        return (
            cell if cell.value is not None else cls(cell.text, cell.mark, leading_number(cell.text))
        )


Row: TypeAlias = Iterable[TableCell | str | float]
"""A row as `Table.of` accepts it."""


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    head: str
    kind: str = TEXT  # `TEXT` or `NUMBER`


def numbers(*heads: str) -> tuple[Column, ...]:
    """Columns of numbers."""
    return tuple(Column(head, NUMBER) for head in heads)


@dataclass(frozen=True)
class Table:
    """A table."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[TableCell, ...], ...]  # each as long as ``columns``
    summary: str = ""  # if given, HTML shows the table collapsed beneath this line

    @classmethod
    def of(cls, columns: Sequence[Column | str], rows: Iterable[Row], summary: str = "") -> "Table":
        """Make a table of plain values."""
        heads = tuple(c if isinstance(c, Column) else Column(c) for c in columns)
        made = (
            tuple(TableCell.of(content, c.kind) for content, c in zip(row, heads, strict=True))
            for row in rows
        )
        return cls(heads, tuple(made), summary)


@dataclass(frozen=True)
class Figure:
    """A figure."""

    path: str  # of an SVG or PNG file, relative to the report's folder and inside it
    caption: str
    alt: str  # description for readers who do not see the figure; not empty


@dataclass(frozen=True)
class Code:
    """A block of code."""

    text: str  # shown literally
    language: str = ""  # name for syntax highlighting; may be empty


@dataclass(frozen=True)
class Glossary:
    """Words and symbols of a page, each with its meaning; HTML shows it folded."""

    title: str  # the line beneath which it is folded
    terms: tuple[tuple[str, str], ...]  # each term and its meaning; at least one


Block: TypeAlias = Text | Table | Figure | Code | Glossary

BLOCKS = {"text": Text, "table": Table, "figure": Figure, "code": Code, "glossary": Glossary}
"""Types of blocks by their name in ``page.json`` and in the templates."""


@dataclass(frozen=True)
class PageSection:
    """A section of a page."""

    title: str
    blocks: tuple[Block, ...] = ()
    sections: tuple["PageSection", ...] = ()  # subsections, which follow the blocks


@dataclass(frozen=True)
class Source:
    """Where a page comes from."""

    repeat: str  # command that makes the page again
    facts: tuple[tuple[str, str], ...] = ()  # entries of the manifest: name and value
    blocks: tuple[Block, ...] = ()  # further blocks, such as the scene


@dataclass(frozen=True)
class Page:
    """The page of a report."""

    title: str
    # sentences that stand first; at least one.  The first is the advice, or what is most worth
    # knowing
    answer: tuple[str, ...]
    source: Source  # stands last
    # before the sections: the key figure, and the table.  HTML and Markdown show the first sentence
    # of the answer, the blocks, and then the other sentences
    blocks: tuple[Block, ...] = ()
    sections: tuple[PageSection, ...] = ()

    def all_sections(self) -> Iterator[PageSection]:
        """Iterate over all sections and subsections, each before its own subsections."""
        waiting = list(self.sections)
        while waiting:
            section = waiting.pop(0)
            yield section
            waiting[:0] = section.sections
