"""The content of a page: a title, the answer, sections of blocks, and where it all comes from.

Texts are plain: what stands between two backticks is code, everything else is shown as it is, whatever the view.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TypeAlias

from rattle.scene.errors import InputError
from rattle.scene.validate import choice

__all__ = [
    "MARKS", "NUMBER", "TEXT", "Block", "Cell", "Code", "Column", "Figure", "Page", "Row", "Section", "Source",
    "Table", "Text", "leading_number", "numbers",
]  # fmt: skip

TEXT, NUMBER = "text", "number"
"""Kinds of a column: words, to the left and in alphabetical order; numbers, to the right and in theirs."""

MARKS = {"": "", "good": "✓", "bad": "✗", "open": "?"}
"""Verdicts that a cell can carry, and their signs."""

NOTHING = "–"


def leading_number(text: str) -> float | None:
    """The first number in a text, by which a column of numbers is sorted; none where there is none.

    Examples
    --------
    >>> leading_number("≤ 0.0006"), leading_number("17,229 paths"), leading_number("-1.5e-3 ± 0.1"), leading_number("–")
    (0.0006, 17229.0, -0.0015, None)
    """
    found = re.search(r"[-+]?\d[\d,]*(?:\.\d+)?(?:[eE][-+]?\d+)?", text)
    return float(found[0].replace(",", "")) if found else None


@dataclass(frozen=True)
class Text:
    """A paragraph; a note is one that explains what stands beside it."""

    text: str
    note: bool = False


@dataclass(frozen=True)
class Cell:
    """A cell of a table: its text, the verdict on it (a key of `MARKS`), and the number by which it is sorted."""

    text: str
    mark: str = ""
    value: float | None = None

    def __post_init__(self) -> None:
        choice("mark", self.mark, MARKS)
        if self.value is not None and not math.isfinite(self.value):
            raise InputError("value", self.value, "give a finite number, or none")

    @property
    def shown(self) -> str:
        """The text with the sign of its verdict."""
        return f"{self.text} {MARKS[self.mark]}" if self.mark else self.text

    @classmethod
    def of(cls, content: "Cell | str | float", kind: str) -> "Cell":
        """A cell of what it holds: four digits of a number, a dash for NaN."""
        if isinstance(content, Cell):
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
        return cell if cell.value is not None else cls(cell.text, cell.mark, leading_number(cell.text))


Row: TypeAlias = Iterable[Cell | str | float]
"""What `Table.of` takes as a row."""


@dataclass(frozen=True)
class Column:
    """The head of a column and its kind, `TEXT` or `NUMBER`."""

    head: str
    kind: str = TEXT

    def __post_init__(self) -> None:
        choice("kind", self.kind, (TEXT, NUMBER))


def numbers(*heads: str) -> tuple[Column, ...]:
    """Columns of numbers."""
    return tuple(Column(head, NUMBER) for head in heads)


@dataclass(frozen=True)
class Table:
    """A table; with a summary it is folded away beneath it where the view can."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    summary: str = ""

    def __post_init__(self) -> None:
        if not self.columns:
            raise InputError("columns", self.columns, "give at least one")
        for number, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise InputError(f"rows[{number}]", len(row), f"must have {len(self.columns)} cells, one for each head")

    @classmethod
    def of(cls, columns: Sequence[Column | str], rows: Iterable[Row], summary: str = "") -> "Table":
        """A table of bare values; a head without a kind is of text.

        Examples
        --------
        >>> table = Table.of(["closure", *numbers("speed-up")], [["saltation", "≥ 480"], ["published", 0.057]])
        >>> table.rows[0][1].value, table.rows[1][1].text
        (480.0, '0.057')
        """
        heads = tuple(c if isinstance(c, Column) else Column(c) for c in columns)
        made = (tuple(Cell.of(content, c.kind) for content, c in zip(row, heads, strict=True)) for row in rows)
        return cls(heads, tuple(made), summary)


@dataclass(frozen=True)
class Figure:
    """A figure in the report's folder, what is said beneath it, and what it shows in words for who cannot see it."""

    path: str
    caption: str
    alt: str

    def __post_init__(self) -> None:
        path = PurePosixPath(self.path)
        if path.is_absolute() or ".." in path.parts or path.suffix not in (".svg", ".png"):
            raise InputError("path", self.path, "give an .svg or .png inside the report's folder")
        if not self.alt.strip():
            raise InputError("alt", self.alt, "say what the figure shows")


@dataclass(frozen=True)
class Code:
    """Text to be shown as it stands, in a language's name."""

    text: str
    language: str = ""


Block: TypeAlias = Text | Table | Figure | Code


@dataclass(frozen=True)
class Section:
    """A part of a page, with parts of its own."""

    title: str
    blocks: tuple[Block, ...] = ()
    sections: tuple["Section", ...] = ()


@dataclass(frozen=True)
class Source:
    """Where a page comes from: the command that repeats it, facts of the manifest by name, and what else tells."""

    repeat: str
    facts: tuple[tuple[str, str], ...] = ()
    blocks: tuple[Block, ...] = ()


@dataclass(frozen=True)
class Page:
    """What a report says: the answer first, the blocks that open it, sections, its source.

    Examples
    --------
    >>> page = Page("Is it right?", ("Yes.",), Source("rattle validate"), sections=(Section("Why", (Text("Tried."),)),))
    >>> [section.title for section in page.all_sections()]
    ['Why']
    """

    title: str
    answer: tuple[str, ...]
    source: Source
    blocks: tuple[Block, ...] = ()
    sections: tuple[Section, ...] = ()

    def __post_init__(self) -> None:
        if not self.answer:
            raise InputError("answer", self.answer, "a page begins with its answer; give a sentence")

    def all_sections(self) -> Iterator[Section]:
        """Every section, each before its own parts."""
        waiting = list(self.sections)
        while waiting:
            section = waiting.pop(0)
            yield section
            waiting[:0] = section.sections
