"""The answer of a trade-off in sentences, and the cheapest method for each accuracy."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import pandas as pd

from rattle.compare.tradeoff.measure import HAND_TUNED_NS, Tradeoff, means_seconds
from rattle.compare.validation.answer import explain_missing
from rattle.compare.validation.validity_range import join_words
from rattle.scene.text import duration_text

EXACT = "exact-flight"
PLAIN = "euler-maruyama"


def cheapest(points: pd.DataFrame, accuracy: float) -> dict[str, Any]:
    """The method of least counted work for an accuracy, of schemes and of closures that predict all moments so well."""
    scheme = (points["kind"] == "scheme") & (points["accuracy"] == accuracy) & ~points["missed"]
    prediction = (
        (points["kind"] == "closure") & (points["error"] <= accuracy) & (points["rows"] == points["rows"].max())
    )
    best: dict[str, Any] = points[scheme | prediction].nsmallest(1, "work").to_dict("records")[0]
    return best


def advice(m: Tradeoff, accuracies: Sequence[float]) -> str:
    """Which method to take down to which error, in one sentence."""
    parts = []
    for method, same in groupby([(a, cheapest(m.points, a)) for a in accuracies], key=lambda found: found[1]["method"]):
        finest, best = list(same)[-1]
        cost = duration_text(best["core_seconds"], 2) + ("" if best["measured"] else ", extrapolated")
        parts.append(f"`{method}` for errors down to {finest:g} of an sd ({cost})")
    scene, impacts = m.reference.scene, m.reference.impacts
    return (
        f"For all means and sds at {impacts} impacts of this gear pair at σ = {scene.sigma:.4g} "
        f"take {join_words(parts)}; "
        "times are those of one core, and what is cheapest is decided by counted work."
    )


def answer(m: Tradeoff, accuracies: Sequence[float]) -> list[str]:
    """What to take, where a closure is cheapest, and the cost of plain Euler-Maruyama."""
    p = m.points
    whole = p["rows"].max()
    found = [advice(m, accuracies)]
    predictions = p[p["kind"] == "closure"]
    wins = []
    for _, row in predictions[predictions["rows"] == whole].iterrows():
        simulated = m.models[EXACT].at(row["error"]).work
        if simulated > row["work"] and row["error"] <= 1.0:
            wins.append(
                f"`{row['method']}`, whose worst error is {'' if row['resolved'] else 'below '}{row['error']:.2g} "
                f"(median {row['median_error']:.2g}) after {duration_text(row['core_seconds'], 2)}: exact flights take "
                f"{float(format(simulated / row['work'], '.2g')):g} times the work for the same error"
            )
    found.append(
        f"A closure is the cheapest method for any accuracy no finer than its own worst error: {'; '.join(wins)}."
        if wins
        else "No closure that predicts all of them is shown to be cheaper than a simulation with the same worst error."
    )
    finest = accuracies[-1]
    plain, exact = m.models[PLAIN], m.models[EXACT].path_alone(finest)
    found.append(
        f"To {finest:g}, plain Euler-Maruyama would need dt = {plain.at(finest).dt:.2g}: at "
        f"{1e9 * plain.step_seconds:.2g} ns per path-step the same number of paths takes "
        f"{plain.path_alone(finest) / exact:,.0f} times the processor time of exact flights "
        f"({duration_text(m.models[EXACT].at(finest).core_seconds, 2)}), and "
        f"{plain.path_alone(finest, HAND_TUNED_NS) / exact:,.0f} times at the {HAND_TUNED_NS:g} ns of hand-tuned "
        "numba code."
    )
    return [*found, *explain_missing(m.reference.scene, list(predictions["method"])), verdict(m, accuracies)]


def verdict(m: Tradeoff, accuracies: Sequence[float]) -> str:
    """Whether multilevel Monte Carlo over the step is anywhere cheaper than exact flights, for the section means."""
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
