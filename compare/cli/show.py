"""The commands ``rattle show``, ``rattle animate``, ``rattle drive`` and ``rattle init``."""

import os
import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import click
from markdown_it import MarkdownIt
from markdown_it.tree import SyntaxTreeNode

from rattle.compare.cli import shared
from rattle.compare.cli.shared import Results, load_scene, say
from rattle.compare.report.folder import default_place, name_of, page_files
from rattle.compare.report.table import MARKS, NUMBER, TEXT, Column, Table, TableCell
from rattle.scene import FileError, InputError, OutputError, count, harmless, line, nearest
from rattle.scene.files import read_text, read_toml
from rattle.scene.gears_input import find_measured, read_measured
from rattle.scene.progress import apart_from_bars

NARROWEST = 20
"""Characters of the shortest line; a narrower terminal wraps it."""
COLOUR = {"good": "green", "bad": "red", "open": "magenta", "part": "yellow"}
WORDS = ("text", "code_inline")
"""Kinds of nodes whose content is shown."""
NARROW = 16
"""Characters below which a column of text is not narrowed."""
GAP = "  "
MARK_OF = {sign: mark for mark, sign in MARKS.items() if mark}


class Section(NamedTuple):
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


def read_page(report: Path) -> list[Section]:
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


def read_sections(markdown: str) -> list[Section]:
    """The sections of a page in their order; the first is what stands above all others."""
    sections = [Section("", 1, [])]
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    for node in SyntaxTreeNode(parser.parse(markdown)).children:
        if node.type == "heading":
            sections.append(Section(_text(node), int(node.tag[1:]), []))
        else:
            sections[-1].blocks.append(node)
    return sections if sections[0].blocks or not sections[1:] else sections[1:]


def _put_answer_first(blocks: list[SyntaxTreeNode]) -> list[SyntaxTreeNode]:
    """Put the sentences of the answer that end the opening of a page below the first of them."""
    other = [number for number, block in enumerate(blocks) if block.type != "paragraph"]
    end = max(other, default=0) + 1
    return [*blocks[:1], *blocks[end:], *blocks[1:end]]


def _text(node: SyntaxTreeNode) -> str:
    """The text of a block on one line, without its markup."""
    return line("".join(inner.content for inner in node.walk() if inner.type in WORDS))


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
        Column(_text(cell), NUMBER if "right" in str(cell.attrs) else TEXT)
        for cell in head.children
    ]
    return Table.of(columns, ([_read_cell(_text(cell)) for cell in row.children] for row in rows))


def _read_cell(text: str) -> TableCell:
    words, _, sign = text.rpartition(" ")
    return TableCell(words, MARK_OF[sign]) if sign in MARK_OF else TableCell(text)


def _panels(table: Table, width: int) -> Iterator[tuple[list[int], list[int]]]:
    """Split a table into panels that fit the width, each with the first column; columns and their
    widths."""
    least, whole = zip(
        *(_extent(table, column) for column in range(len(table.columns))), strict=True
    )
    first, *rest = range(len(table.columns))
    while True:
        panel = [first]
        while rest and (len(panel) == 1 or _total([least[c] for c in [*panel, rest[0]]]) <= width):
            panel.append(rest.pop(0))
        widths = [least[c] for c in panel]
        spare = width - _total([least[c] for c in panel])
        # spare width goes to columns that are narrower than their text
        for i, column in enumerate(panel):
            more = min(max(spare, 0), whole[column] - least[column])
            widths[i] = widths[i] + more
            spare = spare - more
        if spare < 0:  # two columns alone are too wide
            widths[-1] = max(1, widths[-1] + spare)
        yield panel, widths
        if not rest:
            return


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + len(GAP) * (len(widths) - 1)


def _extent(table: Table, column: int) -> tuple[int, int]:
    """The smallest width of a column, and the one at which nothing in it is wrapped."""
    head = table.columns[column].head
    cells = [len(row[column].display) for row in table.rows]
    word = max((len(w) for w in head.split()), default=0)
    longest = max([*cells, word])
    least = (
        longest
        if table.columns[column].kind == NUMBER
        else max(min(longest, NARROW), min(word, NARROW))
    )
    return least, max(longest, min(len(head), 2 * longest))


def _panel(table: Table, columns: Sequence[int], widths: Sequence[int]) -> Iterator[str]:
    """The lines of some columns of a table: heads, which stand on the lowest of their lines, a
    rule, and rows."""
    heads = [textwrap.wrap(table.columns[c].head, w) for c, w in zip(columns, widths, strict=True)]
    deepest = max(map(len, heads))
    kinds = [table.columns[c].kind for c in columns]
    yield from _lines(
        kinds, widths, [[""] * (deepest - len(h)) + h for h in heads], [""] * len(columns)
    )
    yield GAP.join("─" * w for w in widths)
    for row in table.rows:
        cells = [row[c] for c in columns]
        wrapped = [textwrap.wrap(cell.display, w) for cell, w in zip(cells, widths, strict=True)]
        yield from _lines(kinds, widths, wrapped, [cell.mark for cell in cells])


