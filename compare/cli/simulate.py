"""The commands ``rattle simulate``, ``rattle stationary`` and ``rattle chaos``."""

import math
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import rattle as rt
from rattle.compare.cli import shared
from rattle.compare.cli.ranges import Range
from rattle.compare.cli.shared import (
    EXIT_NOT_MET,
    SWEEP_POINTS,
    Begin,
    load_scene,
    say,
    say_json,
    say_lines,
    say_part,
)
from rattle.compare.report.folder import check_own, check_place, write_whole
from rattle.scene import InputError, Scene, positive, section_names, state_names
from rattle.scene.progress import do
from rattle.scene.units import UNITS, check_units, in_units

if TYPE_CHECKING:
    from rattle.montecarlo import Ensemble

MOST_NAMED = 8  # rows that miss an accuracy which are named
TABLE_UNITS = "Units of the tables; physical: ms, mm and mm/s, for a scene with [gears]."
JSON_UNITS = (
    "Units of --json: dimensionless, or physical for a scene with [gears]. [default: dimensionless]"
)
STEP_BIAS = "Measure the bias of an Euler-Maruyama step, with --paths (two thirds more work)."
COMPARED_HELP = "Closure to compare; repeatable. [default: all that can be applied]"
QUANTITY_HELP = (
    "Quantity that the accuracy is for; repeatable. [default: rate_above, speed_above,"
    " energy_per_period]"
)
BUDGET = (
    "Processor seconds of the simulation, all threads together; compiling, closures and figures are"
    " not counted. [default: 60; with --periods refused above an hour]"
)
STATIONARY_BUDGET = 60.0
LONG_RUN_PATHS_HELP = (
    "Independent paths. [default: 64; 80 where each is a gear set with backlashes of its own]"
)
BIFURCATION_POINTS = 24  # values of a bifurcation diagram, where a range does not say how many
RUN_UP_POINTS = 12  # speeds of a run-up, likewise
CHAOS_BUDGET_HELP = (
    "Processor seconds of all, all threads together; compiling and figures are not counted. What"
    " does not fit is made smaller, and said."
)
AN_HOUR = "an hour; beyond it the answer is what 20 s give"


@click.command()
@shared.SCENE_AND_SIGMA
@shared.whole("impacts", 12, "Impacts after the start.")
@shared.real(
    "accuracy", "Error bound of all means and sds, in sds, with 95 % probability. [default: 0.01]"
)
@shared.whole("paths", None, "Number of paths, in place of an accuracy.")
@shared.real("dt", "Step, with --paths. [default: the scheme's, 0.002 for Euler-Maruyama]")
@shared.name_option(
    "scheme", shared.SCHEME_NAMES, "Scheme. [default: what costs least; exact-flight with --paths]"
)
@click.option("--step-bias/--no-step-bias", default=True, help=STEP_BIAS)
@shared.real(
    "budget",
    f"Processor seconds that an accuracy may take, all threads together. [default: {AN_HOUR}]",
)
@shared.SEED_AND_WORKERS
@shared.name_option("units", UNITS, TABLE_UNITS, default="dimensionless")
@click.option(
    "--out", type=shared.FILE_PATH, default=None, help="CSV file of the whole section table."
)
@shared.json_flag("the section table and the settings")
def simulate(
    scene: Path | None,
    sigma: float | None,
    accuracy: float | None,
    paths: int | None,
    dt: float | None,
    scheme: str | None,
    step_bias: bool,
    budget: float | None,
    seed: int,
    units: str,
    out: Path | None,
    as_json: bool,
    **settings: int,
) -> None:
    """Simulate a scene and print its moments at each impact.

    SCENE is a TOML file, DAT21 if none is given. With --accuracy the expected time is printed
    before the work starts. Means and sds that miss the accuracy are marked with a star, and listed
    with their own bound and the reason.

    Exit codes: 0 done; 2 bad input; 3 a mean or an sd misses the accuracy.
    """
    from rattle.compare.validation.transient import describe_transient
    from rattle.montecarlo import AccuracyWarning

    base = load_scene(scene, sigma)
    check_units(units, base.gears)
    if out is not None:
        if not out.parent.is_dir():
            why = f"the folder {out.parent} does not exist; make it first"
            raise InputError("out", str(out), why)
        check_place(out)
        check_own(out, rb"\Aimpact,tau", "a table of rattle simulate")
    transient = describe_transient(base)
    if transient and not as_json:
        say(transient)
    if paths is not None and accuracy is None:
        recorded = None if step_bias else rt.Record(step_bias=False)
        sample: Any = partial(
            rt.simulate, paths=paths, dt=dt, scheme=scheme or "exact-flight", record=recorded
        )
    else:
        accuracy = 0.01 if accuracy is None else accuracy
        for name, value in (("paths", paths), ("dt", dt)):
            if value is not None:
                raise InputError(name, value, "is chosen by --accuracy; leave out one of them")
        do("simulate: pilot runs, which choose scheme, step and paths")
        sample = partial(
            rt.simulate_to, accuracy=accuracy, scheme=scheme, budget=budget, refuse=False
        )
    with (
        shared.estimates_shown(),
        warnings.catch_warnings(action="ignore", category=AccuracyWarning),
    ):
        run = sample(base, rng=seed, progress="simulating", **settings)
    if as_json:
        _say_as_json(run, units, transient)
    else:
        _say_run(run, units, settings["workers"])
    if out is not None:  # last, so that the results have been printed if the file cannot be written
        from rattle.compare.report.save import csv_text

        write_whole(out, csv_text(run.section_in(units)))
    if run.reach and not run.reach.reached:
        raise click.exceptions.Exit(EXIT_NOT_MET)


