"""Studies of the long run at each point of a grid: cells, tables, what their page says, and the
kind ``stationary``."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import cycle
from typing import TYPE_CHECKING, Any

import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.engine.store import Cell, Content, Facts
from rattle.compare.judge.verdict import JUDGED, Tolerances, Verdict
from rattle.compare.report.render import render_sentences
from rattle.compare.report.style import STYLE, new_figure
from rattle.compare.report.texts import REPORT_TEXTS, label_quantity
from rattle.compare.stationary.measure import ESTIMATE_COLUMNS, stationary
from rattle.compare.stationary.result import in_units, plain_unit
from rattle.compare.stationary.verdicts import (
    CLOSURES_JUDGED,
    PREDICTED,
    STATIONARY_TEXTS,
    TOLERANCES,
    choose_closures,
    default_closures,
    judge_predictions,
    predictions,
)
from rattle.compare.study.design import Study, join_points, list_reasons
from rattle.compare.study.figures import label_field, panels
from rattle.compare.study.folder import Drawing
from rattle.montecarlo.kernel.blocks import Blocks, Budget
from rattle.montecarlo.long_run.paths import IMPACT_SECONDS
from rattle.montecarlo.long_run.run import LONG_RUN_ACCURACY, LONG_RUN_PATHS, check_long_run
from rattle.scene import InputError, Scene
from rattle.scene.changes import same_speed, unit_of_value
from rattle.scene.errors import BudgetEnded

if TYPE_CHECKING:
    import xarray as xr

# of the simulation, besides its seed
LONG_RUN_SETTINGS = ("accuracy", "periods", "paths", "burn_in", "slow")
FACTS = ("kind", "said", "periods", "paths", "impacts", "burn_in", "seconds")
TABLES = ("quantities", "verdicts", "cost", "reasons")
"""Tables of such a study, each a Parquet file."""
SMALL = ("cost", "reasons")  # those of them that are written as CSV too
KEYS = ("closures", *LONG_RUN_SETTINGS, "seed")
TITLE = "study of the long run"
PAGE = "rattle.compare.stationary.study"
TEMPLATE = "stationary/study.j2"
MAIN_QUANTITIES = ("rate", "speed", "energy_per_period", "slow_share")  # those of the page
LEAST_LIMIT = 1e-3  # of a budget; what is spent already leaves none
PHYSICAL_QUANTITIES = ("rate_above", "speed_above", "power", "slow_share")  # in physical units
TYPICAL_SPREAD = 2.0  # typical sd over mean of what is averaged, with its autocorrelation


@dataclass(frozen=True)
class LongResult:
    """The long run of a scene as read from the store."""

    table: pd.DataFrame  # as of `rattle.compare.stationary.result.Stationary`
    predicted: pd.DataFrame  # as of `rattle.compare.stationary.verdicts.predictions`
    facts: Facts  # `FACTS`

    @property
    def verdicts(self) -> pd.DataFrame:
        """The closures against the simulation; empty for exact values."""
        if self.facts["kind"] != "simulated" or self.predicted.empty:
            return pd.DataFrame()
        return judge_predictions(self.table, self.facts["periods"], self.predicted)


@dataclass(frozen=True)
class LongCell(Cell):
    """The long run of a scene."""

    group = "long runs"
    packages = ("closure", "montecarlo")

    scene: Scene
    seed: int
    closures: tuple[str, ...]
    accuracy: float | None = None
    periods: int | None = None
    paths: int = LONG_RUN_PATHS
    burn_in: int | None = None
    slow: float = 0.1
    # time that it may take: what does not fit is no result, so that it is no part of the key
    limit: Budget | None = None

    @property
    def asked(self) -> Facts:
        """The `LONG_RUN_SETTINGS` of the simulation."""
        return {name: getattr(self, name) for name in LONG_RUN_SETTINGS}

    @property
    def settings(self) -> Facts:
        """Everything that determines the result besides the scene, and the columns that are
        stored."""
        settings = self.list_fields("limit")
        return {"kind": "stationary", **settings, "columns": [*ESTIMATE_COLUMNS, *PREDICTED]}

    @property
    def core_seconds(self) -> float:
        """Rough estimate of the cost."""
        impacts = (self.periods or 0) * self.paths * 12.0
        if self.periods is None:
            impacts = (2.0 * TYPICAL_SPREAD / (self.accuracy or LONG_RUN_ACCURACY)) ** 2
        return IMPACT_SECONDS * (impacts + 60.0 * 12.0 * self.paths) + 2.5 * (
            "branching" in self.closures
        )

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, Facts]:
        """Follow the long run; raises BudgetEnded if it does not fit the budget."""
        budget = None
        if self.limit is not None and math.isfinite(self.limit.seconds):
            budget = max(self.limit.remaining, LEAST_LIMIT)
        asked = self.asked | {"closures": self.closures, "budget": budget}
        try:
            result = stationary(self.scene.phase_reduced, **asked, rng=self.seed)
        except InputError as error:
            # a burn-in that took more than half of it was refused for want of the rest
            if self.limit and budget and self.limit.remaining < 0.5 * budget:
                raise BudgetEnded from error
            raise
        run = result.run
        if run is not None and self.periods is not None and not run.reached:
            raise BudgetEnded
        parts = [result.table.reset_index().assign(closure="")]
        if run is not None:
            # where it stopped depends on wall time
            if run.reach is not None and not run.reach.reached:
                raise InputError("accuracy", self.accuracy, run.reach.sentence)
            parts.append(predictions(result.laws, result.scene, self.slow))
        facts: Facts = {"kind": result.kind, "said": result.said}
        facts |= {name: getattr(run, name, 0) for name in ("periods", "paths", "impacts")}
        facts["burn_in"] = run.burn_in.periods if run else 0
        return pd.concat([part for part in parts if len(part)], ignore_index=True), facts

    def restore(self, content: Content) -> LongResult:
        """Turn a stored result back into tables."""
        simulated = content.table["closure"] == ""
        names = [name for name in PREDICTED if name in content.table]
        table = content.table[simulated].set_index("quantity")[ESTIMATE_COLUMNS]
        facts = {name: content.facts[name] for name in FACTS}
        return LongResult(table, content.table.loc[~simulated, names], facts)


@dataclass(frozen=True)
class LongTables:
    """The tables of a study of the long run."""

    study: Study
    record: Facts  # the manifest
    # every quantity at every point: the fields that vary, ``quantity``, and the columns of
    # `LongResult.table`
    quantities: pd.DataFrame
    verdicts: pd.DataFrame  # the closures against the simulation at every point
    # length and seconds of each cell, and what kind of motion it is; the seconds are not
    # reproducible
    cost: pd.DataFrame
    reasons: pd.DataFrame  # what could not be computed at each point, and why

    @property
    def empty(self) -> bool:
        """Whether there is no result at all."""
        return self.cost.empty

    def plot(self, **at: Any) -> Figure:
        """Draw the figure of the study's page; a notebook shows it.

        Keywords are values of the fields that vary besides the first; the table's first where one
        is left out.
        """
        for fixed, part in panels(self.study, self.quantities, len(self.quantities)):
            if at.items() <= fixed.items():
                verdicts = self.verdicts
                for name, value in fixed.items() if len(verdicts) else ():
                    verdicts = verdicts[verdicts[name] == value]
                return study_figure(self.study, part, verdicts)
        raise InputError(
            "study", self.study.title, "no field varies over numbers, or nothing could be computed"
        )

    def to_xarray(self) -> "xr.Dataset":
        """Convert the quantities to a dataset, with the unit of each in ``["quantity"].attrs``;
        needs ``xarray``."""
        index = [*(axis.names[0] for axis in self.study.axes), "quantity"]
        numbers = self.quantities.drop(columns="unit", errors="ignore")
        data = numbers.set_index(index).to_xarray()
        unit = unit_of_quantity(self.quantities)
        data["quantity"].attrs |= {name: unit(name) for name in data["quantity"].values}
        return data


RESULT = LongTables


def is_physical(study: Study) -> bool:
    """Whether its quantities are in physical units: where a value of the gears varies in its own
    unit."""
    return study.scene.gears is not None and any(map(unit_of_value, study.names))


def combine(study: Study, found: Mapping[str, LongResult]) -> LongTables:
    """Compute the tables of a study from the results of its cells, by key."""
    points = [(p, found[p.sample.key]) for p in study.points if p.sample and p.sample.key in found]

    physical = is_physical(study)

    def join(table: Callable[[LongResult], pd.DataFrame]) -> pd.DataFrame:
        parts = []
        for point, result in points:
            rows = table(result)
            if physical and "quantity" in rows:
                rows = in_units(rows, point.sample.scene.gears, "physical")
            if len(rows):
                parts.append((point.coordinates, rows))
        return join_points(parts)

    return LongTables(
        study,
        {},
        quantities=join(lambda result: result.table.reset_index()),
        verdicts=join(lambda result: result.verdicts),
        cost=join(lambda result: pd.DataFrame([result.facts])),
        reasons=list_reasons(study),
    )


def read(given: Mapping[str, Any], varying: set[str], scene: Scene) -> Facts:
    """Read the fields of `Study` that ``[study]`` gives."""
    settings = {name: given[name] for name in (*LONG_RUN_SETTINGS, "seed") if name in given}
    for name in varying & {"scheme", "dt", *settings}:
        raise InputError(
            f"study.{name}", name, "cannot vary in a study of the long run, or varies twice"
        )
    closures = given.get("closures", default_closures(scene))
    if isinstance(closures, str | Mapping) or not hasattr(closures, "__iter__"):
        raise InputError("study.closures", closures, "give a list of " + ", ".join(CLOSURES_JUDGED))
    return {
        "closures": choose_closures("study.closures", closures, scene),
        "impacts": 1,
        "order": 2,
        "settings": settings,
        "common_noise": True,
        "within": Tolerances(),
    }


def cells(
    study: Study, scene: Scene, settings: Facts
) -> tuple[LongCell | None, tuple[()], dict[str, str]]:
    """The long run of a point, or why it cannot be computed."""
    try:
        cell = LongCell(scene, settings.pop("seed", 0), tuple(map(str, study.closures)), **settings)
        cell = replace(cell, slow=same_speed(cell.slow, study.scene, scene))
        check_long_run(scene, **cell.asked, rng=cell.seed)
    except InputError as error:
        return None, (), {"sample": str(error)}
    return cell, (), {}


PANELS: dict[str, list[dict[str, str]]] = STATIONARY_TEXTS["panels"]
"""Title of each panel, its unit, and a pattern of the quantities that it shows: at all meshes, or
quantiles; physical where a value of the gears varies in its own unit."""
AVERAGES = ("speed", "slow_share", "energy_per_period")
"""Quantities whose autocorrelation is drawn."""
STYLES: Any = REPORT_TEXTS["marks"]["lines"]


def study_figure(study: Study, quantities: pd.DataFrame, verdicts: pd.DataFrame) -> Figure:
    """Draw rates, losses, speeds, slow shares and the closures' verdicts over the first field that
    varies."""
    along = study.along
    names = [str(name) for name in quantities["quantity"].unique()]
    figure, axes = new_figure(10.0, 6.0, 2, 3)
    of: dict[Any, Any] = dict(iter(quantities.groupby("quantity")))
    units = "physical" if "unit" in quantities else "dimensionless"
    for ax, panel in zip(axes, PANELS[units], strict=False):
        shown_here = [name for name in names if re.fullmatch(panel["names"], name)]
        for name, style in zip(shown_here, cycle(STYLES), strict=False):
            rows = of[name].sort_values(along)
            band = {"color": style["color"], "alpha": 0.25, "lw": 0}
            ax.fill_between(along, "low", "high", data=rows, **band)
            ax.plot(along, "value", data=rows, label=label_quantity(study.scene, name), **style)
        ax.set_title(panel["title"], loc="left")
        ax.set_ylabel(panel["unit"])
    memory, shown = axes[4:]
    averages = [name for name in names if name in AVERAGES]
    for name, style in zip(averages, STYLES, strict=False):
        memory.plot(along, "autocorrelation", data=of[name], label=name, **style)
    memory.set(yscale="log", ylabel="impacts")
    memory.set_title("autocorrelation time", loc="left")
    good = shares(verdicts, along).dropna(axis="columns", how="all")
    for closure, accurate in good.items():
        shown.plot(accurate, lw=1.2, ms=4, label=closure, **STYLE[str(closure)])
    shown.set(ylabel="share", ylim=(-0.05, 1.05), visible=not good.empty)
    shown.set_title("accurate quantities", loc="left")
    for ax in axes:
        label_field(ax, along, quantities[along])
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize=6)
    return figure


def unit_of_quantity(quantities: pd.DataFrame) -> Callable[[str], str]:
    """What gives the unit of a quantity: the table's own, or what dimensionless ones count in."""
    if "unit" not in quantities:
        return plain_unit
    units = dict(zip(quantities["quantity"], quantities["unit"], strict=True))
    return lambda name: str(units.get(name, ""))


