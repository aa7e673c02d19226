"""The page and the folder of a long run, with its answer in a few sentences."""

import math
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.chaos.figures import bifurcation_figure
from rattle.compare.chaos.sweep import Bifurcation
from rattle.compare.judge.verdict import MARKS, Verdict
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.report.report import Report
from rattle.compare.report.table import NO_VALUE, Table
from rattle.compare.report.texts import (
    glossary,
    label_quantities,
    wheel_label,
)
from rattle.compare.stationary.result import LEAST_EFFECTIVE, Stationary, speed_text, usual_units
from rattle.compare.stationary.verdicts import STATIONARY_TEXTS, TOLERANCES
from rattle.montecarlo.long_run.scatter import FEWEST_SETS
from rattle.scene import Scene
from rattle.scene.changes import is_unit
from rattle.scene.text import number_text
from rattle.scene.threshold import rattle_threshold

MESH_WORDS = STATIONARY_TEXTS["by_mesh"]


def _verdicts(verdicts: pd.DataFrame) -> pd.DataFrame:
    """The quantities of each closure that are judged, and why it has none."""
    missing = verdicts["reason"] != ""
    judged = verdicts[~missing & (verdicts["verdict"] != Verdict.NOT_PREDICTED)]
    numbers = dict.fromkeys(("simulated", "low", "high"), np.nan)
    reasons = verdicts[missing].drop_duplicates("closure").assign(quantity="all", unit="")
    rows = pd.concat([judged, reasons.assign(**numbers)]).sort_index()
    return rows.assign(mark=rows["verdict"].map(MARKS).fillna(""))


def make_report(found: Stationary, view: Bifurcation | None, record: Facts) -> Report:
    """The report on a long run."""
    units = usual_units(found.scene)
    gears = found.scene.gears
    figures = found.figures()
    tables = {"stationary": found.table.reset_index()}
    shown = found.table_in(units)
    quantities = shown.reset_index()
    content = {
        "found": found,
        "by_mesh": tabulate_meshes(found, shown),
        "quantities": label_quantities(found.scene, quantities),
        "slow": speed_text(found.slow, gears, units),
        "field": record["field"],
        "tolerances": TOLERANCES,
    }
    if gears:
        tables["physical"] = quantities
    if len(found.verdicts):
        tables["verdicts"] = found.verdicts_in(units)
        content["verdicts"] = label_quantities(found.scene, _verdicts(tables["verdicts"]))
    if len(found.scatter):
        content["scatter"] = tables["scatter"] = found.scatter_in(units)
    if found.densities:
        tables["sections"] = pd.concat([d.table for d in found.densities], ignore_index=True)
    if view is not None:
        figures["bifurcation"] = bifurcation_figure(
            view, gears=None if is_unit(found.scene, view.field) else gears
        )
        tables["bifurcation"] = view.table
    return Report(
        "stationary",
        f"The long run of {record['name']}",
        answer(found),
        record | found.to_dict(),
        content,
        glossary("stationary", gears=gears),
        figures=figures,
        tables=tables,
        digits="%.8g",
    )


def tabulate_meshes(found: Stationary, table: pd.DataFrame) -> Table:
    """What is said of each mesh; the quantities of a single one are those of all impacts."""
    time = "second" if found.scene.gears else "unit of time"
    shown = table.dropna(subset="value")
    meshes = range(1, found.scene.stages + 1)
    rows = []
    for name, words in MESH_WORDS.items():
        by_mesh = found.scene.stages > 1 or name.endswith("_share")
        names = [f"{name}_mesh{mesh}" if by_mesh else name for mesh in meshes]
        cells = [show_quantity(shown, name) if name in shown.index else NO_VALUE for name in names]
        rows.append([words.format(time), *cells])
    heads = (f"mesh {wheel_label(found.scene, mesh)}" for mesh in meshes)
    return Table.of(["", *heads], rows)


def answer(found: Stationary) -> list[str]:
    """Summarise a long run in sentences."""
    units = usual_units(found.scene)
    table = found.table_in(units)
    memory = table["autocorrelation"]
    # 0 where all paths have the same
    memory = memory[(memory > 0.0) & ~memory.index.str.startswith(("contact", "skew_"))]
    meshes = range(1, found.scene.stages + 1)
    closed = (
        (wheel_label(found.scene, mesh), table["value"][f"contact_share_mesh{mesh}"])
        for mesh in meshes
    )
    verdicts = found.verdicts_in(units)
    closures = verdicts.groupby("closure", sort=False) if len(verdicts) else ()
    return render_sentences(
        "stationary/answer.j2",
        found.scene.words,
        found=found,
        thresholds=rattle_threshold(found.scene),
        shares=share_energy(found.scene, table),
        value=table["value"],
        high=table["high"],
        show=partial(show_quantity, table),
        least=speed_text(found.slow, found.scene.gears, units),
        quiet=speed_text(found.run.quiet, found.scene.gears, units) if found.run else "",
        closed=[(mesh, share) for mesh, share in closed if share > 0.0],
        memory=memory,
        few=list(found.few.sort_values().items()),
        least_effective=LEAST_EFFECTIVE,
        ratios=(table["se_batches"] / table["se"])[table["se"] > 0.0].dropna(),
        sets={
            name: rows.set_index("percent").to_dict("index")
            for name, rows in found.scatter_in(units).groupby("quantity")
        }
        if len(found.scatter)
        else {},
        lost="power" if found.scene.gears else "energy_per_period",
        fewest_sets=FEWEST_SETS,
        closures={closure: rows.to_dict("records") for closure, rows in closures},
    )


def share_energy(scene: Scene, table: pd.DataFrame) -> list[tuple[str, str]]:
    """The share of each mesh in the energy that impacts lose, the largest first: its label, and the
    range of the share in percent while every energy lies in its interval.

    Of three meshes or more: of two both energies are stated.
    """
    if scene.stages < 3:
        return []
    names = {f"power_mesh{mesh}": mesh for mesh in range(1, scene.stages + 1)}
    lost = table.reindex(list(names)).dropna(subset="value")
    lost = lost[lost["value"] > 0.0].sort_values("value", ascending=False)
    low = lost["low"] / (lost["low"] + lost["high"].sum() - lost["high"])
    high = lost["high"] / (lost["high"] + lost["low"].sum() - lost["low"])
    shares = []
    for name, least, most in zip(lost.index, low, high, strict=True):
        ends = dict.fromkeys((number_text(100.0 * least, 2), number_text(100.0 * most, 2)))
        shares.append((wheel_label(scene, names[str(name)]), " to ".join(ends)))
    return shares


def show_quantity(table: pd.DataFrame, name: str) -> str:
    """A quantity with its interval and its unit."""
    row: Any = table.loc[name]
    value, low, high, unit = row[["value", "low", "high", "unit"]]
    half = 0.5 * (high - low)
    if value == 0.0 and high > 0.0:
        text = f"none seen, fewer than {number_text(high, 2)}"
    elif low <= 0.0 < value:
        text = f"at most {number_text(high, 2)}"
    elif math.isnan(half):
        text = f"{number_text(value, 3)} (error not known)"
    elif half == 0.0:  # exact
        text = number_text(value, 5)
    else:
        text = f"{number_text(value, _digits(value, half))} ± {number_text(half, 1)}"
    return f"{text} {unit}".rstrip()


def _digits(value: float, half: float) -> int:
    """Digits of a value up to the first of the half width of its interval, one at least."""
    last = math.floor(math.log10(float(f"{half:.0e}")))
    return max(1 + math.floor(math.log10(abs(value))) - last, 1) if value else 1