def _say_as_json(run: "Ensemble", units: str, transient: str) -> None:
    """Print the section table and the settings."""
    reach = run.reach
    say_json(
        {
            "long_run": transient or None,
            "scheme": run.scheme,
            "dt": run.dt,
            "paths": run.paths,
            "seconds": round(run.wall_seconds, 3),
            "reach": reach and reach.sentence,
            "missed": [row._asdict() for row in reach.missed] if reach else [],
            "diagnostics": run.diagnostics,
            "units": units,
            "section": run.section_in(units).reset_index().to_dict("records"),
        }
    )


def _say_run(run: "Ensemble", units: str, workers: int) -> None:
    """Print the section table, what was simulated, and the means and sds that miss the accuracy,
    the worst by name."""
    from rattle.compare.report.render import render_lines
    from rattle.compare.report.texts import name_wheels

    say(section_table(run, units), keep="\n")
    moments = 2 * len(section_names(run.scene.stages)) * len(run.columns["mesh"])
    say_lines(
        render_lines("cli/simulated.j2", run=run, workers=workers, moments=moments, most=MOST_NAMED)
    )
    say_lines(name_wheels(run.scene))


COLUMN_FORMATS = {"se_": ".2g", "bias_": ".2g", "sd_": ".4g"}
"""How columns are printed whose names begin so: errors may be far smaller than what they belong to.
"""


WIDEST_LINE = 208
"""Characters of a line of the table: two wheels in physical units, with biases; the columns of
further wheels stand below."""


def section_table(run: "Ensemble", units: str) -> str:
    """The columns shown on a terminal, without absent and empty ones, and stars at what misses the
    accuracy.

    It is laid out here, for pandas would take as long to load as sampling.
    """
    from rattle.compare.report.table import align_columns

    gears = run.scene.gears
    missed = run.reach.missed if run.reach else ()
    columns = in_units(run.columns, gears, units)
    physical = gears.units if gears is not None and units == "physical" else None
    stars = {(f"{'sd_' if row.moment == 'sd' else ''}{row.quantity}", row.impact) for row in missed}

    def write(column: str) -> Iterator[list[str]]:
        """Head and cells of a column, unless it is absent or empty."""
        name = physical.name_of(column) if physical else column
        values = columns[name].tolist() if name in columns else []
        if all(math.isnan(value) for value in values):
            return
        forms = [form for start, form in COLUMN_FORMATS.items() if name.startswith(start)]
        form = forms[0] if forms else ".5f"
        cells = [
            format(value, form) if isinstance(value, float) else str(value) for value in values
        ]
        starred = [cell + "*" * ((column, k) in stars) for k, cell in enumerate(cells, start=1)]
        yield [name, *starred]

    impacts = ["impact", *map(str, range(1, len(columns["mesh"]) + 1))]
    quantities = ["tau", *state_names(run.scene.stages)[1::2]]
    groups = [[start + name for start in ("", "se_", "bias_", "sd_")] for name in quantities]
    blocks = [[impacts]]
    for group in (*groups, ["mesh", "side", "agreement"]):
        texts = [text for column in group for text in write(column)]
        width = sum(2 + max(map(len, text)) for text in (*blocks[-1], *texts))
        if width > WIDEST_LINE:
            blocks.append([impacts])
        blocks[-1] += texts
    tables = (align_columns(list(zip(*block, strict=True)), ">" * len(block)) for block in blocks)
    return "\n\n".join(map("\n".join, tables))


