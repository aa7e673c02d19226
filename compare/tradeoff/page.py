"""The page of a trade-off: its answer in sentences, tables, and explanations of its tables and
figures."""

from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.report.report import Report
from rattle.compare.report.table import Table, TableCell, of_numbers
from rattle.compare.report.texts import (
    CLOSURE_TERMS,
    SCHEME_TERMS,
    SECTION_TERMS,
    glossary,
)
from rattle.compare.tradeoff.figures import order_figure, tradeoff_figure
from rattle.compare.tradeoff.measure import (
    HAND_TUNED_NS,
    Tradeoff,
    bound_of_means,
    means_seconds,
    slope,
)
from rattle.compare.tradeoff.multilevel import KURTOSIS_ALARM, Rate
from rattle.compare.tradeoff.weak_order import ORDER_IMPACTS, STEP_PAIRS
from rattle.compare.validation.answer import explain_missing
from rattle.compare.validation.verdict import join_words, span
from rattle.scene import duration_text

EXACT_FLIGHT = "exact-flight"
EULER_MARUYAMA = "euler-maruyama"


def cheapest(points: pd.DataFrame, accuracy: float) -> dict[str, Any]:
    """The method of least counted work for an accuracy, of schemes and of closures that predict all
    moments so well."""
    scheme = (points["kind"] == "scheme") & (points["accuracy"] == accuracy) & ~points["missed"]
    closure = (
        (points["kind"] == "closure")
        & (points["error"] <= accuracy)
        & (points["rows"] == points["rows"].max())
    )
    best: dict[str, Any] = points[scheme | closure].nsmallest(1, "work").to_dict("records")[0]
    return best


def advice(m: Tradeoff) -> str:
    """Which method to take down to which error, in one sentence."""
    parts = []
    for method, same in groupby(
        [(a, cheapest(m.points, a)) for a in m.accuracies], key=lambda found: found[1]["method"]
    ):
        finest, best = list(same)[-1]
        cost = duration_text(best["core_seconds"], 2) + (
            "" if best["measured"] else ", extrapolated"
        )
        parts.append(f"`{method}` for errors down to {finest:g} of an sd ({cost})")
    return (
        f"For all means and sds at {m.reference.impacts} impacts of this gear pair at σ ="
        f" {m.reference.scene.sigma:.4g} take {join_words(parts)}; times are those of one core, and"
        " what is cheapest is decided by counted work."
    )


def answer(m: Tradeoff) -> list[str]:
    """What to take, where a closure is cheapest, and the cost of plain Euler-Maruyama."""
    p = m.points
    exact = m.models[EXACT_FLIGHT]
    plain = m.models[EULER_MARUYAMA]
    finest = m.accuracies[-1]
    predictions = p[p["kind"] == "closure"]
    wins = []
    for row in predictions[predictions["rows"] == p["rows"].max()].to_dict("records"):
        simulated = exact.at(row["error"]).work
        if simulated > row["work"] and row["error"] <= m.accuracies[0]:
            below = "" if row["resolved"] else "below "
            after = duration_text(row["core_seconds"], 2)
            times = float(format(simulated / row["work"], ".2g"))
            wins.append(
                f"`{row['method']}`, whose worst error is {below}{row['error']:.2g} (median"
                f" {row['median_error']:.2g}) after {after}: exact flights take {times:g} times the"
                " work for the same error"
            )
    ratios = [
        plain.path_alone(finest, ns) / exact.path_alone(finest) for ns in (None, HAND_TUNED_NS)
    ]
    cost = duration_text(exact.at(finest).core_seconds, 2)
    needs = (
        f"To {finest:g}, plain Euler-Maruyama would need dt = {plain.at(finest).dt:.2g}: at"
        f" {1e9 * plain.step_seconds:.2g} ns per path-step the same number of paths takes"
        f" {ratios[0]:,.0f} times the processor time of exact flights ({cost}), and"
        f" {ratios[1]:,.0f} times at the {HAND_TUNED_NS:g} ns of hand-tuned numba code."
    )
    closures = (
        f"No closure that predicts all of them within {m.accuracies[0]:g} of an sd is shown to take"
        " less work than a simulation with the same worst error."
    )
    if wins:
        closures = (
            "At the accuracy of its own worst error a closure takes less work than a simulation:"
            f" {'; '.join(wins)}."
        )
    missing = explain_missing(m.reference.scene, list(predictions["method"]))
    return [advice(m), closures, needs, *missing, verdict(m)]


