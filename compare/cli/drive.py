"""The command ``rattle drive``."""

from collections.abc import Mapping
from pathlib import Path

import click

from rattle.compare.cli.shared import (
    OVERWRITE,
    PATH,
    folder,
    json_flag,
    load_scene,
    results_folder,
    say_json,
    say_lines,
)
from rattle.scene.errors import InputError


@click.command()
@click.argument("measured", type=PATH, metavar="SCENE")
@folder("reports/NAME-drive")
@OVERWRITE
@json_flag("everything")
def drive(measured: Path, out: Path | None, overwrite: bool, as_json: bool) -> None:
    """Show the measured drive of a scene file.

    SCENE is a TOML file whose table [drive] has a file: its orders, its noise with an interval, and what is left out.
    """
    from rattle.compare.measured_drive import CONTENTS, write_drive
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.scene.files import read_text, read_toml
    from rattle.scene.gears_input import find_measured, read_measured

    watch = Stopwatch()
    base = load_scene(measured, None)
    data = find_measured(read_toml(read_text("scene file", measured)), measured.parent)
    if not isinstance(data.get("drive"), Mapping):
        raise InputError("drive", str(measured), "has no measured drive; give a scene file with [drive] and file = ...")
    found = read_measured(data)
    writes = out is not None or not as_json
    name, out = results_folder(measured, out, "-drive", CONTENTS, overwrite, writes)
    facts = {k: v for k, v in vars(found).items() if k not in ("cycle", "spread", "sum_of_orders", "drive")}
    said = [*found.answer, f"sigma of this scene: {base.sigma:.4g} with alpha = {base.alpha:.4g}."]
    if writes:
        record = {"name": name, "scene": base.to_dict(), "file": str(data["drive"]["file"]), **provenance(watch)}
        write_drive(out, found, record, overwrite)
    if as_json:
        say_json(facts | {"answer": said, "report": out if writes else None})
    else:
        say_lines((*said, f"Page: {out / 'drive.html'}"))
