"""The command ``rattle stability``."""

from pathlib import Path

import click

from rattle.compare.cli.console import say
from rattle.compare.cli.options import AXES, SCHEMES, WHOLE, Name


@click.command()
@click.option(
    "--scheme", "schemes", type=Name("scheme", SCHEMES), multiple=True, help="Scheme; again for more. [default: all]"
)
@click.option("--axis", "axes", type=Name("axis", AXES), multiple=True, help="Axis; again for more. [default: all]")
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
    help="Try extreme values too (rattle extremes), and put their table on the page.",
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
    """Measure where each scheme is stable and unbiased, at admissible and at longer steps, and write a page.

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
    if len(found.undiagnosed) or not all(row.holds for row in tried):
        raise click.exceptions.Exit(1)
