"""The command ``rattle simulate``."""

import logging
import math
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rattle.compare.cli.console import say, say_json
from rattle.compare.cli.load import load_scene
from rattle.compare.cli.options import SCHEMES, WHOLE, Name
from rattle.scene.errors import InputError
from rattle.scene.units import RATE, UNITS, check_units, in_units

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rattle.scene import Gears

EXIT_NOT_MET = 3
AN_HOUR = "what is expected to take more than an hour is refused"


@click.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", type=float, default=None, help="Noise intensity. [default: the scene's; sqrt(alpha) on DAT21]")
@click.option("--impacts", type=WHOLE, default=12, show_default=True, help="Impacts after the start.")
@click.option(
    "--accuracy",
    type=float,
    default=None,
    help="Error bound of all means and sds, in sds, with 95 % probability. [default: 0.01]",
)
@click.option("--paths", type=WHOLE, default=None, help="Number of paths, in place of an accuracy.")
@click.option(
    "--dt", type=float, default=None, help="Step, with --paths. [default: the scheme's, 0.002 for Euler-Maruyama]"
)
@click.option(
    "--scheme",
    type=Name("scheme", SCHEMES),
    default=None,
    help="Scheme. [default: what costs least; exact-flight with --paths]",
)
@click.option(
    "--step-bias/--no-step-bias",
    default=True,
    show_default=True,
    help="Measure the bias of an Euler-Maruyama step, with --paths (two thirds more work).",
)
@click.option(
    "--budget",
    type=float,
    default=None,
    help=f"Processor seconds that an accuracy may take, all threads together. [default: {AN_HOUR}]",
)
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option(
    "--units",
    type=Name("units", UNITS),
    default="dimensionless",
    show_default=True,
    help="Units of the tables; physical: ms, mm, mm/s and impacts per second, for a scene with [gears].",
)
@click.option("--out", type=click.Path(path_type=Path), default=None, help="CSV file of the whole section table.")
@click.option("--json", "as_json", is_flag=True, help="Print the section table and the settings as JSON.")
def simulate(
    scene: Path | None,
    sigma: float | None,
    impacts: int,
    accuracy: float | None,
    paths: int | None,
    dt: float | None,
    scheme: str | None,
    step_bias: bool,
    budget: float | None,
    seed: int,
    workers: int,
    units: str,
    out: Path | None,
    as_json: bool,
) -> None:
    """Simulate a scene and print its moments at each impact.

    SCENE is a TOML file, DAT21 if none is given. With --accuracy the expected time is printed before the work starts.

    Exit codes: 0 done; 2 bad input, or an accuracy that would take too long; 3 the budget ended before the accuracy was
    reached.
    """
    from rattle.compare.report.folder import write_whole
    from rattle.montecarlo import Record, simulate, simulate_to

    base = load_scene(scene, sigma)
    check_units(units, base.gears)
    if out is not None and not out.parent.is_dir():
        raise InputError("out", str(out), f"the folder {out.parent} does not exist; make it first")
    if out is not None and (out.is_dir() or not os.access(out.parent, os.W_OK)):
        raise InputError("out", str(out), "cannot be written; give the name of a file")
    common: dict[str, Any] = {"impacts": impacts, "rng": seed, "workers": workers, "progress": "simulate"}
    if paths is not None and accuracy is None:
        recorded = None if step_bias else Record(step_bias=False)
        run = simulate(base, paths=paths, dt=dt, scheme=scheme or "exact-flight", record=recorded, **common)
    else:
        accuracy = 0.01 if accuracy is None else accuracy
        for name, value in (("paths", paths), ("dt", dt)):
            if value is not None:
                raise InputError(name, value, "is chosen by --accuracy; leave out one of them")
        with _estimates_shown():
            run = simulate_to(base, accuracy, scheme=scheme, budget=budget, **common)
    reach = run.reach
    if as_json:
        record = {
            "scheme": run.scheme,
            "dt": run.dt,
            "paths": run.paths,
            "seconds": round(run.wall_seconds, 3),
            "reach": None if reach is None else reach.sentence,
            "diagnostics": run.diagnostics,
            "units": units,
            "section": run.section_in(units).reset_index().to_dict("records"),
        }
        say_json(record)
    else:
        say(_table(in_units(run.columns, base.gears, units), columns_in(units, base.gears)), keep="\n")
        say(f"{run.paths:,} paths, {run.scheme}, dt = {run.dt:.4g}, {run.wall_seconds:.1f} s on {workers} threads")
        if reach is not None and reach.reached:  # else it is among the diagnostics
            say(reach.sentence)
        for sentence in run.diagnostics:
            say(sentence)
    if out is not None:  # last, so that the results have been printed if the file cannot be written
        from rattle.compare.report.csv_text import csv_text

        write_whole(out, csv_text(run.section_in(units)))
    if reach is not None and not reach.reached:
        raise click.exceptions.Exit(EXIT_NOT_MET)


class _OnStderr(logging.Handler):
    """Log handler that prints each record as a line on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        say(self.format(record), err=True)


@contextmanager
def _estimates_shown() -> "Iterator[None]":
    """Context in which estimates of the time are printed, and the warning of a missed accuracy is not.

    The command itself prints that the accuracy was not reached.
    """
    from rattle.montecarlo import AccuracyWarning
    from rattle.montecarlo.accuracy.simulate_to import ESTIMATES

    handler, level = _OnStderr(), ESTIMATES.level
    ESTIMATES.addHandler(handler)
    ESTIMATES.setLevel(logging.INFO)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            yield
    finally:
        ESTIMATES.removeHandler(handler)
        ESTIMATES.setLevel(level)


FORMS = {"se_": ".2g", "bias_": ".2g", "sd_": ".4g"}
"""How columns are printed whose names begin so: errors may be far smaller than what they belong to."""
SHOWN = (
    "tau",
    "se_tau",
    "bias_tau",
    "sd_tau",
    "y1",
    "se_y1",
    "bias_y1",
    "sd_y1",
    "y2",
    "se_y2",
    "bias_y2",
    "sd_y2",
    "mesh",
    "side",
    "agreement",
)


def columns_in(units: str, gears: "Gears | None") -> tuple[str, ...]:
    """Names of the columns that are shown on a terminal, in a system of units."""
    if units == "dimensionless" or gears is None:
        return SHOWN
    names = [gears.units.columns_of.get(name, (name, 1.0))[0] for name in SHOWN]
    return (names[0], RATE, *names[1:])


def _table(columns: "Mapping[str, NDArray[Any]]", shown: tuple[str, ...]) -> str:
    """The columns shown on a terminal, without absent and empty ones; pandas would take as long to load as sampling."""
    texts = [["impact", *(str(k) for k in range(1, len(columns["mesh"]) + 1))]]
    for name in (name for name in shown if name in columns):
        values = columns[name].tolist()
        if not all(math.isnan(v) for v in values):
            form = next((form for start, form in FORMS.items() if name.startswith(start)), ".5f")
            texts.append([name, *(format(v, form) if isinstance(v, float) else str(v) for v in values)])
    wide = [max(map(len, text)) for text in texts]
    return "\n".join(
        "  ".join(cell.rjust(w) for cell, w in zip(line, wide, strict=True)) for line in zip(*texts, strict=True)
    )
