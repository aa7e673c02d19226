"""The page of a trade-off: its answer in sentences, tables, and explanations of its tables and
figures."""

from itertools import zip_longest
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.report.report import Report
from rattle.compare.report.table import Table, TableCell
from rattle.compare.report.texts import (
    glossary,
    name_wheels,
)
from rattle.compare.tradeoff.figures import order_figure, tradeoff_figure
from rattle.compare.tradeoff.measure import (
    HAND_TUNED_NS,
    Tradeoff,
    bound_of_means,
    means_seconds,
    slope,
)
from rattle.compare.tradeoff.multilevel import KURTOSIS_ALARM
from rattle.compare.tradeoff.weak_order import ORDER_IMPACTS, STEP_PAIRS
from rattle.compare.validation.answer import explain_missing
from rattle.montecarlo.settings import EXACT_SCHEME
from rattle.scene import duration_text

EULER_MARUYAMA = "euler-maruyama"
Costs: TypeAlias = list[Facts]
"""What each accuracy costs, from the roughest to the finest, as `_list_costs` gives it."""


def cheapest(points: pd.DataFrame, accuracy: float) -> Facts:
    """The method of least counted work for an accuracy, of schemes and of closures that predict all
    moments so well."""
    able: Any = points.query(
        "kind == 'scheme' and accuracy == @accuracy and not missed"
        " or kind == 'closure' and error <= @accuracy and rows == rows.max()"
    )
    best: Facts = able.nsmallest(1, "work").to_dict("records")[0]
    return best


def _list_costs(m: Tradeoff) -> Costs:
    """The cheapest method for each accuracy, and what the section means alone take: multilevel
    Monte Carlo of each scheme, and exact flights."""
    exact = m.models[EXACT_SCHEME]
    costs = []
    for a in m.accuracies:
        estimates = [levels.estimate(a) for levels in m.levels.values()]
        control = means_seconds(exact, a, control=True)
        typical = means_seconds(exact, a, control=True, typical=True)
        row = {
            "asked": a,
            "multilevel": estimates,
            "control": control,
            "plain": means_seconds(exact, a, control=False),
            "factor": min(e.seconds for e in estimates) / control,
            "typical": min(e.typical for e in estimates) / typical,
            "standard_error": bound_of_means(a, m.reference.scene, m.reference.impacts),
        }
        costs.append(cheapest(m.points, a) | row)
    return costs


def answer(m: Tradeoff, costs: Costs) -> list[str]:
    """What to take, where a closure is cheapest, the cost of plain Euler-Maruyama, and whether
    multilevel Monte Carlo is anywhere cheaper."""
    exact = m.models[EXACT_SCHEME]

    closures = m.points.query("kind == 'closure'")
    full = m.points.query("kind == 'closure' and rows == rows.max()")
    full = full.assign(simulated=[exact.at(error).work for error in full["error"]])
    wins = full.query("simulated > work and error <= @m.accuracies[0]")

    return render_sentences(
        "tradeoff/answer.j2",
        m.reference.scene.words,
        m=m,
        costs=costs,
        takes=[
            cost
            for cost, finer in zip_longest(costs, costs[1:])
            if finer is None or finer["method"] != cost["method"]
        ],
        wins=wins.to_dict("records"),
        exact=exact,
        plain=m.models[EULER_MARUYAMA],
        tuned_ns=HAND_TUNED_NS,
        missing=" ".join(explain_missing(m.reference.scene, list(closures["method"]))),
    )


def _parts(m: Tradeoff, costs: Costs) -> Facts:
    """The tables and words of the page, by name."""
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
    near_branches = m.models[EXACT_SCHEME].best.plan.mixture is not None
    how = "with paths near rare branches" if near_branches else "with control"
    means = []
    for cost in costs:
        row = {"standard error": f"{cost['asked']:g}"}
        for name, estimate in zip(m.levels, cost["multilevel"], strict=True):
            row[f"multilevel {name}"] = f"{estimate.seconds:.2g} ({estimate.typical:.2g})"
        row[f"{EXACT_SCHEME} {how}"] = f"{cost['control']:.2g}"
        row[f"{EXACT_SCHEME} without"] = f"{cost['plain']:.2g}"
        means.append(row)
    parts: Facts = {
        "cheapest": pd.DataFrame([cheapest(p, a) | {"asked": a} for a in m.accuracies]),
        "points": p.query("kind == 'scheme'"),
        "slopes": pd.DataFrame(
            {
                "scheme": name,
                "ns": 1e9 * model.step_seconds,
                "all": _slope(p, name, False),
                "measured": _slope(p, name),
            }
            for name, model in m.models.items()
        ),
        "closures": p.query("kind == 'closure'"),
        "rates": pd.DataFrame([{"scheme": name, "rates": x} for name, x in m.levels.items()]),
        "means": Table.whole(pd.DataFrame(means)),
    }
    if m.orders:
        table = m.orders.table
        parts |= {"orders_said": orders_said(table), "orders": format_orders(table)}
    if not m.control.empty:
        ratio = m.control["time_ratio"]
        parts["control"] = m.control.assign(
            means_per_second=m.control["means_median"] / ratio,
            sds_per_second=m.control["sds_median"] / ratio,
        )
    return parts


def _slope(points: pd.DataFrame, scheme: str, measured: bool = True) -> str:
    """The power with which the cost of a scheme grows, and from how many points."""
    power, n = slope(points, scheme, measured)
    return f"{power:.2f} ({n} points)" if n > 1 else "–"


def format_orders(table: pd.DataFrame) -> pd.DataFrame:
    """The measured slopes, the orders on which they have settled, and whether each scheme's limit
    is correct."""
    rows = table[table["slope"].notna()]

    def between(value: str, low: str, high: str, none: str = "–") -> list[str]:
        """A value with its interval in each row."""
        return [
            none if np.isnan(v) else f"{v:.2f} ({a:.2f} to {b:.2f})"
            for v, a, b in rows[[value, low, high]].to_numpy()
        ]

    return rows.assign(
        kind=(rows["moment"] + " " + rows["quantity"]).str.strip(),
        whole=between("slope", "low", "high"),
        local=between("last", "last_low", "last_high"),
        settled=between("order", "order_low", "order_high", "not settled"),
    )


def orders_said(table: pd.DataFrame) -> list[str]:
    """Which slopes have settled on an order and which have not, a sentence for each scheme and
    noise intensity."""
    return render_sentences(
        "tradeoff/orders.j2",
        moments=table.query("moment != 'itinerary'"),
        coarsest=STEP_PAIRS[0],
        finest=0.5 * STEP_PAIRS[-1],
    )


def make_report(m: Tradeoff, record: Facts) -> Report:
    """The report on a trade-off."""
    costs = _list_costs(m)
    *sentences, multilevel = answer(m, costs)
    scene = m.reference.scene
    sentences += name_wheels(scene)
    impacts = m.reference.impacts
    slopes = {name: slope(m.points, name, False)[0] for name in m.models}
    means = pd.DataFrame(
        {
            "error": [c["standard_error"] for c in costs],
            "core_seconds": [c["control"] for c in costs],
        }
    )
    figures = {"tradeoff": tradeoff_figure(m.points, slopes, means)}
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
        content | _parts(m, costs),
        glossary("tradeoff", gears=scene.gears),
        figures=figures,
        tables=tables,
        more={"all points": "`tradeoff.csv`"},
    )
