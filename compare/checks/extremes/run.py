"""Runs all rows of the extremes, and makes a table of them."""

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from rattle.compare.checks.extremes import flights, impacts, runs, sampling, scaling, steps, sticking, windows
from rattle.compare.checks.extremes.row import Extreme

if TYPE_CHECKING:
    import pandas as pd

ROWS: dict[str, Callable[[], Extreme]] = {
    row.__name__: row
    for part in (flights, impacts, sticking, windows, steps, sampling, scaling, runs)
    for row in part.ROWS
}
"""Every row by the name of its function."""


def extremes() -> tuple[Extreme, ...]:
    """Run all rows; takes about a minute.

    Examples
    --------
    >>> all(row.holds for row in extremes())  # doctest: +SKIP
    True
    """
    return tuple(row() for row in ROWS.values())


def table(rows: Iterable[Extreme]) -> "pd.DataFrame":
    """Convert rows to a table.

    Examples
    --------
    >>> table([Extreme("E", "beta", "0 to 1e3", "mpmath", 2e-16, 4e-15, "its value")])["holds"].tolist()
    [True]
    """
    import pandas as pd

    return pd.DataFrame([row._asdict() | {"holds": row.holds} for row in rows])
