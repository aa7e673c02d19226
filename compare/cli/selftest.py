"""The command ``rattle selftest``."""

import sys

import click

from rattle.compare.cli.console import say, say_json

__all__ = ["selftest"]

EXIT_BROKEN = 1


@click.command()
@click.option("--law", "names", multiple=True, metavar="NAME", help="One law alone; again for more. [default: all]")
@click.option("--all", "all_checks", is_flag=True, help="Print every check and every planted error.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of all random numbers.")
@click.option("--workers", type=int, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option("--json", "as_json", is_flag=True, help="Print the record as JSON.")
def selftest(names: tuple[str, ...], all_checks: bool, seed: int, workers: int, as_json: bool) -> None:
    """Hold the installed program against published laws: exits, returns, collapse, bounces, exponents, covariances.

    Each law must also reject the errors that are planted for it.  Exit codes: 0 all laws hold; 1 one does not; 2 bad
    input.
    """
    from rattle.compare.checks.laws.run import selftest as put_to_the_test
    from rattle.compare.checks.laws.table import lines, record

    laws = put_to_the_test(names, seed=seed, workers=workers)
    if as_json:
        say_json(record(laws, seed))
    else:
        for line in lines(laws, all_checks=all_checks):
            say(line)
    if not all(law.holds for law in laws):
        sys.exit(EXIT_BROKEN)
