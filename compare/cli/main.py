"""The command ``rattle``."""

from rattle.compare.interrupt import EXIT_INTERRUPTED, NOTHING_WRITTEN, ends_at_once, ends_soon, said

with ends_at_once():
    import errno
    import sys
    from pathlib import Path
    from typing import Any

    import click

    from rattle.compare.cli import sampling as sampling_commands
    from rattle.compare.cli.animate import animate
    from rattle.compare.cli.chaos import chaos
    from rattle.compare.cli.claims import claims
    from rattle.compare.cli.console import say, say_json
    from rattle.compare.cli.extremes import extremes
    from rattle.compare.cli.init import init
    from rattle.compare.cli.load import load_scene
    from rattle.compare.cli.options import CLOSURES, SCHEMES, WHOLE, Name
    from rattle.compare.cli.selftest import selftest
    from rattle.compare.cli.show import show
    from rattle.compare.cli.stability import stability
    from rattle.compare.cli.stationary import stationary
    from rattle.compare.cli.study import study
    from rattle.compare.cli.warm_up import warm_up
    from rattle.scene.errors import RattleError
    from rattle.scene.text import harmless, line

EXIT_BAD_INPUT, EXIT_NOT_MET, EXIT_NOT_REPEATED, EXIT_ROUNDED = 2, 3, 4, 5
PAPER_SIGMAS = (0.01, 0.1, 1.5**0.5)
"""Noise intensities of the default report on DAT21: two small ones, and the paper's sqrt(alpha)."""

STORAGE = {
    errno.ENOSPC: "make room on that disk",
    errno.EDQUOT: "make room on that disk",
    errno.EROFS: "choose another place",
    errno.EACCES: "choose another place",
    errno.EPERM: "choose another place",
    errno.EFBIG: "make room on that disk",
    errno.ENAMETOOLONG: "choose a shorter name",
}
"""Remedies by error number, for files that are not written by this package itself, such as machine code by numba."""

NO_TEMPORARY = ("MPLCONFIGDIR", "No usable temporary directory")
"""What matplotlib and Python say where no folder for temporary files can be written."""


class RattleGroup(click.Group):
    """Group of commands that reports the project's own errors in one line on standard error, with exit code 2."""

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run the command line; Ctrl-C ends it at once where no command runs."""
        with ends_at_once():
            return super().main(*args, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command, and convert its errors to a message and an exit code."""
        try:
            with ends_soon():
                return super().invoke(ctx)
        except click.ClickException as error:  # the message may quote a file name with control characters
            setattr(error, "message", harmless(error.message))  # noqa: B010  (final by its type)
            raise
        except RattleError as error:
            say(f"rattle: {error}", err=True)
            ctx.exit(EXIT_BAD_INPUT)
        except OSError as error:
            if any(sign in str(error) for sign in NO_TEMPORARY):
                say("rattle: no folder for temporary files; set TMPDIR to one that can be written", err=True)
                ctx.exit(EXIT_BAD_INPUT)
            if error.errno not in STORAGE:
                raise
            where = line(str(error.filename or "a file"))
            say(f"rattle: {where}: {error.strerror}; {STORAGE[error.errno]}, and repeat the command", err=True)
            ctx.exit(EXIT_BAD_INPUT)
        except KeyboardInterrupt as interrupt:
            said.set()
            say(f"rattle: {str(interrupt) or NOTHING_WRITTEN}", err=True)
            ctx.exit(EXIT_INTERRUPTED)


COMPLETION = """\b
Completion of commands, options and names by the Tab key, for this session or from the shell's start-up file:
  bash:  eval "$(_RATTLE_COMPLETE=bash_source rattle)"
  zsh:   eval "$(_RATTLE_COMPLETE=zsh_source rattle)"
  fish:  _RATTLE_COMPLETE=fish_source rattle | source
"""