def _lines(
    kinds: Sequence[str], widths: Sequence[int], wrapped: Sequence[list[str]], marks: Sequence[str]
) -> Iterator[str]:
    for pieces in zip_longest(*wrapped, fillvalue=""):
        shown = []
        for piece, kind, width, mark in zip(pieces, kinds, widths, marks, strict=True):
            room = " " * (width - len(piece))
            styled = click.style(piece, fg=COLOUR[mark]) if mark and piece else piece
            shown.append(room + styled if kind == NUMBER else styled + room)
        yield GAP.join(shown).rstrip()


def _select(sections: Sequence[Section], words: str) -> list[Section]:
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


@click.command()
@click.argument("report", type=shared.PATH)
@click.option(
    "--section",
    default=None,
    metavar="NAME",
    help="Only the sections whose title contains these words.",
)
@shared.whole("width", None, "Characters of a line. [default: the terminal's]")
def show(report: Path, section: str | None, width: int | None) -> None:
    """Show a report on the terminal.

    The page in the folder REPORT: the answer, the tables, and what repeats it.

    Exit codes: 0 shown; 2 no report is there.
    """
    sections = read_page(report)
    terminal = max(shutil.get_terminal_size().columns, NARROWEST)
    columns = terminal if width is None else count("width", width, least=NARROWEST)
    if section is not None:
        titles = [one.title for one in sections if one.level > 1]
        sections = _select(sections, section)
        if not sections:
            raise InputError("section", section, nearest(section, titles))
    else:
        sections[0] = sections[0]._replace(blocks=_put_answer_first(sections[0].blocks))
    lines = (row for one in sections for row in one.lines(columns))
    text = "\n".join(lines).rstrip("\n")
    with apart_from_bars():
        click.echo(text, color=False if os.environ.get("NO_COLOR") else None)


@click.command()
@shared.SCENE
@shared.real("sigma", "Noise intensity. [default: the scene's; 0.1 on DAT21]")
@shared.whole("impacts", 24, "Impacts of the noise-free orbit to show, 1 to 200.")
@shared.SEED
@click.option(
    "--out",
    type=shared.PATH,
    default=None,
    help="HTML file. [default: reports/NAME-animation.html]",
)
@click.option("--overwrite", is_flag=True, help="Replace an earlier animation of that name.")
def animate(
    scene: Path | None,
    sigma: float | None,
    impacts: int,
    seed: int,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Draw the moving wheels of a scene in one HTML file.

    The noise-free orbit beside one noisy path. SCENE is a TOML file, DAT21 if none is given. The
    file has less than 1 MB and needs no other; open it in any browser.

    Exit codes: 0 written; 2 bad input.
    """
    from rattle.compare.animation.page import check_file, write_animation
    from rattle.compare.animation.record import check_recording, record
    from rattle.compare.report.provenance import command_line

    base = load_scene(scene, sigma, 0.1)
    check_recording(base, impacts, seed)
    name = name_of(scene) if scene else "DAT21"
    out = out or Path(f"{default_place(name, '-animation')}.html")
    check_file(out, overwrite)
    shown = record(base, impacts=impacts, seed=seed)
    write_animation(out, shown, name, command_line(sys.argv[1:]), overwrite)
    say(f"Animation: {out} ({out.stat().st_size / 1e3:.0f} kB): {shown.sentence}")


def template(name: str) -> str:
    """Text of a scene file with DAT21's values."""
    text = (
        files("rattle.compare.cli").joinpath("templates", "gears.toml").read_text(encoding="utf-8")
    )
    return text.replace("NAME", line(name))


@click.command()
@click.argument("file", type=shared.PATH, default=Path("gears.toml"))
def init(file: Path) -> None:
    """Write a scene file to start from, with comments.

    Every key has its unit, its meaning and the value of DAT21. FILE is gears.toml if none is given;
    an existing file is never replaced.

    Exit codes: 0 written; 2 not.
    """
    text = template(file.name)
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise OutputError(f"{file}: exists already; give another name") from None
    first = f"rattle simulate {file} --paths 10000 --units physical"
    say(
        f"{file}: a gear pair to change; then: rattle stationary {file}; the first impacts, in"
        f" seconds: {first}"
    )


@click.command()
@click.argument("measured", type=shared.PATH, metavar="SCENE")
@shared.folder_options("reports/NAME-drive", shared.JSON_ALONE)
def drive(measured: Path, **written: Any) -> None:
    """Show the measured drive of a scene file.

    SCENE is a TOML file whose table [drive] has a file: its orders, its noise with an interval, and
    what is left out.
    """
    results = Results(name_of(measured), page="drive", module="report.drive", **written)
    base = load_scene(measured, None)
    data = find_measured(read_toml(read_text("scene file", measured)), measured.parent)
    if not isinstance(data.get("drive"), Mapping):
        raise InputError(
            "drive",
            str(measured),
            "has no measured drive; give a scene file with [drive] and file = ...",
        )
    found = read_measured(data)
    facts = {
        k: v
        for k, v in vars(found).items()
        if k not in ("cycle", "spread", "sum_of_orders", "drive")
    }
    said = [*found.answer, f"sigma of this scene: {base.sigma:.4g} with alpha = {base.alpha:.4g}."]
    results.write(found, scene=base.to_dict(), file=str(data["drive"]["file"]))
    results.say(said, lambda: facts | {"answer": said})
