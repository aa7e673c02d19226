"""The folder of a trade-off: its answer in words, its figure, its tables."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd

from compare.folder import whole_folder
from compare.multilevel import KURTOSIS_ALARM, Rate
from compare.style import save
from compare.tradeoff import HAND_TUNED_NS, Measured, means_seconds, slope
from compare.tradeoff_plot import order_figure, tradeoff_figure
from compare.weak_order import ORDER_IMPACTS, Orders

__all__ = ["CONTENTS", "answer", "orders_in_words", "verdict", "write_tradeoff"]

CONTENTS = frozenset(
    {
        "tradeoff.md", "tradeoff.svg", "tradeoff.csv", "levels.csv", "control.csv", "orders.svg", "orders.csv",
        "changes.csv", "manifest.json",
    }
)  # fmt: skip
"""What a trade-off folder holds; anything else in it is not ours."""

PLAIN, EXACT = "euler-maruyama", "exact-flight"


def _seconds(value: float) -> str:
    """A time with its unit.

    Examples
    --------
    >>> _seconds(0.00056), _seconds(12.3), _seconds(86400.0 * 3)
    ('0.56 ms', '12 s', '72 h')
    """
    for factor, unit, below in ((1e-3, "ms", 1.0), (1.0, "s", 120.0), (60.0, "min", 7200.0)):
        if value < below:
            return f"{float(f'{value / factor:.2g}'):g} {unit}"
    return f"{float(f'{value / 3600.0:.2g}'):g} h"


def _table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def _cheapest(points: pd.DataFrame, accuracy: float) -> dict[str, Any]:
    """The cheapest of the schemes, and of the readings that predict everything as well as that."""
    scheme = (points["kind"] == "scheme") & (points["accuracy"] == accuracy) & ~points["missed"]
    closure = (points["kind"] == "closure") & (points["error"] <= accuracy) & (points["rows"] == points["rows"].max())
    best: dict[str, Any] = points[scheme | closure].nsmallest(1, "core_seconds").to_dict("records")[0]
    return best


def answer(m: Measured, accuracies: Sequence[float]) -> list[str]:
    """Which method is cheapest for which accuracy, where a closure wins, and what plain steps would cost."""
    p = m.points
    whole = p["rows"].max()
    parts = []
    for accuracy in accuracies:
        best = _cheapest(p, accuracy)
        how = "" if best["measured"] else ", extrapolated"
        parts.append(f"{accuracy:g}: `{best['method']}` ({_seconds(best['core_seconds'])}{how})")
    found = [f"The cheapest way to every section mean and sd within a share of its sd — {'; '.join(parts)}."]
    closures = p[p["kind"] == "closure"]
    wins = []
    for _, row in closures[closures["rows"] == whole].iterrows():
        simulated = m.laws[EXACT].at(row["error"]).core_seconds
        if simulated > row["core_seconds"] and row["error"] <= 1.0:
            wins.append(
                f"`{row['method']}`, whose worst error is {'' if row['resolved'] else 'below '}{row['error']:.2g} "
                f"(median {row['median_error']:.2g}) after {_seconds(row['core_seconds'])}: exact flights take "
                f"{float(format(simulated / row['core_seconds'], '.2g')):g} times as long to its worst error"
            )
    found.append(
        f"A closure wins outright for any accuracy no finer than its own worst error: {'; '.join(wins)}."
        if wins
        else "No closure that predicts all of them is cheaper than a simulation as accurate as its worst error."
    )
    finest = accuracies[-1]
    plain, exact = m.laws[PLAIN], m.laws[EXACT].path_alone(finest)
    found.append(
        f"To {finest:g}, plain Euler-Maruyama would need dt = {plain.at(finest).dt:.2g}: at "
        f"{1e9 * plain.step_seconds:.2g} ns per path-step the same number of paths takes "
        f"{plain.path_alone(finest) / exact:,.0f} times the processor time of exact flights "
        f"({_seconds(m.laws[EXACT].at(finest).core_seconds)}), and "
        f"{plain.path_alone(finest, HAND_TUNED_NS) / exact:,.0f} times at the {HAND_TUNED_NS:g} ns of a hand-tuned "
        "block."
    )
    return [*found, verdict(m, accuracies)]


def verdict(m: Measured, accuracies: Sequence[float]) -> str:
    """Whether multilevel over the step is cheaper than exact flights anywhere, for the section means alone."""
    exact, factors, typical = m.laws[EXACT], [], []
    for a in accuracies:
        estimates = [levels.estimate(a) for levels in m.levels.values()]
        factors.append(min(e.seconds for e in estimates) / means_seconds(exact, a, control=True))
        typical.append(min(e.typical for e in estimates) / means_seconds(exact, a, control=True, typical=True))
    wins = [f"{a:g} ({1.0 / f:.2g} times)" for a, f in zip(accuracies, factors, strict=True) if f < 1.0]
    found = (
        f"Multilevel Monte Carlo over the step is cheaper than exact flights for the section means at {', '.join(wins)}"
        if wins
        else "Multilevel Monte Carlo over the step never wins for all section means"
    )
    return (
        f"{found}: from {accuracies[0]:g} to {accuracies[-1]:g} the better of both Euler schemes takes "
        f"{factors[0]:.2g} to {factors[-1]:.2g} times as long as exact flights. For a typical mean alone it takes "
        f"{typical[0]:.2g} to {typical[-1]:.2g} times as long."
    )


def _rate(rate: Rate, sign: float) -> str:
    return f"{sign * rate.slope:.2f} ± {rate.half:.2f}"


def _tables(m: Measured, control: pd.DataFrame, accuracies: Sequence[float]) -> dict[str, str]:
    p = m.points
    schemes = [
        (r["method"], f"{r['accuracy']:g}", f"{r['dt']:.2g}", f"{r['paths']:,}", f"{r['core_seconds']:.3g}",
         f"{r['sampling_error']:.2g}", f"{r['step_error']:.2g}",
         "–" if np.isnan(r["actual_error"]) else f"{r['actual_error']:.2g}",
         "missed" if r["missed"] else "measured" if r["measured"] else "extrapolated")
        for _, r in p[p["kind"] == "scheme"].iterrows()
    ]  # fmt: skip
    slopes = [
        (name, f"{1e9 * law.step_seconds:.3g}",
         *(f"{power:.2f} ({n} points)" if n > 1 else "–" for power, n in (slope(p, name, x) for x in (False, True))))
        for name, law in m.laws.items()
    ]  # fmt: skip
    closures = [
        (r["method"], f"{r['rows']} of {p['rows'].max()}", ("" if r["resolved"] else "below ") + f"{r['error']:.3g}",
         f"{r['median_error']:.2g}", _seconds(r["core_seconds"]))
        for _, r in p[p["kind"] == "closure"].iterrows()
    ]  # fmt: skip
    rates = [
        (name, _rate(x.alpha, -1), _rate(x.beta, -1), _rate(x.typical_beta, -1), _rate(x.gamma, 1))
        for name, x in m.levels.items()
    ]
    means = []
    for a in accuracies:
        cells = [f"{e.seconds:.2g} ({e.typical:.2g})" for e in (x.estimate(a) for x in m.levels.values())]
        cells += [f"{means_seconds(m.laws[EXACT], a, control=control):.2g}" for control in (True, False)]
        means.append((f"{a:g}", *cells))
    heads = ["accuracy", *(f"multilevel {n}" for n in m.levels), f"{EXACT} with control", f"{EXACT} without"]
    ratios = ("means_median", "means_smallest", "sds_median", "sds_smallest")
    gains = [
        (f"{r['sigma']:.4g}", *(f"{r[n]:.3g}" for n in ratios),
         f"{r['time_ratio']:.2f}", *(f"{r[n] / r['time_ratio']:.3g}" for n in ("means_median", "sds_median")),
         *(f"{r[n]:.3g}" for n in ("antithetic_means", "antithetic_sds")))
        for _, r in control.iterrows()
    ]  # fmt: skip
    return {
        "schemes": _table(
            ["scheme", "accuracy", "dt", "paths", "core-seconds", "standard error", "step bias", "actual", ""], schemes
        ),
        "slopes": _table(
            ["scheme", "ns per path-step", "cost grows as accuracy to the", "of measured points alone"], slopes
        ),
        "closures": _table(["reading", "rows predicted", "worst error", "median", "time"], closures),
        "rates": _table(["scheme", "α (bias)", "β (variance, worst row)", "β (median row)", "γ (time)"], rates),
        "means": _table(heads, means),
        "control": _table(
            ["σ", "means: median", "smallest", "sds: median", "smallest", "time of a path", "means per second, median",
             "sds per second, median", "antithetic pairs: means", "sds"], gains,
        ),
    }  # fmt: skip


def orders_in_words(table: pd.DataFrame) -> str:
    """The measured weak orders, and whether each limit is the right one."""
    rows = [
        (f"{r['sigma']:.4g}", r["scheme"], r["moment"],
         "hidden by noise" if np.isnan(r["order"]) else f"{r['order']:.2f} ({r['low']:.2f} to {r['high']:.2f})",
         f"{r['change']:.2g}", f"{r['limit_z']:.1f}", f"{r['limit_allowed']:.1f}")
        for _, r in table.iterrows()
    ]  # fmt: skip
    return _table(
        ["σ", "scheme", "moment", "order", "last change", "limit: standard errors off", "allowed"], rows
    )  # fmt: skip


def write_tradeoff(
    out: Path, m: Measured, control: pd.DataFrame, orders: Orders | None, accuracies: Sequence[float],
    record: dict[str, Any], overwrite: bool,
) -> list[str]:  # fmt: skip
    """Write the folder, whole or not at all, and return the answer.

    Parameters
    ----------
    out : Path
    m : Measured
    control : DataFrame
        Of `compare.reduction.control_table`.
    orders : Orders or None
        Of `compare.weak_order.weak_orders`, where measured.
    accuracies : sequence of float
        From the roughest to the finest.
    record : dict
        Of the manifest: at least ``name, scene, budget, command, commit``.
    overwrite : bool

    Raises
    ------
    OutputError
        If the folder holds other things, or earlier ones that may not be replaced.
    """
    said = answer(m, accuracies)
    means = pd.DataFrame({
        "error": accuracies, "core_seconds": [means_seconds(m.laws[EXACT], a, control=True) for a in accuracies],
    })  # fmt: skip
    figure = tradeoff_figure(m.points, {name: slope(m.points, name, False)[0] for name in m.laws}, means)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("compare"), autoescape=False, trim_blocks=True, lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    shown = {name: record[name] for name in ("name", "budget", "command", "commit")}
    page = environment.get_template("tradeoff.md.j2").render(
        **shown, answer=said[:-1], verdict=said[-1], tables=_tables(m, control, accuracies),
        sigma=f"{m.reference.scene.sigma:.4g}", impacts=m.reference.impacts, reference=f"{m.reference.paths:,}",
        alarm=f"{KURTOSIS_ALARM:g}", orders=orders_in_words(orders.table) if orders else "",
        order_impacts=ORDER_IMPACTS,
    )  # fmt: skip
    with whole_folder(out, CONTENTS, overwrite) as folder:
        save(figure, folder / "tradeoff.svg")
        if orders:
            save(order_figure(orders.changes), folder / "orders.svg")
            orders.table.to_csv(folder / "orders.csv", index=False)
            orders.changes.to_csv(folder / "changes.csv", index=False)
        m.points.to_csv(folder / "tradeoff.csv", index=False)
        pd.concat([levels.table for levels in m.levels.values()]).to_csv(folder / "levels.csv", index=False)
        control.to_csv(folder / "control.csv", index=False)
        (folder / "tradeoff.md").write_text(page, encoding="utf-8")
        (folder / "manifest.json").write_text(
            json.dumps({**record, "answer": said}, indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
        )
    return said
