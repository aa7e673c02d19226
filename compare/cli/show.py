"""The commands ``rattle show``, ``rattle animate``, ``rattle drive`` and ``rattle init``."""

import os
import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from itertools import zip_longest
from pathlib import Path
from typing import Any

import click

from rattle.compare.cli import shared
from rattle.compare.cli.shared import Results, load_scene, say
from rattle.compare.report import (
    NUMBER,
    Block,
    Code,
    Figure,
    Glossary,
    Page,
    PageSection,
    Table,
    Text,
    parts,
)
from rattle.compare.report.folder import default_place, name_of
from rattle.compare.report.json_text import NAME, read_page
from rattle.scene import FileError, InputError, OutputError, count, harmless, line, nearest
from rattle.scene.files import read_text, read_toml
from rattle.scene.gears_input import find_measured, read_measured
from rattle.scene.progress import apart_from_bars

NARROWEST_LINE = 20
"""Characters of the shortest line; a narrower terminal wraps it."""
COLOUR = {"good": "green", "bad": "red", "open": "magenta", "part": "yellow"}
NARROWEST_COLUMN = 16
"""Characters below which a column of text is not narrowed."""
GAP = "  "


def page_lines(page: Page, width: int) -> Iterator[str]:
    """The lines of a page."""
    source = page.source
    origin = (
        Text("Repeat it:"),
        Code(line(source.repeat)),
        Glossary("", source.facts),
        *source.blocks,
    )
    sections = (*page.sections, PageSection("Where this comes from", origin))
    yield from section_lines(
        PageSection(page.title, (*map(Text, page.answer), *page.blocks), sections), width, 1
    )


def section_lines(section: PageSection, width: int, level: int = 2) -> Iterator[str]:
    """The lines of a section and its subsections."""
    yield from (*_bold(section.title, width, underline=level < 3 or None), "")
    for block in section.blocks:
        yield from _block(block, width)
    for inner in section.sections:
        yield from section_lines(inner, width, level + 1)


def _words(text: str) -> str:
    return "".join(piece for piece, _ in parts(line(text)))


def _bold(text: str, width: int, **style: Any) -> Iterator[str]:
    yield from (click.style(row, bold=True, **style) for row in textwrap.wrap(_words(text), width))


def _block(block: Block, width: int) -> Iterator[str]:
    match block:
        case Text(text):
            yield from textwrap.wrap(_words(text), width)
        case Figure(path, caption):
            yield from textwrap.wrap(_words(f"[{path}] {caption}"), width)
        case Glossary(title, terms):
            yield from _bold(title, width)
            for term, meaning in terms:
                yield from textwrap.wrap(
                    f"{_words(term)}: {_words(meaning)}", width, subsequent_indent="    "
                )
        case Code(text):
            yield from ("    " + row for row in harmless(text).expandtabs().splitlines())
        case Table():
            yield from _bold(block.summary, width)
            for number, (columns, widths) in enumerate(_panels(block, width)):
                yield from [""] * bool(number)
                yield from _panel(block, columns, widths)
    yield ""


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
    head = _words(table.columns[column].head)
    cells = [len(_words(row[column].display)) for row in table.rows]
    word = max((len(w) for w in head.split()), default=0)
    longest = max([*cells, word])
    least = (
        longest
        if table.columns[column].kind == NUMBER
        else max(min(longest, NARROWEST_COLUMN), min(word, NARROWEST_COLUMN))
    )
    return least, max(longest, min(len(head), 2 * longest))


def _panel(table: Table, columns: Sequence[int], widths: Sequence[int]) -> Iterator[str]:
    """The lines of some columns of a table: heads, which stand on the lowest of their lines, a
    rule, and rows."""
    heads = [
        textwrap.wrap(_words(table.columns[c].head), w)
        for c, w in zip(columns, widths, strict=True)
    ]
    deepest = max(map(len, heads))
    kinds = [table.columns[c].kind for c in columns]
    yield from _lines(
        kinds, widths, [[""] * (deepest - len(h)) + h for h in heads], [""] * len(columns)
    )
    yield GAP.join("─" * w for w in widths)
    for row in table.rows:
        cells = [row[c] for c in columns]
        wrapped = [
            textwrap.wrap(_words(cell.display), w) for cell, w in zip(cells, widths, strict=True)
        ]
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


@click.command()
@click.argument("report", type=shared.FILE_PATH)
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
    path = report / NAME if report.is_dir() else report
    if report.is_dir() and not path.exists():
        why = (
            f"holds no {NAME}; give a folder into which this version of rattle has written a report"
        )
        raise FileError("report", str(report), why)
    page = read_page(path)
    terminal = max(shutil.get_terminal_size().columns, NARROWEST_LINE)
    columns = terminal if width is None else count("width", width, least=NARROWEST_LINE)
    if section is None:
        lines = page_lines(page, columns)
    else:
        titles = [line(s.title) for s in page.all_sections()]
        found = [s for s in page.all_sections() if section.casefold() in line(s.title).casefold()]
        if not found:
            raise InputError("section", section, nearest(section, titles))
        lines = (row for s in found for row in section_lines(s, columns))
    text = "\n".join(lines).rstrip("\n")
    with apart_from_bars():
        click.echo(text, color=False if os.environ.get("NO_COLOR") else None)


@click.command()
@shared.SCENE_ARGUMENT
@shared.real("sigma", "Noise intensity. [default: the scene's; 0.1 on DAT21]")
@shared.whole("impacts", 24, "Impacts of the noise-free orbit to show, 1 to 200.")
@shared.SEED_OPTION
@click.option(
    "--out",
    type=shared.FILE_PATH,
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
@click.argument("file", type=shared.FILE_PATH, default=Path("gears.toml"))
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
@click.argument("measured", type=shared.FILE_PATH, metavar="SCENE")
@shared.folder_options("reports/NAME-drive", shared.JSON_ALONE)
def drive(measured: Path, **written: Any) -> None:
    """Show the measured drive of a scene file.

    SCENE is a TOML file whose table [drive] has a file: its orders, its noise with an interval, and
    what is left out.
    """
    results = Results(name_of(measured), suffix="-drive", page="report.save:write_drive", **written)
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
    results.say(said, "drive.html", lambda: facts | {"answer": said})
