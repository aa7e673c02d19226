"""The page of a trade-off: its answer in sentences, tables, and explanations of its tables and figures."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.report import Column, Figure, Page, PageSection, Row, Table, TableCell, Text, format_table, numbers
from rattle.compare.report.glossary import CLOSURE_TERMS, SCHEME_TERMS, SECTION_TERMS, glossary
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save
from rattle.compare.tradeoff.figures import order_figure, tradeoff_figure
from rattle.compare.tradeoff.measure import HAND_TUNED_NS, Tradeoff, bound_of_means, means_seconds, slope
from rattle.compare.tradeoff.multilevel import KURTOSIS_ALARM, Rate
from rattle.compare.tradeoff.weak_order import ORDER_IMPACTS, STEPS, Orders
from rattle.compare.validation.answer import explain_missing
from rattle.compare.validation.verdict import join_words
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
        f"{factors[0]:.2g} to {factors[-1]:.2g} times the counted work of exact flights. For a typical mean alone it "
        f"takes {typical[0]:.2g} to {typical[-1]:.2g} times theirs."
    )


FIGURE = (
    "Error against processor time, both on logarithmic scales. Schemes: 95 % simultaneous error bound of all "
    "section means and sds. Closures: worst and median error against {reference} paths of exact flights. Dash-dotted: "
    "the section means alone, at nominal core-seconds of counted work. Open and dashed: extrapolated. Pale: runs that "
    "missed the requested accuracy, at their actual error."
)
SCHEMES = (
    "Runs of `rattle simulate --accuracy` with each scheme where {budget} core-seconds suffice, including pilot runs "
    "and the longer steps that measure the step bias. The accuracy is the 95 % simultaneous error bound of all section "
    "means and sds, including rare branches that the sample may miss. The other rows are extrapolated from the time of "
    "a path-step, the number of paths predicted from the largest run, and the step bias, which may take half of the "
    "accuracy. “Actual” is the worst difference of the run from {reference} paths of exact flights over all rows, and "
    "should be within the accuracy; where it exceeds that by more than the reference's own error, the run “missed” it, "
    "and the next row gives the cost predicted from the largest run."
)
STEP = (
    "A path-step is one step of one path at one step size, timed in the pilot runs with all statistics; for "
    "exact-flight it includes the impacts."
)
RATES = (
    "Powers of two per halving of the step, with 95 % intervals. Nominal core-seconds of the counted work for a "
    "standard error of the section means alone; multilevel estimators have a bias of the same size beside it:"
)
LEVELS = (
    "In brackets: for a row with the median of the variances and biases alone. Each level: `levels.csv`; a "
    "kurtosis beyond {alarm} there means that a few paths dominate the variance of the difference, whose estimate is "
    "then unreliable."
)
ORDERS = (
    "No order is published for schemes with inelastic impacts. Two questions are separated. How fast does a scheme "
    "converge towards its own limit: the change of a section mean or sd between dt and dt / 2 on the same Brownian "
    "paths, root mean square over {impacts} impacts in units of the sd, for each quantity alone; its slope over "
    "the stated steps and at the finest ones, with 95 % intervals. It is called an order only where it has settled: "
    "where the local slopes over the finest three changes agree, and the change turns its sign there at no impact. Is"
    " that limit correct: Richardson extrapolation from the smallest steps compared with exact flights, the largest "
    "difference in standard errors, beside its bound at 95 % confidence if the limit is correct. For the noise-free "
    "itinerary the moment is its probability, the error the distance from that of exact flights."
)
ORDER_FIGURE = (
    "Change of each quantity against the step, both on logarithmic scales, with 95 % intervals; what sampling noise "
    "hides is left out. Grey: slope 1. A limit further off than allowed means that a scheme is not yet in its "
    "asymptotic regime at these steps, or that its limit is wrong."
)
GAINS = (
    "Variance of exact flights without the linearised path as control variate over that with it, on the same paths; "
    "divided by the time ratio it is the gain per second. Antithetic pairs, paths with the same noise and its "
    "negative, take no more time: their gain, median over the rows, is 1 / (1 + r) with the correlation r of a pair, "
    "at least 0.5."
)
CONTENTS = contents(
    "tradeoff", figures=["tradeoff", "orders"], tables=["tradeoff", "levels", "control", "orders", "changes"]
)
"""Names of all files in a trade-off folder; a folder with any other file is not overwritten."""

WORDS = (*CLOSURE_TERMS, *SECTION_TERMS, *SCHEME_TERMS, "standard error", "σ")


def _rate(rate: Rate, sign: float) -> str:
    return f"{sign * rate.slope:.2f} ± {rate.half:.2f}"


def _time(row: dict[str, Any]) -> TableCell:
    return TableCell(duration_text(row["core_seconds"], 2), value=float(row["core_seconds"]))


def _found(row: dict[str, Any]) -> str:
    return "missed" if row["missed"] else "measured" if row["measured"] else "extrapolated"


def _actual(row: dict[str, Any]) -> str:
    return "–" if np.isnan(row["actual_error"]) else f"{row['actual_error']:.2g}"


def _cheapest_table(p: pd.DataFrame, accuracies: Sequence[float]) -> Table:
    return format_table(
        pd.DataFrame([cheapest(p, a) | {"asked": a} for a in accuracies]),
        [
            ("error / sd", "{asked:g}"),
            ("cheapest method", "{method}"),
            ("time on one core", _time),
            ("found", lambda r: "measured" if r["measured"] else "extrapolated"),
        ],
        ("cheapest method", "found"),
    )


def _scheme_section(m: Tradeoff, budget: float) -> PageSection:
    p = m.points
    slopes: list[Row] = [
        (
            name,
            f"{1e9 * model.step_seconds:.3g}",
            *(f"{power:.2f} ({n} points)" if n > 1 else "–" for power, n in (slope(p, name, x) for x in (False, True))),
        )
        for name, model in m.models.items()
    ]
    points = format_table(
        p[p["kind"] == "scheme"],
        [
            ("scheme", "{method}"),
            ("accuracy", "{accuracy:g}"),
            ("dt", "{dt:.2g}"),
            ("paths", "{paths:,}"),
            ("core-seconds", "{core_seconds:.3g}"),
            ("standard error", "{sampling_error:.2g}"),
            ("step bias", "{step_error:.2g}"),
            ("actual", _actual),
            ("found", _found),
        ],
        ("scheme", "found"),
    )
    heads: list[Column | str] = [
        "scheme",
        *numbers("ns per path-step", "cost grows as accuracy to the", "of measured points alone"),
    ]
    note = SCHEMES.format(budget=budget, reference=f"{m.reference.paths:,}")
    return PageSection("Schemes", (Text(note, note=True), points, Table.of(heads, slopes), Text(STEP, note=True)))


def _closure_section(p: pd.DataFrame) -> PageSection:
    table = format_table(
        p[p["kind"] == "closure"].assign(most=p["rows"].max()),
        [
            ("closure", "{method}"),
            ("rows predicted", "{rows} of {most}"),
            ("worst error", lambda r: f"{'' if r['resolved'] else 'below '}{r['error']:.3g}"),
            ("median", "{median_error:.2g}"),
            ("time", _time),
        ],
        ("closure",),
    )
    return PageSection("Closures", (table,))


def _multilevel_section(m: Tradeoff, accuracies: Sequence[float], said: str) -> PageSection:
    rates: list[Row] = [
        (name, _rate(x.alpha, -1), _rate(x.beta, -1), _rate(x.typical_beta, -1), _rate(x.gamma, 1))
        for name, x in m.levels.items()
    ]
    means: list[Row] = []
    for a in accuracies:
        cells = [f"{e.seconds:.2g} ({e.typical:.2g})" for e in (x.estimate(a) for x in m.levels.values())]
        cells += [f"{means_seconds(m.models[EXACT], a, control=control):.2g}" for control in (True, False)]
        means.append((f"{a:g}", *cells))
    heads = ["standard error", *(f"multilevel {n}" for n in m.levels), f"{EXACT} with control", f"{EXACT} without"]
    names: list[Column | str] = [
        "scheme",
        *numbers("α (bias)", "β (variance, worst row)", "β (median row)", "γ (work)"),
    ]
    note = Text(LEVELS.format(alarm=f"{KURTOSIS_ALARM:g}"), note=True)
    tables = (Table.of(names, rates), Text(RATES, note=True), Table.of(numbers(*heads), means))
    return PageSection("Multilevel Monte Carlo over the step, for the section means alone", (Text(said), *tables, note))


def _order_section(orders: Orders) -> PageSection:
    alt = "Change of means and sds, and error of the itinerary's probability, against the step"
    said = (*map(Text, orders_said(orders.table)), Text(ORDERS.format(impacts=ORDER_IMPACTS), note=True))
    shown = (orders_table(orders.table), Figure("orders.svg", ORDER_FIGURE, alt))
    return PageSection("Slopes of the step bias, and orders, measured", (*said, *shown))


def _control_section(control: pd.DataFrame) -> PageSection:
    title = "What the control variate and antithetic pairs are worth"
    if control.empty:
        return PageSection(title, (Text("Left out: the control variate is for white noise only."),))
    table = format_table(
        control,
        [
            ("σ", "{sigma:.4g}"),
            ("means: median", "{means_median:.3g}"),
            ("smallest", "{means_smallest:.3g}"),
            ("sds: median", "{sds_median:.3g}"),
            ("smallest", "{sds_smallest:.3g}"),
            ("time of a path", "{time_ratio:.2f}"),
            ("means per second, median", lambda r: f"{r['means_median'] / r['time_ratio']:.3g}"),
            ("sds per second, median", lambda r: f"{r['sds_median'] / r['time_ratio']:.3g}"),
            ("antithetic pairs: means", "{antithetic_means:.3g}"),
            ("sds", "{antithetic_sds:.3g}"),
        ],
    )
    return PageSection(title, (Text(GAINS, note=True), table))


def orders_table(table: pd.DataFrame) -> Table:
    """The measured slopes, the orders on which they have settled, and whether each scheme's limit is correct."""
    return format_table(
        table[table["slope"].notna()],
        [
            ("σ", "{sigma:.4g}"),
            ("scheme", "{scheme}"),
            ("moment", lambda r: f"{r['moment']} {r['quantity']}".strip()),
            ("dt", "{coarsest:g} to {finest:g}"),
            ("slope", lambda r: _between(r, "slope", "low", "high")),
            ("at the finest", lambda r: _between(r, "last", "last_low", "last_high")),
            ("impacts where it turns", "{turns}"),
            ("order", _order),
            ("last change", "{change:.2g}"),
            ("limit: standard errors off", "{limit_z:.1f}"),
            ("allowed", "{limit_allowed:.1f}"),
        ],
        ("scheme", "moment"),
    )


