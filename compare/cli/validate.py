"""The commands that judge closures and schemes: validate and tradeoff."""

import math
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rattle.compare.cli import shared
from rattle.compare.cli.ranges import Range
from rattle.compare.cli.shared import (
    EXIT_NOT_MET,
    PAPER_SIGMA,
    Begin,
    load_scene,
    say,
    say_json,
    say_lines,
)
from rattle.compare.report.folder import default_place
from rattle.scene import Scene, count, positive

if TYPE_CHECKING:
    from rattle.compare.report.manifest import Repeat
    from rattle.compare.validation.report_run import ReportRun

EXIT_FAILED = 1
EXIT_NOT_REPEATED = 4
EXIT_ROUNDED = 5
JUDGED_CLOSURES_HELP = (
    "Closure, or package.module:function of your own; repeatable. [default: all that can be"
    " applied]"
)
BESIDE_HELP = (
    "Scheme whose ensemble is shown beside; repeatable. [default: both Euler-Maruyama schemes"
    " without SCENE]"
)
VALIDITY = (
    "Noise intensities of the figure that opens the report, evenly spaced in their logarithm."
)
VALIDITY_POINTS = 12
TRADEOFF_HELP = (
    "Core-seconds of counted work of all. A point may take a fourth; costlier ones are"
    " extrapolated."
)
VALIDATION_BUDGET = (
    "Core-seconds of counted work: the scene's own noise first, in any case, then as much of that"
    " figure as is left for."
)
PAPER_SIGMAS = (0.01, 0.1, PAPER_SIGMA)
"""Noise intensities of the default report on DAT21: two small ones, and the paper's sqrt(alpha)."""


