"""The folder of a trade-off: its answer in words, its figure, its tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.report.save import contents, save
from rattle.compare.tradeoff.figures import order_figure, tradeoff_figure
from rattle.compare.tradeoff.measure import HAND_TUNED_NS, Measured, means_seconds, slope
from rattle.compare.tradeoff.page import EXACT, seconds, tradeoff_page
from rattle.compare.tradeoff.weak_order import Orders
from rattle.compare.validation.answer import SECTION, left_out

__all__ = ["CONTENTS", "answer", "verdict", "write_tradeoff"]

CONTENTS = contents(
    "tradeoff", figures=["tradeoff", "orders"], tables=["tradeoff", "levels", "control", "orders", "changes"]
)
"""Names of all files in a trade-off folder; a folder with any other file is not overwritten."""

PLAIN = "euler-maruyama"


def _cheapest(points: pd.DataFrame, accuracy: float) -> dict[str, Any]:
    """The cheapest method for an accuracy: of the schemes, and of the closures that predict all moments so well."""
    scheme = (points["kind"] == "scheme") & (points["accuracy"] == accuracy) & ~points["missed"]
    prediction = (
        (points["kind"] == "closure") & (points["error"] <= accuracy) & (points["rows"] == points["rows"].max())
    )
    best: dict[str, Any] = points[scheme | prediction].nsmallest(1, "core_seconds").to_dict("records")[0]
    return best


def answer(m: Measured, accuracies: Sequence[float]) -> list[str]:
    """Which method is cheapest for which accuracy, where a closure is cheapest, and the cost of plain Euler-Maruyama.

    Parameters
    ----------
    m : Measured
        What was measured.
    accuracies : sequence of float
        From the roughest to the finest.

    Returns
    -------
    list of str
        Sentences; the last one is `verdict`.
    """
    p = m.points
    whole = p["rows"].max()
    parts = []
    for accuracy in accuracies:
        best = _cheapest(p, accuracy)
        how = "" if best["measured"] else ", extrapolated"
        parts.append(f"{accuracy:g}: `{best['method']}` ({seconds(best['core_seconds'])}{how})")
    found = [
        f"The cheapest method for all section means and sds{SECTION} within a share of the sd — {'; '.join(parts)}."
    ]
    predictions = p[p["kind"] == "closure"]
    wins = []
    for _, row in predictions[predictions["rows"] == whole].iterrows():
        simulated = m.models[EXACT].at(row["error"]).core_seconds
        if simulated > row["core_seconds"] and row["error"] <= 1.0:
            wins.append(
                f"`{row['method']}`, whose worst error is {'' if row['resolved'] else 'below '}{row['error']:.2g} "
                f"(median {row['median_error']:.2g}) after {seconds(row['core_seconds'])}: exact flights take "
                f"{float(format(simulated / row['core_seconds'], '.2g')):g} times as long to its worst error"
            )
    found.append(
        f"A closure is the cheapest method for any accuracy no finer than its own worst error: {'; '.join(wins)}."
        if wins
        else "No closure that predicts all of them is shown to be cheaper than a simulation as accurate as its worst "
        "error."
    )
    finest = accuracies[-1]
    plain, exact = m.models[PLAIN], m.models[EXACT].path_alone(finest)
    found.append(
        f"To {finest:g}, plain Euler-Maruyama would need dt = {plain.at(finest).dt:.2g}: at "
        f"{1e9 * plain.step_seconds:.2g} ns per path-step the same number of paths takes "
        f"{plain.path_alone(finest) / exact:,.0f} times the processor time of exact flights "
        f"({seconds(m.models[EXACT].at(finest).core_seconds)}), and "
        f"{plain.path_alone(finest, HAND_TUNED_NS) / exact:,.0f} times at the {HAND_TUNED_NS:g} ns of hand-tuned "
        "numba code."
    )
    return [*found, *left_out(m.reference.scene, list(predictions["method"])), verdict(m, accuracies)]


def verdict(m: Measured, accuracies: Sequence[float]) -> str:
    """Whether multilevel Monte Carlo over the step is anywhere cheaper than exact flights, for the section means.

    Parameters
    ----------
    m : Measured
        What was measured.
    accuracies : sequence of float
        From the roughest to the finest.

    Returns
    -------
    str
    """
    exact, factors, typical = m.models[EXACT], [], []
    for a in accuracies:
        estimates = [levels.estimate(a) for levels in m.levels.values()]
        factors.append(min(e.seconds for e in estimates) / means_seconds(exact, a, control=True))
        typical.append(min(e.typical for e in estimates) / means_seconds(exact, a, control=True, typical=True))
    wins = [f"{a:g} ({1.0 / f:.2g} times)" for a, f in zip(accuracies, factors, strict=True) if f < 1.0]
    found = (
        f"Multilevel Monte Carlo over the step is cheaper than exact flights for the section means at {', '.join(wins)}"
        if wins
        else "Multilevel Monte Carlo over the step is never cheaper than exact flights for all section means"
    )
    return (
        f"{found}: from {accuracies[0]:g} to {accuracies[-1]:g} the better of both Euler schemes takes "
        f"{factors[0]:.2g} to {factors[-1]:.2g} times as long as exact flights. For a typical mean alone it takes "
        f"{typical[0]:.2g} to {typical[-1]:.2g} times as long."
    )


def write_tradeoff(
    out: Path, m: Measured, control: pd.DataFrame, orders: Orders | None, accuracies: Sequence[float],
    record: dict[str, Any], overwrite: bool,
) -> list[str]:  # fmt: skip
    """Write the folder of a trade-off, whole or not at all.

    Parameters
    ----------
    out : Path
        The folder.
    m : Measured
        What was measured.
    control : DataFrame
        From `rattle.compare.tradeoff.variance_reduction.control_table`.
    orders : Orders or None
        From `rattle.compare.tradeoff.weak_order.weak_orders`, if measured.
    accuracies : sequence of float
        From the roughest to the finest.
    record : dict
        Of the manifest: at least ``name, scene, budget, command, commit, versions``.
    overwrite : bool
        Whether earlier results may be replaced.

    Returns
    -------
    list of str
        The answer.

    Raises
    ------
    OutputError
        If the folder holds other files, or earlier results that may not be replaced.
    """
    sentences = answer(m, accuracies)
    means = pd.DataFrame({
        "error": accuracies, "core_seconds": [means_seconds(m.models[EXACT], a, control=True) for a in accuracies],
    })  # fmt: skip
    slopes = {name: slope(m.points, name, False)[0] for name in m.models}
    figures = {"tradeoff": tradeoff_figure(m.points, slopes, means)}
    levels = pd.concat([levels.table for levels in m.levels.values()])
    tables = {"tradeoff": m.points, "levels": levels, "control": control}
    if orders:
        figures["orders"] = order_figure(orders.changes)
        tables |= {"orders": orders.table, "changes": orders.changes}
    page = tradeoff_page(m, control, orders, accuracies, sentences, record)
    save(out, "tradeoff", page, record, allowed=CONTENTS, figures=figures, tables=tables, overwrite=overwrite)
    return sentences
