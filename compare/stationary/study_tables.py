"""The tables of a study of the long run."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from rattle.compare.stationary.cell import LongResult
from rattle.compare.stationary.units import PLAIN, kind_of
from rattle.compare.study.design import Study, list_reasons, with_coordinates
from rattle.scene.errors import InputError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

TABLES = ("quantities", "verdicts", "cost", "reasons")
"""Tables of such a study, each a Parquet file."""


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

    def plot(self) -> "Figure":
        """Draw the figure of the study's page; a notebook shows it."""
        from rattle.compare.stationary.study_figures import study_figure

        if not self.study.along or self.quantities.empty:
            raise InputError("study", self.study.title, "no field varies over numbers, or nothing could be computed")
        return study_figure(self)

    def to_xarray(self) -> "xr.Dataset":
        """Convert the quantities to a dataset, with the unit of each in ``["quantity"].attrs``; needs ``xarray``."""
        data = self.quantities.set_index([*(axis.names[0] for axis in self.study.axes), "quantity"]).to_xarray()
        data["quantity"].attrs |= {name: PLAIN.get(kind_of(name), "1") for name in data["quantity"].values}
        return data


def combine(study: Study, found: Mapping[str, LongResult]) -> LongTables:
    """Compute the tables of a study from the results of its cells, by key."""
    points = [(p, found[p.sample.key]) for p in study.points if p.sample and p.sample.key in found]

    def join(table: Callable[[LongResult], pd.DataFrame]) -> pd.DataFrame:
        parts = [with_coordinates(point, own) for point, result in points if len(own := table(result))]
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()

    return LongTables(
        study,
        {},
        quantities=join(lambda result: result.table.reset_index()),
        verdicts=join(lambda result: result.verdicts),
        cost=join(lambda result: pd.DataFrame([result.facts])),
        reasons=list_reasons(study),
    )