def shares(verdicts: pd.DataFrame, along: str) -> pd.DataFrame:
    """How many quantities of each closure are accurate at each value of a field.

    Returns: Index the field; for each closure the share of its judged quantities that are accurate,
    NaN without any.
    """
    if verdicts.empty:
        return pd.DataFrame()
    judged = verdicts[verdicts["verdict"].isin(JUDGED)]
    good = (
        judged.assign(good=judged["verdict"] == Verdict.ACCURATE)
        .groupby([along, "closure"])["good"]
        .mean()
        .unstack()
    )
    return good.reindex(sorted(verdicts[along].unique()))


def answer(r: LongTables) -> list[str]:
    """Summarise a study of the long run in a few sentences."""
    if r.empty:
        return ["No point could be computed; the command says why."]
    values = {
        name: r.quantities[r.quantities["quantity"] == name].sort_values("value")
        for name in ("rate_above", "power", "rate", "energy_per_period")
    }
    reach = []
    if r.study.along and not r.verdicts.empty:
        accurate = shares(r.verdicts, r.study.along)
        reasons = r.verdicts.groupby("closure")["reason"].first()
        nothing = pd.Series(dtype=float)
        reach = [
            (closure, accurate.get(closure, nothing).dropna(), reasons[closure])
            for closure in map(str, r.study.closures)
        ]
    return render_sentences(
        "stationary/study_answer.j2",
        r.study.scene.words,
        r=r,
        ends={
            name: rows.iloc[[0, -1]].to_dict("records")
            for name, rows in values.items()
            if len(rows)
        },
        reach=reach,
        physical=is_physical(r.study),
        exact=(r.cost["kind"] != "simulated").sum(),
    )


