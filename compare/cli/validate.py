"""The commands that judge closures and schemes: validate, tradeoff and order."""

import math
import sys
from pathlib import Path
from typing import Any

import click

import rattle as rt
from rattle.compare.cli import shared
from rattle.compare.cli.shared import (
    EXIT_NOT_MET,
    PAPER_SIGMA,
    Begin,
    load_scene,
    say,
    say_json,
    say_lines,
)
from rattle.compare.report.folder import check_free, default_place, name_of, report_files
from rattle.compare.report.interrupt import stored
from rattle.scene import Scene, choice, count, positive

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
@click.option(
    "--closure", "closures", type=shared.CLOSURE_TYPE, multiple=True, help=JUDGED_CLOSURES_HELP
)
@shared.name_option("beside", shared.SCHEME_NAMES, BESIDE_HELP, many="beside")
@shared.whole("order", 4, "Order of the closures' moments, 2 to 6.")
@shared.SEED_AND_WORKERS
@shared.grid("validity", "1e-3:2:12", VALIDITY)
@shared.whole("validity-paths", 40_000, "Simulated paths of each of these.")
@shared.real("budget", "Core-seconds of counted work for that figure.", 60.0)
@click.option("--no-validity", is_flag=True, help="Leave that figure out.")
@click.option(
    "--out", type=shared.FILE_PATH, default=None, help="Report folder. [default: reports/NAME]"
)
@click.option("--overwrite", is_flag=True, help="Replace an earlier report in that folder.")
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
    dt: float | None,
    closures: tuple[str, ...],
    beside: tuple[str, ...],
    workers: int,
    validity: str,
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
    from rattle.closure import closures_for
    from rattle.closure.mean_map import find_closures, predict
    from rattle.compare.report import manifest
    from rattle.compare.report.provenance import Stopwatch, command_line, provenance
    from rattle.compare.validation.answer import (
        SECTION_EXPLAINED,
        UNFINISHED,
        answer,
        describe_left_out,
    )
    from rattle.compare.validation.page import all_rows, draw_sections, write_report
    from rattle.compare.validation.transient import describe_transient
    from rattle.compare.validation.validate import check_sweep, compare_schemes, read_grid, sweep
    from rattle.montecarlo import SCHEMES, check_settings, default_step

    positive("budget", budget)
    recorded = None
    if repeat is not None:
        budget = math.inf  # what the first run has left out is not in its manifest
        recorded = manifest.read_settings(repeat)
        settings = recorded.settings
        out = out or default_place(settings.name, "-repeated")
    else:
        base = load_scene(scene, sigmas[0] if sigmas else None, 0.0)
        name = name_of(scene) if scene else "DAT21"
        have_bias = [name for name, each in SCHEMES.items() if each.has_step_bias]
        wanted = sigmas or ((base.sigma,) if scene else PAPER_SIGMAS)
        scenes = tuple(base.with_sigma(s) for s in dict.fromkeys(wanted))
        steps = (default_step(s, asked["scheme"], asked["scheme"] in have_bias) for s in scenes)
        settings = manifest.ReportSettings(
            name=name,
            scenes=scenes,
            dt=min(steps) if dt is None else dt,
            closures=closures or closures_for(base),
            validity=() if no_validity else read_grid(validity),
            validity_paths=0 if no_validity else count("validity-paths", validity_paths),
            beside=beside or (() if scene else tuple(have_bias)),
            **asked,
        )
        out = out or default_place(name)
    own = [method for method in find_closures("closures", settings.closures) if method.own]
    check_free(out, report_files("report"), overwrite)
    first = settings.scenes[0]
    biased = SCHEMES[choice("scheme", settings.scheme, SCHEMES)].has_step_bias
    for s in settings.scenes:
        check_settings(s, **settings.simulation, workers=workers, step_bias=biased)
    for s in (*settings.scenes[1:], *(first.with_sigma(sigma) for sigma in settings.validity)):
        for method in own:  # what it returns is checked before anything is simulated
            predict(s, method, settings.impacts, settings.order)
    check_sweep(first, settings.validity, **settings.sweep, workers=workers)
    watch = Stopwatch()
    predictions: dict[str, Any] = {"closures": settings.closures, "order": settings.order}
    validations = [
        rt.validate(
            s,
            **settings.simulation,
            **predictions,
            workers=workers,
            progress=f"sigma {s.sigma:.4g}",
        )
        for s in settings.scenes
    ]
    origin = {"repeat": command_line(["validate", "--repeat", str(out / "manifest.json")])}
    page = out / "report.html"
    said = answer(validations)
    told: list[str] = []  # what is printed before the page is whole
    if settings.validity or settings.beside:
        told = said
    if not as_json:
        say_lines(told)
    drawn = draw_sections(validations)
    if told:
        at_once = settings._replace(validity=(), validity_paths=0, beside=())
        unfinished = [UNFINISHED] if settings.validity else []
        measured = origin | provenance(watch)
        write_report(out, at_once, validations, None, said + unfinished, drawn, measured, overwrite)
        overwrite = True
        stored.append(lambda: f"the page is written, without the range of validity: {page}")
    swept = None
    if settings.validity:
        say(
            f"Page: {page}; now the range of validity over σ, at {len(settings.validity)}"
            " intensities",
            err=True,
        )
        swept = sweep(
            first,
            settings.validity,
            **settings.sweep,
            **predictions,
            workers=workers,
            budget=budget,
        )
        settings = settings._replace(validity=tuple(sorted(swept.validity["sigma"].unique())))
        said = answer(validations, swept) + describe_left_out(swept, budget)
    schemes = compare_schemes(validations, settings.beside, workers) if settings.beside else None
    measured = origin | provenance(watch)
    record = write_report(
        out, settings, validations, swept, said, drawn, measured, overwrite, schemes
    )
    repeated = None if recorded is None else manifest.compare(recorded, record, out)
    accurate = all(v.accurate for v in validations)
    if as_json:
        transient = describe_transient(first)
        summary = {
            "long_run": transient or None,
            "report": out,
            "answer": record["answer"],
            "accurate": accurate,
            "repeated": None,
        }
        if repeated:
            summary |= {
                "repeated": repeated.outcome == manifest.BIT_FOR_BIT,
                "repeat": repeated.to_dict(),
            }
        say_json(summary | {"table": all_rows(validations).to_dict("records")})
    else:
        comparison = repeated.sentences if repeated else []
        # it explains a word at its first use
        known = {sentence.replace(SECTION_EXPLAINED, "") for sentence in told}
        new = [
            sentence for sentence in said if sentence.replace(SECTION_EXPLAINED, "") not in known
        ]
        say_lines((*new, f"Report: {page}", *comparison))
    if repeated and repeated.outcome == manifest.DIFFERENT:
        sys.exit(EXIT_NOT_REPEATED)
    failed = {f"closure {name} {why}" for v in validations for name, why in v.failed.items()}
    for why in sorted(failed):
        say(f"rattle: {why}", err=True)
    if failed:
        sys.exit(EXIT_FAILED)
    if require and not accurate:
        sys.exit(EXIT_NOT_MET)
    if repeated and repeated.outcome == manifest.ROUNDED:
        sys.exit(EXIT_ROUNDED)


