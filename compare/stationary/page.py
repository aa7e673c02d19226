"""The page and the folder of a long run, with its answer in a few sentences."""

import math
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.chaos.sweep import Bifurcation
from rattle.compare.report.report import Report
from rattle.compare.report.table import Table
from rattle.compare.report.texts import CLOSURE_TERMS, VERDICT_TERMS, glossary
from rattle.compare.stationary.figures import bifurcation_figure, speed_unit
from rattle.compare.stationary.result import LEAST_EFFECTIVE, Stationary, speed_text
from rattle.compare.stationary.verdicts import STATIONARY_TEXTS, TOLERANCES
from rattle.compare.validation.transient import drag_text
from rattle.compare.validation.verdict import JUDGED, MARKS, Verdict
from rattle.montecarlo.long_run import LongRun
from rattle.scene import Scene
from rattle.scene.gear_values import UNIT_VALUES
from rattle.scene.text import percent
from rattle.scene.threshold import rattle_threshold

STATIONARY_WORDS: tuple[str, ...] = (
    *CLOSURE_TERMS,
    *VERDICT_TERMS,
    "exact flight",
    "σ",
    "ε",
    "τ",
    "Δτ",
    "y1, y2",
    "E, sd",
)
STATIONARY_WORDS += ("orbit", "mean map", "sticking")
MASS_UNIT = ", in units of the mass of wheel 1 at its rim times the square of the unit of speed"
BY_MESH: dict[str, str] = STATIONARY_TEXTS["by_mesh"]
MAIN_QUANTITIES = ("rate_above", "speed_above", "energy_per_period")
NAMED = 4  # quantities with few effective paths that are named
# share of slow impacts from which on they are called chatter, although no mesh closes
CHATTER_SHARE = 0.5
ERROR_RATIO = 0.5  # ratio of standard errors, from paths and from batches, from which both disagree


def _units(found: Stationary) -> str:
    return "physical" if found.scene.gears else "dimensionless"


def _by_mesh(table: pd.DataFrame, name: str, mesh: int, stages: int) -> str:
    """A quantity at a mesh with its interval."""
    own = f"{name}_mesh{mesh}" if stages == 2 or name.endswith("_share") else name
    return _show(table, own) if own in table["value"].dropna().index else "–"


def _verdicts(verdicts: pd.DataFrame) -> pd.DataFrame:
    """The quantities of each closure that are judged, and why it has none."""
    missing = verdicts["reason"] != ""
    alone = missing & ~verdicts["closure"].duplicated()
    nothing = {"quantity": "all", "unit": "", "simulated": np.nan, "low": np.nan, "high": np.nan}
    rows = verdicts.assign(
        **{name: verdicts[name].mask(alone, value) for name, value in nothing.items()}
    )
    rows = rows[alone | (rows["verdict"] != Verdict.NOT_PREDICTED) & ~missing]
    return rows.assign(mark=rows["verdict"].map(MARKS).fillna(""))


def make_report(found: Stationary, view: Bifurcation | None, record: dict[str, Any]) -> Report:
    """The report on a long run."""
    units = _units(found)
    gears = found.scene.gears
    figures = found.figures()
    tables = {"stationary": found.table.reset_index()}
    shown = found.table_in(units)
    quantities = shown.reset_index()
    content = {
        "by_mesh": _tabulate_meshes(found, shown),
        "quantities": quantities,
        "slow": speed_text(found.slow, gears, units),
        "mass": "" if gears else MASS_UNIT,
        "field": record["field"],
        "tolerances": TOLERANCES,
    }
    if gears:
        tables["physical"] = quantities
        content["dimensionless"] = found.table_in("dimensionless").reset_index()
    if len(found.verdicts):
        tables["verdicts"] = found.verdicts_in(units)
        content["verdicts"] = _verdicts(tables["verdicts"])
    if found.densities:
        tables["sections"] = pd.concat([d.table for d in found.densities], ignore_index=True)
    if view is not None:
        figures["bifurcation"] = bifurcation_figure(
            view, *speed_unit(None if view.field in UNIT_VALUES else gears)
        )
        tables["bifurcation"] = view.table
    return Report(
        "stationary",
        f"The long run of {record['name']}",
        answer(found),
        record | found.to_dict(),
        content,
        glossary(*STATIONARY_WORDS, gears=gears),
        figures=figures,
        tables=tables,
        digits="%.8g",
    )


