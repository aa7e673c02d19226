"""The command ``rattle extremes``."""

import sys

import click

from rattle.compare.cli.console import say, say_json

EXIT_BROKEN = 1


@click.command()
@click.option("--all", "ranges", is_flag=True, help="Print the range and the reference of every row.")
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
def extremes(ranges: bool, as_json: bool) -> None:
    """Compare the installed program at extreme values with independent references, and print the worst errors.

    References are formulas in 400 digits, limits, published results, and exact scaling.  Exit codes: 0 all rows hold;
    1 one does not; 2 bad input.
    """
    from rattle.compare.checks.extremes.run import extremes as run_checks
    from rattle.compare.checks.extremes.table import lines

    rows = run_checks()
    if as_json:
        say_json([row._asdict() | {"holds": row.holds} for row in rows])
    else:
        for line in lines(rows, ranges=ranges):
            say(line)
    if not all(row.holds for row in rows):
        sys.exit(EXIT_BROKEN)