def _order(row: dict[str, Any]) -> str:
    return "not settled" if np.isnan(row["order"]) else _between(row, "order", "order_low", "order_high")


def _between(row: dict[str, Any], value: str, low: str, high: str) -> str:
    return "–" if np.isnan(row[value]) else f"{row[value]:.2f} ({row[low]:.2f} to {row[high]:.2f})"


def orders_said(table: pd.DataFrame) -> list[str]:
    """Which slopes have settled on an order and which have not, a sentence for each scheme and noise intensity."""
    said = []
    for (sigma, scheme), rows in table[table["moment"] != "itinerary"].groupby(["sigma", "scheme"], sort=False):
        seen = rows[rows["slope"].notna()]
        settled = seen["order"].notna()
        parts = [
            f"{text} {'an order' if text == 'settled on' else 'at'} {_groups(found, value)}"
            for text, found, value in (("settled on", seen[settled], "order"), ("not settled", seen[~settled], "slope"))
            if len(found)
        ]
        hidden = len(rows) - len(seen)
        parts += [f"hidden by noise or constant: {hidden} of {len(rows)}"] if hidden else []
        said.append(f"`{scheme}`, σ = {sigma:.4g}, dt from {STEPS[0]:g} to {0.5 * STEPS[-1]:g}: {'; '.join(parts)}.")
    return said


