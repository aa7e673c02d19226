"""The answer of a long run in a few sentences."""

import math

import pandas as pd

from rattle.compare.stationary.measure import LEAST_EFFECTIVE, Stationary
from rattle.compare.stationary.units import speed_text

MAIN = ("rate_above", "speed_above", "energy_per_period")
NAMED = 4  # quantities with few effective paths that are named
CHATTER = 0.5  # share of slow impacts from which on they are called chatter, although no mesh closes
FEW = 0.5  # ratio of standard errors, from paths and from batches, from which both disagree


def answer(found: Stationary) -> list[str]:
    """Summarise a long run in sentences."""
    units = "dimensionless" if found.scene.gears is None else "physical"
    table = found.table_in(units)
    said = [*_impacts(found, table, units), found.said]
    run = found.run
    if run is None:
        return said
    said.append(run.burn_in.sentence)
    if run.reach is not None:
        said.append(run.reach.sentence)
    said += [_memory(found.table), *_few(found), *_compare_errors(found.table), *verdict_lines(found)]
    return said


def _show(table: pd.DataFrame, name: str) -> str:
    row = table.loc[name].to_dict()
    half = 0.5 * (row["high"] - row["low"])
    value = float(row["value"])
    exact = _number(value, 5) if half == 0.0 else f"{_number(value, 4)} ± {_number(half, 1)}"
    return f"{exact} {row['unit']!s}".rstrip()


def _number(value: float, digits: int) -> str:
    """A number to some digits, without an exponent where it is not needed."""
    return f"{float(f'{value:.{digits}g}'):,.6g}"


def _impacts(found: Stationary, table: pd.DataFrame, units: str) -> list[str]:
    """The impacts that are not slow, and the others, in a sentence each."""
    value = {str(name): float(v) for name, v in table["value"].items()}
    if value["rate"] == 0.0:
        return ["There are no impacts in the long run: the motion comes to rest for good."]
    second = " a second" if units == "physical" else " per unit of dimensionless time"
    least = speed_text(found.slow, found.scene.gears, units)
    lost = f"all impacts lose {_show(table, 'energy_per_period')} a period"
    lost += f", {_show(table, 'power')}" if units == "physical" else ""
    if value["rate_above"] == 0.0:
        said = f"In the long run no impact is faster than {least}; {lost}."
    else:
        speeds = f"half of them faster than {value['q50_speed_above']:.3g}, one in twenty faster than "
        speeds += f"{value['q95_speed_above']:.3g} {table.loc['speed_above', 'unit']!s}".rstrip()
        rate = _show(table, "rate_above").removesuffix(" 1/s")
        said = (
            f"In the long run there are {rate} impacts{second} faster than {least}, {speeds} (mean "
            f"{_show(table, 'speed_above')}); {lost}."
        )
    return [said, *_slow(found, value, second)]


def _slow(found: Stationary, value: dict[str, float], second: str) -> list[str]:
    """The slow impacts: chatter where they are most of all, or end with closed teeth."""
    share, slower = value["slow_share"], value["rate"] - value["rate_above"]
    if not share > 0.0:
        return []
    each = f"{_number(slower, 3)} slower impacts{second}, {share:.2%} of all"
    closed = [(m, value[f"contact_share_mesh{m}"]) for m in range(1, found.scene.stages + 1)]
    named = " and ".join(f"mesh {m} for {part:.2g} %" for m, part in ((m, 100.0 * s) for m, s in closed) if part > 0.0)
    if named:
        return [
            f"The others are chatter: {each}, in which teeth bounce ever more weakly until they stay closed ({named} "
            "of the time). Such chatter has infinitely many impacts, followed until they are too small to matter: "
            "`rate`, and means and quantiles over all impacts, depend on where that is."
        ]
    if share > CHATTER:
        return [f"The others are chatter that closes no mesh: {each}."]
    return [f"There are {each}."]


def _memory(table: pd.DataFrame) -> str:
    """Autocorrelations that matter."""
    own = table["autocorrelation"].dropna()
    own = own[[name for name in own.index if not name.startswith(("contact", "skew_"))]]
    own = own[own > 0.0]  # 0 where all paths have the same
    if own.empty:
        return "All paths have the same sums: there is no sampling error."
    high, low = str(own.idxmax()), str(own.idxmin())
    most, least = float(own.max()), float(own.min())
    return (
        f"Autocorrelation times range from {least:.2g} impacts (`{low}`) to {most:.3g} (`{high}`): errors computed as "
        f"if impacts were independent would be {_number(least**-0.5, 2)} times too large and {_number(most**0.5, 2)} "
        "times too small."
    )


def _few(found: Stationary) -> list[str]:
    """Where errors rest on few paths, as where bursts of slow impacts are rare; how many periods would fix it."""
    few, run = found.few.sort_values(), found.run
    if few.empty or run is None:
        return []
    names = [f"`{name}`" for name in few.index[:NAMED]]
    others = f" and {few.size - NAMED} more" if few.size > NAMED else ""
    periods = math.ceil(run.periods * (LEAST_EFFECTIVE / float(few.iloc[0]) - 1.0))
    return [
        f"The standard error of {names[0]} rests on about {few.iloc[0]:.0f} of {run.paths} paths, which differ most "
        f"from the others: intervals of {', '.join(names)}{others} are wider for that reason. About "
        f"{_number(periods, 1)} more periods would fix this."
    ]


def _compare_errors(table: pd.DataFrame) -> list[str]:
    """Standard errors from paths against those from batch means."""
    both = table[(table["se"] > 0.0) & table["se_batches"].notna()]
    if both.empty:
        return []
    ratio = both["se_batches"] / both["se"]
    said = f"Standard errors from batch means are {ratio.min():.2f} to {ratio.max():.2f} times those between paths"
    if ratio.min() < FEW:
        return [
            f"{said}: paths differ more than batches of one path do, so some correlations last longer than a batch."
        ]
    return [f"{said}."]


def verdict_lines(found: Stationary) -> list[str]:
    """What each closure says of the long run, and whether it is right."""
    said = []
    verdicts = found.verdicts_in("dimensionless" if found.scene.gears is None else "physical")
    for closure, rows in verdicts.groupby("closure", sort=False) if len(verdicts) else ():
        if rows["reason"].iloc[0]:
            said.append(f"`{closure}` ({rows['kind'].iloc[0]}): not predicted, {rows['reason'].iloc[0]}.")
            continue
        n = rows["verdict"].value_counts()
        main = rows.set_index("quantity").loc[list(MAIN)]
        each = ", ".join(
            f"{name} {row['predicted']:.4g} against {row['simulated']:.4g} {row['unit']}".rstrip()
            + f" ({row['verdict']})"
            for name, row in main.iterrows()
        )
        said.append(
            f"`{closure}` ({rows['kind'].iloc[0]}): {n.get('accurate', 0)} quantities accurate, "
            f"{n.get('inaccurate', 0)} inaccurate, {n.get('undecided', 0)} undecided; {each}."
        )
    return said
