"""The axes of a study: which fields vary and over which values.

Fields of one axis vary together; axes are crossed with each other (a full factorial grid).
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from rattle.scene.errors import InputError
from rattle.scene.parts import Start, Tolerance
from rattle.scene.scene import Scene
from rattle.scene.validate import check_keys, count, finite, nearest, positive

SETTINGS = ("scheme", "paths", "accuracy", "dt", "seed")
"""Settings of the simulation that an axis may vary, in addition to the fields of the scene."""

PARTS = {"tolerance": Tolerance, "start": Start}
FIELDS = tuple(
    [f.name for f in fields(Scene) if f.name not in (*PARTS, "gears")]
    + [f"{part}.{f.name}" for part, kind in PARTS.items() for f in fields(kind)]
)
MOST_POINTS = 100_000  # largest number of grid points of a study
EXAMPLE = "write { log = [0.001, 2.0, 24] }, { linear = [0.5, 1.5, 11] } or a list of values"


class Axis(NamedTuple):
    """One or more fields that vary together."""

    names: tuple[str, ...]  # the fields
    # one tuple for each step along the axis: a value of each field, in the order of `names`
    values: tuple[tuple[Any, ...], ...]

    def pair_values(self, step: tuple[Any, ...]) -> Iterator[tuple[str, Any]]:
        """Pair the fields with their values at a step."""
        return zip(self.names, step, strict=True)


def read_axes(tables: Sequence[Mapping[str, Any]]) -> tuple[Axis, ...]:
    """Read the axes from the ``[[axes]]`` tables of a study file.

    `tables`: Each table gives one or more fields (dotted names for parts of the scene, such as ``start.y1``) and
    their values: a list, ``{ linear = [LOW, HIGH, POINTS] }`` or ``{ log = [LOW, HIGH, POINTS] }``.  Fields of
    one table vary together and need equally many values.

    Examples
    --------
    >>> read_axes([{"sigma": {"log": [0.01, 1.0, 3]}}, {"gap1": [0.4, 0.5], "gap2": [0.5, 0.6]}])[1].values
    ((0.4, 0.5), (0.5, 0.6))
    """
    found: list[Axis] = []
    if isinstance(tables, str | Mapping) or not isinstance(tables, Sequence):
        raise InputError("axes", tables, "write each axis as a table [[axes]]")
    for table in tables:
        if not isinstance(table, Mapping) or not table:
            raise InputError("axes", table, "give each [[axes]] a field and its values, as in sigma = [0.1, 0.2]")
        columns = {name: _values(_check_field(name), table[name]) for name in table}
        lengths = {name: len(values) for name, values in columns.items()}
        if len(set(lengths.values())) > 1:
            raise InputError("axes", lengths, "fields of one [[axes]] table vary together: give as many values each")
        found.append(Axis(tuple(columns), tuple(zip(*columns.values(), strict=True))))
    names = [name for axis in found for name in axis.names]
    for name in names:
        if names.count(name) > 1:
            raise InputError("axes", name, "varies along two axes; keep one")
    points = math.prod(len(axis.values) for axis in found)
    if points > MOST_POINTS:
        raise InputError("axes", points, f"points make the grid; it may have {MOST_POINTS}: take fewer values")
    return tuple(found)


def combinations(axes: Sequence[Axis]) -> list[dict[str, Any]]:
    """List all points of the grid, the last axis running fastest."""
    return [
        {name: value for axis, step in zip(axes, steps, strict=True) for name, value in axis.pair_values(step)}
        for steps in itertools.product(*(axis.values for axis in axes))
    ]


def combination(axes: Sequence[Axis], number: int) -> dict[str, Any]:
    """Give one point of the grid by its index in `combinations`, without listing the others.

    Examples
    --------
    >>> combination(read_axes([{"sigma": [0.1, 0.2]}, {"gap1": [0.4, 0.5, 0.6]}]), 4)
    {'sigma': 0.2, 'gap1': 0.5}
    """
    steps = np.unravel_index(number, [len(axis.values) for axis in axes])
    return {
        name: value for axis, i in zip(axes, steps, strict=True) for name, value in axis.pair_values(axis.values[i])
    }


def _check_field(name: str) -> str:
    if name not in (*FIELDS, *SETTINGS):
        raise InputError("axes", name, "no field of a scene or a simulation; " + nearest(name, (*FIELDS, *SETTINGS)))
    return name


def _values(name: str, given: Any) -> tuple[Any, ...]:
    field = f"axes.{name}"
    if isinstance(given, Mapping):
        check_keys(field, given, ("linear", "log"))
        if len(given) != 1:
            raise InputError(field, dict(given), EXAMPLE)
        kind, ends = next(iter(given.items()))
        values = _space(field, kind, ends)
    elif isinstance(given, Sequence) and not isinstance(given, str):
        values = tuple(given)
    else:
        raise InputError(field, given, EXAMPLE)
    if not values:
        raise InputError(field, given, "has no values; " + EXAMPLE)
    for value in values:
        if isinstance(value, Sequence | Mapping) and not isinstance(value, str):
            raise InputError(field, value, "each value is a number or a name")
    if len(set(values)) < len(values):
        raise InputError(field, given, "holds a value twice")
    return values


def _space(field: str, kind: str, ends: Any) -> tuple[float, ...]:
    """Values spaced evenly, or evenly in their logarithm, rounded to six or more significant digits."""
    if not isinstance(ends, Sequence) or isinstance(ends, str) or len(ends) != 3:
        raise InputError(field, ends, "give [LOW, HIGH, POINTS]")
    low, high = finite(f"{field} LOW", ends[0]), finite(f"{field} HIGH", ends[1])
    points = count(f"{field} POINTS", ends[2], least=2, most=MOST_POINTS)
    if kind == "log":
        positive(f"{field} LOW", low)
    if high <= low:
        raise InputError(f"{field} HIGH", high, f"must be greater than LOW = {low:g}")
    values = np.geomspace(low, high, points) if kind == "log" else np.linspace(low, high, points)
    digits = 6 + max(0, math.ceil(math.log10(points)) - 3)
    return tuple(float(f"{v:.{digits}g}") for v in values)
