"""All checks at extreme values, and the run of them."""

from collections.abc import Callable

from rattle.compare.checks.check import Result, run_checks
from rattle.compare.checks.extremes import flights, impacts, runs, sampling, scaling, steps, windows

ROWS: dict[str, Callable[..., Result]] = {
    row.__name__: row for part in (flights, impacts, windows, steps, sampling, scaling, runs) for row in part.ROWS
}
"""Every check by the name of its function."""


def extremes() -> list[Result]:
    """Run all checks at extreme values; takes about a minute."""
    return run_checks(ROWS)