@click.group(cls=RattleGroup, epilog=COMPLETION, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rattle")
def main() -> None:
    """When can a cheap moment closure of a noisy vibro-impact system be believed?"""


@main.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", "sigmas", multiple=True, type=float, help="Noise intensity; give it again for more.")
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
    help="Closure; again for more. [default: all that can be applied]",
)
@click.option(
    "--beside",
    type=Name("beside", SCHEMES),
    multiple=True,
    help="Scheme whose ensemble is shown beside; again for more. [default: both Euler-Maruyama schemes without SCENE]",
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
    """Compare closures with a simulation of SCENE (a TOML file; DAT21 if none) and write a report.

    Exit codes: 0 the run is complete, whatever the verdicts; 2 bad input; 3 --require is not met; 4 --repeat differs;
    5 --repeat is the same but for rounding, as on another kind of processor.
    """
    # the scientific stack is imported here, so that --help and wrong options need not wait for it
    from rattle.closure import closures_for
    from rattle.compare.report import manifest
    from rattle.compare.report.folder import check_free, default_place, name_of
    from rattle.compare.report.provenance import Stopwatch, command_line, provenance
    from rattle.compare.report.repeat import DIFFERENT, ROUNDED, SAME, compare, tables_beside
    from rattle.compare.validation.beside import beside as ensembles_beside
    from rattle.compare.validation.page import CONTENTS, write_report
    from rattle.compare.validation.sweep import check_sweep, grid, sweep
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
            () if no_validity else grid(validity),
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
    schemes = ensembles_beside(validations, settings.beside, workers) if settings.beside else None
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


@main.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", type=float, help="Noise intensity. [default: the scene's, or 0.1]")
@click.option("--impacts", type=WHOLE, default=12, show_default=True, help="Impacts after the start.")
@click.option(
    "--accuracy", "accuracies", multiple=True, type=float, help="Error in sds; again for more. [default: 0.3 to 0.001]"
)
@click.option(
    "--budget",
    type=float,
    default=100.0,
    show_default=True,
    help="Core-seconds up to which a point is run; costlier ones are extrapolated.",
)
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed of the simulations.")
@click.option("--orders/--no-orders", default=True, show_default=True, help="Measure the schemes' weak orders as well.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Folder. [default: reports/NAME-tradeoff]")
@click.option("--overwrite", is_flag=True, help="Replace earlier results in that folder.")
def tradeoff(
    scene: Path | None,
    sigma: float | None,
    impacts: int,
    accuracies: tuple[float, ...],
    budget: float,
    seed: int,
    orders: bool,
    workers: int,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Measure what accuracy costs on SCENE (a TOML file; DAT21 if none) by every scheme and every closure.

    Exit codes: 0 complete; 2 bad input.
    """
    from rattle.compare.report.folder import check_free, default_place, name_of
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.compare.tradeoff.measure import ACCURACIES, check_accuracies, measure
    from rattle.compare.tradeoff.save import CONTENTS, write_tradeoff
    from rattle.compare.tradeoff.variance_reduction import control_table
    from rattle.compare.tradeoff.weak_order import orders_over
    from rattle.montecarlo import SCHEMES, check_settings
    from rattle.scene.validate import positive

    base = load_scene(scene, sigma, 0.1)
    positive("sigma", base.sigma)
    asked = check_accuracies(accuracies or ACCURACIES)
    positive("budget", budget)
    common: dict[str, Any] = {"impacts": impacts, "workers": workers}
    for scheme in SCHEMES:
        check_settings(base, paths=1, dt=None, scheme=scheme, rng=seed, step_bias=False, **common)
    name = name_of(scene) if scene else "DAT21"
    out = out or default_place(name, "-tradeoff")
    check_free(out, CONTENTS, overwrite)
    watch = Stopwatch()
    found = measure(base, accuracies=asked, budget=budget, seed=seed, **common)
    control = control_table(base, seed=seed, **common)
    sigmas = sorted({base.sigma, base.alpha**0.5})  # its own, and the paper's
    measured = orders_over(base, sigmas, rng=seed, workers=workers) if orders else None
    record = {
        "name": name,
        "scene": base.to_dict(),
        "impacts": impacts,
        "accuracies": asked,
        "budget": budget,
        "seed": seed,
        "orders": orders,
        "workers": workers,
        **provenance(watch),
    }
    for sentence in write_tradeoff(out, found, control, measured, asked, record, overwrite):
        say(sentence)
    say(f"Page: {out / 'tradeoff.html'}")


main.add_command(init)
main.add_command(sampling_commands.simulate)
main.add_command(sampling_commands.bench)
main.add_command(sampling_commands.order)
main.add_command(study)
main.add_command(chaos)
main.add_command(stationary)
main.add_command(claims)
main.add_command(show)
main.add_command(animate)
main.add_command(selftest)
main.add_command(stability)
main.add_command(extremes)
main.add_command(warm_up)
