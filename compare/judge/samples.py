"""Reads samples of any simulation, in whichever form they come, as blocks of paths."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.judge.sums import BLOCK_VALUES
from rattle.scene import FileError, Floats, InputError, nearest

SAMPLE_FORMS = (
    "give an array (paths, rows, quantities), a mapping of names to arrays (paths, rows), a table"
    " with columns path, row and quantities, an xarray Dataset, a CSV or Parquet file or a folder"
    " of them, an iterator of blocks of paths, or a reduced table with columns x, se_x"
)
SUFFIXES: dict[str, Any] = {
    ".csv": pd.read_csv,
    ".parquet": pd.read_parquet,
    ".pq": pd.read_parquet,
}
"""How a file of each kind is read."""

PATH_DIMENSIONS = ("path", "sample", "chain")
"""Names of the dimension, or column, that numbers the paths."""

DRAW = "draw"  # the dimension beside "chain" of ArviZ


@dataclass
class PathSamples:
    """Samples as blocks of paths, or already reduced to a table."""

    names: tuple[str, ...]  # of the quantities
    label: str  # what numbers the rows, such as "impact"; empty where nothing says so
    labels: NDArray[Any] | None  # of the rows; None where they have none
    blocks: Iterable[Floats]  # each (paths, rows, quantities)
    array: Any = None  # all of it, (paths, rows, quantities), where it is in memory
    reduced: pd.DataFrame | None = None  # a row for each moment, where it is reduced already
    draws: int = 0  # per chain, where the paths are draws of chains
    columns: dict[str, NDArray[Any]] = field(default_factory=dict)  # what else a path has
    units: dict[str, str] = field(default_factory=dict)


def read_samples(given: Any, names: Sequence[str] | None, label: str, argument: str) -> PathSamples:
    """Read samples in any of their `SAMPLE_FORMS`.

    `names`: Of the quantities, where the samples do not say. `label`: What numbers the rows of the
    predictions. `argument`: Its name, for error messages.
    """
    if isinstance(given, str | Path):
        return _read_path(Path(given), names, label, argument)
    if hasattr(given, "to_dataset") and not hasattr(given, "dims"):  # a group of ArviZ
        given = given.to_dataset()
    if hasattr(given, "data_vars"):
        return _read_dataset(given, label, argument)
    if isinstance(given, pd.DataFrame):
        return _read_table(given, names, label, argument)
    if isinstance(given, Mapping):
        return _read_mapping(given, argument)
    if isinstance(given, np.ndarray) or hasattr(given, "__array__"):
        return _read_array(np.asarray(given), names, argument)
    if isinstance(given, Iterator):
        return _read_blocks(given, names, label, argument)
    raise InputError(argument, type(given).__name__, SAMPLE_FORMS)


def _read_array(values: NDArray[Any], names: Sequence[str] | None, argument: str) -> PathSamples:
    """An array (paths, rows, quantities), or (paths, rows) of one quantity."""
    _check_numbers(values, argument)
    if values.ndim == 2 and names is not None and len(names) == 1:
        values = values[:, :, None]
    if values.ndim != 3:
        why = f"has {values.ndim} dimensions; {SAMPLE_FORMS}"
        raise InputError(argument, f"array of shape {values.shape}", why)
    if names is None:
        why = f"its {values.shape[2]} quantities have no names; give names=[...]"
        raise InputError(argument, f"array of shape {values.shape}", why)
    if len(names) != values.shape[2]:
        why = f"names {len(names)} quantities, and {argument} has {values.shape[2]}"
        raise InputError("names", tuple(names), why)
    return PathSamples(tuple(names), "", None, _slices(values), array=values)


def _read_mapping(given: Mapping[str, Any], argument: str) -> PathSamples:
    """A mapping of names to arrays (paths, rows)."""
    arrays = {str(name): np.asarray(values) for name, values in given.items()}
    if not arrays:
        raise InputError(argument, {}, SAMPLE_FORMS)
    shapes = {}
    for name, values in arrays.items():
        _check_numbers(values, f"{argument}[{name!r}]")
        if values.ndim != 2:
            why = "give an array (paths, rows)"
            raise InputError(f"{argument}[{name!r}]", f"array of shape {values.shape}", why)
        shapes[name] = values.shape
    if len(set(shapes.values())) > 1:
        raise InputError(argument, shapes, "all quantities need the same paths and rows")
    stacked = np.stack(list(arrays.values()), axis=-1)
    return PathSamples(tuple(arrays), "", None, _slices(stacked), array=stacked)


def _read_dataset(given: Any, label: str, argument: str) -> PathSamples:
    """An xarray Dataset whose variables have a dimension ``path`` (or ``chain`` and ``draw``)."""
    dims = tuple(map(str, given.dims))
    path = next((name for name in PATH_DIMENSIONS if name in dims), None)
    if path is None:
        why = f"has no dimension that numbers the paths; name one of them {PATH_DIMENSIONS[0]!r}"
        raise InputError(argument, dims, why)
    over = [path, DRAW] if DRAW in dims else [path]
    rows = [name for name in dims if name not in over]
    if len(rows) != 1:
        why = "needs one dimension besides the paths, which numbers the rows"
        raise InputError(argument, dims, why)
    names = tuple(str(name) for name, values in given.data_vars.items() if path in values.dims)
    arrays = []
    for name in names:
        values = given[name].transpose(*over, *rows).to_numpy()
        _check_numbers(values, f"{argument}[{name!r}]")
        arrays.append(values.reshape(-1, values.shape[-1]))
    stacked = np.stack(arrays, axis=-1)
    labels = given[rows[0]].to_numpy() if rows[0] in given.coords else None
    units = {
        name: str(given[name].attrs["units"]) for name in names if given[name].attrs.get("units")
    }
    draws = given.sizes[DRAW] if DRAW in dims else 0
    return PathSamples(names, rows[0], labels, _slices(stacked), stacked, draws=draws, units=units)


def _read_table(
    given: pd.DataFrame, names: Sequence[str] | None, label: str, argument: str
) -> PathSamples:
    """A long table with a column ``path``, or one that is reduced already."""
    units = dict(given.attrs.get("units", {}))
    table = given.reset_index() if any(name is not None for name in given.index.names) else given
    columns = [str(name) for name in table.columns]
    table = table.set_axis(columns, axis="columns")
    path = next((name for name in PATH_DIMENSIONS if name in columns), None)
    if path is None:
        if "simulated" in columns and "moment" in columns:
            row = label if label in columns else _row_column(columns, TIDY, label, argument)
            quantities = tuple(dict.fromkeys(table["quantity"]))
            return PathSamples(quantities, row, None, (), reduced=table, units=units)
        if any(name.startswith("se_") for name in columns):
            return _read_reduced(table, given, label, argument, units)
        raise InputError(argument, columns, f"has no column 'path'; {SAMPLE_FORMS}")
    row = (
        label if label in columns else _row_column(columns, [path, *(names or ())], label, argument)
    )
    return _unstack(table, path, row, names, argument, units)


TIDY = ("quantity", "moment")


def _row_column(columns: Sequence[str], others: Iterable[str], label: str, argument: str) -> str:
    """The column that numbers the rows, where it has not the name that the predictions give it."""
    usual = [name for name in ("row", "impact", "time", "index") if name in columns]
    left = [name for name in columns if name not in set(others)]
    if usual or (len(left) == 1 and not label):
        return usual[0] if usual else left[0]
    why = f"has no column {label or 'row'!r}, which numbers the rows"
    raise InputError(argument, list(columns), why)


def _unstack(
    table: pd.DataFrame,
    path: str,
    row: str,
    names: Sequence[str] | None,
    argument: str,
    units: dict[str, str],
) -> PathSamples:
    """A long table as an array; a path that has not a row has no values there."""
    others = [name for name in table.columns if name not in (path, row)]
    unknown = [name for name in names or () if name not in others]
    if unknown:
        raise InputError("names", unknown[0], nearest(unknown[0], others))
    numeric = [name for name in others if pd.api.types.is_numeric_dtype(table[name])]
    quantities = tuple(names or numeric)
    for name in quantities:
        _check_numbers(table[name].to_numpy(), f"{argument}[{name!r}]")
    which, paths = pd.factorize(table[path])
    at, labels = pd.factorize(table[row])
    if pd.MultiIndex.from_arrays([which, at]).has_duplicates:
        raise InputError(argument, row, f"some path has two rows of the same {row}; keep one")
    array = np.full((len(paths), len(labels), len(quantities)), np.nan)
    array[which, at] = table[list(quantities)].to_numpy(float)
    first = np.unique(which, return_index=True)[1]
    more = {name: table[name].to_numpy()[first] for name in others if name not in quantities}
    return PathSamples(
        quantities, row, np.asarray(labels), _slices(array), array, columns=more, units=units
    )


def _read_reduced(
    table: pd.DataFrame, given: pd.DataFrame, label: str, argument: str, units: dict[str, str]
) -> PathSamples:
    """A table with columns ``x, se_x, sd_x, se_sd_x, ...`` as one with a row for each moment."""
    row = label if label in table else str(given.index.name or "")
    if not row:
        usual = [name for name in ("row", "impact", "time") if name in table]
        row = usual[0] if usual else "row"
    labels = table[row] if row in table else pd.Series(np.arange(1, len(table) + 1))
    parts = []
    quantities: list[str] = []
    for prefix, moment in (("", "mean"), ("sd_", "sd"), ("skew_", "skew"), ("kurt_", "kurt")):
        for column in table.columns:
            base = column.removeprefix("se_")
            if base == column or base not in table or not base.startswith(prefix):
                continue
            quantity = base.removeprefix(prefix)
            if prefix == "" and base.startswith(("sd_", "skew_", "kurt_", "rho_")):
                continue
            if prefix == "" and quantity not in quantities:
                quantities.append(quantity)
            parts.append(_reduced_rows(table, labels, row, quantity, moment, base, argument))
    for column in table.columns:
        if column.startswith("rho_") and f"se_{column}" in table:
            parts.append(_reduced_rows(table, labels, row, column, "rho", column, argument))
    if not parts:
        why = "needs a column 'se_x' beside each 'x': its standard error, 0 where it is exact"
        raise InputError(argument, list(table.columns), why)
    rows = pd.concat(parts, ignore_index=True)
    return PathSamples(tuple(quantities), row, None, (), reduced=rows, units=units)


def _reduced_rows(
    table: pd.DataFrame,
    labels: "pd.Series[Any]",
    row: str,
    quantity: str,
    moment: str,
    column: str,
    argument: str,
) -> pd.DataFrame:
    """The rows of one moment of a reduced table."""
    _check_numbers(table[column].to_numpy(), f"{argument}[{column!r}]")
    _check_numbers(table[f"se_{column}"].to_numpy(), f"{argument}['se_{column}']")
    for name in (f"se_{column}", *([column] if moment == "sd" else [])):
        below = table[table[name] < 0.0]
        if len(below):
            value = below[name].iloc[0]
            raise InputError(f"{argument}[{name!r}]", float(value), "must be 0 or greater")
    paths = table["paths"].to_numpy(float) if "paths" in table else np.nan
    return pd.DataFrame(
        {
            row: labels.to_numpy(),
            "quantity": quantity,
            "moment": moment,
            "simulated": table[column].to_numpy(float),
            "se": table[f"se_{column}"].to_numpy(float),
            "paths": paths,
        }
    )


def _read_path(path: Path, names: Sequence[str] | None, label: str, argument: str) -> PathSamples:
    """A file, or a folder of files of which each holds whole paths."""
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
        if not files:
            raise FileError(argument, str(path), "holds no .csv or .parquet file")
        return _read_blocks(map(read_table, files), names, label, argument)
    return _read_table(read_table(path, argument), names, label, argument)


def read_table(path: Path, argument: str = "samples") -> pd.DataFrame:
    """A table from a CSV or Parquet file."""
    if path.suffix not in SUFFIXES:
        raise FileError(argument, str(path), f"give a file {' or '.join(SUFFIXES)}, or a folder")
    try:
        table: pd.DataFrame = SUFFIXES[path.suffix](path)
    except FileNotFoundError:
        raise FileError(argument, str(path), "does not exist; check the path") from None
    except (OSError, ValueError, UnicodeError) as error:
        why = f"is no table ({str(error).splitlines()[0]}); write it as CSV or Parquet"
        raise FileError(argument, str(path), why) from None
    return table


def _read_blocks(
    given: Iterator[Any], names: Sequence[str] | None, label: str, argument: str
) -> PathSamples:
    """An iterator of blocks of paths, each in a form of its own; one is in memory at a time."""
    first = next(given, None)
    if first is None:
        raise InputError(argument, "an iterator", "yields no block of paths")
    head = read_samples(first, names, label, argument)
    if head.reduced is not None:
        raise InputError(argument, "a reduced table", "give it alone, not among others")

    def blocks() -> Iterator[Floats]:
        yield from head.blocks
        for number, block in enumerate(given, start=2):
            piece = read_samples(block, names, label, f"block {number} of {argument}")
            same_rows = pd.Series(piece.labels).equals(pd.Series(head.labels))
            if piece.names != head.names or not same_rows:
                why = f"has other quantities or rows than the first block: {head.names}"
                raise InputError(f"block {number} of {argument}", piece.names, why)
            yield from piece.blocks

    return PathSamples(head.names, head.label, head.labels, blocks(), units=head.units)


def _slices(values: NDArray[Any]) -> Iterator[Floats]:
    """An array in blocks of paths that the cache of a processor holds."""
    paths = max(BLOCK_VALUES // max(values.shape[1] * values.shape[2], 1), 32)
    for start in range(0, len(values), paths):
        yield np.ascontiguousarray(values[start : start + paths], dtype=float)


def _check_numbers(values: NDArray[Any], field_name: str) -> None:
    """Refuse what is no array of real numbers."""
    if values.dtype.kind not in "iuf":
        why = "give real numbers" + ("; take its real part" if values.dtype.kind == "c" else "")
        raise InputError(field_name, f"array of type {values.dtype}", why)


def check_block(block: Floats, seen_paths: int, names: Sequence[str], argument: str) -> None:
    """Refuse values that are infinite, or missing elsewhere than from some row on.

    `seen_paths`: Paths of earlier blocks. Shapes: `block` (paths, rows, quantities).
    """
    finite: NDArray[Any] = np.asarray(np.isfinite(block))
    if finite.all():
        return
    infinite: NDArray[Any] = np.asarray(np.isinf(block))
    here: NDArray[Any] = np.asarray(~finite.all(axis=2))
    partly = here & finite.any(axis=2)
    resumed = np.zeros_like(here)
    resumed[:, :-1] = here[:, :-1] & ~here[:, 1:]
    refused: tuple[tuple[Any, str], ...] = (
        (infinite.any(axis=2), "is infinite; leave the path out from there on, as NaN"),
        (partly, "is missing, and others of the same row are not; a path ends in all at once"),
        (resumed, "is missing, and there is a later one; a path that has ended does not go on"),
    )
    for wrong, why in refused:
        if wrong.any():
            path, row = np.argwhere(wrong)[0].tolist()
            which = int(np.argmin(np.isfinite(block[path, row])))
            place = f"{argument}, path {seen_paths + path}, row {row + 1}, {names[which]}"
            raise InputError(place, float(block[path, row, which]), why)
