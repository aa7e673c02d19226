"""Reads predicted moments, in whichever form they come, as tables by the name of their closure."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.compare.judge.rows import PREFIX, NamedSection, split_column
from rattle.compare.judge.samples import read_table, units_of
from rattle.scene import InputError, nearest

PREDICTED_FORMS = (
    "give a table (or a mapping of columns) with columns x, sd_x, skew_x, kurt_x, rho_x_y, a"
    " mapping of names to such tables, a result of mean_map, or a function that returns one of them"
)
MOMENTS = ("mean", "sd", "skew", "kurt")


def read_predictions(given: Any, name: str = "prediction") -> list[NamedSection]:
    """Read predicted moments in any of their `PREDICTED_FORMS`."""
    if callable(given) and not hasattr(given, "section"):
        label = getattr(given, "__name__", name)
        return read_predictions(given(), "closure" if label == "<lambda>" else label)
    if hasattr(given, "section"):
        return [NamedSection(str(given.closure), given.section)]
    if isinstance(given, str | Path):
        table = read_table(Path(given), "predicted")
        return read_predictions(table, Path(given).stem)
    if isinstance(given, pd.DataFrame):
        return _read_frame(given, name)
    if hasattr(given, "to_dataframe"):
        frame = given.to_dataframe()
        frame.attrs["units"] = units_of(given.data_vars)
        return [NamedSection(name, frame)]
    if isinstance(given, Mapping) and given:
        tables = [_is_table(value) for value in given.values()]
        if any(tables) and not all(tables):
            name, value = list(given.items())[tables.index(False)]
            raise InputError(f"predicted[{name!r}]", value, "give a table, as for the others")
        if all(tables):
            return [
                section._replace(closure=str(closure))
                for closure, value in given.items()
                for section in read_predictions(value, str(closure))[:1]
            ]
        return [NamedSection(name, _frame_of_columns(given))]
    raise InputError("predicted", type(given).__name__, PREDICTED_FORMS)


def _is_table(value: Any) -> bool:
    return (
        isinstance(value, pd.DataFrame | Mapping | Path)
        or callable(value)
        or hasattr(value, "section")
        or hasattr(value, "to_dataframe")
    )


def _frame_of_columns(given: Mapping[Any, Any]) -> pd.DataFrame:
    """A table from its columns; numbers are those of a single row, which is numbered from 1."""
    columns = {str(name): np.atleast_1d(np.asarray(values)) for name, values in given.items()}
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError("predicted", lengths, "all columns need the same number of rows")
    index = pd.RangeIndex(1, next(iter(lengths.values())) + 1)
    return pd.DataFrame(columns, index=index)


def _read_frame(given: pd.DataFrame, name: str) -> list[NamedSection]:
    """A table; one with a column ``closure`` holds several."""
    if "closure" not in given:
        return [NamedSection(name, _numbered(given))]
    return [
        NamedSection(str(closure), _numbered(table.drop(columns="closure")))
        for closure, table in given.groupby("closure", sort=False)
    ]


USUAL_LABELS = ("impact", "row", "time")
OF_SECTION = {"tau", "flight", "mesh", "side"}
"""Columns by which a table of `rattle.mean_map` is known."""


def _numbered(table: pd.DataFrame) -> pd.DataFrame:
    """A table by its label; the rows of one without any are numbered from 1."""
    if table.index.name is not None or not isinstance(table.index, pd.RangeIndex):
        return table
    for name in USUAL_LABELS:
        if name in table:
            return table.set_index(name)
    return table.set_axis(pd.RangeIndex(1, len(table) + 1), axis="index")


class PredictedMoments(NamedTuple):
    """What is predicted of the quantities of samples."""

    quantities: list[str]
    moments: list[str]  # of mean, sd, skew, kurt; mean and sd always
    pairs: list[tuple[str, str]]  # of which a correlation is predicted
    others: list[str]  # columns that are no moments of these quantities

    @property
    def columns(self) -> list[str]:
        """The columns of all these moments."""
        single = [PREFIX[moment] + name for moment in self.moments for name in self.quantities]
        return [*single, *(f"rho_{a}_{b}" for a, b in self.pairs)]


def find_moments(
    predictions: Sequence[NamedSection], names: Sequence[str], left_out: Iterable[str] = ()
) -> PredictedMoments:
    """Find what is predicted of the quantities with these names.

    A column whose name is nearly that of a quantity, or the moment of an unknown one, is refused,
    unless it is empty, as of a second wheel that is not there, or one of a mean map, which has more
    quantities than many samples. `left_out`: Quantities that the
    samples have too, and that were not asked for.
    """
    tables = [table.section for table in predictions]
    columns = list(dict.fromkeys(str(name) for table in tables for name in table.columns))
    filled = {str(name) for table in tables for name in table.columns if table[name].notna().any()}
    of_map = columns if set(columns) >= OF_SECTION else []
    known = [*names, *left_out]
    not_asked = {prefix + name for name in left_out for prefix in PREFIX.values()}
    quantities = []
    moments = set()
    pairs = []
    others: list[str] = []
    for column in columns:
        # a quantity may have a name that looks like that of a moment
        moment, quantity = ("mean", column) if column in names else split_column(column)
        if moment != "rho" and quantity in names:
            moments.add(moment)
            quantities.append(quantity)
        elif pair := _pair_of(column, names):
            pairs.append(pair)
            quantities.extend(pair)
        else:
            known_moment = column in not_asked or _pair_of(column, known)
            if column in filled and not known_moment and column not in of_map:
                _check_name(column, names)
            if column not in of_map or quantity not in others:
                others.append(quantity if column in of_map else column)
    ordered = [name for name in names if name in quantities]
    if not ordered:
        first = columns[0] if columns else ""
        raise InputError(
            "predicted", columns, f"no column names a quantity; {nearest(first, names)}"
        )
    listed = [m for m in MOMENTS if m in moments | {"mean", "sd"}]
    return PredictedMoments(ordered, listed, pairs, others)


def _pair_of(column: str, names: Sequence[str]) -> tuple[str, str] | None:
    """The two quantities whose correlation a column is."""
    pairs = ((a, b) for a in names for b in names if column == f"rho_{a}_{b}")
    return next(pairs, None)


def _check_name(column: str, names: Sequence[str]) -> None:
    """Refuse the moment of an unknown quantity, and what looks like a misspelt one."""
    moment, quantity = split_column(column)
    meant = nearest(quantity, names)
    if moment != "mean" or meant.startswith("did you mean"):
        raise InputError("predicted", column, f"no such quantity; {meant}")


def check_values(predictions: Sequence[NamedSection], columns: Iterable[str]) -> None:
    """Refuse predicted moments that are no real numbers, and sds below zero."""
    for closure, table in predictions:
        for column in columns:
            if column not in table:
                continue
            values = table[column]
            place = f"predicted {column} of {closure}"
            if values.dtype.kind not in "iuf":
                raise InputError(place, f"values of type {values.dtype}", "give real numbers")
            wrong = np.isinf(values.to_numpy(float))
            if wrong.any():
                label = table.index[wrong][0]
                why = "is infinite; leave it out, as NaN, where nothing is predicted"
                raise InputError(f"{place} at {label}", float(values[wrong].iloc[0]), why)
            if column.startswith("sd_") and (values < 0.0).any():
                label = table.index[values < 0.0][0]
                raise InputError(
                    f"{place} at {label}", float(values[label]), "must be 0 or greater"
                )


def check_labels(predictions: Sequence[NamedSection], labels: Sequence[Any], label: str) -> None:
    """Refuse predicted rows that the samples do not have, and rows in another order."""
    known = pd.Index(labels)
    for closure, table in predictions:
        if table.index.has_duplicates:
            twice = table.index[table.index.duplicated()][0]
            raise InputError(f"{label} of {closure}", twice, "stands twice; keep one")
        at = known.get_indexer(table.index)
        if (at < 0).any():
            missing = table.index[at < 0][0]
            span = f"{labels[0]} to {labels[-1]}, {len(labels)} rows"
            raise InputError(f"{label} of {closure}", missing, f"the samples have {span}")
        if (np.diff(at) <= 0).any():
            why = f"the samples come in another order ({labels[0]} first); sort one like the other"
            raise InputError(f"{label} of {closure}", table.index.tolist(), why)
