"""The commands ``rattle show``, ``rattle animate``, ``rattle drive`` and ``rattle init``."""

import os
import shutil
import sys
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import click

from rattle.compare.cli import shared
from rattle.compare.cli.shared import Results, load_scene, say
from rattle.compare.report.folder import default_place, name_of
from rattle.scene import InputError, OutputError, count, line, nearest
from rattle.scene.files import read_text, read_toml
from rattle.scene.gears_input import find_measured, read_measured
from rattle.scene.progress import apart_from_bars
from rattle.scene.types import MOST_WHEELS

NARROWEST_LINE = 20
"""Characters of the shortest line; a narrower terminal wraps it."""


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
    from rattle.compare.cli.terminal import put_answer_first, read_page, select

    sections = read_page(report)
    terminal = max(shutil.get_terminal_size().columns, NARROWEST_LINE)
    columns = terminal if width is None else count("width", width, least=NARROWEST_LINE)
    if section is not None:
        titles = [one.title for one in sections if one.level > 1]
        sections = select(sections, section)
        if not sections:
            raise InputError("section", section, nearest(section, titles))
    else:
        sections[0] = put_answer_first(sections[0])
    lines = (row for one in sections for row in one.lines(columns))
    text = "\n".join(lines).rstrip("\n")
    with apart_from_bars():
        click.echo(text, color=False if os.environ.get("NO_COLOR") else None)


@click.command()
@shared.SCENE_ARGUMENT
@shared.real("sigma", "Noise intensity. [default: the scene's; 0.1 on DAT21]")
@shared.whole("periods", None, "Periods to show, after the transient, 1 to 60. [default: 4]")
@shared.whole("impacts", None, "In place of it: the first impacts after the start.")
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
    out: Path | None,
    overwrite: bool,
    **asked: Any,
) -> None:
    """Draw the moving wheels or bodies of a scene in one HTML file.

    The noise-free orbit beside one noisy path that starts with it. SCENE is a TOML file, DAT21 if
    none is given. The file has less than 1 MB and needs no other; open it in any browser.

    Exit codes: 0 written; 2 bad input.
    """
    from rattle.compare.animation.page import check_file, write_animation
    from rattle.compare.animation.record import check_recording, record
    from rattle.compare.report.provenance import command_line

    base = load_scene(scene, sigma, 0.1)
    check_recording(base, **asked)
    name = shared.name_scene(scene)
    out = out or Path(f"{default_place(name, '-animation')}.html")
    check_file(out, overwrite)
    shown = record(base, **asked)
    write_animation(out, shown, name, command_line(sys.argv[1:]), overwrite)
    say(f"Animation: {out} ({out.stat().st_size / 1e3:.0f} kB): {shown.sentence}")


SYSTEMS = {
    "ball": "a ball on a shaking table",
    "oscillator": "an impact oscillator",
    "pair": "an impact pair",
}
"""Systems beyond gears of which there is a file to start from, which is one of examples/."""


def template(name: str, wheels: int | None = None, system: str | None = None) -> str:
    """Text of a scene file: DAT21's pair, a shaft and the loose wheels that it drives, or another
    system."""
    folder = files("rattle.compare.cli").joinpath("templates")
    if system is not None:
        example = "impact-pair" if system == "pair" else system
        text = folder.joinpath(f"{system}.toml").read_text(encoding="utf-8")
        return text.replace(f"{example}.toml", line(name))
    texts = {
        part: folder.joinpath(f"{part}.toml").read_text(encoding="utf-8")
        for part in ("gears", "gearbox", "wheel")
    }
    if wheels is None:
        return texts["gears"].replace("NAME", line(name))
    text = texts["gearbox"].replace("NAME", line(name))
    for number in range(2, wheels + 1):
        # mm: from the lowest gear to the highest, at one distance of the shafts
        parent_radius = 19.0 + 27.0 * (number - 2) / max(wheels - 2, 1)
        radius = 77.0 - parent_radius
        # kg mm^2 of a steel wheel some 20 mm wide; N mm
        inertia = 4e-4 * radius**4
        torque = radius
        text += texts["wheel"].format(
            number=number - 1,
            parent_radius=parent_radius,
            radius=radius,
            inertia=inertia,
            torque=torque,
        )
    return text


@click.command()
@click.argument("file", type=shared.FILE_PATH, required=False)
@shared.whole("wheels", None, "Loose wheels: a gearbox in place of the pair; 1 to 32.")
@shared.name_option("system", list(SYSTEMS), "No gears: another system with impacts.")
def init(file: Path | None, wheels: int | None, system: str | None) -> None:
    """Write a scene file to start from, with comments.

    Every key has its unit, its meaning and a value: those of DAT21, with --wheels those of a
    made-up gearbox, with --system those of a ball, an oscillator or an impact pair. FILE is
    gears.toml if none is given, or ball.toml and so on; an existing file is never replaced.

    Exit codes: 0 written; 2 not.
    """
    if wheels is not None:
        count("wheels", wheels, most=MOST_WHEELS)
    if wheels is not None and system is not None:
        raise InputError("wheels", wheels, "goes without --system; give one of them")
    file = file or Path(f"{system or 'gears'}.toml")
    text = template(file.name, wheels, system)
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise OutputError(f"{file}: exists already; give another name") from None
    first = f"rattle simulate {file} --paths 10000"
    if system is not None:
        what = SYSTEMS[system]
        impacts = f"the first impacts: {first}"
    else:
        what = "a gear pair" if wheels is None else "a gearbox"
        impacts = f"the first impacts, in seconds: {first} --units physical"
    say(f"{file}: {what} to change; then: rattle stationary {file}; {impacts}")


@click.command()
@click.argument("measured", type=shared.FILE_PATH, metavar="SCENE")
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
    measurement = read_measured(data)
    facts = {
        k: v
        for k, v in vars(measurement).items()
        if k not in ("cycle", "spread", "sum_of_orders", "drive")
    }
    sentences = [
        *measurement.answer,
        f"sigma of this scene: {base.sigma:.4g} with alpha = {base.alpha:.4g}.",
    ]
    results.write(measurement, scene=base.to_dict(), file=str(data["drive"]["file"]))
    results.say(sentences, lambda: facts | {"answer": sentences})
