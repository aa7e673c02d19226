"""The commands on scene files: ``rattle init`` writes one, ``rattle drive`` shows the measured drive of one."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import click

from rattle.compare.cli.shared import JSON_ALONE, PATH, Results, folder_options, load_scene, say
from rattle.scene.errors import InputError, OutputError
from rattle.scene.text import line


def template(name: str) -> str:
    """Text of a scene file with DAT21's values.

    Examples
    --------
    >>> from rattle.scene import Scene
    >>> scene = Scene.from_toml(template("gears.toml"))
    >>> round(scene.alpha, 12), round(scene.gears.sigma_from(rms=0.03, bandwidth=50.0), 2) == scene.sigma
    (1.5, True)
    """
    text = files("rattle.compare.cli").joinpath("templates", "gears.toml").read_text(encoding="utf-8")
    return text.replace("NAME", line(name))


@click.command()
@click.argument("file", type=PATH, default=Path("gears.toml"))
def init(file: Path) -> None:
    """Write a scene file to start from, with comments.

    Every key has its unit, its meaning and the value of DAT21. FILE is gears.toml if none is given; an existing file is
    never replaced.

    Exit codes: 0 written; 2 not.
    """
    text = template(file.name)
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise OutputError(f"{file}: exists already; give another name") from None
    except OSError as error:
        raise OutputError(f"{file}: cannot be written ({error.strerror}); give another place") from None
    say(f"{file}: a gear pair to change; then: rattle simulate {file} --units physical")


@click.command()
@click.argument("measured", type=PATH, metavar="SCENE")
@folder_options("reports/NAME-drive", JSON_ALONE)
def drive(measured: Path, out: Path | None, overwrite: bool, as_json: bool) -> None:
    """Show the measured drive of a scene file.

    SCENE is a TOML file whose table [drive] has a file: its orders, its noise with an interval, and what is left out.
    """
    from rattle.compare.report.measured_drive import CONTENTS, write_drive
    from rattle.scene.files import read_text, read_toml
    from rattle.scene.gears_input import find_measured, read_measured

    results = Results(measured, out, "-drive", CONTENTS, overwrite, as_json)
    base = load_scene(measured, None)
    data = find_measured(read_toml(read_text("scene file", measured)), measured.parent)
    if not isinstance(data.get("drive"), Mapping):
        raise InputError("drive", str(measured), "has no measured drive; give a scene file with [drive] and file = ...")
    found = read_measured(data)
    facts = {k: v for k, v in vars(found).items() if k not in ("cycle", "spread", "sum_of_orders", "drive")}
    said = [*found.answer, f"sigma of this scene: {base.sigma:.4g} with alpha = {base.alpha:.4g}."]
    results.write(write_drive, found, scene=base.to_dict(), file=str(data["drive"]["file"]))
    results.say(said, "drive.html", lambda: facts | {"answer": said})
