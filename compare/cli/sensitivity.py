"""The command ``rattle sensitivity``."""

from pathlib import Path
from typing import Any

import click

from rattle.compare.cli.shared import (
    CLOSURES,
    OVERWRITE,
    SCENE,
    SIGMA,
    WORKERS,
    ClosureName,
    folder,
    json_flag,
    load_scene,
    real,
    results_folder,
    say_json,
    say_lines,
    several,
    whole,
)
from rattle.scene.errors import InputError

EXIT_NOT_MET = 3


@click.command()
@SCENE
@SIGMA
@several("quantity", "quantities", str, "Quantity; repeatable. [default: energy, impacts and speeds, by mesh]")
@several("parameter", "parameters", str, "Parameter; repeatable. [default: all]")
@click.option(
    "--closure", type=ClosureName("closure", CLOSURES), help="In place of quantities: judge what it predicts."
)
@whole("impacts", 4, "Impacts at which a closure is judged.")
@whole("paths", 16_384, "Simulated paths beside a closure, for each change.")
@real("accuracy", "Half width of the widest 95 % interval of an effect of 1 %.", 0.001)
@real("slow", "Speed below which an impact is slow.", 0.1)
@real("budget", "Processor seconds after which no more runs are begun.")
@whole("seed", 0, "Seed.")
@WORKERS
@folder("reports/NAME-sensitivity")
@OVERWRITE
@json_flag("everything")
def sensitivity(
    scene: Path | None,
    sigma: float | None,
    quantities: tuple[str, ...],
    parameters: tuple[str, ...],
    closure: str | None,
    impacts: int,
    paths: int,
    accuracy: float,
    slow: float,
    budget: float | None,
    seed: int,
    workers: int,
    out: Path | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Find which parameter changes the rattle, and by how much.

    Impacts a second, energy and speeds for 1 % more of every value of the gears. With --closure: what it says of the
    section means and sds of the first impacts, beside a simulation. SCENE is a TOML file, DAT21 if none is given.

    Exit codes: 0 done; 2 bad input, or no stationary motion was reached; 3 the intervals are wider than asked for.
    """
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.compare.sensitivity.of_closure import closure_sensitivity
    from rattle.compare.sensitivity.page import CONTENTS, write_closure_sensitivity, write_sensitivity
    from rattle.compare.sensitivity.sensitivity import sensitivity as measure

    base = load_scene(scene, sigma)
    if closure is not None and quantities:
        raise InputError("closure", closure, "takes the place of --quantity; give one of them")
    writes = out is not None or not as_json
    name, out = results_folder(scene, out, "-sensitivity", CONTENTS, overwrite, writes)
    common: dict[str, Any] = {"parameters": parameters or None, "rng": seed, "workers": workers}
    settings: dict[str, Any] = {"accuracy": accuracy, "slow": slow, "budget": budget}
    if closure is not None:
        settings = {"closure": closure, "impacts": impacts, "paths": paths}
    watch, reached = Stopwatch(), True
    record = {"name": name, "scene": base.to_dict(), **settings, "seed": seed}
    if closure is not None:
        judged = closure_sensitivity(base, **settings, **common, progress="sensitivity")
        facts, said = judged.to_dict(), judged.answer
        if writes:
            write_closure_sensitivity(out, judged, record | provenance(watch), overwrite)
    else:
        found = measure(base, quantities=quantities or None, **settings, **common, progress="sensitivity")
        facts, said, reached = found.to_dict(), [*found.answer, found.said], found.reached
        if writes:
            write_sensitivity(out, found, record | provenance(watch), overwrite)
    if as_json:
        say_json(facts | {"report": out if writes else None})
    else:
        say_lines((*said, f"Page: {out / 'sensitivity.html'}"))
    if not reached:
        raise click.exceptions.Exit(EXIT_NOT_MET)
