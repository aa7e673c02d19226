"""What to take at the noise intensities that were asked for, and what it costs: two sentences.

Accuracy decides, and where a closure is accurate the counted work of both sides; no time that a clock measured.
"""

import pandas as pd

from rattle.compare.validation.validity_range import join_words
from rattle.scene.text import duration_text

ASKED = "1% of an sd"
"""The accuracy for which a simulation's cost is stated; see `rattle.compare.validation.speed.WANTED`."""


def advice(validity: pd.DataFrame, impacts: int, speed: pd.DataFrame) -> str:
    """What to take for a gear pair at each noise intensity that was asked for, in one sentence.

    Examples
    --------
    >>> rows = [("saltation", 0.01, 12, 12), ("saltation", 0.1, 3, 3)]
    >>> table = pd.DataFrame(rows, columns=["closure", "sigma", "accurate", "not_inaccurate"])
    >>> work = pd.DataFrame([("saltation", 0.01, 12, True, 1e-3, 900.0)],
    ...     columns=["closure", "sigma", "impacts", "resolved", "closure_seconds", "speed_up"])
    >>> print(advice(table, 12, work).replace("; ", ";\\n"))
    For this gear pair take `saltation` at σ = 0.01 (all means and sds at 12 impacts are accurate);
    simulate at σ = 0.1 (no closure is accurate at all 12 impacts, `saltation` at the first 3).
    """
    said = []
    for sigma, rows in validity.groupby("sigma", sort=False):
        own = speed[(speed["sigma"] == sigma) & (speed["impacts"] == impacts)].sort_values("closure_seconds")
        slower = own["resolved"] & (own["speed_up"] < 1.0)
        worth, dearer = ([f"`{c}`" for c in own[keep]["closure"]] for keep in (~slower, slower))
        if worth:
            said.append(f"take {worth[0]} at σ = {sigma:.4g} (all {_moments(impacts)} are accurate)")
        elif dearer:
            takes = "is accurate, but takes" if len(dearer) == 1 else "are accurate, but take"
            why = f"{join_words(dearer)} {takes} more work than an equally accurate simulation"
            said.append(f"simulate at σ = {sigma:.4g} ({why})")
        else:
            said.append(f"simulate at σ = {sigma:.4g} ({_none(rows, impacts)})")
    return f"For this gear pair {'; '.join(said)}."


def _none(rows: pd.DataFrame, impacts: int) -> str:
    """Why no closure is taken at a noise intensity; what is undecided must not be called wrong."""
    undecided = [f"`{c}`" for c in rows[rows["not_inaccurate"] == impacts]["closure"]]
    if undecided:
        verb = "is" if len(undecided) == 1 else "are"
        return f"{join_words(undecided)} {verb} undecided: more paths would settle it"
    if impacts == 1:
        return "no closure is accurate at the first impact"
    best = rows.sort_values("accurate", ascending=False, kind="stable").iloc[0]
    part = f", `{best['closure']}` at the first {best['accurate']}" if best["accurate"] > 0 else ""
    return f"no closure is accurate at all {impacts} impacts{part}"


def _moments(impacts: int) -> str:
    return f"means and sds at {impacts} impacts" if impacts > 1 else "means and sds at the first impact"


def cost_sentence(
    simulation: pd.DataFrame, speed: pd.DataFrame, impacts: int, duration: str = "", over: pd.DataFrame | None = None
) -> str:
    """What a simulation and the closures cost in counted work.

    `duration`: How long the motion is in physical units, as "24 ms of rattling", if that is known.
    """
    what = f"{impacts} impact{'s' if impacts > 1 else ''}{f' ({duration})' if duration else ''} to {ASKED}"
    each = [
        f"{duration_text(row['core_seconds'], 2)} at σ = {row['sigma']:.4g} ({_paths(row['paths'])})"
        for row in simulation.to_dict("records")
    ]
    whole = speed[speed["impacts"] == impacts].groupby("closure", sort=False)["closure_seconds"].max()
    closures = (
        join_words([f"`{name}` {duration_text(seconds, 2)}" for name, seconds in whole.items()]) if len(whole) else ""
    )
    said = f"Nominal time on one core, from counted work: a simulation of {what} takes {join_words(each)}"
    said += f"; {closures}" if closures else ""
    if over is not None:
        slower = over[over["resolved"] & (over["speed_up"] < 1.0) & (over["impacts"] == impacts)]
        for closure, rows in slower.groupby("closure", sort=False):
            at = join_words([f"{sigma:.4g}" for sigma in rows["sigma"]])
            said += f"; at σ = {at} an equally accurate simulation takes less than `{closure}`"
    return f"{said}."


def _paths(paths: float) -> str:
    number = f"{paths:,.0f}" if paths < 1e4 else f"{float(f'{paths:.2g}'):,.0f}" if paths < 1e12 else f"{paths:.2g}"
    return f"{number} path{'s' if paths > 1 else ''}"
