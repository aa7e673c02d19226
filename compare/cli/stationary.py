"""The command ``rattle stationary``."""

from pathlib import Path
from typing import Any

import click

from rattle.compare.cli.console import say, say_json
from rattle.compare.cli.load import load_scene
from rattle.compare.cli.options import CLOSURES, FIELDS, WHOLE, Name
from rattle.scene.errors import InputError
from rattle.scene.units import UNITS, check_units

EXIT_NOT_MET = 3


@click.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", type=float, default=None, help="Noise intensity. [default: the scene's; sqrt(alpha) on DAT21]")
@click.option(
    "--accuracy",
    type=float,
    default=None,
    help="Relative half width of the widest 95 % interval. [default: 0.01]",
)
@click.option("--periods", type=WHOLE, default=None, help="Periods of each path, in place of an accuracy.")
@click.option(
    "--quantity",
    "quantities",
    multiple=True,
    metavar="NAME",
    help="Quantity that the accuracy is for; repeatable. [default: rate, speed, energy_per_period]",
)
@click.option("--paths", type=WHOLE, default=256, show_default=True, help="Independent paths.")
@click.option("--burn-in", type=WHOLE, default=None, help="Periods of burn-in, left out. [default: found by tests]")
@click.option("--slow", type=float, default=0.1, show_default=True, help="Speed below which an impact is slow.")
@click.option(
    "--budget",
    type=float,
    default=None,
    help="Processor seconds of the simulation, all threads together; "
    "compiling, closures and figures are not counted. [default: refused above an hour]",
)
@click.option(
    "--closure",
    "closures",
    type=Name("closures", CLOSURES),
    multiple=True,
    help="Closure to compare; repeatable. [default: all]",
)
@click.option("--no-closures", is_flag=True, help="Compare no closure.")
@click.option("--field", type=Name("field", FIELDS), default="alpha", show_default=True, help="Field of --over.")
@click.option(
    "--over", default=None, metavar="LOW:HIGH:POINTS", help="Draw a bifurcation diagram over these values of a field."
)
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option(
    "--units",
    type=Name("units", UNITS),
    default=None,
    help="Units of --json: dimensionless, or physical for a scene with [gears]. [default: dimensionless]",
)
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Folder. [default: reports/NAME-stationary]")
@click.option("--overwrite", is_flag=True, help="Replace earlier results in that folder.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON; no folder is written without --out.")
def stationary(
    scene: Path | None,
    sigma: float | None,
    accuracy: float | None,
    periods: int | None,
    quantities: tuple[str, ...],
    paths: int,
    burn_in: int | None,
    slow: float,
    budget: float | None,
    closures: tuple[str, ...],
    no_closures: bool,
    field: str,
    over: str | None,
    seed: int,
    workers: int,
    units: str | None,
    out: Path | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Measure long-run averages: impacts a second, speeds, energy.

    Each has its error. SCENE is a TOML file, DAT21 if none is given.

    Exit codes: 0 done; 2 bad input, or no stationary motion was reached; 3 the budget ended before the accuracy was
    reached.
    """
    from rattle.compare.chaos.bifurcation import stationary_bifurcation
    from rattle.compare.chaos.sweep import values, with_field
    from rattle.compare.report.folder import check_free, default_place, name_of
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.compare.stationary.measure import stationary as measure
    from rattle.compare.stationary.page import CONTENTS, write_stationary
    from rattle.compare.stationary.verdicts import CLOSURES_JUDGED
    from rattle.montecarlo.long_run.run import ASKED

    base = load_scene(scene, sigma)
    check_units(units or "dimensionless", base.gears)
    if closures and no_closures:
        raise InputError("closure", closures, "is left out by --no-closures; give one of them")
    at = () if over is None else values("over", over)
    for value in at:
        with_field(base, field, value)
    name = name_of(scene) if scene else "DAT21"
    writes = out is not None or not as_json
    out = out or default_place(name, "-stationary")
    if writes:
        check_free(out, CONTENTS, overwrite)
    settings: dict[str, Any] = {
        "accuracy": accuracy,
        "periods": periods,
        "quantities": list(quantities or ASKED),
        "paths": paths,
        "burn_in": burn_in,
        "slow": slow,
        "budget": budget,
        "closures": [] if no_closures else list(closures or CLOSURES_JUDGED),
    }
    watch = Stopwatch()
    view = stationary_bifurcation(base, at, field=field, seed=seed, workers=workers) if at else None
    found = measure(base, **settings, rng=seed, workers=workers, progress="stationary")
    record = {
        "name": name,
        "scene": base.to_dict(),
        **settings,
        "seed": seed,
        "field": field,
        "over": list(at),
        **provenance(watch),
    }
    said = write_stationary(out, found, view, record, overwrite) if writes else []
    if as_json:
        say_json(found.to_dict(units or "dimensionless") | {"report": out if writes else None})
    else:
        for sentence in said:
            say(sentence)
        say(f"Page: {out / 'stationary.html'}")
    if found.run is not None and found.run.reach is not None and not found.run.reach.reached:
        raise click.exceptions.Exit(EXIT_NOT_MET)