def verdict(m: Tradeoff) -> str:
    """Whether multilevel Monte Carlo over the step is anywhere cheaper than exact flights, for the
    section means."""
    exact = m.models[EXACT_FLIGHT]
    factors = []
    typical = []
    for a in m.accuracies:
        estimates = [levels.estimate(a) for levels in m.levels.values()]
        factors.append(min(e.seconds for e in estimates) / means_seconds(exact, a, control=True))
        typical.append(
            min(e.typical for e in estimates) / means_seconds(exact, a, control=True, typical=True)
        )
    wins = [
        f"{a:g} ({1.0 / f:.2g} times)"
        for a, f in zip(m.accuracies, factors, strict=True)
        if f < 1.0
    ]
    found = "is never cheaper than exact flights for all section means"
    if wins:
        found = f"is cheaper than exact flights for the section means at {', '.join(wins)}"
    return (
        f"Multilevel Monte Carlo over the step {found}: from {m.accuracies[0]:g} to"
        f" {m.accuracies[-1]:g} the better of both Euler schemes takes {factors[0]:.2g} to"
        f" {factors[-1]:.2g} times the counted work of exact flights. For a typical mean alone it"
        f" takes {typical[0]:.2g} to {typical[-1]:.2g} times theirs."
    )


TRADEOFF_WORDS = (*CLOSURE_TERMS, *SECTION_TERMS, *SCHEME_TERMS, "standard error", "σ")


def _parts(m: Tradeoff) -> dict[str, Any]:
    """The tables and words of the page, by name."""
    exact = m.models[EXACT_FLIGHT]
    p = m.points
    p = p.assign(
        found=np.select([p["missed"], p["measured"]], ["missed", "measured"], "extrapolated"),
        actual=["–" if np.isnan(error) else f"{error:.2g}" for error in p["actual_error"]],
        time=p["core_seconds"].map(
            lambda seconds: TableCell(duration_text(seconds, 2), value=seconds)
        ),
        below=np.where(p["resolved"], "", "below "),
        most=p["rows"].max(),
    )
    means: list[tuple[str, ...]] = []
    for a in m.accuracies:
        cells = [
            f"{e.seconds:.2g} ({e.typical:.2g})" for e in (x.estimate(a) for x in m.levels.values())
        ]
        cells += [f"{means_seconds(exact, a, control=control):.2g}" for control in (True, False)]
        means.append((f"{a:g}", *cells))
    how = "with control" if exact.best.plan.mixture is None else "with paths near rare branches"
    heads = [
        "standard error",
        *(f"multilevel {n}" for n in m.levels),
        f"{EXACT_FLIGHT} {how}",
        f"{EXACT_FLIGHT} without",
    ]
    rates = ("alpha", "beta", "typical_beta", "gamma")
    parts: dict[str, Any] = {
        "cheapest": pd.DataFrame([cheapest(p, a) | {"asked": a} for a in m.accuracies]),
        "points": p[p["kind"] == "scheme"],
        "slopes": pd.DataFrame(
            {
                "scheme": name,
                "ns": 1e9 * model.step_seconds,
                "all": _slope(p, name, False),
                "measured": _slope(p, name),
            }
            for name, model in m.models.items()
        ),
        "closures": p[p["kind"] == "closure"],
        "rates": pd.DataFrame(
            {"scheme": name}
            | {rate: _rate(getattr(x, rate), 1 if rate == "gamma" else -1) for rate in rates}
            for name, x in m.levels.items()
        ),
        "means": Table.of(map(of_numbers, heads), means),
    }
    if m.orders:
        table = m.orders.table
        parts |= {"orders_said": orders_said(table), "orders": format_orders(table)}
    if m.control.empty:
        return parts
    gains = {
        f"{of}_per_second": m.control[f"{of}_median"] / m.control["time_ratio"]
        for of in ("means", "sds")
    }
    return parts | {"control": m.control.assign(**gains)}