@click.command()
@shared.SCENE_ARGUMENT
@shared.real("sigma", "Noise intensity. [default: the scene's, or 0.1]")
@shared.whole("impacts", 12, "Impacts after the start.")
@shared.several(
    "accuracy", "accuracies", float, "Error in sds; repeatable. [default: 0.3 to 0.001]"
)
@shared.real(
    "budget", "Core-seconds up to which a point is run; costlier ones are extrapolated.", 100.0
)
@shared.SEED_OPTION
@click.option(
    "--orders/--no-orders",
    default=True,
    show_default=True,
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
    from rattle.compare.tradeoff.measure import ACCURACIES, check_accuracies, measure
    from rattle.montecarlo import SCHEMES, check_settings

    positive("sigma", base.sigma)
    asked = check_accuracies(accuracies or ACCURACIES)
    positive("budget", settings["budget"])
    common: dict[str, Any] = {name: settings[name] for name in ("impacts", "workers")}
    for scheme in SCHEMES:
        check_settings(
            base, paths=1, dt=None, scheme=scheme, rng=settings["seed"], step_bias=False, **common
        )
    results = begin()
    asked_for = {"accuracies": asked, "orders": orders, **settings}
    found = measure(base, **asked_for)
    results.say(results.write(found, scene=base.to_dict(), **asked_for))


@click.command()
@shared.SCENE_AND_SIGMA
@shared.whole("impacts", 4, "Impacts after the start.")
@shared.whole("paths", 20_000, "Paths of each run.")
@shared.SEED_AND_WORKERS
@shared.json_flag("the table")
def order(
    scene: Path | None, sigma: float | None, seed: int, as_json: bool, **settings: int
) -> None:
    """Measure the order of the step bias of Euler-Maruyama.

    SCENE is a TOML file, DAT21 if none is given.
    """
    from rattle.compare.tradeoff.page import orders_said
    from rattle.compare.tradeoff.weak_order import weak_orders

    table = weak_orders(load_scene(scene, sigma), rng=seed, **settings).table
    if as_json:
        say_json(table.to_dict("records"))
        return
    names = [
        "scheme",
        "moment",
        "quantity",
        "slope",
        "low",
        "high",
        "last",
        "turns",
        "order",
        "change",
        "limit_z",
    ]
    say(table[names].to_string(index=False, float_format="{:.3g}".format, na_rep="-"), keep="\n")
    say_lines(orders_said(table))
    say(
        "slope of the step bias over these dt, in [low, high] with 95 % confidence; last: that at"
        " the finest; turns: impacts at\nwhich the change turns its sign; order: only where the"
        " slope has settled; change: size of the last change, in sds;\nlimit_z: Richardson"
        " extrapolation minus exact flights in standard errors; -: hidden by noise.",
        keep="\n",
    )
