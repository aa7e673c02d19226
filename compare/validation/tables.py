"""The tables on the page of a validation, and the motion of its gears in physical units: ms, mm,
mm/s and mJ."""

import math
from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.judge.verdict import JUDGED, MARKS, Verdict
from rattle.compare.report.render import render_sentences
from rattle.compare.report.table import NO_VALUE, Table, TableCell
from rattle.compare.report.texts import wheel_label
from rattle.compare.validation.comparison import CAUSES, Comparison, find_validities
from rattle.compare.validation.errors import ON_ITINERARY
from rattle.compare.validation.realizability import (
    first_failures,
    realizability_table,
    section_distances,
)
from rattle.scene import state_names
from rattle.scene.units import PRODUCTS

DESCRIBES = {"itinerary": "paths on its itinerary", "all paths": "all paths", None: "not stated"}
"""What the page says of `rattle.closure.Closure.describes`."""

MOMENT_HEADS = {"mean": "E", "sd": "sd"}


def count_verdicts(v: Comparison) -> pd.DataFrame:
    """Number of moments with each verdict, by closure and kind of moment."""
    names = {"section": "section {}s", ON_ITINERARY: "section {}s, paths on its itinerary"}
    groups = v.table.groupby(["closure", "kind", "moment"], sort=False)["verdict"]
    no_verdicts = dict.fromkeys(Verdict, 0)
    return pd.DataFrame(
        {"closure": closure, "what": names.get(str(kind), "ρ at mid-flight").format(moment)}
        | no_verdicts
        | verdicts.value_counts().to_dict()
        for (closure, kind, moment), verdicts in groups
    )


def _cell(row: pd.Series) -> TableCell:
    if row["verdict"] not in JUDGED:
        return TableCell(NO_VALUE)
    unit = row["unit"] if row["unit"] > 0.0 else 1.0
    error = row["error"] / unit
    half = 0.5 * (row["high"] - row["low"]) / unit
    text = f"{error:+.3f} ± {half:.3f}" if abs(error) < 1e3 else f"{error:+.2g} ± {half:.2g}"
    if half != half:  # too few paths for an interval
        text = f"{error:+.3g}"
    return TableCell(text, MARKS[row["verdict"]], float(error))


def impact_table(v: Comparison, closure: str) -> Table:
    """Errors of a closure at each impact, in sds, with the half width of their intervals."""
    section = v.predictions[closure].section
    rows = v.section_rows(closure)
    rows = rows.assign(cell=rows.apply(_cell, axis="columns"))
    cells = rows.pivot(index="impact", columns=["moment", "quantity"], values="cell")
    columns: dict[str, Any] = {
        "impact": map(str, section.index),
        "agreement": map("{:.3f}".format, v.run.agreement[closure][section.index]),
    }
    # the table files hold the other moments
    shown = {"tau": "τ"} | {f"y{i}": f"y{i}" for i in v.meshes}
    for (moment, letter), (quantity, symbol) in product(MOMENT_HEADS.items(), shown.items()):
        moments = cells[moment, quantity].reindex(section.index)
        columns[f"{letter} {symbol}"] = moments.to_numpy()
    for stage in v.meshes:
        columns[f"ρ{stage}"] = [
            NO_VALUE if pd.isna(rho) else f"{rho:.3f}" for rho in section[f"rho{stage}"]
        ]
    columns["realizable"] = np.where(section["realizable"], "yes", "no")
    return Table.whole(pd.DataFrame(columns), texts=["realizable"])


def find_failures(v: Comparison) -> pd.DataFrame:
    """First failure of each check of realizability; mixtures (branching) have no moments of a
    perturbation to check."""
    failures = first_failures(
        realizability_table([m for m in v.predictions.values() if m.trace.parts is None])
    )
    names = {0: "all stages"} | {i: f"stage {wheel_label(v.scene, i)}" for i in v.meshes}
    stages = failures["stage"].map(names)
    return failures.assign(where="impact " + failures["impact"].astype(str) + ", " + stages)


def find_distances(v: Comparison) -> pd.DataFrame:
    """Distances between predicted section density and histogram by closure, over that of a sample
    of the true one."""
    table = pd.concat(
        [section_distances(m, v.run) for m in v.predictions.values()], ignore_index=True
    )
    ratios = pd.DataFrame(
        {name: table[name] / table[f"{name}_floor"] for name in ("kolmogorov", "total_variation")}
    )
    distances = ratios.groupby(table["closure"], sort=False).agg(["median", "max"])
    return distances.set_axis(distances.columns.map(" ".join), axis="columns").reset_index()


def find_reach(v: Comparison) -> pd.DataFrame:
    """Range of validity of each closure of a validation, its cause, and which paths the closure
    describes."""
    reach = find_validities([v])
    return reach.assign(
        describes=[DESCRIBES[v.predictions[name].method.describes] for name in reach["closure"]]
    )


def list_leaving(v: Comparison) -> pd.DataFrame:
    """How paths leave the noise-free itinerary, by what they strike instead."""
    leaving = v.run.leaving
    return leaving.assign(
        label=leaving["mesh"].map(partial(wheel_label, v.scene)),
        known=np.where(
            leaving["near"].astype(bool), "paths drawn near the branch", "this simulation"
        ),
    )


