"""Studies of the long run, at each point of a grid: its cells, its tables, and the kind ``stationary``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar

import pandas as pd

from rattle.compare.stationary.measure import COLUMNS, stationary
from rattle.compare.stationary.result import PLAIN, kind_of
from rattle.compare.stationary.verdicts import CLOSURES_JUDGED, PREDICTED, judge_predictions, predictions
from rattle.compare.study.design import Study, list_reasons, with_coordinates
from rattle.compare.study.folder import load_study as load
from rattle.compare.study.store import Cell, Content
from rattle.compare.validation.verdict import Tolerances
from rattle.montecarlo.kernel.blocks import Blocks
from rattle.montecarlo.long_run.paths import IMPACT_SECONDS
from rattle.montecarlo.long_run.run import ACCURACY, PATHS, check_long_run
from rattle.scene.errors import InputError, choice
from rattle.scene.scene import Scene

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = ["load"]  # earlier pages say that `load` loads a study of the long run

SETTINGS = ("accuracy", "periods", "paths", "burn_in", "slow")  # of the simulation, besides its seed
FACTS = ("kind", "said", "periods", "paths", "impacts", "burn_in", "seconds")
TABLES = ("quantities", "verdicts", "cost", "reasons")
"""Tables of such a study, each a Parquet file."""
SMALL = ("cost", "reasons")  # those of them that are written as CSV too
KEYS = ("closures", *SETTINGS, "seed")
TITLE, PAGE = "study of the long run", "rattle.compare.stationary.study_page"
SPREAD = 2.0  # typical sd over mean of what is averaged, with its autocorrelation


@dataclass(frozen=True)
class LongResult:
    """The long run of a scene as read from the store."""

    table: pd.DataFrame  # as of `rattle.compare.stationary.result.Stationary`
    predicted: pd.DataFrame  # as of `rattle.compare.stationary.verdicts.predictions`
    facts: dict[str, Any]  # `FACTS`

    @property
    def verdicts(self) -> pd.DataFrame:
        """The closures against the simulation; empty for exact values."""
        if self.facts["kind"] != "simulated" or self.predicted.empty:
            return pd.DataFrame()
        return judge_predictions(self.table, self.facts["periods"], self.predicted)


@dataclass(frozen=True)
class LongCell(Cell):
    """The long run of a scene."""

    group: ClassVar[str] = "long runs"
    packages: ClassVar[tuple[str, ...]] = ("closure", "montecarlo")

    scene: Scene
    seed: int
    closures: tuple[str, ...]
    accuracy: float | None = None
    periods: int | None = None
    paths: int = PATHS
    burn_in: int | None = None
    slow: float = 0.1

    @property
    def asked(self) -> dict[str, Any]:
        """The `SETTINGS` of the simulation."""
        return {name: getattr(self, name) for name in SETTINGS}

    @property
    def settings(self) -> dict[str, Any]:
        """Everything that determines the result besides the scene, and the columns that are stored."""
        settings = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "scene"}
        return {"kind": "stationary", **settings, "columns": [*COLUMNS, *PREDICTED]}

    @property
    def core_seconds(self) -> float:
        """Rough estimate of the cost."""
        impacts = (self.periods or 0) * self.paths * 12.0
        if self.periods is None:
            impacts = (2.0 * SPREAD / (self.accuracy or ACCURACY)) ** 2
        return IMPACT_SECONDS * (impacts + 60.0 * 12.0 * self.paths) + 2.5 * ("branching" in self.closures)

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, dict[str, Any]]:
        """Follow the long run."""
        found = stationary(self.scene.phase_reduced, **self.asked, closures=self.closures, rng=self.seed)
        run, predicted = found.run, pd.DataFrame()
        if run is not None:
            if run.reach is not None and not run.reach.reached:  # where it stopped depends on wall time
                raise InputError("accuracy", self.accuracy, run.reach.sentence)
            predicted = predictions(found.laws, found.scene, self.slow)
        facts: dict[str, Any] = {"kind": found.kind, "said": found.said}
        facts |= {name: getattr(run, name, 0) for name in ("periods", "paths", "impacts")}
        facts |= {"burn_in": run.burn_in.periods if run else 0}
        parts = [found.table.reset_index().assign(closure=""), predicted]
        return pd.concat([part for part in parts if len(part)], ignore_index=True), facts

    def restore(self, content: Content) -> LongResult:
        """Turn a stored result back into tables."""
        own = content.table["closure"] == ""
        names = [c for c in PREDICTED if c in content.table]
        table = content.table[own].set_index("quantity")[COLUMNS]
        return LongResult(table, content.table.loc[~own, names], {name: content.facts[name] for name in FACTS})


@dataclass(frozen=True)
class LongTables:
    """The tables of a study of the long run."""

    study: Study
    record: dict[str, Any]  # the manifest
    # every quantity at every point: the fields that vary, ``quantity``, and the columns of `LongResult.table`
    quantities: pd.DataFrame
    verdicts: pd.DataFrame  # the closures against the simulation at every point
    # length and seconds of each cell, and what kind of motion it is; the seconds are not reproducible
    cost: pd.DataFrame
    reasons: pd.DataFrame  # what could not be computed at each point, and why

    @property
    def empty(self) -> bool:
        """Whether there is no result at all."""
        return self.cost.empty

    def plot(self, **at: Any) -> "Figure":
        """Draw the figure of the study's page; a notebook shows it.

        Keywords are values of the fields that vary besides the first; the table's first where one is left out.
        """
        from rattle.compare.stationary.study_page import study_figure
        from rattle.compare.study.figures import panels

        rows = self.quantities
        for fixed, part in panels(self.study, rows, len(rows)):
            if at.items() <= fixed.items():
                own = self.verdicts
                for name, value in fixed.items() if len(own) else ():
                    own = own[own[name] == value]
                return study_figure(self.study.along, part, own)
        raise InputError("study", self.study.title, "no field varies over numbers, or nothing could be computed")

    def to_xarray(self) -> "xr.Dataset":
        """Convert the quantities to a dataset, with the unit of each in ``["quantity"].attrs``; needs ``xarray``."""
        data = self.quantities.set_index([*(axis.names[0] for axis in self.study.axes), "quantity"]).to_xarray()
        data["quantity"].attrs |= {name: PLAIN.get(kind_of(name), "1") for name in data["quantity"].values}
        return data


RESULT = LongTables


def combine(study: Study, found: Mapping[str, LongResult]) -> LongTables:
    """Compute the tables of a study from the results of its cells, by key."""
    points = [(p, found[p.sample.key]) for p in study.points if p.sample and p.sample.key in found]

    def join(table: Callable[[LongResult], pd.DataFrame]) -> pd.DataFrame:
        parts = [with_coordinates(point.coordinates, own) for point, result in points if len(own := table(result))]
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()

    return LongTables(
        study,
        {},
        quantities=join(lambda result: result.table.reset_index()),
        verdicts=join(lambda result: result.verdicts),
        cost=join(lambda result: pd.DataFrame([result.facts])),
        reasons=list_reasons(study),
    )


def read(given: Mapping[str, Any], varying: set[str]) -> dict[str, Any]:
    """Read the fields of `Study` that ``[study]`` gives."""
    settings = {name: given[name] for name in (*SETTINGS, "seed") if name in given}
    for name in varying & {"scheme", "dt", *settings}:
        raise InputError(f"study.{name}", name, "cannot vary in a study of the long run, or varies twice")
    return {
        "closures": _closures(given.get("closures", tuple(CLOSURES_JUDGED))),
        "impacts": 1,
        "order": 2,
        "settings": settings,
        "common_noise": True,
        "within": Tolerances(),
    }


def cells(study: Study, scene: Scene, settings: dict[str, Any]) -> tuple[LongCell | None, tuple[()], dict[str, str]]:
    """The long run of a point, or why it cannot be computed."""
    try:
        cell = LongCell(scene, settings.pop("seed", 0), tuple(map(str, study.closures)), **settings)
        check_long_run(scene, **cell.asked, rng=cell.seed)
    except InputError as error:
        return None, (), {"sample": str(error)}
    return cell, (), {}


def _closures(given: Any) -> tuple[str, ...]:
    if isinstance(given, str | Mapping) or not hasattr(given, "__iter__"):
        raise InputError("study.closures", given, "give a list of " + ", ".join(CLOSURES_JUDGED))
    return tuple(dict.fromkeys(choice("study.closures", name, CLOSURES_JUDGED) for name in given))
