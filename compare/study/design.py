"""The design of a study: a scene, axes and settings; its kind says what is computed at each point
of the grid."""

import hashlib
import math
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from rattle.closure import Closure
from rattle.closure.mean_map import find_closure
from rattle.compare.engine.store import Cell, Facts, Store
from rattle.compare.judge.verdict import Tolerances
from rattle.scene import (
    Gears,
    InputError,
    Scene,
    check_keys,
    choice,
    count,
    finite,
    nearest,
    positive,
)
from rattle.scene.changes import ORDER_FIELD, axis_names, change, is_unit, spell
from rattle.scene.files import in_file, read_text, read_toml
from rattle.scene.gears import check_typed
from rattle.scene.gears_input import GEAR_FIELDS, OPTIONAL, check_plausible
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.scene_tables import TABLES

SETTING_NAMES = ("scheme", "paths", "accuracy", "dt", "seed")
"""Settings of the simulation that an axis may vary, in addition to the fields of the scene."""

GEAR_NAMES = (*GEAR_FIELDS, *OPTIONAL)
MOST_GRID_POINTS = 100_000  # largest number of grid points of a study
AXIS_EXAMPLE = "write { log = [0.001, 2.0, 24] }, { linear = [0.5, 1.5, 11] } or a list of values"


Coordinates: TypeAlias = dict[str, Any]
"""The value of each field that varies, at a point of the grid."""
Placed: TypeAlias = tuple[Coordinates, pd.DataFrame]
"""A table with the coordinates of its point."""


class Axis(NamedTuple):
    """One or more fields that vary together."""

    names: tuple[str, ...]  # the fields
    # one tuple for each step along the axis: a value of each field, in the order of `names`
    values: tuple[tuple[Any, ...], ...]


def read_axes(tables: Sequence[Mapping[str, Any]], scene: Scene) -> tuple[Axis, ...]:
    """Read the axes from the ``[[axes]]`` tables of a study file.

    `tables`: Each table gives one or more fields of `scene` (dotted names for its parts, such as
    ``start.y1`` or ``drive.2.amplitude``; of a scene of gears their values too, such as
    ``backlash1`` or ``wheel.third.torque``) and their values: a list, ``{ linear = [LOW, HIGH,
    POINTS] }`` or ``{ log = [LOW, HIGH, POINTS] }``. Fields of one table vary together and need
    equally many values.
    """
    gears = scene.gears
    valid = (*axis_names(scene), *SETTING_NAMES)
    axes: list[Axis] = []
    if not isinstance(tables, list | tuple):
        raise InputError("axes", tables, "write each axis as a table [[axes]]")
    for table in tables:
        if not isinstance(table, Mapping) or not table:
            raise InputError(
                "axes", table, "give each [[axes]] a field and its values, as in sigma = [0.1, 0.2]"
            )
        for name in table:
            if spell(scene, name) not in valid and not ORDER_FIELD.fullmatch(name):
                why = f"no field of a scene or a simulation; {nearest(name, valid)}"
                if gears is not None:
                    check_typed(gears, name, "axes")
                elif name in GEAR_NAMES:
                    why = (
                        "a value of gears, which this study has not; write [gears], or vary one of"
                        " [scene]"
                    )
                raise InputError("axes", name, why)
        columns = {spell(scene, name): _values(name, values) for name, values in table.items()}
        lengths = {name: len(values) for name, values in columns.items()}
        if len(set(lengths.values())) > 1:
            raise InputError(
                "axes",
                lengths,
                "fields of one [[axes]] table vary together: give as many values each",
            )
        axes.append(Axis(tuple(columns), tuple(zip(*columns.values(), strict=True))))
    names = [name for axis in axes for name in axis.names]
    for name in names:
        if names.count(name) > 1:
            raise InputError("axes", name, "varies along two axes; keep one")
    points = math.prod(len(axis.values) for axis in axes)
    if points > MOST_GRID_POINTS:
        raise InputError(
            "axes",
            points,
            f"points make the grid; it may have {MOST_GRID_POINTS}: take fewer values",
        )
    return tuple(axes)


