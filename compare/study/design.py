"""The design of a study: a scene, axes and settings; its kind says what is computed at each point of the grid."""

import hashlib
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.study.axes import SETTINGS, Axis, combination, combinations, read_axes
from rattle.compare.study.store import Cell, Store
from rattle.compare.validation.verdict import Tolerances
from rattle.scene.errors import InputError
from rattle.scene.files import in_file, read_text, read_toml
from rattle.scene.gears import Gears
from rattle.scene.plausible import check_plausible
from rattle.scene.scene import Scene
from rattle.scene.validate import check_keys, choice

__all__ = ["Point", "Study", "place"]

KINDS = {"impacts": "rattle.compare.study.impacts", "stationary": "rattle.compare.stationary.study"}
"""Module of each kind of study; it has a `Kind` named ``KIND``."""


@dataclass(frozen=True)
class Point:
    """One point of the grid."""

    coordinates: dict[str, Any]  # value of each field that varies
    # the simulation, of an ensemble or of the long run; None if the scene or the settings cannot be simulated
    sample: Any
    predictions: tuple[Any, ...]  # one for each closure that covers the scene
    # the error message for everything that is missing, under ``scene``, ``sample`` or the name of the closure
    reasons: dict[str, str]

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Cells to compute; none without an ensemble, since a prediction alone cannot be judged."""
        return (self.sample, *self.predictions) if self.sample else ()


@dataclass(frozen=True)
class Study:
    """A grid over fields of a scene and of its simulation.

    Parameters
    ----------
    base : dict
        The scene as `Scene.to_dict` gives it; without ``start`` if the default start is to follow the gaps.
    axes : tuple of Axis
    closures : tuple of str
        Names in `rattle.closure.CLOSURES`.
    impacts, order : int
        Impacts that are followed, and order of the Edgeworth series.
    settings : dict
        Those of ``scheme, paths, accuracy, dt, seed`` that do not vary.
    common_noise : bool
        Whether all points use common random numbers, which makes the errors of differences along an axis small;
        otherwise every point has a seed of its own.
    within : Tolerances
        Errors up to which a mean or an sd counts as accurate.
    title : str
    text : str
        Content of the file that the study was read from.
    gears : Gears or None
        Those of its scene, in whose units the page explains what it shows.
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

    base: dict[str, Any]
    axes: tuple[Axis, ...]
    closures: tuple[str, ...]
    impacts: int
    order: int
    settings: dict[str, Any]
    common_noise: bool
    within: Tolerances
    title: str = "study"
    text: str = ""
    gears: Gears | None = None
    kind: str = "impacts"

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
            If a key or a value is wrong, or the gears cannot exist (`rattle.scene.plausible`); the message names it.
        FileError
            If the file cannot be read.
        """
        text = read_text("study file", path)
        with in_file(path, text):
            study = cls.from_toml(text)
            if study.gears is not None:
                check_plausible(study.gears, read_toml(text)["gears"])
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
        check_keys("top level", data, ("study", "gears", "scene", "axes"))
        given = data.get("study", {})
        if not isinstance(given, Mapping):
            raise InputError("study", given, "write it as a table: [study]")
        name = choice("study.kind", given.get("kind", cls.kind), tuple(KINDS))
        kind = kind_of(name)
        check_keys("study", given, ("kind", "title", *kind.keys))
        parts: dict[str, Any] = {name: data[name] for name in ("gears", "scene") if name in data}
        scene = Scene.from_dict(parts)
        base = replace(scene, gears=None).to_dict()["scene"]  # without the gears: an axis may vary what they fix
        if "start" not in parts.get("scene", {}):
            del base["start"]
        axes = read_axes(data.get("axes", []))
        own = kind.read(given, {name for axis in axes for name in axis.names})
        title = str(given.get("title", kind.title))
        return cls(base=base, axes=axes, title=title, text=text, gears=scene.gears, kind=name, **own)

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
        found = tuple(self._point(coordinates) for coordinates in combinations(self.axes))
        if not any(p.sample for p in found):
            why = next(iter(found[0].reasons.values()))
            raise InputError("study", self.title, f"not one point of the grid can be computed ({why})")
        return found

    @property
    def names(self) -> list[str]:
        """Fields that vary."""
        return [name for axis in self.axes for name in axis.names]

    @property
    def along(self) -> str:
        """The field over which curves are drawn: the first that varies and is numeric; empty if there is none."""
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
        """Number of different scenes: points that differ only in settings of the simulation share one."""
        return math.prod(len(axis.values) for axis in self.axes if not set(axis.names) <= set(SETTINGS))

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
        return tuple(self._point(combination(self.axes, number)) for number in numbers)

    @cached_property
    def cells(self) -> list[Cell]:
        """The cells of all points, without duplicates."""
        return list({cell.key: cell for point in self.points for cell in point.cells}.values())

    def _point(self, coordinates: dict[str, Any]) -> Point:
        try:
            scene = Scene.from_dict({"scene": place(self.base, coordinates)})
        except InputError as error:
            return Point(coordinates, None, (), {"scene": str(error)})
        settings = self.settings | {name: value for name, value in coordinates.items() if name in SETTINGS}
        sample, predictions, reasons = kind_of(self.kind).cells(self, scene, settings)
        return Point(coordinates, sample, predictions, reasons)


@dataclass(frozen=True)
class Kind:
    """What is computed at each point of a grid, and how it is shown."""

    title: str  # of a study that gives none
    keys: tuple[str, ...]  # of ``[study]``, besides ``kind`` and ``title``
    tables: tuple[str, ...]  # each a Parquet file
    small: tuple[str, ...]  # those of them that are written as CSV too
    # reads the fields of `Study` that ``[study]`` gives, where some names vary
    read: Callable[[Mapping[str, Any], set[str]], dict[str, Any]]
    # makes the simulation, the predictions and the reasons of a `Point` from its scene and settings
    cells: Callable[[Study, Scene, dict[str, Any]], tuple[Any, tuple[Any, ...], dict[str, str]]]
    # makes an object of `study`, `record` and the tables by name, which has these and ``empty`` as attributes
    make: Callable[..., Any]
    # computes it from the results of the cells by key
    combine: Callable[[Study, Mapping[str, Any]], Any]
    # module of functions of that object: `answer` (sentences), `draw` (figures), `facts` (entries of the manifest) and
    # `blocks` (what stands above the sections of the page, and its last sections)
    page: str


def kind_of(name: str) -> Kind:
    """The kind of a name in `KINDS`."""
    kind: Kind = import_module(KINDS[name]).KIND
    return kind


def page_of(study: Study) -> Any:
    """The module that shows a study of its kind."""
    return import_module(kind_of(study.kind).page)


def read_results(study: Study, store: Store) -> dict[str, Any]:
    """Read the results of a study that are stored, by key."""
    return {cell.key: found for cell in study.cells if (found := store.read(cell)) is not None}


def combine(study: Study, results: Mapping[str, Any]) -> Any:
    """Compute the tables of a study from the results of its cells, by key."""
    return kind_of(study.kind).combine(study, results)


def list_reasons(study: Study) -> pd.DataFrame:
    """What could not be computed at each point, and why: the fields that vary, ``what, why``."""
    rows = [{**p.coordinates, "what": what, "why": why} for p in study.points for what, why in p.reasons.items()]
    return pd.DataFrame(rows, columns=[*study.names, "what", "why"])


def with_coordinates(point: Point, table: pd.DataFrame) -> pd.DataFrame:
    """Put the coordinates of a point before the columns of its table."""
    coordinates = pd.DataFrame({n: [v] * len(table) for n, v in point.coordinates.items()}, index=table.index)
    return pd.concat([coordinates, table], axis=1)


def place(base: dict[str, Any], coordinates: Mapping[str, Any]) -> dict[str, Any]:
    """The scene's table with values replaced; a dotted name is a field of a nested table."""
    out = {name: dict(value) if isinstance(value, dict) else value for name, value in base.items()}
    for name, value in coordinates.items():
        part, _, field = name.partition(".")
        if field:
            out.setdefault(part, {})[field] = value
        elif name not in SETTINGS:
            out[name] = value
    return out
