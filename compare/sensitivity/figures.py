"""The sentences and the figure of a sensitivity."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.report.style import new_figure
from rattle.compare.study.parameters import CHANGE, Parameter, find_parameters
from rattle.scene.scene import Scene

LESS, MORE, BENT = "#0072B2", "#D55E00", "#999999"
WORDS = {
    "rate_above": "the number of impacts per second{}",
    "rate": "the number of all impacts per second{}",
    "power": "the energy lost per second{}",
    "speed_above": "the mean speed of impacts{}",
    "rms_speed_above": "the root of the mean square speed of impacts{}",
    "q95_speed_above": "the 95 % quantile of the speed of impacts{}",
    "contact_share": "the share of time in contact{}",
    "open_share": "the share of time with open teeth{}",
}


def quantity_words(quantity: str) -> str:
    """A quantity in words."""
    kind, _, mesh = quantity.partition("_mesh")
    return WORDS.get(kind, f"`{kind}`{{}}").format(f" at mesh {mesh}" if mesh else "")


def lever_sentences(scene: Scene, table: pd.DataFrame, values: pd.DataFrame) -> list[str]:
    """The strongest lever of each quantity, a sentence each, with what both are now."""
    known = find_parameters(scene)
    said = []
    for quantity, rows in table.groupby("quantity", sort=False):
        rows = rows[rows["effect"].notna()]
        if rows.empty:
            continue
        row = rows.to_dict("records")[int(rows["effect"].abs().argmax())]
        certain = row["low"] > 0.0 or row["high"] < 0.0
        if not certain:
            said.append(f"For {quantity_words(str(quantity))} no effect is larger than its error.")
            continue
        lever = _effect_words(known[row["parameter"]], row)
        now = value_text(values["value"][str(quantity)], values["unit"][str(quantity)])
        said.append(f"The strongest lever on {quantity_words(str(quantity))} (now {now}) is the {lever}.")
    return said


def _effect_words(parameter: Parameter, row: Mapping[Any, Any]) -> str:
    half = 50.0 * (row["high"] - row["low"])
    does = "takes {} % off it" if row["effect"] < 0.0 else "adds {} %"
    digits = int(np.clip(1 - np.floor(np.log10(max(half, 1e-3))), 1, 3))
    amount = f"{abs(100.0 * row['effect']):.{digits}f} ± {half:.{digits}f}"
    bent = "" if row["linear"] else " (not linear here)"
    now = value_text(parameter.value, parameter.unit)
    return f"{parameter.words} (now {now}): {CHANGE:.0%} more {does.format(amount)}{bent}"


def value_text(value: Any, unit: Any) -> str:
    """A value with its unit."""
    return f"{float(f'{value:.3g}'):,g} {unit}".rstrip()


def tornado(table: pd.DataFrame, quantities: list[str]) -> Figure:
    """Draw the effects on every quantity as bars, the strongest first."""
    columns = min(len(quantities), 2)
    rows = -(-len(quantities) // columns)
    most = table.groupby("quantity")["effect"].count().max()
    figure, axes = new_figure(4.6 * columns, rows * (0.9 + 0.2 * most), rows, columns)
    for ax, quantity in zip(axes, quantities, strict=False):
        own = table[(table["quantity"] == quantity) & table["effect"].notna()]
        own = own.loc[own["effect"].abs().sort_values().index]
        value, y = 100.0 * own["effect"].to_numpy(), np.arange(len(own))
        colours = np.where(~own["linear"].astype(bool), BENT, np.where(value < 0.0, LESS, MORE))
        errors = 100.0 * np.abs(own[["low", "high"]].to_numpy().T - own["effect"].to_numpy())
        ax.barh(y, value, color=list(colours), xerr=errors, error_kw={"elinewidth": 1.0, "capsize": 2.0})
        ax.set_yticks(y, own["parameter"])
        ax.axvline(0.0, color="0.3", lw=0.8)
        ax.set_title(quantity_words(quantity).removeprefix("the ").replace("`", ""), loc="left")
        ax.set_xlabel(f"change (%) for {CHANGE:.0%} more of the parameter")
    for ax in axes[len(quantities) :]:
        ax.remove()
    return figure
