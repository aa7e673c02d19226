"""The simulated motion of a gear pair in physical units, beside the dimensionless ones: ms, mm, mm/s and mJ."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from rattle.compare.report import Block, Row, Table, Text, numbers
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
    return [*blocks, fixed_time_table(v)] if len(v.run.at_times()) else blocks


def motion_table(v: Comparison) -> Table:
    """The simulated section means and sds in both systems of units."""
    plain, physical = v.run.section, v.run.section_in("physical")
    speeds = [f"y{i}" for i in range(1, v.scene.stages + 1)]
    rows: list[Row] = []
    for k in plain.index:
        p, q = plain.loc[k], physical.loc[k]
        rows.append(
            [
                str(k),
                *(_spread(p[name], p[f"sd_{name}"]) for name in ("tau", *speeds)),
                _spread(q["tau_ms"], q["sd_tau_ms"]),
                f"{q[RATE]:.4g}",
                *(_spread(q[f"{name}_mm_per_s"], q[f"sd_{name}_mm_per_s"]) for name in speeds),
                *([f"{q['energy_mJ']:.3g}"] if "energy_mJ" in q else []),
            ]
        )
    energy = ["energy [mJ]"] if "energy_mJ" in physical else []
    heads = ["impact", "τ", *speeds, "time [ms]", "impacts per second", *(f"{name} [mm/s]" for name in speeds), *energy]
    return Table.of(numbers(*heads), rows)


def fixed_time_table(v: Comparison) -> Table:
    """The simulated means and sds at fixed times in both systems of units."""
    state = STATE[: 2 * v.scene.stages]
    plain, physical = v.run.at_times(), v.run.at_times(units="physical")
    units = {name: "mm" if name.startswith("x") else "mm_per_s" for name in state}
    rows: list[Row] = []
    for (time, p), (ms, q) in zip(plain.iterrows(), physical.iterrows(), strict=True):
        own = [_spread(p[name], math.sqrt(p[f"cov_{name}_{name}"])) for name in state]
        theirs = [
            _spread(q[f"{name}_{unit}"], math.sqrt(q[f"cov_{name}_{name}_{PRODUCTS[unit, unit]}"]))
            for name, unit in units.items()
        ]
        rows.append([f"{time:.4g}", *own, f"{ms:.4g}", *theirs])
    heads = ["τ", *state, "time [ms]", *(f"{name} [{unit.replace('_per_', '/')}]" for name, unit in units.items())]
    return Table.of(numbers(*heads), rows, FIXED)


def lasting(v: Comparison) -> str:
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


def _spread(mean: float, sd: float) -> str:
    return "–" if pd.isna(mean) else f"{mean:.4g} ± {float(f'{sd:.2g}'):g}"
