"""The command ``rattle selftest``."""

import sys

import click

from rattle.compare.cli.console import say, say_json
from rattle.compare.cli.options import WHOLE

EXIT_BROKEN = 1


@click.command()
@click.option(
    "--result", "names", multiple=True, metavar="NAME", help="One result alone; again for more. [default: all]"
)
@click.option("--all", "all_checks", is_flag=True, help="Print every check and every negative control.")
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed of all random numbers.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option("--json", "as_json", is_flag=True, help="Print the record as JSON.")
def selftest(names: tuple[str, ...], all_checks: bool, seed: int, workers: int, as_json: bool) -> None:
    """Compare the installed program with published results: exits, returns, collapse, bounces, exponents, covariances.

    Each check must also reject its negative controls.  Exit codes: 0 all results hold; 1 one does not; 2 bad input.
    """
    from rattle.compare.checks.published.run import selftest as run_checks
    from rattle.compare.checks.published.table import lines, record

    results = run_checks(names, seed=seed, workers=workers)
    if as_json:
        say_json(record(results, seed))
    else:
        for line in lines(results, all_checks=all_checks):
            say(line)
    if not all(result.holds for result in results):
        sys.exit(EXIT_BROKEN)
