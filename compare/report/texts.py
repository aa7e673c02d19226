"""Texts of the pages as data: each folder keeps them in ``texts.toml``, and the layout of its page in ``page.md``."""

import re
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from importlib.resources import files
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from rattle.compare.report import NUMBER, TEXT, Block, Column, Figure, PageSection, Table, TableCell, Text

if TYPE_CHECKING:
    import pandas as pd

FIGURE, PART, PLAIN = (re.compile(form) for form in (r"!\[(.*?)\]\((.*?)\) ?(.*)", r"\[([\w-]+)\]", r"\{[^{}:]+\}"))


def read_texts(package: str) -> dict[str, Any]:
    """The entries of ``texts.toml`` in a folder of `rattle.compare`; within a text a line break is a space.

    Examples
    --------
    >>> read_texts("report")["σ"]
    'noise intensity: strength of the random part of the driving motion; 0 is none'
    """
    return {name: _join_lines(value) for name, value in tomllib.loads(read_file(package, "texts.toml")).items()}


def _join_lines(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _join_lines(inner) for name, inner in value.items()}
    return " ".join(value.split())


def read_file(package: str, name: str) -> str:
    """The text of a file in a folder of `rattle.compare`."""
    return files("rattle.compare").joinpath(*package.split("."), name).read_text(encoding="utf-8")


def lay_out(
    package: str, parts: Mapping[str, Any], drawn: Collection[str] = (), layout: str = "page.md", **values: Any
) -> tuple[tuple[Block, ...], tuple[PageSection, ...]]:
    """The blocks above the sections of a page, and the sections, as ``page.md`` of its folder says, or another layout.

    ``# Title`` begins a section, ``[name]`` stands for the block or blocks of that name in `parts`, or for a table of
    that frame if heads, alignment and forms of its columns follow; ``![alternative](NAME.svg) caption`` for a figure
    that is `drawn`; `values` are put between braces.  A paragraph with ``>`` is a note to the part that follows it.  A
    part or figure that is not there is left out with its note, and so is a section without blocks.
    """
    sections: list[tuple[str, list[Block]]] = [("", [])]
    notes: list[Block] = []
    for paragraph in read_file(package, layout).split("\n\n"):
        piece = " ".join(paragraph.split())
        if piece.startswith("# "):
            sections[-1][1].extend(notes)
            sections.append((piece[2:].format(**values), []))
        elif piece.startswith("> "):
            notes.append(Text(piece[2:].format(**values), note=True))
            continue
        elif blocks := _blocks(paragraph, piece, parts, drawn, values):
            sections[-1][1].extend([*notes, *blocks])
        notes = []
    sections[-1][1].extend(notes)
    (_, opening), *others = sections
    return tuple(opening), tuple(PageSection(title, tuple(blocks)) for title, blocks in others if blocks)


def _blocks(
    paragraph: str, piece: str, parts: Mapping[str, Any], drawn: Collection[str], values: Mapping[str, Any]
) -> Sequence[Block]:
    if found := FIGURE.fullmatch(piece.format(**values) if piece.startswith("!") else ""):
        alternative, path, caption = found.groups()
        return [Figure(path, caption, alternative or caption)] if path.removesuffix(".svg") in drawn else []
    if found := PART.match(piece):
        part, (first, *rows) = parts.get(found[1], ()), paragraph.strip().splitlines()
        if rows and not isinstance(part, Sequence):
            rows[0] = rows[0].format(**values)
            return [_table(part, rows, first.partition("] ")[2].format(**values))]
        return part if isinstance(part, Sequence) else [part]
    return [Text(piece.format(**values))]


def _table(frame: "pd.DataFrame", rows: Sequence[str], summary: str) -> Table:
    """A table of a frame by three rows: heads, alignment (``--:`` for numbers), and the forms of its cells."""
    heads, rule, forms = ([cell.strip() for cell in row.strip().strip("|").split("|")] for row in rows)
    columns = [Column(head, NUMBER if mark.endswith(":") else TEXT) for head, mark in zip(heads, rule, strict=True)]
    cells = [_form(form, column.kind) for form, column in zip(forms, columns, strict=True)]
    return Table.of(columns, [[cell(row) for cell in cells] for row in frame.to_dict("records")], summary)


def _form(form: str, kind: str) -> Callable[[Any], TableCell | str | float]:
    """What a cell shows: a format, of ``{name}`` alone the number itself; ``!name`` is the column of its mark."""
    text, _, mark = form.partition(" !")
    if mark:
        return lambda row: TableCell(text.format_map(row), row[mark])
    return itemgetter(form[1:-1]) if kind == NUMBER and PLAIN.fullmatch(form) else form.format_map
