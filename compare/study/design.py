"""The design of a study: a scene, the axes, the settings of the simulation, and the closures compared with it."""

import hashlib
import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from rattle.closure import CLOSURES
from rattle.closure.mean_map import ORDERS
from rattle.compare.study.axes import SETTINGS, Axis, combination, combinations, read_axes
from rattle.compare.study.cells import Cell, Prediction, Sample
from rattle.compare.validation.verdict import Tolerances
from rattle.montecarlo import SCHEMES, check_settings, default_step
from rattle.scene.errors import InputError
from rattle.scene.files import in_file, read_text, read_toml
from rattle.scene.gears import Gears
from rattle.scene.plausible import check_plausible
from rattle.scene.scene import Scene
from rattle.scene.validate import check_keys, choice, count, positive

__all__ = ["TABLES", "Point", "Study", "place"]

KEYS = (
    "kind",
    "title",
    "impacts",
    "closures",
    "order",
    "scheme",
    "paths",
    "accuracy",
    "dt",
    "seed",
    "common_noise",
    "within",
)


TABLES = ("errors", "sections", "correlation", "validity", "paired", "cost", "reasons")
"""Tables of a study of impacts, each a Parquet file."""


@dataclass(frozen=True)
class Point:
    """One point of the grid."""

    coordinates: dict[str, Any]  # value of each field that varies
    # the simulation: a `Sample`, or the long run of a scene; None if the scene or the settings cannot be simulated
    sample: Any
    predictions: tuple[Prediction, ...]  # one for each closure that covers the scene
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

    kind: ClassVar[str] = "impacts"
    tables: ClassVar[tuple[str, ...]] = TABLES

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
        wanted = data.get("study", {})
        if not isinstance(wanted, Mapping):
            raise InputError("study", wanted, "write it as a table: [study]")
        if wanted.get("kind", cls.kind) != cls.kind:
            from rattle.compare.stationary.study import KIND, LongStudy  # which builds upon this module

            choice("study.kind", wanted["kind"], (cls.kind, KIND))
            return LongStudy.of(data, text)
        check_keys("study", wanted, KEYS)
        given: dict[str, Any] = {name: data[name] for name in ("gears", "scene") if name in data}
        scene = Scene.from_dict(given)
        base = replace(scene, gears=None).to_dict()["scene"]  # without the gears: an axis may vary what they fix
        if "start" not in given.get("scene", {}):
            del base["start"]
        axes = read_axes(data.get("axes", []))
        settings = {name: wanted[name] for name in SETTINGS if name in wanted}
        varying = {name for axis in axes for name in axis.names}
        _check_settings(settings, varying)
        return cls(
            base=base,
            axes=axes,
            closures=_closures(wanted.get("closures", tuple(CLOSURES))),
            impacts=count("study.impacts", wanted.get("impacts", 12)),
            order=count("study.order", wanted.get("order", 4), *ORDERS),
            settings=settings,
            common_noise=_flag("study.common_noise", wanted.get("common_noise", True)),
            within=_within(wanted.get("within", {})),
            title=str(wanted.get("title", "study")),
            text=text,
            gears=scene.gears,
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
        settings = {**self.settings, **{k: v for k, v in coordinates.items() if k in SETTINGS}}
        seed = settings.pop("seed", 0)
        reasons: dict[str, str] = {}
        sample, predictions = None, []
        try:
            sample = _check_sample(Sample(scene, self.impacts, seed, **settings))
            if not self.common_noise:
                own = hashlib.sha256(f"{sample.key} {seed}".encode()).digest()
                sample = replace(sample, seed=int.from_bytes(own[:8], "little"))
        except InputError as error:
            reasons["sample"] = str(error)
        for closure in self.closures:
            try:
                CLOSURES[closure].check(scene)
                predictions.append(Prediction(scene, self.impacts, closure, self.order))
            except InputError as error:
                reasons[closure] = str(error)
        return Point(coordinates, sample, tuple(predictions), reasons)


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


def _check_sample(sample: Sample) -> Sample:
    scheme = choice("scheme", sample.scheme, SCHEMES)
    kind = SCHEMES[scheme]
    if sample.accuracy is not None:
        positive("accuracy", sample.accuracy)
    biased = kind.has_step_bias
    dt = default_step(sample.scene, scheme, biased) if sample.dt is None else sample.dt
    check_settings(
        sample.scene,
        paths=1 if sample.paths is None else sample.paths,
        impacts=sample.impacts,
        dt=dt,
        scheme=scheme,
        rng=sample.seed,
        workers=1,
        step_bias=biased,
    )
    return sample


def _check_settings(settings: Mapping[str, Any], varying: set[str]) -> None:
    for name in settings:
        if name in varying:
            raise InputError(f"study.{name}", settings[name], "varies along an axis too; keep one")
    known = set(settings) | varying
    if ("paths" in known) == ("accuracy" in known):
        raise InputError("study.paths", settings.get("paths"), "give either paths or accuracy")
    if "accuracy" in known and "dt" in known:
        raise InputError("study.dt", settings.get("dt"), "accuracy chooses the step itself; leave it out")


def _closures(given: Any) -> tuple[str, ...]:
    if isinstance(given, str) or not isinstance(given, Sequence) or not given:
        raise InputError("study.closures", given, "give a list of " + ", ".join(CLOSURES))
    return tuple(dict.fromkeys(choice("study.closures", r, CLOSURES) for r in given))


def _flag(field: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError(field, value, "give true or false")
    return value


def _within(given: Any) -> Tolerances:
    if not isinstance(given, Mapping):
        raise InputError("study.within", given, "write it as a table: within = { mean = 0.05, sd = 0.10 }")
    check_keys("study.within", given, Tolerances._fields)
    return Tolerances(**{name: positive(f"study.within.{name}", value) for name, value in given.items()})
