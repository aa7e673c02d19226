"""CSV output: numbers without loss of digits, text without terminal control characters."""

from pathlib import Path
from typing import Any

import pandas as pd

from rattle.scene.text import harmless


def csv_text(table: pd.DataFrame, **options: Any) -> str:
    r"""A table as CSV.

    Examples
    --------
    >>> print(csv_text(pd.DataFrame({"name": ["\x1b[31mnormal"], "sigma": [0.1]}), index=False).strip())
    name,sigma
    \x1b[31mnormal,0.1
    """
    texts = table.select_dtypes(exclude=["number", "bool"])
    return str(table.assign(**{str(name): texts[name].map(_cell) for name in texts}).to_csv(**options))


def write_csv(table: pd.DataFrame, path: Path, **options: Any) -> None:
    """Write a table as CSV, see `csv_text`."""
    path.write_text(csv_text(table, **options), encoding="utf-8")


def _cell(value: object) -> object:
    return harmless(value, keep="") if isinstance(value, str) else value