def _tabulate_meshes(found: Stationary, table: pd.DataFrame) -> Table:
    """What is said of each mesh."""
    time = "second" if found.scene.gears else "unit of time"
    stages = found.scene.stages
    meshes = range(1, stages + 1)
    rows = [
        [words.format(time), *(_by_mesh(table, name, mesh, stages) for mesh in meshes)]
        for name, words in BY_MESH.items()
    ]
    return Table.of(["", *(f"mesh {mesh}" for mesh in meshes)], rows)


def answer(found: Stationary) -> list[str]:
    """Summarise a long run in sentences."""
    run = found.run
    said = [*_impacts(found), found.said, threshold_sentence(found.scene)]
    if run is not None:
        said += [run.burn_in.sentence, run.reach.sentence if run.reach else ""]
        said += [
            _memory(found.table),
            _few(found, run),
            _compare_errors(found.table),
            *_closures(found),
        ]
    return [sentence for sentence in said if sentence]


def threshold_sentence(scene: Scene) -> str:
    """The drag from which on closed teeth stay closed, beside what the wheels have."""
    found = rattle_threshold(scene)
    least = " and ".join(f"{drag_text(t.least, t.unit)} on wheel {t.wheel}" for t in found)
    own = " and ".join(drag_text(t.drag, t.unit) for t in found)
    what = "drag torque" if scene.gears else "gamma"
    if any(t.opens for t in found):
        return (
            f"Threshold of rattle, without noise: closed teeth open below a {what} of {least}; here"
            f" it is {own}."
        )
    return f"Without noise closed teeth stay closed: from a {what} of {least} on; here it is {own}."


def _show(table: pd.DataFrame, name: str) -> str:
    row = table.loc[name].to_dict()
    if row["value"] == 0.0 and row["high"] > 0.0:
        return f"none seen, fewer than {_number(row['high'], 2)} {row['unit']!s}".rstrip()
    half = 0.5 * (row["high"] - row["low"])
    exact = (
        _number(row["value"], 5)
        if half == 0.0
        else f"{_number(row['value'], 4)} ± {_number(half, 1)}"
    )
    return f"{exact} {row['unit']!s}".rstrip()


def _number(value: float, digits: int) -> str:
    """A number to some digits, without an exponent where it is not needed."""
    return f"{float(f'{value:.{digits}g}'):,.6g}"


def _impacts(found: Stationary) -> list[str]:
    """The impacts that are not slow, and the others, in a sentence each."""
    table = found.table_in(_units(found))
    gears = found.scene.gears
    value = {str(name): float(v) for name, v in table["value"].items()}
    second, power = (
        (" a second", f", {_show(table, 'power')}")
        if gears
        else (" per unit of dimensionless time", "")
    )
    least = speed_text(found.slow, gears, _units(found))
    most = float(table["high"]["rate_above"])
    unseen = f" (fewer than {_number(most, 2)}{second} with 95 % probability)" if most > 0.0 else ""
    if value["rate"] == 0.0 and unseen:
        return [f"No impact was seen in the long run, so none faster than {least}{unseen}."]
    if value["rate"] == 0.0:
        return ["There are no impacts in the long run: the motion comes to rest for good."]
    lost = f"all impacts lose {_show(table, 'energy_per_period')} a period{power}."
    if value["rate_above"] == 0.0:
        return [
            f"In the long run no impact is faster than {least}{unseen}; {lost}",
            _slow(found, value, second),
        ]
    fastest = f"{value['q95_speed_above']:.3g} {table.loc['speed_above', 'unit']!s}".rstrip()
    said = (
        f"In the long run there are {_show(table, 'rate_above').removesuffix(' 1/s')}"
        f" impacts{second} faster than {least}, half of them faster than"
        f" {value['q50_speed_above']:.3g}, one in twenty faster than {fastest} (mean"
        f" {_show(table, 'speed_above')}); {lost}"
    )
    return [said, _slow(found, value, second)]


