"""What boundaries, maps and sensitivities say, in sentences."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.parameters.search import ACCURATE, UNDECIDED, WRONG, Edge
from rattle.compare.study.parameters import PERCENT, Parameter, find_parameters
from rattle.scene.scene import Scene

WORDS = {
    "rate_above": "the number of impacts per second{}",
    "rate": "the number of all impacts per second{}",
    "power": "the energy lost per second{}",
    "speed_above": "the mean speed of impacts{}",
    "rms_speed_above": "the rms speed of impacts{}",
    "q95_speed_above": "the 95 % quantile of impact speeds{}",
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
    return said or ["Nothing that was changed has an effect that can be stated."]


def _effect_words(parameter: Parameter, row: Mapping[Any, Any]) -> str:
    half = 50.0 * (row["high"] - row["low"])
    does = "takes {} % off it" if row["effect"] < 0.0 else "adds {} %"
    digits = int(np.clip(1 - np.floor(np.log10(max(half, 1e-3))), 1, 3))
    amount = f"{abs(100.0 * row['effect']):.{digits}f} ± {half:.{digits}f}"
    bent = "" if row["linear"] else " (not linear here)"
    now = value_text(parameter.value, parameter.unit)
    return f"{parameter.words} (now {now}): {PERCENT} more {does.format(amount)}{bent}"


def value_text(value: Any, unit: Any) -> str:
    """A value with its unit."""
    return f"{float(f'{value:.3g}'):,g} {unit}".rstrip()


def boundary_sentences(
    closure: str, over: str, unit: str, edges: Sequence[Edge], table: pd.DataFrame, path_steps: int
) -> list[str]:
    """The edges of the range of validity in words, and what stays undecided."""
    unit = f" {unit}" if unit else ""
    low, high = (f"{value:.4g}" for value in (table["value"].min(), table["value"].max()))
    said = []
    for edge in edges:
        way = "up to" if edge.accurate < edge.wrong else "down to"
        said.append(
            f"`{closure}` is accurate {way} {over} = {edge.accurate:.4g}{unit} and shown wrong at "
            f"{edge.wrong:.4g} ({edge.why})."
        )
    if len(edges) > 1:
        said.append("Its range of validity is not one interval.")
    if not edges:
        verdicts = set(table["verdict"])
        if verdicts == {ACCURATE}:
            said.append(f"`{closure}` is accurate from {over} = {low} to {high}{unit}: no boundary in there.")
            said.append(_side(over, unit, table, accurate=True))
        elif verdicts == {WRONG}:
            said.append(f"`{closure}` is nowhere accurate from {over} = {low} to {high}{unit}.")
            said.append(_side(over, unit, table, accurate=False))
        else:
            best = table[table["verdict"] != UNDECIDED]
            also = f"; it is {best['verdict'].iloc[0]} at {_list(best['value'])}{unit}" if len(best) else ""
            said.append(f"No boundary of `{closure}` was decided from {over} = {low} to {high}{unit}{also}.")
    doubt = table[table["verdict"] == UNDECIDED]
    if len(doubt):
        why = ", ".join(dict.fromkeys(doubt["remark"]))
        said.append(f"Undecided at {over} = {_list(doubt['value'])}{unit}: {why}.")
    said.append(f"{len(table)} values were judged, with {path_steps:.3g} path-steps.")
    return said


def _side(over: str, unit: str, table: pd.DataFrame, accurate: bool) -> str:
    """On which side of the range to look for a boundary that is not in it."""
    first, last = table.iloc[0], table.iloc[-1]
    grows, falls = last["low"] > first["high"], first["low"] > last["high"]
    if not falls and over == "sigma":
        grows = True  # where the intervals do not tell it: more noise never helps
    if not grows and not falls:
        return f"If there is one, it lies below {first['value']:.4g} or above {last['value']:.4g}{unit}."
    above = grows == accurate
    return f"If there is one, it lies {'above' if above else 'below'} {(last if above else first)['value']:.4g}{unit}."


def map_sentences(
    names: tuple[str, str, str, tuple[str, str]], curve: pd.DataFrame, points: pd.DataFrame, path_steps: int
) -> list[str]:
    """The curve of a map in words: its extremes, where it has no edge or several, and what it cost."""
    closure, over, along, units = names
    first, second = (f" {unit}" if unit else "" for unit in units)
    edges = curve[curve["accurate"].notna() & curve["wrong"].notna()]
    said = []
    if len(edges):
        up = edges["accurate"] < edges["wrong"]
        way = "up to" if up.all() else "down to"
        ordered = edges.sort_values("accurate").to_dict("records")
        low, high = (f"{row['accurate']:.4g}{first}" for row in (ordered[0], ordered[-1]))
        least, most = (f"{row['along']:.4g}{second}" for row in (ordered[0], ordered[-1]))
        if low == high:
            said.append(f"`{closure}` is accurate {way} {over} = {low} at every value of {along} with an edge.")
        elif up.all() or not up.any():
            said.append(
                f"`{closure}` is accurate {way} {over} = {low} at {along} = {least}, which is the least, and {way} "
                f"{high} at {most}, the most."
            )
        else:
            said.append(
                f"The edges of where `{closure}` is accurate lie between {over} = {low} (at {along} = {least}) and "
                f"{high} (at {most})."
            )
    several = edges["along"][edges["along"].duplicated()].unique()
    if len(several):
        said.append(f"Its range of validity is not one interval at {along} = {_list(several)}{second}.")
    for why, rows in curve.drop(edges.index).groupby("why", sort=False):
        said.append(f"At {along} = {_list(rows['along'])}{second}: {why}.")
    said.append(
        f"{len(points)} values of {over} were judged at {curve['along'].nunique()} values of {along}, with "
        f"{path_steps:.3g} path-steps; all that is said holds together with 95 % probability."
    )
    return said


def _list(values: Any) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
