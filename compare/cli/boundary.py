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


@click.command()
@SCENE
@SIGMA
@click.option("--closure", default="saltation", show_default=True, metavar="NAME", help="Closure.")
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
    closure: str,
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

    It is accurate up to one value and shown wrong from another. SCENE is a TOML file, DAT21 if none is given. Results
    are stored in OUT-cells: after an interruption the same command continues.
    """
    from rattle.compare.boundary.boundary import boundary as find
    from rattle.compare.boundary.page import CONTENTS, write_boundary
    from rattle.compare.report.provenance import Stopwatch, provenance

    base = load_scene(scene, sigma)
    writes = out is not None or not as_json
    name, out = results_folder(scene, out, "-boundary", CONTENTS, overwrite, writes)
    settings: dict[str, Any] = {"closure": closure, "over": over, "between": between, "impacts": impacts}
    settings |= {"points": points, "width": width, "budget": budget}
    watch = Stopwatch()
    cells = out.with_name(f"{out.name}-cells") if writes else None  # beside the report, which is replaced as a whole
    found = find(base, **settings, folder=cells, rng=seed, workers=workers, progress="boundary")
    if writes:
        record = {"name": name, "scene": base.to_dict(), **settings, "seed": seed, **provenance(watch)}
        write_boundary(out, found, record, overwrite)
    if as_json:
        say_json(found.to_dict() | {"report": out if writes else None})
    else:
        say_lines((*found.answer, f"Page: {out / 'boundary.html'}"))
