"""Texts of the pages as data: each folder keeps them in ``texts.toml``, and the layout of its page
in ``page.md``.

The words and symbols of the pages are explained once; the glossary of a page shows those that it
uses.
"""

import re
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from importlib.resources import files
from operator import itemgetter
from typing import Any

import pandas as pd

from rattle.compare.report import (
    NUMBER,
    TEXT,
    Block,
    Column,
    Figure,
    Glossary,
    PageSection,
    Table,
    TableCell,
    Text,
)
from rattle.scene import Gears, InputError

FIGURE, PART, PLAIN = (
    re.compile(form) for form in (r"!\[(.*?)\]\((.*?)\) ?(.*)", r"\[([\w-]+)\]", r"\{[^{}:]+\}")
)


def read_texts(package: str) -> dict[str, Any]:
    """The entries of ``texts.toml`` in a folder of `rattle.compare`; within a text a line break is
    a space."""
    return {
        name: _join_lines(value)
        for name, value in tomllib.loads(read_file(package, "texts.toml")).items()
    }


def _join_lines(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _join_lines(inner) for name, inner in value.items()}
    return " ".join(value.split())


def read_file(package: str, name: str) -> str:
    """The text of a file in a folder of `rattle.compare`."""
    return files("rattle.compare").joinpath(*package.split("."), name).read_text(encoding="utf-8")


def lay_out(
    package: str,
    parts: Mapping[str, Any],
    drawn: Collection[str] = (),
    layout: str = "page.md",
    **values: Any,
) -> tuple[tuple[Block, ...], tuple[PageSection, ...]]:
    """The blocks above the sections of a page, and the sections, as ``page.md`` of its folder says,
    or another layout.

    ``# Title`` begins a section, ``[name]`` stands for the block or blocks of that name in `parts`,
    or for a table of that frame if heads, alignment and forms of its columns follow, or, if it is
    True there, for the text that follows on its line; ``![alternative](NAME.svg) caption`` for a
    figure that is `drawn`; `values` are put between braces.  A paragraph with ``>`` is a note to
    the part that follows it.  A part or figure that is not there is left out with its note, and so
    is a section without blocks.
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
    return tuple(opening), tuple(
        PageSection(title, tuple(blocks)) for title, blocks in others if blocks
    )


def _blocks(
    paragraph: str,
    piece: str,
    parts: Mapping[str, Any],
    drawn: Collection[str],
    values: Mapping[str, Any],
) -> Sequence[Block]:
    if found := FIGURE.fullmatch(piece.format(**values) if piece.startswith("!") else ""):
        alternative, path, caption = found.groups()
        return (
            [Figure(path, caption, alternative or caption)]
            if path.removesuffix(".svg") in drawn
            else []
        )
    if found := PART.match(piece):
        part = parts.get(found[1], ())
        first, *rows = paragraph.strip().splitlines()
        if part is True:
            return [Text(piece.partition("] ")[2].format(**values))]
        if rows and not isinstance(part, Sequence):
            rows[0] = rows[0].format(**values)
            return [_table(part, rows, first.partition("] ")[2].format(**values))]
        return part if isinstance(part, Sequence) else [part]
    return [Text(piece.format(**values))]


def _table(frame: pd.DataFrame, rows: Sequence[str], summary: str) -> Table:
    """A table of a frame by three rows: heads, alignment (``--:`` for numbers), and the forms of
    its cells."""
    heads, rule, forms = (
        [cell.strip() for cell in row.strip().strip("|").split("|")] for row in rows
    )
    columns = [
        Column(head, NUMBER if mark.endswith(":") else TEXT)
        for head, mark in zip(heads, rule, strict=True)
    ]
    cells = [_form(form, column.kind) for form, column in zip(forms, columns, strict=True)]
    return Table.of(
        columns, [[cell(row) for cell in cells] for row in frame.to_dict("records")], summary
    )


def _form(form: str, kind: str) -> Callable[[Any], TableCell | str | float]:
    """What a cell shows: a format, of ``{name}`` alone the number itself; ``!name`` is the column
    of its mark."""
    text, _, mark = form.partition(" !")
    if mark:
        return lambda row: TableCell(text.format_map(row), row[mark])
    return itemgetter(form[1:-1]) if kind == NUMBER and PLAIN.fullmatch(form) else form.format_map


TITLE = "Symbols and words of this page"

TERMS: dict[str, str] = read_texts("report")
"""Meaning of each term, in plain words, in the order in which a page lists them."""

CLOSURE_TERMS = (
    "closure",
    "`published`",
    "`corrected`",
    "`saltation`",
    "`branching`",
    "simulation",
)
SCHEME_TERMS = (
    "scheme",
    "`euler-maruyama`",
    "`euler-maruyama-located`",
    "`exact-flight`",
    "exact flight",
    "dt",
)
SECTION_TERMS = ("τ", "x1, x2", "y1, y2", "E, sd", "impact", "itinerary")
EXPONENT_TERMS = ("Lyapunov exponent", "drift's linearisation", "finite-size exponent")
CHAOS_TERMS = ("orbit", "mean map", *EXPONENT_TERMS, "square-root law", "band", "sticking")
VERDICT_TERMS = ("accurate", "inaccurate", "undecided", "range of validity")


IN_UNITS = {
    **dict.fromkeys(("α", "x1, x2"), "{length:.4g} mm"),
    **dict.fromkeys(("τ", "Δτ", "dt"), "{time:.4g} ms"),
    "y1, y2": "{speed:.4g} mm/s",
    "Lyapunov exponent": "{each_second:.4g} per second",
}
"""What 1 is in physical units, of the quantities that have a dimension."""


def glossary(*names: str, gears: Gears | None = None) -> Glossary:
    """The glossary of the terms that a page uses, in the order of `TERMS`; with gears, what 1 is in
    their units."""
    if unknown := set(names) - TERMS.keys():
        raise InputError("names", unknown.pop(), "is not explained; add it to TERMS")
    terms = {name: meaning for name, meaning in TERMS.items() if name in names}
    if gears is not None:
        units = gears.units._asdict() | {"each_second": 1e3 / gears.units.time}
        ones = {name: one.format(**units) for name, one in IN_UNITS.items() if name in terms}
        terms |= {name: f"{terms[name]}; 1 is {one} for these gears" for name, one in ones.items()}
    return Glossary(TITLE, tuple(terms.items()))


def table_of(frame: pd.DataFrame, texts: Collection[str] = (), summary: str = "") -> Table:
    """A table of all columns as they are; those in `texts` are text."""
    names = [str(name) for name in frame.columns]
    rows = (
        [str(v) if n in texts else float(v) for n, v in zip(names, row, strict=True)]
        for row in frame.itertuples(index=False)
    )
    return Table.of(
        [Column(name, TEXT if name in texts else NUMBER) for name in names], rows, summary
    )
