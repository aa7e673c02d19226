"""The command ``rattle show``."""

import os
import shutil
from pathlib import Path

import click

from rattle.compare.cli.options import WHOLE

NARROWEST = 20
"""Characters of the shortest line; a narrower terminal wraps it."""


@click.command()
@click.argument("report", type=click.Path(path_type=Path))
@click.option("--section", default=None, metavar="NAME", help="Only the sections whose title has these words in it.")
@click.option("--width", type=WHOLE, default=None, help="Characters of a line. [default: the terminal's]")
def show(report: Path, section: str | None, width: int | None) -> None:
    """Show the page in the folder REPORT on the terminal: the answer, the tables, and what repeats it.

    Exit codes: 0 shown; 2 no report is there.
    """
    from rattle.compare.cli.terminal import page_lines, section_lines
    from rattle.compare.report.page_file import NAME, read_page
    from rattle.scene.errors import FileError, InputError
    from rattle.scene.text import line
    from rattle.scene.validate import count, nearest

    path = report / NAME if report.is_dir() else report
    if report.is_dir() and not path.exists():
        why = f"holds no {NAME}; give a folder into which this version of rattle has written a report"
        raise FileError("report", str(report), why)
    page = read_page(path)
    terminal = max(shutil.get_terminal_size().columns, NARROWEST)
    columns = terminal if width is None else count("width", width, least=NARROWEST)
    if section is None:
        lines = page_lines(page, columns)
    else:
        titles = [line(s.title) for s in page.all_sections()]
        found = [s for s in page.all_sections() if section.casefold() in line(s.title).casefold()]
        if not found:
            raise InputError("section", section, nearest(section, titles))
        lines = (row for s in found for row in section_lines(s, columns))
    text = "\n".join(lines).rstrip("\n")
    click.echo(text, color=False if os.environ.get("NO_COLOR") else None)
