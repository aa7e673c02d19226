"""The answer of a long run in a few sentences."""

import math

import pandas as pd

from rattle.compare.stationary.measure import LEAST_CARRIERS, Stationary

__all__ = ["answer", "verdict_lines"]

MAIN = ("rate", "speed", "energy_per_period")
NAMED = 4  # quantities with few carriers that are named
FEW = 0.5  # ratio of standard errors, from paths and from batches, from which both disagree


def answer(found: Stationary) -> list[str]:
    """Summarise a long run in sentences.

    Parameters
    ----------
    found : Stationary
        What was found.

    Returns
    -------
    list of str
    """
    units = "dimensionless" if found.scene.gears is None else "physical"
    table = found.table_in(units)
    said = [_first(table, units), found.said]
    run = found.run
    if run is None:
        return said
    said.append(run.burn_in.sentence)
    if run.reach is not None:
        said.append(run.reach.sentence)
    said += [_memory(found.table), *_carried_by_few(found), *_checked(found.table), *verdict_lines(found)]
    return said


def _shown(table: pd.DataFrame, name: str) -> str:
    row = table.loc[name]
    half = 0.5 * (row["high"] - row["low"])
    exact = f"{row['value']:.5g}" if half == 0.0 else f"{row['value']:.4g} ± {float(f'{half:.1g}'):g}"
    return f"{exact} {row['unit']!s}".rstrip()


def _first(table: pd.DataFrame, units: str) -> str:
    """The main quantities in one sentence."""
    if table.loc["rate", "value"] == 0.0:
        return "There are no impacts in the long run: the motion comes to rest for good."
    second = "a second" if units == "physical" else "per unit of dimensionless time"
    rate = _shown(table, "rate").removesuffix(" 1/s")
    said = f"In the long run there are {rate} impacts {second}, "
    said += f"at a mean speed of {_shown(table, 'speed')}; they lose {_shown(table, 'energy_per_period')} a period"
    if units == "physical":
        said += f", {_shown(table, 'power')}"
    slow = float(table["value"].to_dict()["slow_share"])
    return f"{said}. {slow:.2%} of the impacts are slow."


def _memory(table: pd.DataFrame) -> str:
    """Autocorrelations that matter."""
    own = table["autocorrelation"].dropna()
    own = own[[name for name in own.index if not name.startswith(("contact", "skew_"))]]
    own = own[own > 0.0]  # 0 where all paths have the same
    if own.empty:
        return "All paths have the same sums: nothing is left to chance."
    high, low = str(own.idxmax()), str(own.idxmin())
    most, least = float(own.max()), float(own.min())
    return (
        f"Autocorrelation times reach from {least:.2g} impacts (`{low}`) to {most:.3g} (`{high}`): errors computed as "
        f"if impacts were independent would be {least**-0.5:.2g} times too large and {most**0.5:.2g} times too small."
    )


def _carried_by_few(found: Stationary) -> list[str]:
    """Where few paths carry the errors, as where slow impacts come in rare bursts; what more would do."""
    few, run = found.few.sort_values(), found.run
    if few.empty or run is None:
        return []
    names = [f"`{name}`" for name in few.index[:NAMED]]
    others = f" and {few.size - NAMED} more" if few.size > NAMED else ""
    periods = math.ceil(run.periods * (LEAST_CARRIERS / float(few.iloc[0]) - 1.0))
    return [
        f"About {few.iloc[0]:.0f} of {run.paths} paths carry the error of {names[0]}, as where bursts are rare: "
        f"intervals of {', '.join(names)}{others} are wider for that, since their errors are badly known. "
        f"About {float(f'{periods:.1g}'):,.0f} more periods would mend it."
    ]


def _checked(table: pd.DataFrame) -> list[str]:
    """Standard errors from paths against those from batch means."""
    both = table[(table["se"] > 0.0) & table["se_batches"].notna()]
    if both.empty:
        return []
    ratio = both["se_batches"] / both["se"]
    said = f"Standard errors from batch means are {ratio.min():.2f} to {ratio.max():.2f} times those between paths"
    if ratio.min() < FEW:
        return [f"{said}: paths differ by more than their parts do, so that some of the memory is longer than a batch."]
    return [f"{said}."]


def verdict_lines(found: Stationary) -> list[str]:
    """What each closure says of the long run, and whether it is right.

    Parameters
    ----------
    found : Stationary
        What was found.

    Returns
    -------
    list of str
        A sentence for each closure.
    """
    said = []
    for closure, rows in found.verdicts.groupby("closure", sort=False) if len(found.verdicts) else ():
        if rows["reason"].iloc[0]:
            said.append(f"`{closure}` ({rows['kind'].iloc[0]}): not predicted, {rows['reason'].iloc[0]}.")
            continue
        n = rows["verdict"].value_counts()
        main = rows.set_index("quantity").loc[list(MAIN)]
        each = ", ".join(
            f"{name} {row['predicted']:.4g} against {row['simulated']:.4g} ({row['verdict']})"
            for name, row in main.iterrows()
        )
        said.append(
            f"`{closure}` ({rows['kind'].iloc[0]}): {n.get('accurate', 0)} quantities accurate, "
            f"{n.get('inaccurate', 0)} inaccurate, {n.get('undecided', 0)} undecided; {each}."
        )
    return said
