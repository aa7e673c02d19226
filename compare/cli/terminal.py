"""A page on a terminal, read from its Markdown."""

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
from markdown_it import MarkdownIt
from markdown_it.tree import SyntaxTreeNode

from rattle.compare.report.folder import page_files
from rattle.compare.report.table import NUMBER, SIGNS_OF_MARKS, TEXT, Column, Table, TableCell
from rattle.scene import FileError, harmless, line
from rattle.scene.files import read_text

COLOUR = {"good": "green", "bad": "red", "open": "magenta", "part": "yellow"}
WORD_NODES = ("text", "code_inline")
"""Kinds of nodes whose content is shown."""
NARROWEST_COLUMN = 16
"""Characters below which a column of text is not narrowed."""
GAP = "  "
MARK_OF = {sign: mark for mark, sign in SIGNS_OF_MARKS.items() if mark}


class ShownSection(NamedTuple):
    """A section of a page in Markdown, without those below it."""

    title: str
    level: int  # 1 for the whole page
    blocks: list[SyntaxTreeNode]

    def lines(self, width: int) -> Iterator[str]:
        """Its lines on a terminal."""
        yield from _bold(self.title, width, underline=self.level < 3 or None)
        yield ""
        for block in self.blocks:
            yield from _block_lines(block, width)


def read_page(report: Path) -> list[ShownSection]:
    """Read the page of a report, from its folder or from its file in Markdown."""
    return read_sections(read_text("page", _find_page(report), "a page in Markdown"))


def _find_page(report: Path) -> Path:
    """The file of the page of a report in Markdown."""
    if not report.is_dir():
        return report
    for page in sorted(report.glob("*.md")):
        if all((report / name).exists() for name in page_files(page.stem)):
            return page
    raise FileError(
        "report", str(report), "holds no page; give a folder into which rattle has written a report"
    )


def read_sections(markdown: str) -> list[ShownSection]:
    """The sections of a page in their order; the first is what stands above all others."""
    sections = [ShownSection("", 1, [])]
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    for node in SyntaxTreeNode(parser.parse(markdown)).children:
        if node.type == "heading":
            sections.append(ShownSection(_text(node), int(node.tag[1:]), []))
        else:
            sections[-1].blocks.append(node)
    return sections if sections[0].blocks or not sections[1:] else sections[1:]


def put_answer_first(opening: ShownSection) -> ShownSection:
    """Put the sentences of the answer that end the opening of a page below the first of them."""
    blocks = opening.blocks
    other = [number for number, block in enumerate(blocks) if block.type != "paragraph"]
    end = max(other, default=0) + 1
    return opening._replace(blocks=[*blocks[:1], *blocks[end:], *blocks[1:end]])


def _text(node: SyntaxTreeNode) -> str:
    """The text of a block on one line, without its markup."""
    return line("".join(inner.content for inner in node.walk() if inner.type in WORD_NODES))


def _bold(text: str, width: int, **style: Any) -> Iterator[str]:
    yield from (click.style(row, bold=True, **style) for row in textwrap.wrap(text, width))


def _block_lines(block: SyntaxTreeNode, width: int) -> Iterator[str]:
    """The lines of a block, and an empty one unless it is the head of the next."""
    match block.type:
        case "paragraph":
            inside = [node for node in block.children[0].children if node.children or node.content]
            if [node.type for node in inside] == ["image"]:
                yield f"[{line(str(inside[0].attrs['src']))}]"
                return
            if [node.type for node in inside] == ["strong"]:
                yield from _bold(_text(block), width)
                return
            yield from textwrap.wrap(_text(block), width)
        case "bullet_list":
            for item in block.children:
                yield from textwrap.wrap(_text(item), width, subsequent_indent="    ")
        case "fence":
            rows = harmless(block.content).expandtabs().splitlines()
            yield from (f"    {row}" for row in rows)
        case "table":
            table = _read_table(block)
            for number, (columns, widths) in enumerate(_panels(table, width)):
                yield from [""] * bool(number)
                yield from _panel(table, columns, widths)
    yield ""