def _rate(rate: Rate, sign: float) -> str:
    return f"{sign * rate.slope:.2f} ± {rate.half:.2f}"


def _slope(points: pd.DataFrame, scheme: str, measured: bool = True) -> str:
    power, n = slope(points, scheme, measured)
    return f"{power:.2f} ({n} points)" if n > 1 else "–"


def format_orders(table: pd.DataFrame) -> pd.DataFrame:
    """The measured slopes, the orders on which they have settled, and whether each scheme's limit
    is correct."""
    rows = table[table["slope"].notna()]

    def between(value: str, low: str, high: str, none: str = "–") -> list[str]:
        found = zip(rows[value], rows[low], rows[high], strict=True)
        return [none if np.isnan(v) else f"{v:.2f} ({a:.2f} to {b:.2f})" for v, a, b in found]

    return rows.assign(
        kind=[
            f"{moment} {q}".strip()
            for moment, q in zip(rows["moment"], rows["quantity"], strict=True)
        ],
        whole=between("slope", "low", "high"),
        local=between("last", "last_low", "last_high"),
        settled=between("order", "order_low", "order_high", "not settled"),
    )


def orders_said(table: pd.DataFrame) -> list[str]:
    """Which slopes have settled on an order and which have not, a sentence for each scheme and
    noise intensity."""
    said = []
    for (sigma, scheme), rows in table[table["moment"] != "itinerary"].groupby(
        ["sigma", "scheme"], sort=False
    ):
        seen = rows[rows["slope"].notna()]
        settled = seen["order"].notna()
        parts = [
            f"{text} {'an order' if text == 'settled on' else 'at'} {_groups(found, value)}"
            for text, found, value in (
                ("settled on", seen[settled], "order"),
                ("not settled", seen[~settled], "slope"),
            )
            if len(found)
        ]
        hidden = len(rows) - len(seen)
        parts += [f"hidden by noise or constant: {hidden} of {len(rows)}"] if hidden else []
        said.append(
            f"`{scheme}`, σ = {sigma:.4g}, dt from {STEP_PAIRS[0]:g} to {0.5 * STEP_PAIRS[-1]:g}:"
            f" {'; '.join(parts)}."
        )
    return said


def _groups(rows: pd.DataFrame, value: str) -> str:
    """Quantities and the range of their values, of means and of sds."""
    found = []
    for moment, own in rows.groupby("moment", sort=False):
        found.append(
            f"{span(own[value], '.2f')} ({moment}s of {join_words(list(own['quantity']))})"
        )
    return join_words(found)


def make_report(m: Tradeoff, record: dict[str, Any]) -> Report:
    """The report on a trade-off."""
    *sentences, multilevel = answer(m)
    scene = m.reference.scene
    impacts = m.reference.impacts
    exact = m.models[EXACT_FLIGHT]
    means = [
        (bound_of_means(a, scene, impacts), means_seconds(exact, a, control=True))
        for a in m.accuracies
    ]
    slopes = {name: slope(m.points, name, False)[0] for name in m.models}
    figures = {
        "tradeoff": tradeoff_figure(
            m.points, slopes, pd.DataFrame(means, columns=["error", "core_seconds"])
        )
    }
    levels = pd.concat([levels.table for levels in m.levels.values()])
    tables = {"tradeoff": m.points, "levels": levels, "control": m.control}
    if m.orders:
        figures["orders"] = order_figure(m.orders.changes)
        tables |= {"orders": m.orders.table, "changes": m.orders.changes}
    content = {
        "verdict": multilevel,
        "budget": record["budget"],
        "reference": f"{m.reference.paths:,}",
        "alarm": f"{KURTOSIS_ALARM:g}",
        "impacts": ORDER_IMPACTS,
    }
    return Report(
        "tradeoff",
        f"What accuracy costs: {record['name']}, σ = {scene.sigma:.4g}, {impacts} impacts",
        sentences,
        record,
        content | _parts(m),
        glossary(*TRADEOFF_WORDS, gears=scene.gears),
        figures=figures,
        tables=tables,
        more={"all points": "`tradeoff.csv`"},
    )
