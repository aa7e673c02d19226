"""The command ``rattle boundary``."""

from pathlib import Path
from typing import Any

import click

from rattle.compare.cli.shared import (
    OVERWRITE,
    SCENE,
    SCHEDULER,
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
@click.option("--and", "along", metavar="NAME", help="A second parameter: trace the boundary over both.")
@click.option(
    "--reach", nargs=2, type=float, metavar="LOW HIGH", help="Its range. [default: half its value to twice it]"
)
@whole("values", 9, "How many values of it.")
@SCHEDULER
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
    along: str | None,
    reach: tuple[float, float] | None,
    values: int,
    scheduler: str | None,
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

    It is accurate up to one value and shown wrong from another. With --and: at each value of a second parameter, a map.
    With --quantity: where a quantity of the long run crosses a level. SCENE is a TOML file, DAT21 if none is given.
    Results are stored in OUT-cells: after an interruption the same command continues.
    """
    from rattle.compare.boundary.boundary import boundary as find
    from rattle.compare.boundary.crossing import crossing
    from rattle.compare.boundary.map import boundary_map
    from rattle.compare.boundary.page import CONTENTS, write_boundary
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.compare.study.cluster import check_address, silence

    base = load_scene(scene, sigma)
    if quantity is not None and closure is not None:
        raise InputError("quantity", quantity, "takes the place of a closure; give one of them")
    if (quantity is None) != (level is None):
        raise InputError("level", level, "goes with --quantity; give both or none")
    if along is not None and quantity is not None:
        raise InputError("quantity", quantity, "does not go with --and, which maps a closure")
    if along is not None and budget is not None:
        raise InputError("budget", budget, "does not go with --and: interrupt a map, and the same command continues it")
    if along is None and (reach or scheduler) is not None:
        raise InputError("reach" if reach else "scheduler", reach or scheduler, "goes with --and")
    if scheduler is not None:
        check_address(scheduler)
        silence()
    writes = out is not None or not as_json
    name, out = results_folder(scene, out, "-boundary", CONTENTS, overwrite, writes)
    settings: dict[str, Any] = {"over": over, "between": between, "points": points, "width": width}
    settings |= {"quantity": quantity, "level": level} if quantity else {"closure": closure or "saltation"}
    settings |= {} if quantity else {"impacts": impacts}
    watch = Stopwatch()
    cells = out.with_name(f"{out.name}-cells") if writes else None  # beside the report, which is replaced as a whole
    if along is None:
        settings |= {"budget": budget}
        search = find if quantity is None else crossing
        found: Any = search(base, **settings, folder=cells, rng=seed, workers=workers, progress="boundary")
    else:
        settings |= {"along": along, "reach": reach, "values": values}
        found = boundary_map(
            base, **settings, folder=cells, rng=seed, workers=workers, scheduler=scheduler, progress=True
        )
    if writes:
        record = {"name": name, "scene": base.to_dict(), **settings, "seed": seed, **provenance(watch)}
        write_boundary(out, found, record, overwrite)
    if as_json:
        say_json(found.to_dict() | {"report": out if writes else None})
    else:
        say_lines((*found.answer, f"Page: {out / 'boundary.html'}"))