def _read_table(block: SyntaxTreeNode) -> Table:
    """The table of a page; a cell that ends in the sign of a mark has that mark."""
    head, *rows = (row for part in block.children for row in part.children)
    columns = [
        Column(_text(cell), kind=NUMBER if "right" in str(cell.attrs) else TEXT)
        for cell in head.children
    ]
    return Table.of(columns, ([_read_cell(_text(cell)) for cell in row.children] for row in rows))


def _read_cell(text: str) -> TableCell:
    words, _, sign = text.rpartition(" ")
    return TableCell(words, MARK_OF[sign]) if sign in MARK_OF else TableCell(text)


def _panels(table: Table, width: int) -> Iterator[tuple[list[int], list[int]]]:
    """Split a table into panels that fit the width, each with the first column; columns and their
    widths."""
    first, *rest = range(len(table.columns))
    extents = [_extent(table, column) for column in (first, *rest)]
    while True:
        panel = [first]
        spare = width - extents[first][0]
        while rest:
            left = spare - len(GAP) - extents[rest[0]][0]
            if left < 0 and len(panel) > 1:
                break
            spare = left
            panel.append(rest.pop(0))
        widths = []
        # spare width goes to columns that are narrower than their text
        for least, whole in (extents[column] for column in panel):
            more = min(max(spare, 0), whole - least)
            widths.append(least + more)
            spare = spare - more
        if spare < 0:  # two columns alone are too wide
            widths[-1] = max(1, widths[-1] + spare)
        yield panel, widths
        if not rest:
            return


def _extent(table: Table, column: int) -> tuple[int, int]:
    """The smallest width of a column, and the one at which nothing in it is wrapped."""
    head = table.columns[column].head
    cells = [len(row[column].display) for row in table.rows]
    word = max((len(w) for w in head.split()), default=0)
    longest = max([*cells, word])
    is_number = table.columns[column].kind == NUMBER
    least = longest if is_number else min(longest, NARROWEST_COLUMN)
    return least, max(longest, min(len(head), 2 * longest))


def _panel(table: Table, columns: Sequence[int], widths: Sequence[int]) -> Iterator[str]:
    """The lines of some columns of a table: heads, a rule, and rows."""
    shown = [table.columns[c] for c in columns]
    kinds = [column.kind for column in shown]
    yield from _row([TableCell(column.head) for column in shown], kinds, widths, lowest=True)
    yield GAP.join("─" * w for w in widths)
    for row in table.rows:
        yield from _row([row[c] for c in columns], kinds, widths)


def _row(
    cells: Sequence[TableCell], kinds: Sequence[str], widths: Sequence[int], lowest: bool = False
) -> Iterator[str]:
    """The lines of a row of cells, numbers to the right, those with a mark in its colour.

    `lowest`: Whether cells with fewer lines stand on the lowest of them.
    """
    wrapped = [textwrap.wrap(cell.display, w) for cell, w in zip(cells, widths, strict=True)]
    height = max(map(len, wrapped))
    for number in range(height):
        pieces = []
        for cell, lines, kind, width in zip(cells, wrapped, kinds, widths, strict=True):
            blank = [""] * (height - len(lines))
            piece = (blank + lines if lowest else lines + blank)[number]
            room = " " * (width - len(piece))
            styled = click.style(piece, fg=COLOUR[cell.mark]) if cell.mark and piece else piece
            pieces.append(room + styled if kind == NUMBER else styled + room)
        yield GAP.join(pieces).rstrip()


def select(sections: Sequence[ShownSection], words: str) -> list[ShownSection]:
    """The sections whose title contains these words, each with those below it."""
    chosen = []
    within = 0  # level of the section that has been chosen; 0 outside of any
    for section in sections:
        if section.level <= within:
            within = 0
        if not within and section.level > 1 and words.casefold() in section.title.casefold():
            within = section.level
        if within:
            chosen.append(section)
    return chosen
