"""The commands ``rattle check``: what checks the installation."""

import sys
from pathlib import Path

import click

from rattle.compare.cli.console import say, say_json
from rattle.compare.cli.options import AXES, SCHEMES, WHOLE, Name

EXIT_BROKEN = 1


@click.group()
def check() -> None:
    """Check this installation: results, extremes, stability, speed."""


@check.command("published")
@click.option("--result", "names", multiple=True, metavar="NAME", help="One result alone; repeatable. [default: all]")
@click.option("--all", "all_checks", is_flag=True, help="Print every check and every negative control.")
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed of all random numbers.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option("--json", "as_json", is_flag=True, help="Print the record as JSON.")
def results(names: tuple[str, ...], all_checks: bool, seed: int, workers: int, as_json: bool) -> None:
    """Compare this installation with published results.

    They are exits, returns, collapse, bounces, exponents and covariances; each check must also reject its negative
    controls.

    Exit codes: 0 all results hold; 1 one does not; 2 bad input.
    """
    from rattle.compare.checks.published.run import check_results
    from rattle.compare.checks.table import published_lines, published_record

    found = check_results(names, seed=seed, workers=workers)
    if as_json:
        say_json(published_record(found, seed))
    else:
        for line in published_lines(found, all_checks=all_checks):
            say(line)
    if not all(result.holds for result in found):
        sys.exit(EXIT_BROKEN)


@check.command()
@click.option("--all", "ranges", is_flag=True, help="Print the range and the reference of every row.")
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
def extremes(ranges: bool, as_json: bool) -> None:
    """Compare extreme values with independent references.

    Prints the worst errors. References are formulas in 400 digits, limits, published results, and exact scaling.

    Exit codes: 0 all rows hold; 1 one does not; 2 bad input.
    """
    from rattle.compare.checks.extremes.run import extremes as run_checks
    from rattle.compare.checks.table import extreme_lines, extreme_record

    rows = run_checks()
    if as_json:
        say_json([extreme_record(row) for row in rows])
    else:
        for line in extreme_lines(rows, ranges=ranges):
            say(line)
    if not all(row.holds for row in rows):
        sys.exit(EXIT_BROKEN)


@check.command()
@click.option(
    "--scheme", "schemes", type=Name("scheme", SCHEMES), multiple=True, help="Scheme; repeatable. [default: all]"
)
@click.option("--axis", "axes", type=Name("axis", AXES), multiple=True, help="Axis; repeatable. [default: all]")
@click.option("--points", type=WHOLE, default=7, show_default=True, help="Values of each axis, 1 to 7.")
@click.option("--paths", type=WHOLE, default=32_768, show_default=True, help="Most paths of a cell.")
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("reports/stability"), show_default=True, help="Folder."
)
@click.option(
    "--extremes/--no-extremes",
    "extreme",
    default=True,
    show_default=True,
    help="Try extreme values too (rattle check extremes), and put their table on the page.",
)
@click.option("--overwrite", is_flag=True, help="Replace earlier results in that folder.")
def stability(
    schemes: tuple[str, ...],
    axes: tuple[str, ...],
    points: int,
    paths: int,
    seed: int,
    workers: int,
    out: Path,
    extreme: bool,
    overwrite: bool,
) -> None:
    """Measure where each scheme is stable and unbiased.

    At admissible and at longer steps; writes a page.

    Exit codes: 0 complete; 1 a run with an admissible step is inaccurate without a diagnostic, or an extreme value
    fails; 2 bad input.
    """
    from rattle.compare.checks.extremes.run import extremes
    from rattle.compare.checks.stability.axes import moderate
    from rattle.compare.checks.stability.chart import chart
    from rattle.compare.checks.stability.free_flight import covariance_table
    from rattle.compare.checks.stability.page import CONTENTS, write_stability
    from rattle.compare.report.folder import check_free
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.scene.validate import count

    chosen, along = list(dict.fromkeys(schemes)) or list(SCHEMES), list(dict.fromkeys(axes)) or list(AXES)
    count("points", points, most=7)
    count("paths", paths, least=1000)
    count("seed", seed, least=0)
    count("workers", workers)
    check_free(out, CONTENTS, overwrite)
    watch = Stopwatch()
    found = chart(schemes=chosen, axes=along, points=points, paths=paths, seed=seed, workers=workers)
    covariances = covariance_table(points=points, paths=paths, seed=seed, workers=workers)
    tried = extremes() if extreme else ()
    record = {
        "scene": moderate().to_dict(),
        "schemes": chosen,
        "axes": along,
        "points": points,
        "paths": paths,
        "seed": seed,
        "workers": workers,
        **provenance(watch),
    }
    for sentence in write_stability(out, found, covariances, tried, record, overwrite):
        say(sentence)
    say(f"Page: {out / 'stability.html'}")
    if len(found.without_diagnostic) or not all(row.holds for row in tried):
        sys.exit(EXIT_BROKEN)


@check.command()
@click.option("--json", "as_json", is_flag=True, help="Print the table as JSON.")
def speed(as_json: bool) -> None:
    """Measure the time of a step of a path on this machine.

    Beside it stands its lower bound: random numbers and arithmetic alone.
    """
    from rattle.montecarlo.bench import bench as measure

    table = measure()
    if as_json:
        say_json(table.reset_index().to_dict("records"))
        return
    names = {"ns": "ns per path-step", "times_floor": "times floor", "gain": "times as fast", "us": "us per path"}
    say(table.rename(columns=names).to_string(float_format="{:.2f}".format, na_rep=""), keep="\n")
    say("Processor time of one core, the least of several turns; ratios are medians. Floor: one normal and the")
    say("arithmetic of one step. Times as fast: as a path-step of the skilled loop, or as a normal by standard_normal.")