def merge_sigmas(table: pd.DataFrame) -> pd.DataFrame:
    """Range of validity of each closure; neighbouring noise intensities with the same range and
    cause are one row."""
    rows = []
    for closure, group in table.groupby("closure", sort=False):
        group = group.sort_values("sigma")
        ranges = group[["accurate", "not_inaccurate", "cause"]]
        for _, same in group.groupby((ranges != ranges.shift()).any(axis=1).cumsum()):
            first = same.iloc[0]
            last = same.iloc[-1]
            sigma = f"{first['sigma']:.4g}" + (f" – {last['sigma']:.4g}" if len(same) > 1 else "")
            why = first["why"] if same["why"].nunique() == 1 else CAUSES[first["cause"]]
            rows.append(
                {
                    "closure": closure,
                    "sigma": sigma,
                    **first[["accurate", "not_inaccurate"]],
                    "why": why,
                }
            )
    return pd.DataFrame(rows)


def speed_rows(table: pd.DataFrame) -> pd.DataFrame:
    """Speed-up of each closure against a simulation of equal accuracy, in words where it is a bound
    or not known.

    Where the interval of the worst error contains zero, the error is an upper and the speed-up a
    lower bound.  The time of a closure of one's own is measured, that of the simulation counted:
    they are not compared.
    """
    rows = table.sort_values(["closure", "sigma"])
    speeds = list(rows[["speed_up", "resolved", "closure_seconds"]].itertuples(index=False))
    return rows.assign(
        most=np.where(rows["resolved"], "", "≤ "),
        own=[
            f"{1e3 * seconds:.2f} ms{', measured' * math.isnan(gain)}"
            for gain, _, seconds in speeds
        ],
        simulated=1e3 * rows["simulation_seconds"],
        gain=[
            "–" if math.isnan(g) else f"{'≥ ' * (not sure)}{float(f'{g:.2g}'):g}"
            for g, sure, _ in speeds
        ],
    )


def simulation_text(v: Comparison) -> str:
    """The simulation behind a validation in words: paths, scheme, step, sampling error,
    diagnostics."""
    run = v.run
    section = run.section
    varies = v.scene.sigma > 0
    return " ".join(
        render_sentences(
            "validation/simulation.j2",
            run=run,
            z=v.z,
            share=(section["se_tau"] / section["sd_tau"]).median() if varies else 0.0,
            bias_measured="fine_coarse" in run.result.sums,
            searched=not v.scene.correlation_time,
        )
    )


def motion_table(v: Comparison) -> Table:
    """The simulated section means and sds in both systems of units."""
    plain = v.run.section
    physical = v.run.section_in("physical")
    speeds = [f"y{i}" for i in v.meshes]
    columns: dict[str, Any] = {"impact": map(str, plain.index), "τ": _spreads(plain, "tau")}
    columns |= {name: _spreads(plain, name) for name in speeds}
    columns |= {"time [ms]": _spreads(physical, "tau_ms")}
    columns |= {f"{name} [mm/s]": _spreads(physical, f"{name}_mm_per_s") for name in speeds}
    if "energy_mJ" in physical:
        columns["energy [mJ]"] = map("{:.3g}".format, physical["energy_mJ"])
    return Table.whole(pd.DataFrame(columns))


def time_table(v: Comparison) -> Table:
    """The simulated means and sds at fixed times in both systems of units."""
    plain = v.run.at_times()
    physical = v.run.at_times(units="physical")
    state = state_names(v.scene.stages)
    columns: dict[str, Any] = {"τ": map("{:.4g}".format, plain.index)}
    columns |= {name: _spreads(plain, name, f"cov_{name}_{name}") for name in state}
    columns["time [ms]"] = map("{:.4g}".format, physical.index)
    for name in state:
        unit = "mm" if name.startswith("x") else "mm_per_s"
        variance = f"cov_{name}_{name}_{PRODUCTS[unit, unit]}"
        columns[f"{name} [{unit.replace('_per_', '/')}]"] = _spreads(
            physical, f"{name}_{unit}", variance
        )
    return Table.whole(pd.DataFrame(columns))


def duration_words(v: Comparison) -> str:
    """How long the simulated motion is, for the advice.

    Returns: As "the first 24 ms"; empty for a scene that was not made from gears, or if no path had
    all impacts.
    """
    time = _milliseconds(v)
    return "" if math.isnan(time) else f"the first {time:.3g} ms"


def motion_sentence(validations: Sequence[Comparison]) -> list[str]:
    """The motion of gears in physical units, in a sentence."""
    motions = []
    for v in validations:
        time = _milliseconds(v)
        if not math.isnan(time):
            physical = v.run.section_in("physical")
            speeds = physical.filter(regex=r"^y\d+_mm_per_s$").abs()
            lost = physical["energy_mJ"].mean() if "energy_mJ" in physical else None
            motions.append((v.scene.sigma, len(v.run.section), time, np.nanmax(speeds), lost))
    return render_sentences("validation/motion.j2", motions=motions)


def _milliseconds(v: Comparison) -> float:
    """Mean time from the start to the last impact; NaN without gears or without a path that had
    it."""
    if v.scene.gears is None:
        return math.nan
    local = v.run.phase_reduced.section["tau"].iloc[-1] - v.scene.phase
    return float(local * v.scene.gears.units.time)


def _spreads(table: pd.DataFrame, name: str, variance: str = "") -> list[str]:
    """A quantity of each row as mean ± sd; the sd from the column of its variance, if one is
    named."""
    sds = table[variance].map(math.sqrt) if variance else table[f"sd_{name}"]
    return [
        "–" if pd.isna(mean) else f"{mean:.4g} ± {float(f'{sd:.2g}'):g}"
        for mean, sd in zip(table[name], sds, strict=True)
    ]
