"""The command ``rattle sensitivity``."""

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
    several,
    whole,
)

EXIT_NOT_MET = 3


@click.command()
@SCENE
@SIGMA
@several("quantity", "quantities", str, "Quantity; repeatable. [default: energy, impacts and speeds, by mesh]")
@several("parameter", "parameters", str, "Parameter; repeatable. [default: all]")
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

    Impacts a second, energy and speeds for 1 % more of every value of the gears. SCENE is a TOML file, DAT21 if none
    is given.

    Exit codes: 0 done; 2 bad input, or no stationary motion was reached; 3 the intervals are wider than asked for.
    """
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.compare.sensitivity.page import CONTENTS, write_sensitivity
    from rattle.compare.sensitivity.sensitivity import sensitivity as measure

    base = load_scene(scene, sigma)
    writes = out is not None or not as_json
    name, out = results_folder(scene, out, "-sensitivity", CONTENTS, overwrite, writes)
    settings: dict[str, Any] = {"accuracy": accuracy, "slow": slow, "budget": budget}
    watch = Stopwatch()
    found = measure(
        base,
        quantities=quantities or None,
        parameters=parameters or None,
        **settings,
        rng=seed,
        workers=workers,
        progress="sensitivity",
    )
    if writes:
        record = {"name": name, "scene": base.to_dict(), **settings, "seed": seed, **provenance(watch)}
        write_sensitivity(out, found, record, overwrite)
    if as_json:
        say_json(found.to_dict() | {"report": out if writes else None})
    else:
        say_lines((*found.answer, found.said, f"Page: {out / 'sensitivity.html'}"))
    if not found.reached:
        raise click.exceptions.Exit(EXIT_NOT_MET)
