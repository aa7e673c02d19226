"""The command ``rattle validate``."""

import sys
from pathlib import Path
from typing import Any

import click

from rattle.compare.cli.console import say, say_json
from rattle.compare.cli.load import load_scene
from rattle.compare.cli.options import CLOSURES, SCHEMES, WHOLE, Name

EXIT_NOT_MET, EXIT_NOT_REPEATED, EXIT_ROUNDED = 3, 4, 5
PAPER_SIGMAS = (0.01, 0.1, 1.5**0.5)
"""Noise intensities of the default report on DAT21: two small ones, and the paper's sqrt(alpha)."""


@click.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", "sigmas", multiple=True, type=float, help="Noise intensity; repeatable.")
@click.option("--impacts", type=WHOLE, default=12, show_default=True, help="Impacts after the start.")
@click.option("--paths", type=WHOLE, default=256_000, show_default=True, help="Simulated paths.")
@click.option("--dt", type=float, default=None, help="Step. [default: the scheme's, 0.002 for Euler-Maruyama]")
@click.option(
    "--scheme",
    type=Name("scheme", SCHEMES),
    default="exact-flight",
    show_default=True,
    help="Scheme of the simulation.",
)
@click.option(
    "--closure",
    "closures",
    type=Name("closures", CLOSURES),
    multiple=True,
    help="Closure; repeatable. [default: all that can be applied]",
)
@click.option(
    "--beside",
    type=Name("beside", SCHEMES),
    multiple=True,
    help="Scheme whose ensemble is shown beside; repeatable. [default: both Euler-Maruyama schemes without SCENE]",
)
@click.option("--order", type=WHOLE, default=4, show_default=True, help="Order of the closures' moments, 2 to 6.")
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed of the simulation.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option(
    "--validity",
    default="1e-3:2:12",
    show_default=True,
    metavar="LOW:HIGH:POINTS",
    help="Noise intensities of the figure that opens the report, evenly spaced in their logarithm.",
)
@click.option(
    "--validity-paths", type=WHOLE, default=40_000, show_default=True, help="Simulated paths of each of these."
)
@click.option("--no-validity", is_flag=True, help="Leave that figure out.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Report folder. [default: reports/NAME]")
@click.option("--overwrite", is_flag=True, help="Replace an earlier report in that folder.")
@click.option("--repeat", type=click.Path(path_type=Path), help="Repeat the run of a manifest.json.")
@click.option("--require", type=click.Choice(["accurate"]), help="Exit 3 unless every predicted moment is accurate.")
@click.option("--json", "as_json", is_flag=True, help="Print the answer as JSON.")
def validate(
    scene: Path | None,
    sigmas: tuple[float, ...],
    impacts: int,
    paths: int,
    dt: float | None,
    scheme: str,
    closures: tuple[str, ...],
    beside: tuple[str, ...],
    order: int,
    seed: int,
    workers: int,
    validity: str,
    validity_paths: int,
    no_validity: bool,
    out: Path | None,
    overwrite: bool,
    repeat: Path | None,
    require: str | None,
    as_json: bool,
) -> None:
    """Compare closures with a simulation and write a report.

    SCENE is a TOML file, DAT21 if none is given.

    Exit codes: 0 the run is complete, whatever the verdicts; 2 bad input; 3 --require is not met; 4 --repeat differs; 5
    --repeat is the same but for rounding, as on another kind of processor.
    """
    # the scientific stack is imported here, so that --help and wrong options need not wait for it
    from rattle.closure import closures_for
    from rattle.compare.report import manifest
    from rattle.compare.report.folder import check_free, default_place, name_of
    from rattle.compare.report.provenance import Stopwatch, command_line, provenance
    from rattle.compare.report.repeat import DIFFERENT, ROUNDED, SAME, compare, tables_beside
    from rattle.compare.validation.page import CONTENTS, write_report
    from rattle.compare.validation.schemes import compare_schemes
    from rattle.compare.validation.sweep import check_sweep, read_grid, sweep
    from rattle.compare.validation.validate import validate as compare_closures
    from rattle.montecarlo import SCHEMES, check_settings, default_step
    from rattle.scene.validate import choice, count

    recorded, earlier = None, {}
    if repeat is not None:
        recorded = manifest.read_settings(repeat)
        settings, earlier = recorded.settings, tables_beside(repeat, recorded)
        out = out or default_place(settings.name, "-repeated")
    else:
        base = load_scene(scene, sigmas[0] if sigmas else None, 0.0)
        name = name_of(scene) if scene else "DAT21"
        biased = SCHEMES[choice("scheme", scheme, SCHEMES)].has_step_bias
        wanted = sigmas or ((base.sigma,) if scene else PAPER_SIGMAS)
        scenes = tuple(base.with_sigma(s) for s in dict.fromkeys(wanted))
        settings = manifest.ReportSettings(
            name,
            scenes,
            impacts,
            paths,
            min(default_step(s, scheme, biased) for s in scenes) if dt is None else dt,
            scheme,
            seed,
            order,
            closures or closures_for(base),
            () if no_validity else read_grid(validity),
            0 if no_validity else count("validity-paths", validity_paths),
            beside or (() if scene else tuple(s for s in SCHEMES if SCHEMES[s].has_step_bias)),
        )
        out = out or default_place(name)
    check_free(out, CONTENTS, overwrite)
    first = settings.scenes[0]
    biased = SCHEMES[choice("scheme", settings.scheme, SCHEMES)].has_step_bias
    for s in settings.scenes:
        check_settings(s, **settings.simulation, workers=workers, step_bias=biased)
    check_sweep(first, settings.validity, **settings.sweep, workers=workers)
    watch = Stopwatch()
    predictions: dict[str, Any] = {"closures": settings.closures, "order": settings.order}
    validations = [
        compare_closures(s, **settings.simulation, **predictions, workers=workers, progress=f"sigma {s.sigma:.4g}")
        for s in settings.scenes
    ]
    swept = (
        sweep(first, settings.validity, **settings.sweep, **predictions, workers=workers) if settings.validity else None
    )
    schemes = compare_schemes(validations, settings.beside, workers) if settings.beside else None
    origin = {"repeat": command_line(["validate", "--repeat", str(out / "manifest.json")])} | provenance(watch)
    record = write_report(out, settings, validations, swept, origin, overwrite, schemes)
    repeated = None if recorded is None else compare(recorded, earlier, record, out)
    accurate = all(v.accurate for v in validations)
    if as_json:
        summary = {"report": out, "answer": record["answer"], "accurate": accurate, "repeated": None}
        if repeated:
            summary |= {"repeated": repeated.outcome == SAME, "repeat": repeated.to_dict()}
        say_json(summary)
    else:
        comparison = repeated.sentences if repeated else []
        for sentence in (*record["answer"], f"Report: {out / 'report.html'}", *comparison):
            say(sentence)
    if repeated and repeated.outcome == DIFFERENT:
        sys.exit(EXIT_NOT_REPEATED)
    if require and not accurate:
        sys.exit(EXIT_NOT_MET)
    if repeated and repeated.outcome == ROUNDED:
        sys.exit(EXIT_ROUNDED)
