"""Reads samples of any simulation, in whichever form they come, as blocks of paths."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.judge.rows import PREFIX, split_column
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
ROW_COLUMNS = ("row", "impact", "time", "index")
"""Usual names of the column that numbers the rows."""
TIDY = ("quantity", "moment")


@dataclass
class PathSamples:
    """Samples as blocks of paths, or already reduced to a table."""

    names: tuple[str, ...]  # of the quantities
    label: str = ""  # what numbers the rows, such as "impact"; empty where nothing says so
    labels: NDArray[Any] | None = None  # of the rows; None where they have none
    array: Any = None  # all of it, (paths, rows, quantities), where it is in memory
    blocks: Iterable[
        Floats
    ] = ()  # each (paths, rows, quantities); those of the array if it is there
    reduced: pd.DataFrame | None = None  # a row for each moment, where it is reduced already
    draws: int = 0  # per chain, where the paths are draws of chains
    columns: dict[str, NDArray[Any]] = field(default_factory=dict)  # what else a path has
    units: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.array is not None:
            self.blocks = _slices(self.array)


def _slices(values: NDArray[Any]) -> Iterator[Floats]:
    """An array in blocks of paths that the cache of a processor holds."""
    paths = max(BLOCK_VALUES // max(values.shape[1] * values.shape[2], 1), 32)
    for start in range(0, len(values), paths):
        yield np.ascontiguousarray(values[start : start + paths], dtype=float)


@dataclass(frozen=True)
class SampleReader:
    """Reads samples in any of their `SAMPLE_FORMS`."""

    names: Sequence[str] | None  # of the quantities, where the samples do not say
    label: str  # what numbers the rows of the predictions
    argument: str  # its name, for error messages

    def read(self, given: Any) -> PathSamples:
        """Read them, whatever their form."""
        if isinstance(given, str | Path):
            return self._read_path(Path(given))
        if hasattr(given, "to_dataset") and not hasattr(given, "dims"):  # a group of ArviZ
            given = given.to_dataset()
        if hasattr(given, "data_vars"):
            return self._read_dataset(given)
        if isinstance(given, pd.DataFrame):
            return self._read_table(given)
        if isinstance(given, Mapping):
            return self._read_mapping(given)
        if isinstance(given, np.ndarray) or hasattr(given, "__array__"):
            return self._read_array(np.asarray(given))
        if isinstance(given, Iterator):
            return self._read_blocks(given)
        raise self._refuse(type(given).__name__, SAMPLE_FORMS)

    def _refuse(self, value: object, why: str) -> InputError:
        """The error for samples that cannot be read."""
        return InputError(self.argument, value, why)

    def _numbers(self, values: Any, name: object) -> NDArray[Any]:
        """The values of a quantity, which are checked."""
        return check_numbers(np.asarray(values), f"{self.argument}[{name!r}]")

    def _read_array(self, values: NDArray[Any]) -> PathSamples:
        """An array (paths, rows, quantities), or (paths, rows) of one quantity."""
        check_numbers(values, self.argument)
        names = self.names
        if values.ndim == 2 and names is not None and len(names) == 1:
            values = values[:, :, None]
        shape = f"array of shape {values.shape}"
        if values.ndim != 3:
            raise self._refuse(shape, f"has {values.ndim} dimensions; {SAMPLE_FORMS}")
        if names is None:
            why = f"its {values.shape[2]} quantities have no names; give names=[...]"
            raise self._refuse(shape, why)
        if len(names) != values.shape[2]:
            why = f"names {len(names)} quantities, and {self.argument} has {values.shape[2]}"
            raise InputError("names", tuple(names), why)
        return PathSamples(tuple(names), array=values)

    def _read_mapping(self, given: Mapping[str, Any]) -> PathSamples:
        """A mapping of names to arrays (paths, rows)."""
        if not given:
            raise self._refuse({}, SAMPLE_FORMS)
        arrays = {}
        for name, values in given.items():
            array = self._numbers(values, str(name))
            if array.ndim != 2:
                place = f"{self.argument}[{str(name)!r}]"
                why = "give an array (paths, rows)"
                raise InputError(place, f"array of shape {array.shape}", why)
            arrays[str(name)] = array
        shapes = {name: array.shape for name, array in arrays.items()}
        if len(set(shapes.values())) > 1:
            raise self._refuse(shapes, "all quantities need the same paths and rows")
        return PathSamples(tuple(arrays), array=np.stack(list(arrays.values()), axis=-1))

    def _read_dataset(self, given: Any) -> PathSamples:
        """An xarray Dataset whose variables have a dimension ``path`` (or ``chain`` and
        ``draw``)."""
        dims = tuple(map(str, given.dims))
        path = _first_of(PATH_DIMENSIONS, dims)
        if not path:
            first = PATH_DIMENSIONS[0]
            why = f"has no dimension that numbers the paths; name one of them {first!r}"
            raise self._refuse(dims, why)
        rows = [name for name in dims if name not in (path, DRAW)]
        if len(rows) != 1:
            why = "needs one dimension besides the paths, which numbers the rows"
            raise self._refuse(dims, why)
        quantities = {
            str(n): values for n, values in given.data_vars.items() if path in values.dims
        }
        over = [path, DRAW] if DRAW in dims else [path]
        arrays = []
        for name, variable in quantities.items():
            values = self._numbers(variable.transpose(*over, *rows), name)
            arrays.append(values.reshape(-1, values.shape[-1]))
        return PathSamples(
            tuple(quantities),
            rows[0],
            given[rows[0]].to_numpy() if rows[0] in given.coords else None,
            np.stack(arrays, axis=-1),
            draws=given.sizes.get(DRAW, 0),
            units=units_of(quantities),
        )

    def _read_table(self, given: pd.DataFrame) -> PathSamples:
        """A long table with a column ``path``, or one that is reduced already."""
        indexed = any(name is not None for name in given.index.names)
        table = given.reset_index() if indexed else given
        columns = [str(name) for name in table.columns]
        table = table.set_axis(columns, axis="columns")
        path = _first_of(PATH_DIMENSIONS, columns)
        if path:
            samples = self._unstack(table, path, self._row_column(columns, path))
        elif "simulated" in columns and "moment" in columns:
            row = self._row_column(columns)
            names = tuple(dict.fromkeys(table["quantity"]))
            samples = PathSamples(names, row, reduced=table)
        elif any(name.startswith("se_") for name in columns):
            samples = self._read_reduced(table, str(given.index.name or ""))
        else:
            raise self._refuse(columns, f"has no column 'path'; {SAMPLE_FORMS}")
        return replace(samples, units=dict(given.attrs.get("units", {})))

    def _row_column(self, columns: Sequence[str], path: str = "") -> str:
        """The column that numbers the rows: that of the predictions, or with a usual name, or the
        only one that is left."""
        if self.label in columns:
            return self.label
        others = {path, *(self.names or ())} if path else set(TIDY)
        left = [name for name in columns if name not in others]
        only = left[0] if len(left) == 1 and not self.label else ""
        if row := _first_of(ROW_COLUMNS, columns) or only:
            return row
        why = f"has no column {self.label or 'row'!r}, which numbers the rows"
        raise self._refuse(list(columns), why)

    def _unstack(self, table: pd.DataFrame, path: str, row: str) -> PathSamples:
        """A long table as an array; a path that has not a row has no values there."""
        others = [name for name in table.columns if name not in (path, row)]
        for name in self.names or ():
            if name not in others:
                raise InputError("names", name, nearest(name, others))
        numeric = [name for name in others if pd.api.types.is_numeric_dtype(table[name])]
        quantities = tuple(self.names or numeric)
        for name in quantities:
            self._numbers(table[name], name)
        which, paths = pd.factorize(table[path])
        at, labels = pd.factorize(table[row])
        if pd.MultiIndex.from_arrays([which, at]).has_duplicates:
            raise self._refuse(row, f"some path has two rows of the same {row}; keep one")
        array = np.full((len(paths), len(labels), len(quantities)), np.nan)
        array[which, at] = table[list(quantities)].to_numpy(float)
        first = np.unique(which, return_index=True)[1]
        more = {name: table[name].to_numpy()[first] for name in others if name not in quantities}
        return PathSamples(quantities, row, np.asarray(labels), array, columns=more)

    def _read_reduced(self, table: pd.DataFrame, index: str) -> PathSamples:
        """A table with columns ``x, se_x, sd_x, se_sd_x, ...`` as one with a row for each moment.

        `index`: The name of its index.
        """
        names = list(map(str, table))
        usual = _first_of(ROW_COLUMNS[:-1], names) or "row"
        row = self.label if self.label in names else index or usual
        labels = table[row] if row in names else np.arange(1, len(table) + 1)
        bases = [name.removeprefix("se_") for name in names if name.startswith("se_")]
        columns = {moment: list[str]() for moment in PREFIX}
        for column in bases:
            if column in names:
                columns[split_column(column)[0]].append(column)
        if not any(columns.values()):
            why = "needs a column 'se_x' beside each 'x': its standard error, 0 where it is exact"
            raise self._refuse(names, why)
        paths = table["paths"].to_numpy(float) if "paths" in table else np.nan
        parts = [
            pd.DataFrame(
                {
                    row: labels,
                    "quantity": column.removeprefix(PREFIX[moment]),
                    "moment": moment,
                    "simulated": self._reduced_numbers(table, column, least=moment == "sd"),
                    "se": self._reduced_numbers(table, f"se_{column}", least=True),
                    "paths": paths,
                }
            )
            for moment, of_moment in columns.items()
            for column in of_moment
        ]
        rows = pd.concat(parts, ignore_index=True)
        return PathSamples(tuple(columns["mean"]), row, reduced=rows)

    def _reduced_numbers(self, table: pd.DataFrame, column: str, least: bool) -> NDArray[Any]:
        """A column of a reduced table.

        `least`: Whether it must not be below 0.
        """
        values = self._numbers(table[column], column).astype(float)
        if least and (below := values[values < 0.0]).size:
            place = f"{self.argument}[{column!r}]"
            raise InputError(place, float(below[0]), "must be 0 or greater")
        return values

    def _read_path(self, path: Path) -> PathSamples:
        """A file, or a folder of files of which each holds whole paths."""
        if not path.is_dir():
            return self._read_table(read_table(path, self.argument))
        files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
        if not files:
            raise FileError(self.argument, str(path), "holds no .csv or .parquet file")
        return self._read_blocks(map(read_table, files))

    def _read_blocks(self, given: Iterator[Any]) -> PathSamples:
        """An iterator of blocks of paths, each in a form of its own; one is in memory at a time."""
        first = next(given, None)
        if first is None:
            raise self._refuse("an iterator", "yields no block of paths")
        head = self.read(first)
        if head.reduced is not None:
            raise self._refuse("a reduced table", "give it alone, not among others")

        def blocks() -> Iterator[Floats]:
            yield from head.blocks
            for number, block in enumerate(given, start=2):
                reader = replace(self, argument=f"block {number} of {self.argument}")
                piece = reader.read(block)
                same_rows = pd.Series(piece.labels).equals(pd.Series(head.labels))
                if piece.names != head.names or not same_rows:
                    why = f"has other quantities or rows than the first block: {head.names}"
                    raise InputError(reader.argument, piece.names, why)
                yield from piece.blocks

        return PathSamples(head.names, head.label, head.labels, blocks=blocks(), units=head.units)


def _first_of(names: Sequence[str], columns: Iterable[str]) -> str:
    """The first of some names that is among others; empty if none is."""
    return next((name for name in names if name in columns), "")


def units_of(variables: Mapping[Any, Any]) -> dict[str, str]:
    """The units of the variables of a dataset that have one."""
    units = {str(name): variable.attrs.get("units") for name, variable in variables.items()}
    return {name: str(unit) for name, unit in units.items() if unit}


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


def check_numbers(values: NDArray[Any], place: str) -> NDArray[Any]:
    """Refuse what is no array of real numbers."""
    if values.dtype.kind not in "iuf":
        why = "give real numbers" + ("; take its real part" if values.dtype.kind == "c" else "")
        raise InputError(place, f"array of type {values.dtype}", why)
    return values


def check_block(block: Floats, seen_paths: int, names: Sequence[str], argument: str) -> None:
    """Refuse values that are infinite, or missing elsewhere than from some row on.

    `seen_paths`: Paths of earlier blocks. Shapes: `block` (paths, rows, quantities).
    """
    finite: NDArray[Any] = np.asarray(np.isfinite(block))
    if finite.all():
        return
    here: NDArray[Any] = ~np.asarray(finite.all(axis=2))
    resumed = np.zeros_like(here)
    resumed[:, :-1] = here[:, :-1] & ~here[:, 1:]
    refused = {
        "is infinite; leave the path out from there on, as NaN": np.isinf(block).any(axis=2),
        "is missing, and others of the same row are not; a path ends in all at once": (
            here & finite.any(axis=2)
        ),
        "is missing, and there is a later one; a path that has ended does not go on": resumed,
    }
    for why, wrong in refused.items():
        if wrong.any():
            path, row = np.argwhere(wrong)[0].tolist()
            which = int(finite[path, row].argmin())
            place = f"{argument}, path {seen_paths + path}, row {row + 1}, {names[which]}"
            raise InputError(place, float(block[path, row, which]), why)