@click.command()
@shared.SCENE_AND_SIGMA
@shared.real("accuracy", "Relative half width of the widest 95 % interval. [default: 0.01]")
@shared.whole("periods", None, "Periods of each path, in place of an accuracy.")
@shared.several("quantity", "quantities", str, QUANTITY_HELP)
@shared.whole("paths", None, LONG_RUN_PATHS_HELP)
@shared.whole("burn-in", None, "Periods of burn-in, left out. [default: found by tests]")
@shared.real("slow", "Speed below which an impact is slow.", 0.1)
@shared.real(
    "resolve",
    "Speed down to which impacts at closed meshes are followed; 0 for all. [default: slow / 8]",
)
@shared.real("budget", BUDGET)
@shared.closures(COMPARED_HELP)
@click.option("--no-closures", is_flag=True, help="Compare no closure.")
@shared.over("Draw a bifurcation diagram over a value of the gears or the scene.")
@shared.SEED_AND_WORKERS
@shared.name_option("units", UNITS, JSON_UNITS)
@shared.report("reports/NAME-stationary", "stationary.page", shared.JSON_ALONE)
def stationary(
    base: Scene,
    begin: Begin,
    quantities: tuple[str, ...],
    closures: tuple[str, ...],
    no_closures: bool,
    over: Range | None,
    units: str | None,
    seed: int,
    workers: int,
    **settings: Any,
) -> None:
    """Measure long-run averages: impacts a second, speeds, energy.

    Each has its error. SCENE is a TOML file, DAT21 if none is given.

    Exit codes: 0 done; 2 bad input, or no stationary motion was reached; 3 the accuracy was not
    reached: the budget ended, or only more gear sets would help.
    """
    from rattle.compare.chaos.sweep import stationary_bifurcation, vary
    from rattle.compare.stationary.verdicts import default_closures
    from rattle.montecarlo.long_run.run import ASKED
    from rattle.scene.changes import spell

    check_units(units or "dimensionless", base.gears)
    if own := [name for name in closures if ":" in name]:
        why = (
            "predicts impacts, not the long run; leave it out, or judge it by rattle validate or"
            " rattle boundary"
        )
        raise InputError("closure", own[0], why)
    if closures and no_closures:
        raise InputError("closure", closures, "is left out by --no-closures; give one of them")
    field = spell(base, over.name) if over else ""
    at = over.values(base, BIFURCATION_POINTS) if over else ()
    scenes = vary(base, field, at) if over else {}
    results = begin()
    names = ("accuracy", "periods", "paths", "burn_in", "slow", "resolve", "budget")
    settings = shared.pick(settings, *names)
    if settings["budget"] is None and settings["periods"] is None:
        settings["budget"] = STATIONARY_BUDGET
    settings["quantities"] = quantities or ASKED
    settings["closures"] = () if no_closures else closures or default_closures(base)
    if at:
        do(f"stationary: bifurcation diagram at {len(at)} values of {field}")
    view = stationary_bifurcation(scenes, field, seed=seed, workers=workers) if at else None
    with shared.estimates_shown():
        result = rt.stationary(base, **settings, rng=seed, workers=workers, progress="stationary")
    settings |= {"seed": seed, "field": field, "over": at}
    answer = results.write(result, view, **settings)
    results.say(answer, lambda: result.to_dict(units or "dimensionless"))
    if result.run and not result.run.reached:
        raise click.exceptions.Exit(EXIT_NOT_MET)


