"""Studies of the long run: `kind = "stationary"` in a study file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from rattle.compare.stationary.cell import LongCell, LongResult
from rattle.compare.stationary.judged import CLOSURES_JUDGED
from rattle.compare.stationary.units import PLAIN, kind_of
from rattle.compare.study.axes import read_axes
from rattle.compare.study.design import Point, Study, place
from rattle.compare.study.store import Store
from rattle.compare.validation.verdict import JUDGED, Tolerances
from rattle.montecarlo import check_settings
from rattle.montecarlo.long_run.run import PATHS
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import check_keys, choice, count, positive

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

KIND = "stationary"
KEYS = ("kind", "title", "closures", "accuracy", "periods", "paths", "burn_in", "slow", "seed")
SETTINGS = ("accuracy", "periods", "paths", "burn_in", "slow", "seed")
TABLES = ("quantities", "verdicts", "cost", "reasons")
"""Tables of such a study, each a Parquet file."""


@dataclass(frozen=True)
class LongStudy(Study):
    """A grid over fields of a scene, with the long run at each point; `closures` are those that are judged.

    Examples
    --------
    >>> study = Study.from_toml('''
    ... [study]
    ... kind = "stationary"
    ... closures = ["saltation"]
    ... accuracy = 0.02
    ... [scene]
    ... alpha = 0.25
    ... epsilon = 0.5
    ... beta1 = 0.0
    ... gamma1 = 0.0
    ... stages = 1
    ... [[axes]]
    ... sigma = [0.001, 0.01]
    ... ''')
    >>> len(study.cells), study.kind
    (2, 'stationary')
    """

    kind = KIND
    tables = TABLES

    @classmethod
    def of(cls, data: Mapping[str, Any], text: str) -> "LongStudy":
        """Make a study of the tables of its file."""
        wanted = data["study"]
        check_keys("study", wanted, KEYS)
        given: dict[str, Any] = {name: data[name] for name in ("gears", "scene") if name in data}
        scene = Scene.from_dict(given)
        base = replace(scene, gears=None).to_dict()["scene"]
        if "start" not in given.get("scene", {}):
            del base["start"]
        axes = read_axes(data.get("axes", []))
        settings = {name: wanted[name] for name in SETTINGS if name in wanted}
        for axis in axes:
            for name in axis.names:
                if name in ("scheme", "dt", *settings):
                    raise InputError(f"study.{name}", name, "cannot vary in a study of the long run, or varies twice")
        return cls(
            base=base,
            axes=axes,
            closures=_closures(wanted.get("closures", tuple(CLOSURES_JUDGED))),
            impacts=1,
            order=2,
            settings=settings,
            common_noise=True,
            within=Tolerances(),
            title=str(wanted.get("title", "study of the long run")),
            text=text,
            gears=scene.gears,
        )

    def _point(self, coordinates: dict[str, Any]) -> Point:
        try:
            scene = Scene.from_dict({"scene": place(self.base, coordinates)})
        except InputError as error:
            return Point(coordinates, None, (), {"scene": str(error)})
        settings = self.settings | {k: v for k, v in coordinates.items() if k in SETTINGS}
        try:
            cell = LongCell(scene, settings.pop("seed", 0), self.closures, **settings)
            _check(cell)
        except InputError as error:
            return Point(coordinates, None, (), {"sample": str(error)})
        return Point(coordinates, cell, (), {})


def _closures(given: Any) -> tuple[str, ...]:
    if isinstance(given, str | Mapping) or not hasattr(given, "__iter__"):
        raise InputError("study.closures", given, "give a list of " + ", ".join(CLOSURES_JUDGED))
    return tuple(dict.fromkeys(choice("study.closures", name, CLOSURES_JUDGED) for name in given))


def _check(cell: LongCell) -> None:
    """Refuse settings that could not be run."""
    if cell.accuracy is not None:
        positive("accuracy", cell.accuracy)
        if cell.periods is not None:
            raise InputError("periods", cell.periods, "is chosen by accuracy; leave out one of them")
    if cell.periods is not None:
        count("periods", cell.periods, least=64)
    count("paths", cell.paths, least=16)
    positive("slow", cell.slow)
    check_settings(
        cell.scene, paths=PATHS, impacts=1, dt=None, scheme="exact-flight", rng=cell.seed, workers=1, step_bias=False
    )


@dataclass(frozen=True)
class LongResults:
    """The results of a study of the long run that are stored so far."""

    study: Study
    found: list[LongResult | None]  # of each point; None if it is not stored

    @classmethod
    def of(cls, study: Study, store: Store) -> "LongResults":
        """Read the results of a study from a store."""
        stored = [store.read(p.sample.key) if p.sample else None for p in study.points]
        found = [p.sample.restore(s) if p.sample and s else None for p, s in zip(study.points, stored, strict=True)]
        return cls(study, found)

    @cached_property
    def quantities(self) -> pd.DataFrame:
        """Every quantity at every point: the fields that vary, ``quantity``, and the columns of `LongResult.table`."""
        return self._join(lambda r: r.table.reset_index())

    @cached_property
    def verdicts(self) -> pd.DataFrame:
        """The closures against the simulation at every point."""
        return self._join(lambda r: r.verdicts)

    @cached_property
    def cost(self) -> pd.DataFrame:
        """Length and seconds of each cell, and what kind of motion it is; the seconds are not reproducible."""
        return self._join(lambda r: pd.DataFrame([r.facts]))

    @property
    def reasons(self) -> pd.DataFrame:
        """What could not be computed at each point, and why."""
        rows = [
            {**p.coordinates, "what": what, "why": why} for p in self.study.points for what, why in p.reasons.items()
        ]
        return pd.DataFrame(rows, columns=[*self.study.names, "what", "why"])

    @property
    def empty(self) -> bool:
        """Whether there is no result at all."""
        return not any(self.found)

    def _join(self, table: Any) -> pd.DataFrame:
        parts = []
        for point, result in zip(self.study.points, self.found, strict=True):
            if result is None:
                continue
            own = table(result)
            if len(own):
                fields = pd.DataFrame({n: [v] * len(own) for n, v in point.coordinates.items()}, index=own.index)
                parts.append(pd.concat([fields, own], axis=1))
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


@dataclass(frozen=True)
class LongTables:
    """The tables of a finished study of the long run."""

    study: Study
    record: dict[str, Any]  # the manifest
    quantities: pd.DataFrame  # quantities, verdicts, cost, reasons: see `LongResults`
    verdicts: pd.DataFrame
    cost: pd.DataFrame
    reasons: pd.DataFrame

    def plot(self) -> "Figure":
        """Draw the figure of the study's page; a notebook shows it."""
        from rattle.compare.stationary.study_page import study_figure

        if not self.study.along or self.quantities.empty:
            raise InputError("study", self.study.title, "no field varies over numbers, or nothing could be computed")
        return study_figure(self)

    def to_xarray(self) -> "xr.Dataset":
        """Convert the quantities to a dataset, with the unit of each in ``["quantity"].attrs``; needs ``xarray``."""
        data = self.quantities.set_index([*(axis.names[0] for axis in self.study.axes), "quantity"]).to_xarray()
        data["quantity"].attrs |= {name: PLAIN.get(kind_of(name), "1") for name in data["quantity"].values}
        return data


def load(folder: str | Path) -> LongTables:
    """Load the tables of a study of the long run from a folder that ``rattle study`` has written.

    Parameters
    ----------
    folder : str or Path
        The folder.

    Returns
    -------
    LongTables
    """
    from rattle.compare.study.tables import read_tables

    study, record, tables = read_tables(folder)
    return LongTables(study, record, **{name: tables[name] for name in TABLES})


def shares(verdicts: pd.DataFrame, along: str) -> pd.DataFrame:
    """How many quantities of each closure are accurate at each value of a field.

    Returns: Index the field; for each closure the share of its judged quantities that are accurate, NaN without
    any.
    """
    if verdicts.empty:
        return pd.DataFrame()
    judged = verdicts[verdicts["verdict"].isin(JUDGED)]
    good = judged.assign(good=judged["verdict"] == "accurate").groupby([along, "closure"])["good"].mean().unstack()
    return good.reindex(sorted(verdicts[along].unique()))