def _values(name: str, given: Any) -> tuple[Any, ...]:
    """Read the values of a field along an axis: a list, or evenly spaced ones."""
    field = f"axes.{name}"
    if isinstance(given, Mapping):
        check_keys(field, given, ("linear", "log"))
        if len(given) != 1:
            raise InputError(field, dict(given), AXIS_EXAMPLE)
        ((kind, ends),) = given.items()
        values = _space(field, kind, ends)
    elif isinstance(given, list | tuple):
        values = tuple(given)
    else:
        raise InputError(field, given, AXIS_EXAMPLE)
    if not values:
        raise InputError(field, given, "has no values; " + AXIS_EXAMPLE)
    for value in values:
        if isinstance(value, list | tuple | dict):
            raise InputError(field, value, "each value is a number or a name")
    if len(set(values)) < len(values):
        raise InputError(field, given, "holds a value twice")
    return values


def _space(field: str, kind: str, ends: Any) -> tuple[float, ...]:
    """Values spaced evenly, or evenly in their logarithm, rounded to six or more significant
    digits."""
    if not isinstance(ends, list | tuple) or len(ends) != 3:
        raise InputError(field, ends, "give [LOW, HIGH, POINTS]")
    low = finite(f"{field} LOW", ends[0])
    high = finite(f"{field} HIGH", ends[1])
    points = count(f"{field} POINTS", ends[2], least=2, most=MOST_GRID_POINTS)
    if kind == "log":
        positive(f"{field} LOW", low)
    if high <= low:
        raise InputError(f"{field} HIGH", high, f"must be greater than LOW = {low:g}")
    space = np.geomspace if kind == "log" else np.linspace
    digits = 6 + max(0, math.ceil(math.log10(points)) - 3)
    return tuple(float(f"{value:.{digits}g}") for value in space(low, high, points))


STUDY_KINDS = {
    "impacts": "rattle.compare.study.impacts",
    "stationary": "rattle.compare.stationary.study",
}
"""Module of each kind of study: what is computed at each point of a grid, and how it is shown.

``TITLE`` of a study that gives none.  ``KEYS`` of ``[study]`` besides ``kind`` and ``title``:
``read`` turns them into fields of `Study`, where some names vary.  ``cells`` makes the simulation,
the predictions and the reasons of a `Point` from its scene and settings.  ``combine`` makes a
``RESULT`` of the results by key: an object with ``study, record, empty`` and ``TABLES``, each a
Parquet file, those of ``SMALL`` written as CSV too.  ``PAGE`` is the module that shows it:
``answer`` (sentences), ``draw`` (figures) and ``content`` (what its ``TEMPLATE`` shows besides).
The words that it explains stand in `rattle.compare.report.texts`, as ``study of`` that kind.
"""