def _groups(rows: pd.DataFrame, value: str) -> str:
    """Quantities and the range of their values, of means and of sds."""
    found = []
    for moment, own in rows.groupby("moment", sort=False):
        low, high = own[value].min(), own[value].max()
        span = f"{low:.2f}" if f"{low:.2f}" == f"{high:.2f}" else f"{low:.2f} to {high:.2f}"
        found.append(f"{span} ({moment}s of {join_words(list(own['quantity']))})")
    return join_words(found)


def tradeoff_page(
    m: Tradeoff,
    control: pd.DataFrame,
    orders: Orders | None,
    accuracies: Sequence[float],
    sentences: Sequence[str],
    record: dict[str, Any],
) -> Page:
    """The page and the folder of a trade-off."""
    caption = FIGURE.format(reference=f"{m.reference.paths:,}")
    sections = [
        _scheme_section(m, record["budget"]),
        _closure_section(m.points),
        _multilevel_section(m, accuracies, sentences[-1]),
        *([_order_section(orders)] if orders else []),
        _control_section(control),
    ]
    scene, impacts = m.reference.scene, m.reference.impacts
    return Page(
        f"What accuracy costs: {record['name']}, σ = {scene.sigma:.4g}, {impacts} impacts",
        tuple(sentences[:-1]),
        source_of(record, more={"all points": "`tradeoff.csv`"}),
        (
            Figure("tradeoff.svg", caption, "Error against processor time of every scheme and every closure"),
            _cheapest_table(m.points, accuracies),
            glossary(*WORDS, gears=scene.gears),
        ),
        tuple(sections),
    )


def write_tradeoff(
    out: Path,
    m: Tradeoff,
    control: pd.DataFrame,
    orders: Orders | None,
    accuracies: Sequence[float],
    record: dict[str, Any],
    overwrite: bool,
) -> list[str]:
    """Write the folder of a trade-off, whole or not at all."""
    sentences = answer(m, accuracies)
    means = pd.DataFrame(
        {
            "error": [bound_of_means(a, m.reference.scene, m.reference.impacts) for a in accuracies],
            "core_seconds": [means_seconds(m.models[EXACT], a, control=True) for a in accuracies],
        }
    )
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
