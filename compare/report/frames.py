"""Tables of a page from DataFrames."""

from collections.abc import Callable, Collection, Sequence
from typing import Any, TypeAlias

import pandas as pd

from rattle.compare.report.content import NUMBER, TEXT, Column, Table, TableCell

Form: TypeAlias = str | Callable[[Any], TableCell | str | float]
"""What a cell shows of a row: a format that names its values, or a function of it."""


def table_of(frame: pd.DataFrame, texts: Collection[str] = (), summary: str = "") -> Table:
    """A table of all columns as they are; those in `texts` are text.

    Examples
    --------
    >>> table = table_of(pd.DataFrame({"scheme": ["exact-flight"], "paths": [4000]}), ["scheme"])
    >>> [cell.text for cell in table.rows[0]]
    ['exact-flight', '4,000']
    """
    names = [str(name) for name in frame.columns]
    rows = (
        [str(v) if n in texts else float(v) for n, v in zip(names, row, strict=True)]
        for row in frame.itertuples(index=False)
    )
    return Table.of(_columns(names, texts), rows, summary)


def format_table(
    frame: pd.DataFrame, columns: Sequence[tuple[str, Form]], texts: Collection[str] = (), summary: str = ""
) -> Table:
    """A table of columns with heads and forms of their own; those with a head in `texts` are text.

    Examples
    --------
    >>> table = format_table(pd.DataFrame({"sigma": [0.123], "n": [4000]}), [("σ", "{sigma:.2g}"), ("paths", "{n:,}")])
    >>> [cell.text for cell in table.rows[0]]
    ['0.12', '4,000']
    """
    rows = (
        [form.format_map(row) if isinstance(form, str) else form(row) for _, form in columns]
        for row in frame.to_dict("records")
    )
    return Table.of(_columns([head for head, _ in columns], texts), rows, summary)


def _columns(heads: Sequence[str], texts: Collection[str]) -> list[Column]:
    return [Column(head, TEXT if head in texts else NUMBER) for head in heads]