def _slow(found: Stationary, value: dict[str, float], second: str) -> str:
    """The slow impacts: chatter where they are most of all, or end with closed teeth."""
    share = value["slow_share"]
    slower = value["rate"] - value["rate_above"]
    if not share > 0.0:
        return ""
    each = f"{_number(slower, 3)} slower impacts{second}, {share:.2%} of all"
    closed = {mesh: value[f"contact_share_mesh{mesh}"] for mesh in range(1, found.scene.stages + 1)}
    named = " and ".join(
        f"mesh {mesh} for {percent(part)}" for mesh, part in closed.items() if part > 0.0
    )
    if named:
        return (
            f"The others are chatter: {each}, in which teeth bounce ever more weakly until they"
            f" stay closed ({named} of the time). Such chatter has infinitely many impacts,"
            " followed until they are too small to matter: `rate`, and means and quantiles over"
            " all impacts, depend on where that is."
        )
    return (
        f"The others are chatter that closes no mesh: {each}."
        if share > CHATTER_SHARE
        else f"There are {each}."
    )


def _memory(table: pd.DataFrame) -> str:
    """Autocorrelations that matter."""
    own = table["autocorrelation"]
    # 0 where all paths have the same
    own = own[(own > 0.0) & ~own.index.str.startswith(("contact", "skew_"))]
    if own.empty:
        return "All paths have the same sums: there is no sampling error."
    most = own.max()
    least = own.min()
    return (
        f"Autocorrelation times range from {least:.2g} impacts (`{own.idxmin()}`) to {most:.3g}"
        f" (`{own.idxmax()}`): errors computed as if impacts were independent would be"
        f" {_off_by(least)} and {_off_by(most)}."
    )


def _off_by(autocorrelation: float) -> str:
    """How far an error is off that is computed as if impacts were independent."""
    if autocorrelation < 1.0:
        return f"{_number(autocorrelation**-0.5, 2)} times too large"
    return f"{_number(autocorrelation**0.5, 2)} times too small"


def _few(found: Stationary, run: LongRun) -> str:
    """Where errors rest on few paths, as where bursts of slow impacts are rare; how many periods
    would fix it."""
    few = found.few.sort_values()
    if few.empty:
        return ""
    names = [f"`{name}`" for name in few.index[:NAMED]]
    others = f" and {few.size - NAMED} more" if few.size > NAMED else ""
    periods = math.ceil(run.periods * (LEAST_EFFECTIVE / float(few.iloc[0]) - 1.0))
    return (
        f"The standard error of {names[0]} rests on about {few.iloc[0]:.0f} of {run.paths} paths,"
        f" which differ most from the others: intervals of {', '.join(names)}{others} are wider for"
        f" that reason. About {_number(periods, 1)} more periods would fix this."
    )


def _compare_errors(table: pd.DataFrame) -> str:
    """Standard errors from paths against those from batch means."""
    both = table[(table["se"] > 0.0) & table["se_batches"].notna()]
    if both.empty:
        return ""
    ratio = both["se_batches"] / both["se"]
    said = (
        f"Standard errors from batch means are {ratio.min():.2f} to {ratio.max():.2f} times those"
        " between paths"
    )
    if ratio.min() < ERROR_RATIO:
        said += (
            ": paths differ more than batches of one path do, so some correlations last longer than"
            " a batch"
        )
    return f"{said}."


def _closures(found: Stationary) -> list[str]:
    """What each closure says of the long run, and whether it is right."""
    said = []
    verdicts = found.verdicts_in(_units(found))
    for closure, rows in verdicts.groupby("closure", sort=False) if len(verdicts) else ():
        name = f"`{closure}` ({rows['kind'].iloc[0]})"
        if rows["reason"].iloc[0]:
            said.append(f"{name}: not predicted, {rows['reason'].iloc[0]}.")
            continue
        good, bad, undecided = ((rows["verdict"] == verdict).sum() for verdict in JUDGED)
        each = [
            f"{quantity} {row['predicted']:.4g} against "
            + f"{row['simulated']:.4g} {row['unit']}".rstrip()
            + f" ({row['verdict']})"
            for quantity, row in rows.set_index("quantity").loc[list(MAIN_QUANTITIES)].iterrows()
        ]
        counts = f"{good} quantities accurate, {bad} inaccurate, {undecided} undecided"
        said.append(f"{name}: {counts}; {', '.join(each)}.")
    return said
