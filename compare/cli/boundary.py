"""The command ``rattle boundary``."""

from pathlib import Path
from typing import Any

import click

from rattle.compare.cli.shared import (
    OVERWRITE,
    SCENE,
    SIGMA,
    WORKERS,
    folder,
    json_flag,
    load_scene,
    real,
    results_folder,
    say_json,
    say_lines,
    whole,
)
from rattle.scene.errors import InputError


@click.command()
@SCENE
@SIGMA
@click.option("--closure", metavar="NAME", help="Closure. [default: saltation]")
@click.option("--quantity", metavar="NAME", help="In place of a closure: a quantity of the long run, with --level.")
@real("level", "Its level; impacts per second, mm/s or mW for a scene with [gears].")
@click.option("--over", default="sigma", show_default=True, metavar="NAME", help="Parameter of the gears or the scene.")
@click.option("--between", nargs=2, type=float, metavar="LOW HIGH", help="Range. [default: 0.001 2 for sigma]")
@whole("impacts", 12, "Impacts that must be accurate.")
@whole("points", 8, "Values of the first scan.")
@real("width", "Every edge is known to ± this share.", 0.1)
@real("budget", "Processor seconds after which no further value is judged.")
@whole("seed", 0, "Seed.")
@WORKERS
@folder("reports/NAME-boundary")
@OVERWRITE
@json_flag("everything")
def boundary(
    scene: Path | None,
    sigma: float | None,
    closure: str | None,
    quantity: str | None,
    level: float | None,
    over: str,
    between: tuple[float, float] | None,
    impacts: int,
    points: int,
    width: float,
    budget: float | None,
    seed: int,
    workers: int,
    out: Path | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Find where along a parameter a closure stops holding.

    It is accurate up to one value and shown wrong from another. With --quantity: where a quantity of the long run
    crosses a level. SCENE is a TOML file, DAT21 if none is given. Results
    are stored in OUT-cells: after an interruption the same command continues.
    """
    from rattle.compare.boundary.boundary import boundary as find
    from rattle.compare.boundary.crossing import crossing
    from rattle.compare.boundary.page import CONTENTS, write_boundary
    from rattle.compare.report.provenance import Stopwatch, provenance

    base = load_scene(scene, sigma)
    if quantity is not None and closure is not None:
        raise InputError("quantity", quantity, "takes the place of a closure; give one of them")
    if (quantity is None) != (level is None):
        raise InputError("level", level, "goes with --quantity; give both or none")
    writes = out is not None or not as_json
    name, out = results_folder(scene, out, "-boundary", CONTENTS, overwrite, writes)
    settings: dict[str, Any] = {"over": over, "between": between, "points": points, "width": width, "budget": budget}
    if quantity is None:
        settings |= {"closure": closure or "saltation", "impacts": impacts}
    else:
        settings |= {"quantity": quantity, "level": level}
    watch = Stopwatch()
    cells = out.with_name(f"{out.name}-cells") if writes else None  # beside the report, which is replaced as a whole
    found = (find if quantity is None else crossing)(
        base, **settings, folder=cells, rng=seed, workers=workers, progress="boundary"
    )
    if writes:
        record = {"name": name, "scene": base.to_dict(), **settings, "seed": seed, **provenance(watch)}
        write_boundary(out, found, record, overwrite)
    if as_json:
        say_json(found.to_dict() | {"report": out if writes else None})
    else:
        say_lines((*found.answer, f"Page: {out / 'boundary.html'}"))
