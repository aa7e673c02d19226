"""The simulated motion of a gear pair in physical units, beside the dimensionless ones: ms, mm, mm/s and mJ."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from rattle.compare.report import Block, Table, Text, numbers
from rattle.compare.validation.comparison import Comparison
from rattle.scene.moments import STATE
from rattle.scene.units import PRODUCTS, RATE

NOTE = (
    "The simulated motion, mean ± sd over the paths: each path just before its own k-th impact. For these gears 1 of τ "
    "is {time:.4g} ms, of x {length:.4g} mm, of y {speed:.4g} mm/s. The energy is the mean loss at the impact."
)
FIXED = "The simulated motion between the impacts: mean ± sd of all paths at one time"


def motion_blocks(v: Comparison) -> list[Block]:
    """The motion of a validation's gears in both systems of units, as blocks of a page."""
    if v.scene.gears is None:
        return []
    blocks: list[Block] = [Text(NOTE.format(**v.scene.gears.units._asdict()), note=True), motion_table(v)]
    return [*blocks, time_table(v)] if len(v.run.at_times()) else blocks


def motion_table(v: Comparison) -> Table:
    """The simulated section means and sds in both systems of units."""
    plain, physical = v.run.section, v.run.section_in("physical")
    speeds = [f"y{i}" for i in range(1, v.scene.stages + 1)]
    columns = {
        "impact": [str(impact) for impact in plain.index],
        "τ": _spreads(plain, "tau"),
        **{name: _spreads(plain, name) for name in speeds},
        "time [ms]": _spreads(physical, "tau_ms"),
        "impacts per second": [f"{rate:.4g}" for rate in physical[RATE]],
        **{f"{name} [mm/s]": _spreads(physical, f"{name}_mm_per_s") for name in speeds},
    }
    if "energy_mJ" in physical:
        columns["energy [mJ]"] = [f"{energy:.3g}" for energy in physical["energy_mJ"]]
    return Table.of(numbers(*columns), zip(*columns.values(), strict=True))


def time_table(v: Comparison) -> Table:
    """The simulated means and sds at fixed times in both systems of units."""
    plain, physical = v.run.at_times(), v.run.at_times(units="physical")
    columns = {"τ": [f"{time:.4g}" for time in plain.index]}
    columns |= {name: _spreads(plain, name, f"cov_{name}_{name}") for name in STATE[: 2 * v.scene.stages]}
    columns["time [ms]"] = [f"{time:.4g}" for time in physical.index]
    for name in STATE[: 2 * v.scene.stages]:
        unit = "mm" if name.startswith("x") else "mm_per_s"
        variance = f"cov_{name}_{name}_{PRODUCTS[unit, unit]}"
        columns[f"{name} [{unit.replace('_per_', '/')}]"] = _spreads(physical, f"{name}_{unit}", variance)
    return Table.of(numbers(*columns), zip(*columns.values(), strict=True), FIXED)


def duration_words(v: Comparison) -> str:
    """How long the simulated motion is, for the advice.

    Returns: As "24 ms of rattling"; empty for a scene that was not made from gears, or if no path had all
    impacts.
    """
    time = _milliseconds(v)
    return "" if math.isnan(time) else f"{time:.3g} ms of rattling"


def motion_sentence(validations: Sequence[Comparison]) -> list[str]:
    """The motion of gears in physical units, in a sentence."""
    shown = [v for v in validations if not math.isnan(_milliseconds(v))]
    return [f"In the units of these gears: {'; '.join(map(_in_words, shown))}."] if shown else []


def _in_words(v: Comparison) -> str:
    physical, impacts, time = v.run.section_in("physical"), len(v.run.section), _milliseconds(v)
    speeds = physical[[f"y{i}_mm_per_s" for i in range(1, v.scene.stages + 1)]].abs()
    lost = f" and a mean loss of {physical['energy_mJ'].mean():.2g} mJ per impact" if "energy_mJ" in physical else ""
    return (
        f"at σ = {v.scene.sigma:.4g}, {impacts} impacts take {time:.3g} ms on average ({1e3 * impacts / time:.3g} "
        f"impacts per second), with mean velocities before an impact of up to {np.nanmax(speeds):.3g} mm/s{lost}"
    )


def _milliseconds(v: Comparison) -> float:
    """Mean time from the start to the last impact; NaN without gears or without a path that had it."""
    if v.scene.gears is None:
        return math.nan
    local = v.run.phase_reduced.section["tau"].iloc[-1] - v.scene.phase
    return float(local * v.scene.gears.units.time)


def _spreads(table: pd.DataFrame, name: str, variance: str = "") -> list[str]:
    """A quantity of each row as mean ± sd; the sd from the column of its variance, if one is named."""
    sds = table[variance].map(math.sqrt) if variance else table[f"sd_{name}"]
    return [
        "–" if pd.isna(mean) else f"{mean:.4g} ± {float(f'{sd:.2g}'):g}"
        for mean, sd in zip(table[name], sds, strict=True)
    ]
