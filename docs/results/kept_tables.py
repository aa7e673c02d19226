"""Tables of the pages: numbers as words, and what is measured as Markdown beside its CSV.

A measuring script names its `TABLE`, a CSV, and the function `table` that says what the page shows
of it.  ``python docs/results/kept_tables.py`` writes all of that from the kept CSVs.
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest

HERE = Path(__file__).parent
Table = tuple[list[str], list[list[str]]]
Cell = str | Callable[[dict[str, Any]], str]
"""A column whose numbers are shown with few digits, or what is shown of a row."""


def short(value: Any, digits: int = 3) -> str:
    """A number with few digits; a dash for none."""
    if isinstance(value, str):
        return value
    if pd.isna(value):
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if float(value).is_integer() and abs(value) < 1e9:
        return f"{int(value):,}"
    return f"{float(value):.{digits}g}"


def share(hits: float, of: int) -> str:
    """A count with the 95 % interval of its share (Clopper and Pearson 1934); nothing where none
    was measured."""
    if not hits >= 0.0:
        return ""
    low, high = binomtest(int(hits), of).proportion_ci()
    return f"{hits:.0f} of {of} ({low:.2%} to {high:.2%})"


def median_and_most(values: pd.Series, between: str = " / ", after: str = "") -> str:
    """The median and the largest of some numbers."""
    return f"{short(values.median(), 2)}{between}{short(values.max(), 2)}{after}"


def columns(found: pd.DataFrame, cells: dict[str, Cell]) -> Table:
    """A row for each of `found`, with a cell under each head."""
    rows = [
        [cell(row) if callable(cell) else short(row[cell]) for cell in cells.values()]
        for row in found.to_dict("records")
    ]
    return list(cells), rows


def place_of(csv: Path) -> Path:
    """Where the Markdown of a CSV is."""
    return csv.with_suffix(".table.md")


def text(table: Table) -> str:
    """A table in Markdown."""
    heads, rows = table
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def read(file: Path) -> Table:
    """A table from its Markdown."""
    heads, _, *rows = (
        [cell.strip() for cell in line[1:-1].split("|")]
        for line in file.read_text(encoding="utf-8").splitlines()
    )
    return heads, rows


def keep(
    found: pd.DataFrame,
    csv: Path,
    table: Callable[[pd.DataFrame], Table],
    digits: str | None = "%.4g",
) -> None:
    """Write what was measured, and what the page shows of it; without `digits` all of them."""
    found.to_csv(csv, index=False, float_format=digits, lineterminator="\n")
    place_of(csv).write_text(text(table(pd.read_csv(csv))), encoding="utf-8")


def kept() -> dict[Path, str]:
    """The Markdown of every measuring script from its kept CSV, by its file."""
    scripts = (import_module(file.stem) for file in sorted(HERE.glob("measure_*.py")))
    return {
        place_of(script.TABLE): text(script.table(pd.read_csv(script.TABLE)))
        for script in scripts
        if hasattr(script, "TABLE")
    }


if __name__ == "__main__":
    for file, written in kept().items():
        file.write_text(written, encoding="utf-8")