@click.command()
@shared.SCENE_ARGUMENT
@shared.several("sigma", "sigmas", float, "Noise intensity; repeatable.")
@shared.whole("impacts", 12, "Impacts after the start.")
@shared.whole("paths", 256_000, "Simulated paths.")
@shared.real("dt", "Step. [default: the scheme's, 0.002 for Euler-Maruyama]")
@shared.name_option(
    "scheme", shared.SCHEME_NAMES, "Scheme of the simulation.", default="exact-flight"
)
@shared.closures(JUDGED_CLOSURES_HELP)
@shared.several("beside", "beside", shared.Name("beside", shared.SCHEME_NAMES), BESIDE_HELP)
@shared.whole("order", 4, "Order of the closures' moments, 2 to 6.")
@shared.SEED_AND_WORKERS
@shared.over(VALIDITY, "sigma=1e-3:2:12", only="sigma")
@shared.whole("validity-paths", 40_000, "Simulated paths of each of these.")
@shared.real("budget", VALIDATION_BUDGET, 60.0)
@click.option("--no-validity", is_flag=True, help="Leave that figure out.")
@shared.folder_options("reports/NAME")
@click.option("--repeat", type=shared.FILE_PATH, help="Repeat the run of a manifest.json.")
@click.option(
    "--require",
    type=click.Choice(["accurate"]),
    help="Exit 3 unless every predicted moment is accurate.",
)
@shared.json_flag("the answer and all rows of the table")
def validate(
    scene: Path | None,
    sigmas: tuple[float, ...],
    beside: tuple[str, ...],
    workers: int,
    over: Range,
    validity_paths: int,
    budget: float,
    no_validity: bool,
    out: Path | None,
    overwrite: bool,
    repeat: Path | None,
    require: str | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """Compare closures with a simulation and write a report.

    SCENE is a TOML file, DAT21 if none is given.

    Exit codes: 0 the run is complete, whatever the verdicts; 1 complete, but a closure of your own
    raised an exception; 2 bad input; 3 --require is not met; 4 --repeat differs; 5 --repeat is the
    same but for rounding, as on another kind of processor.
    """
    # the scientific stack is imported here, so that --help and wrong options need not wait for it
    from rattle.compare.report import manifest
    from rattle.compare.validation.report_run import HAVE_BIAS, ReportRun, settle

    positive("budget", budget)
    recorded = None
    if repeat is not None:
        budget = math.inf  # what the first run has left out is not in its manifest
        recorded = manifest.read_settings(repeat)
        settings = recorded.settings
    else:
        base = load_scene(scene, sigmas[0] if sigmas else None, 0.0)
        wanted = sigmas or ((base.sigma,) if scene else PAPER_SIGMAS)
        settings = settle(
            shared.name_scene(scene),
            [base.with_sigma(sigma) for sigma in dict.fromkeys(wanted)],
            validity=() if no_validity else over._replace(log=True).values(base, VALIDITY_POINTS),
            validity_paths=0 if no_validity else count("validity-paths", validity_paths),
            beside=beside or (() if scene else HAVE_BIAS),
            **asked,
        )
    out = out or default_place(settings.name, "-repeated" if repeat else "")
    run = ReportRun(settings, out, overwrite, workers)
    sentences = run.judge()
    told = sentences if run.goes_on else []  # what is printed before the page is whole
    if not as_json:
        say_lines(told)
    run.draw()
    if run.goes_on:
        run.write_first()
    if settings.validity:
        intensities = f"{len(settings.validity)} intensities"
        say(f"Page: {run.page}; now the range of validity over σ, at {intensities}", err=True)
        run.sweep(budget)
    record = run.write()
    repeated = None if recorded is None else manifest.compare(recorded, record, out)
    if as_json:
        _say_as_json(run, record, repeated)
    else:
        _say_rest(run, told, repeated)
    _exit(run, repeated, bool(require))


def _say_rest(run: "ReportRun", told: list[str], repeated: "Repeat | None") -> None:
    """Print what the first sentences did not tell, where the report is, and what it repeats."""
    from rattle.compare.validation.answer import SECTION_EXPLAINED

    # one that was told may have explained a word at its first use
    known = {text.replace(SECTION_EXPLAINED, "") for text in told}
    new = [text for text in run.sentences if text.replace(SECTION_EXPLAINED, "") not in known]
    comparison = repeated.sentences if repeated else []
    say_lines((*new, f"Report: {run.page}", *comparison))


def _say_as_json(run: "ReportRun", record: Mapping[str, Any], repeated: "Repeat | None") -> None:
    """Print the answer and all rows of the table."""
    from rattle.compare.report.manifest import BIT_FOR_BIT
    from rattle.compare.validation.page import all_rows
    from rattle.compare.validation.transient import describe_transient

    summary = {
        "long_run": describe_transient(run.settings.scenes[0]) or None,
        "report": run.out,
        "answer": record["answer"],
        "accurate": all(v.accurate for v in run.validations),
        "repeated": None,
    }
    if repeated:
        summary["repeated"] = repeated.outcome == BIT_FOR_BIT
        summary["repeat"] = repeated.to_dict()
    say_json(summary | {"table": all_rows(run.validations).to_dict("records")})


def _exit(run: "ReportRun", repeated: "Repeat | None", must_be_accurate: bool) -> None:
    """End with the exit code of what was found, where it is not 0."""
    from rattle.compare.report.manifest import DIFFERENT, ROUNDED

    if repeated and repeated.outcome == DIFFERENT:
        sys.exit(EXIT_NOT_REPEATED)
    failed = {f"closure {name} {why}" for v in run.validations for name, why in v.failed.items()}
    for why in sorted(failed):
        say(f"rattle: {why}", err=True)
    if failed:
        sys.exit(EXIT_FAILED)
    if must_be_accurate and not all(v.accurate for v in run.validations):
        sys.exit(EXIT_NOT_MET)
    if repeated and repeated.outcome == ROUNDED:
        sys.exit(EXIT_ROUNDED)


@click.command()
@shared.SCENE_ARGUMENT
@shared.real("sigma", "Noise intensity. [default: the scene's, or 0.1]")
@shared.whole("impacts", 12, "Impacts after the start.")
@shared.several(
    "accuracy", "accuracies", float, "Error in sds; repeatable. [default: 0.3 to 0.001]"
)
@shared.real("budget", TRADEOFF_HELP, 400.0)
@shared.SEED_OPTION
@click.option(
    "--orders/--no-orders",
    default=True,
    help="Measure the schemes' weak orders as well.",
)
@shared.whole("workers", 2, "Threads.")
@shared.report("reports/NAME-tradeoff", "tradeoff.page", otherwise=0.1)
def tradeoff(
    base: Scene, begin: Begin, accuracies: tuple[float, ...], orders: bool, **settings: Any
) -> None:
    """Measure what an accuracy costs by each scheme and closure.

    SCENE is a TOML file, DAT21 if none is given.

    Exit codes: 0 complete; 2 bad input.
    """
    from rattle.compare.tradeoff.measure import ACCURACIES, measure
    from rattle.montecarlo import SCHEMES, check_settings

    positive("sigma", base.sigma)
    wanted = {positive("accuracy", accuracy) for accuracy in accuracies or ACCURACIES}
    asked = sorted(wanted, reverse=True)
    positive("budget", settings["budget"])
    check = partial(check_settings, base, paths=1, dt=None, rng=settings["seed"], step_bias=False)
    for scheme in SCHEMES:
        check(scheme=scheme, impacts=settings["impacts"], workers=settings["workers"])
    results = begin()
    asked_for = {"accuracies": asked, "orders": orders, **settings}
    result = measure(base, **asked_for)
    results.say(results.write(result, **asked_for))