@click.command("run-up")
@shared.SCENE_AND_SIGMA
@shared.over("Mean speeds of the driver, 1/min.", "speed_rpm=600:3000:12", only="speed_rpm")
@click.option("--down", is_flag=True, help="Let the speed fall, from HIGH to LOW.")
@shared.real("seconds", "Duration of the ramp.", 10.0)
@shared.real("slow", "Speed below which an impact is slow, at the speed of the file.", 0.1)
@shared.real("budget", "Processor seconds, all threads together; compiling is not counted.", 60.0)
@shared.SEED_AND_WORKERS
@shared.report("reports/NAME-run-up", "ramp.page", shared.JSON_ALONE)
def run_up(
    base: Scene,
    begin: Begin,
    over: Range,
    down: bool,
    seed: int,
    workers: int,
    **settings: float,
) -> None:
    """Measure rattle over the speed: constant speeds, and a ramp.

    Impacts a second, power and speeds while the driver's mean speed changes slowly, beside those at
    constant speeds. SCENE is a TOML file of gears with a mean speed (speed_rpm).

    Exit codes: 0 done; 2 bad input.
    """
    from rattle.compare import run_up as measure_run_up

    speeds = over.values(base, RUN_UP_POINTS)
    ends = (speeds[-1], speeds[0]) if down else (speeds[0], speeds[-1])
    settings = shared.pick(settings, "seconds", "slow", "budget")
    results = begin()
    with shared.estimates_shown():
        result = measure_run_up(
            base,
            rpm=ends,
            points=len(speeds),
            **settings,
            rng=seed,
            workers=workers,
            progress="run-up",
        )
    results.conclude(result, **settings, seed=seed, rpm=speeds, down=down)


@click.command()
@shared.SCENE_AND_SIGMA
@shared.over("Value of the gears or the scene that is swept.", "alpha=0.05:2.5:100")
@click.option(
    "--keep-sigma",
    is_flag=True,
    help="Keep the noise along a sweep of alpha too; else it is the paper's there, sqrt(alpha).",
)
@click.option("--no-sweep", is_flag=True, help="Leave sweep and bifurcation view out.")
@shared.real("width", "Widest interval of a largest exponent.", 0.01)
@shared.whole("points", 1_000_000, "Points of each Poincare section.")
@shared.whole("impacts", 200_000, "Impacts of the spectra.")
@shared.whole("events", 4000, "Pairs of paths behind each figure.")
@shared.real("budget", CHAOS_BUDGET_HELP, 60.0)
@shared.SEED_AND_WORKERS
@shared.report("reports/NAME-chaos", "chaos.page")
def chaos(
    base: Scene, begin: Begin, over: Range, keep_sigma: bool, no_sweep: bool, **settings: Any
) -> None:
    """Measure Lyapunov exponents, Poincare sections and spectra.

    They say whether the motion of SCENE (a TOML file, DAT21 if none is given) is chaotic, also over
    a sweep. Results of the sweep are stored in OUT-cells: after an interruption the same command
    continues with them.

    Exit codes: 0 complete; 2 bad input.
    """
    from rattle.compare.chaos.effort import Effort
    from rattle.compare.chaos.measure import study
    from rattle.compare.chaos.sweep import paper_noise, vary
    from rattle.scene.changes import spell

    field = spell(base, over.name)
    at = () if no_sweep else over.values(base, SWEEP_POINTS)
    noise = paper_noise if field == "alpha" and not keep_sigma else None
    scenes = vary(base, field, at, noise) if noise else vary(base, field, at)
    positive("budget", settings["budget"])
    effort = Effort(**settings).check()
    results = begin()
    result = study(base, scenes, field, effort, say_part, results.cells)
    noise_text = "the scene's" if noise is None else "sqrt(alpha)"
    swept = {"field": field, "over": at, "noise": noise_text}
    results.say(results.write(result, **settings, **swept))