@dataclass(frozen=True)
class Point:
    """One point of the grid."""

    coordinates: Coordinates
    # the simulation, of an ensemble or of the long run; None if the scene or the settings cannot be
    # simulated
    sample: Any
    predictions: tuple[Any, ...]  # one for each closure that covers the scene
    # the error message for everything that is missing, under ``scene``, ``sample`` or the name of
    # the closure
    reasons: dict[str, str]

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Cells to compute; none without an ensemble, since a prediction alone cannot be judged."""
        return (self.sample, *self.predictions) if self.sample else ()


@numpy_defaults
@dataclass(frozen=True)
class Study:
    """A grid over fields of a scene and of its simulation.

    Parameters
    ----------
    scene : Scene
        The scene of which some values vary; all others stay as they were typed.
    axes : tuple of Axis
    closures : tuple of str, Closure or callable
        Names in `rattle.closure.CLOSURES`, ``package.module:function``, or functions ``(scene,
        impacts)``.
    impacts, order : int
        Impacts that are followed, and order of the Edgeworth series.
    settings : dict
        Those of ``scheme, paths, accuracy, dt, seed`` that do not vary.
    common_noise : bool
        Whether all points use common random numbers, which makes the errors of differences along an
        axis small; otherwise every point has a seed of its own.
    on_itinerary : bool
        Whether the paths on the noise-free itinerary are judged apart too, in rows of kind
        ``itinerary``.
    near_branches : bool
        Whether a part of the paths is drawn near the rare branches that matter; these are then
        32,768 at least.
    within : Tolerances
        Errors up to which a mean or an sd counts as accurate.
    title : str
    text : str
        Content of the file that the study was read from.
    kind : str
        ``impacts``, or ``stationary`` for studies of the long run.

    Examples
    --------
    >>> study = Study.from_toml('''
    ... [study]
    ... impacts = 2
    ... closures = ["saltation"]
    ... paths = 4096
    ... [scene]
    ... alpha = 1.5
    ... epsilon = 0.9
    ... beta1 = 0.08
    ... gamma1 = 0.05
    ... stages = 1
    ... [[axes]]
    ... sigma = { log = [0.01, 0.1, 3] }
    ... ''')
    >>> [p.coordinates["sigma"] for p in study.points]
    [0.01, 0.0316228, 0.1]
    """

    scene: Scene
    axes: tuple[Axis, ...]
    closures: tuple[str | Closure | Callable[..., Any], ...]
    impacts: int
    order: int
    settings: Facts
    common_noise: bool
    within: Tolerances
    on_itinerary: bool = False
    near_branches: bool = False
    title: str = "study"
    text: str = ""
    kind: str = "impacts"

    def __repr__(self) -> str:
        """What varies, and what is computed at each point."""
        closures = ", ".join(find_closure("closures", closure).name for closure in self.closures)
        over = ", ".join(f"{axis.names[0]} ({len(axis.values)})" for axis in self.axes) or "nothing"
        return (
            f"Study {self.title!r} of {self.kind}: {self.size} points over {over}; closures:"
            f" {closures or 'none'}"
        )

    @classmethod
    def load(cls, path: str | Path) -> "Study":
        """Read a study from a TOML file.

        Parameters
        ----------
        path : str or Path
            The file.

        Returns
        -------
        Study

        Raises
        ------
        InputError
            If a key or a value is wrong, or the gears cannot exist (``rattle.scene.gears_input``);
            names it.
        FileError
            If the file cannot be read.
        """
        text = read_text("study file", path)
        with in_file(path, text):
            study = cls.from_toml(text)
            if study.scene.gears is not None:
                check_plausible(study.scene.gears, read_toml(text)["gears"])
        return study

    @classmethod
    def from_toml(cls, text: str) -> "Study":
        """Read a study from TOML text.

        Parameters
        ----------
        text : str
            Tables ``[study]``, a scene as in a scene file, and ``[[axes]]`` (see `read_axes`).

        Returns
        -------
        Study

        Raises
        ------
        InputError
            If a key or a value is wrong; the message names it.
        """
        data = read_toml(text)
        check_keys("top level", data, ("study", *TABLES, "axes"))
        given = data.get("study", {})
        if not isinstance(given, Mapping):
            raise InputError("study", given, "write it as a table: [study]")
        name = choice("study.kind", given.get("kind", cls.kind), STUDY_KINDS)
        kind = kind_of(name)
        check_keys("study", given, ("kind", "title", *kind.KEYS))
        parts: Facts = {part: data[part] for part in TABLES if part in data}
        scene = Scene.from_dict(parts)
        axes = read_axes(data.get("axes", []), scene)
        return cls(
            scene=scene,
            axes=axes,
            title=str(given.get("title", kind.TITLE)),
            text=text,
            kind=name,
            **kind.read(given, {field for axis in axes for field in axis.names}, scene),
        )

    @property
    def digest(self) -> str:
        """Digest of the file that the study was read from."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """The points of the grid, the last axis running fastest.

        Raises
        ------
        InputError
            If no point can be simulated.
        """
        points = tuple(map(self._point, range(self.size)))
        if not any(point.sample for point in points):
            why = next(iter(points[0].reasons.values()))
            raise InputError(
                "study", self.title, f"not one point of the grid can be computed ({why})"
            )
        return points

    @property
    def names(self) -> list[str]:
        """Fields that vary."""
        return [name for axis in self.axes for name in axis.names]

    @property
    def along(self) -> str:
        """The field over which curves are drawn: the first that varies and is numeric; empty if
        there is none."""
        for axis in self.axes:
            if len(axis.values) > 1 and all(type(step[0]) in (int, float) for step in axis.values):
                return axis.names[0]
        return ""

    @property
    def others(self) -> list[str]:
        """The first field of each other axis."""
        return [axis.names[0] for axis in self.axes if self.along not in axis.names]

    @property
    def size(self) -> int:
        """Number of grid points."""
        return math.prod(len(axis.values) for axis in self.axes)

    @property
    def scenes(self) -> int:
        """Number of different scenes: points that differ only in settings of the simulation share
        one."""
        return math.prod(
            len(axis.values) for axis in self.axes if not set(axis.names) <= set(SETTING_NAMES)
        )

    def some_points(self, most: int) -> tuple[Point, ...]:
        """Give all points of a small grid, or a fixed random sample of a larger one.

        Parameters
        ----------
        most : int
            Largest number of points.

        Returns
        -------
        tuple of Point
        """
        if self.size <= most:
            return self.points
        numbers = sorted(random.Random(0).sample(range(self.size), most))
        return tuple(map(self._point, numbers))

    @cached_property
    def cells(self) -> list[Cell]:
        """The cells of all points, without duplicates."""
        return list({cell.key: cell for point in self.points for cell in point.cells}.values())

    @property
    def shown_gears(self) -> Gears | None:
        """The gears in whose units the study is explained; None where these vary along an axis."""
        varies = any(is_unit(self.scene, name) for name in self.names)
        return None if varies else self.scene.gears

    def _point(self, number: int) -> Point:
        """One point of the grid by its index, the last axis running fastest."""
        steps = np.unravel_index(number, [len(axis.values) for axis in self.axes])
        coordinates = {
            name: value
            for axis, step in zip(self.axes, steps, strict=True)
            for name, value in zip(axis.names, axis.values[step], strict=True)
        }
        varied = {name: value for name, value in coordinates.items() if name in SETTING_NAMES}
        changes = {name: value for name, value in coordinates.items() if name not in varied}
        try:
            scene = change(self.scene, changes)
        except InputError as error:
            return Point(coordinates, None, (), {"scene": str(error)})
        return Point(coordinates, *kind_of(self.kind).cells(self, scene, self.settings | varied))


def kind_of(name: str) -> Any:
    """The module of a kind of study."""
    return import_module(STUDY_KINDS[name])


def page_of(study: Study) -> Any:
    """The module that shows a study of its kind."""
    return import_module(kind_of(study.kind).PAGE)


def read_results(study: Study, store: Store) -> Facts:
    """Read the results of a study that are stored, by key."""
    return {cell.key: result for cell in study.cells if (result := store.read(cell)) is not None}


def combine(study: Study, results: Mapping[str, Any]) -> Any:
    """Compute the tables of a study from the results of its cells, by key."""
    return kind_of(study.kind).combine(study, results)


def list_reasons(study: Study) -> pd.DataFrame:
    """What could not be computed at each point, and why: the fields that vary, ``what, why``."""
    rows = [
        {**p.coordinates, "what": what, "why": why}
        for p in study.points
        for what, why in p.reasons.items()
    ]
    return pd.DataFrame(rows, columns=[*study.names, "what", "why"])


def with_coordinates(coordinates: Coordinates, table: pd.DataFrame) -> pd.DataFrame:
    """Put the coordinates of a point before the columns of its table; they replace columns of the
    same name."""
    columns = dict.fromkeys([*coordinates, *table])
    return table.assign(**coordinates)[[*columns]]


def join_points(tables: Iterable[Placed], columns: Sequence[str] = ()) -> pd.DataFrame:
    """Join the tables of points, each with its coordinates; without any, a table of these
    columns."""
    parts = [with_coordinates(coordinates, table) for coordinates, table in tables]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=[*columns])