def draw(r: LongTables) -> list[Drawing]:
    """Draw the figure, where a field varies, once for all values of the others."""
    drawn = []
    for number, (fixed, _) in enumerate(panels(r.study, r.quantities), 1):
        name = f"figures/long-run-{number}" if fixed else "figures/long-run"
        at = "".join(f" {field} = {v}." for field, v in fixed.items())
        units = "" if is_physical(r.study) else f" {STATIONARY_TEXTS['study_units']}"
        drawn.append(Drawing(name, r.plot(**fixed), STATIONARY_TEXTS["study"] + units + at))
    return drawn


def content(r: LongTables, seconds: Mapping[str, float]) -> Facts:
    """What the template of the page shows: the main quantities at every point, with half widths of
    their intervals."""
    point = ["study", *r.study.names]  # an index even where no field varies
    half = 0.5 * (r.quantities["high"] - r.quantities["low"])
    physical = is_physical(r.study)
    shown = PHYSICAL_QUANTITIES if physical else MAIN_QUANTITIES
    main = [(kind, name) for name in shown for kind in ("value", "half")]
    columns = (
        r.quantities.assign(half=half, study=0)
        .pivot(index=point, columns="quantity", values=["value", "half"])
        .reindex(columns=main)
        .set_axis([" ".join(head) for head in main], axis="columns")
    )
    rows = r.cost.assign(study=0).join(columns, on=point)
    unit = unit_of_quantity(r.quantities)
    units = {name: unit(name) if physical else "" for name in shown}
    return {"rows": rows, "units": units, "tolerances": TOLERANCES}
