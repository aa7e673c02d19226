"""What the pages show of the committed reports, read when the site is built: tables, answers and
figures.

.. code-block:: none

    ```{reported} speed        a table, by the name of one of the functions in `TABLES`
    ```{answer} chaos          the sentences that open a report
    ```{reported-figure} chaos/sweep.svg
    :alt: what it shows
    the caption
"""

import json
import math
import os
from collections.abc import Callable, Iterable
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import source_tree
from docutils import nodes
from docutils.parsers.rst import directives
from scipy.stats import binomtest
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from rattle.montecarlo.looks import widest

__all__ = ["TABLES", "setup"]

Table = tuple[list[str], list[list[str]]]
TABLES: dict[str, Callable[[Path], Table]] = {}
CLOSURES = ("published", "corrected", "saltation", "branching")
MOMENTS = {
    "tau": "the time of an impact",
    "flight": "a flight",
    "y1": "the speed y1",
    "y2": "the speed y2",
}
AVERAGES = {
    "rate": "impacts per unit of time",
    "rate_above": "those faster than 0.1",
    "energy_per_period": "energy lost per period",
}


def table(make: Callable[[Path], Table]) -> Callable[[Path], Table]:
    """Register a table by the name of the function that makes it from the folder of reports."""
    TABLES[make.__name__.replace("_", "-")] = make
    return make


def short(value: Any, digits: int = 3) -> str:
    """A number with few digits; a dash for none."""
    if isinstance(value, str):
        return value
    if pd.isna(value):
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if float(value).is_integer() and abs(value) < 1e9:
        return f"{int(value):,}"
    return f"{float(value):.{digits}g}"


def seconds(value: float) -> str:
    """A time in the unit that suits it."""
    for unit, size in (("h", 3600.0), ("min", 60.0), ("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{float(f'{value / size:.3g}'):,g} {unit}"
    return f"{value / 1e-6:.3g} µs"


def interval(row: Any, value: str, digits: int = 3) -> str:
    """A value and the half width of its interval."""
    half = 0.5 * (row["high"] - row["low"])
    return "–" if pd.isna(row[value]) else f"{row[value]:.{digits}f} ± {half:.{digits}f}"


def stretch(sigmas: Iterable[float]) -> str:
    """One noise intensity, or the first and the last of several."""
    found = [f"{s:.3g}" for s in sigmas]
    return found[0] if len(found) == 1 else f"{found[0]} – {found[-1]}"


@table
def source(_: Path) -> Table:
    """Lines of the source, counted when the site is built."""
    header = ["folder", "modules", "lines", "of code", "of docstrings"]
    return header, [[row[0], *(f"{n:,}" for n in row[1:])] for row in source_tree.rows()]


@table
def validity(reports: Path) -> Table:
    """How far each closure is accurate, for the noise intensities of the report on DAT21."""
    rows = []
    found = pd.read_csv(reports / "dat21" / "validity.csv")
    for closure in CLOSURES:
        of = found[found["closure"] == closure].sort_values("sigma").to_dict("records")
        for (accurate, not_wrong, _), same in groupby(
            of, lambda r: (r["accurate"], r["not_inaccurate"], r["cause"])
        ):
            group = list(same)
            why = group[0]["why"] if len(group) == 1 else group[0]["why"].split(":")[0]
            rows.append(
                [
                    closure,
                    stretch(r["sigma"] for r in group),
                    short(accurate),
                    short(not_wrong),
                    why,
                ]
            )
    return ["closure", "σ", "accurate up to impact", "not shown wrong up to", "why it ends"], rows


@table
def itinerary(reports: Path) -> Table:
    """Moments of the paths on each closure's itinerary, and of all paths, at the noise of the
    report on DAT21."""
    found = pd.read_csv(reports / "dat21" / "table.csv")
    rows = []
    for sigma, of in found.groupby("sigma"):
        for closure in CLOSURES:
            cells = []
            for kind in ("itinerary", "section"):
                own = of[(of["closure"] == closure) & (of["kind"] == kind)]
                judged = own["verdict"][
                    own["verdict"].isin(["accurate", "inaccurate", "undecided"])
                ]
                right = (judged == "accurate").sum()
                wrong = (judged == "inaccurate").sum()
                cells.append(f"{right} ({len(judged) - wrong}) of {len(judged)}")
            rows.append([f"{sigma:.4g}", closure, *cells])
    return ["σ", "closure", "on its itinerary", "all paths"], rows


@table
def leaving(reports: Path) -> Table:
    """How paths leave the itinerary of DAT21's orbit."""
    found = pd.read_csv(reports / "dat21" / "leaving.csv")
    rows = [
        [
            f"{r['sigma']:.4g}",
            f"{r['impact']}",
            f"mesh {r['mesh']}, side {r['side']:+d}",
            f"{r['probability']:.3g} ({r['low']:.3g} to {r['high']:.3g})",
            "paths drawn near it" if r["near"] else "the report's paths",
        ]
        for r in found.to_dict("records")
    ]
    return ["σ", "impact", "struck instead", "probability", "known from"], rows


@table
def leaving_coverage(reports: Path) -> Table:
    """How often intervals of the probability of leaving hold it, kept beside the page."""
    found = pd.read_csv(Path(__file__).parent / "results" / "leaving_coverage.csv")
    rows = [
        [
            f"{r['set']}, {'unseen' if r['unseen'] else 'looked at'}",
            f"{r['impact']}: mesh {r['mesh']}, side {r['side']:+d}",
            f"{short(r['truth'], 3)} ± {short(r['se_truth'], 1)}",
            short(r["plain"], 2),
            f"{r['mean']:.3f} ± {math.hypot(r['se_mean'], r['se_truth'] / r['truth']):.3f}",
            f"{r['scatter']:.0%}",
            f"{r['coverage']:.1%}",
            f"{r['coverage_of_mean']:.1%}",
        ]
        for r in found.to_dict("records")
    ]
    for name, some in (("looked at", found[~found["unseen"]]), ("unseen", found[found["unseen"]])):
        every = [
            np.average(some[c], weights=some["seeds"]) for c in ("coverage", "coverage_of_mean")
        ]
        scatter = f"{some['scatter'].median():.0%} (median)"
        rows.append([f"all {name}", "", "", "", "", scatter, *(f"{share:.1%}" for share in every)])
    head = ["gear set", "exit", "truth", "plain paths", "mean", "scatter"]
    return [*head, "95 % intervals that hold the truth", "the mean"], rows


@table
def coverage(reports: Path) -> Table:
    """How often the intervals of the long run hold the truth, and how often naive ones would."""
    found = pd.read_csv(Path(__file__).parent / "results" / "coverage.csv")
    rate = found[found["quantity"] == "rate"].set_index(["paths", "periods"])["value"]

    def impacts_of(r: pd.Series) -> float:
        duration = r["periods"] * 2.0 * math.pi
        return rate[r["paths"], r["periods"]] * r["paths"] * duration

    rows = [
        [
            f"{r['paths']} × {r['periods']}",
            short(float(f"{impacts_of(r):.2g}")),
            f"{r['seeds']}",
            r["quantity"],
            short(r["value"], 4),
            f"{r['coverage']:.1%} ± {r['se_coverage']:.1%}",
            f"{r['naive_coverage']:.1%}",
            short(r["autocorrelation"]),
            short(r["stated_se"] / r["sd_of_estimates"]),
        ]
        for r in found.sort_values(["paths", "periods"], kind="stable").to_dict("records")
    ]
    head = [
        "paths × periods",
        "impacts",
        "runs",
        "quantity",
        "mean of all runs",
        "intervals that hold it",
        "naive ones",
    ]
    return [*head, "autocorrelation (impacts)", "stated error / spread of the runs"], rows


@table
def drive_noise(reports: Path) -> Table:
    """How often the interval of a measured drive holds the noise that was put into made
    measurements."""
    found = pd.read_csv(Path(__file__).parent / "results" / "drive_noise.csv")
    rows = [
        [
            r["quantity"],
            f"{r['noise']:.1%}",
            short(r["sigma"]),
            short(r["median_sigma"]),
            _share(r["hold"], r["seeds"]),
            "" if r["sigma"] == 0.0 else f"{r['hold_planted']} of {r['seeds']}",
            f"{r['at_most']} of {r['seeds']}",
            short(r["median_floor"], 2),
        ]
        for r in found.to_dict("records")
    ]
    heads = [
        "file",
        "noise of the measurement",
        "σ/α",
        "median found",
        "intervals that hold it (95 % interval)",
    ]
    return [*heads, "that hold 1.5 times as much", "said as “at most”", "floor"], rows


@table
def energy_law(reports: Path) -> Table:
    """What ``rattle check published --result energy-law --all --json`` has printed, kept beside the
    page."""
    found = json.loads((Path(__file__).parent / "results" / "energy_law.json").read_text())[
        "results"
    ][0]
    heads = [
        "long run",
        "energy lost per unit of time",
        "by the law",
        "relative standard error",
        "off by [se]",
    ]
    return [*heads, "allowed"], [
        [
            c["quantity"]
            .removeprefix("loss per time, ")
            .replace("eps", "ε")
            .replace("sigma", "σ ="),
            short(c["found"], 4),
            short(c["truth"], 4),
            f"{c['se'] / c['truth']:.2%}",
            short(c["z"], 2),
            short(found["allowed"], 2),
        ]
        for c in found["checks"]
    ]


@table
def long_restitution(reports: Path) -> Table:
    """The long run over the restitution."""
    found = pd.read_parquet(reports / "studies" / "long-restitution" / "quantities.parquet")
    names = ["rate", "energy_per_period", "slow_share"]
    rows = []
    for epsilon, of in list(found.groupby("epsilon"))[::2]:
        by = of.set_index("quantity")
        main = (f"{by['value'][n]:.3g} ± {0.5 * (by['high'][n] - by['low'][n]):.1g}" for n in names)
        rows.append([short(epsilon), *main, short(by["autocorrelation"]["slow_share"])])
    heads = ["ε", "impacts per unit of time", "energy lost per period", "share of slow impacts"]
    return [*heads, "their autocorrelation (impacts)"], rows


@table
def random_gears(reports: Path) -> Table:
    """How far each closure is accurate on gear sets drawn at random, kept beside the page."""
    found = pd.read_csv(Path(__file__).parent / "results" / "random_gears.csv")
    rows = []
    for (_, ratio), of in found.groupby(["set", "ratio"], sort=False):
        first = of.iloc[0]
        by = of.set_index("closure")
        gears = [short(first[name]) for name in ("set", "stages", "alpha", "epsilon", "gap2")]
        reach = [
            f"{by['accurate'][c]:.0f} ({by['not_inaccurate'][c]:.0f})" if c in by.index else "–"
            for c in CLOSURES
        ]
        rows.append([*gears, f"{ratio:g}", *reach])
    return ["set", "stages", "α", "ε", "gap 2", "σ/√α", *CLOSURES], rows


@table
def rare_branches(reports: Path) -> Table:
    """What sampling rare branches gains, and whether its intervals hold, kept beside the page."""
    found = pd.read_csv(Path(__file__).parent / "results" / "rare_branches.csv")
    rows = []
    for r in found.to_dict("records"):
        scene = f"{r['scene']}, {r['impacts']} impacts"
        if not r["parts"] > 0.0:
            rows.append([scene, "none is worth it", *["–"] * 8])
            continue
        rows.append(
            [
                scene,
                r["branch"],
                short(r["first_order"], 2),
                f"{short(r['near'], 3)} ± {short(r['se_near'], 1)}",
                short(r["plain"], 3),
                f"{r['worst_row']} ({r['kurtosis']:,.0f})",
                f"{r['gain']:,.0f}",
                short(r["median_gain"], 2),
                f"{r['largest_z']:.1f}",
                f"{r['coverage']:.1%} ({r['least_coverage']:.1%})",
            ]
        )
    heads = [
        "scene",
        "branch (impact: struck instead)",
        "first order",
        "near",
        "plain",
        "worst row (kurtosis)",
    ]
    return [
        *heads,
        "its variance falls",
        "median row",
        "largest z",
        "intervals that hold (worst row)",
    ], rows


@table
def boundary_seeds(reports: Path) -> Table:
    """Whether searches with seeds of their own hold the true boundary, and at what cost, kept
    beside the page."""
    found = pd.read_csv(Path(__file__).parent / "results" / "boundary_seeds.csv")
    truth = found["truth"]
    share = found["path_steps"] / found["study_path_steps"]
    of = found["seed"].nunique()
    se = widest(1) * found["se_truth"].iloc[0]
    held = (found["accurate"] <= truth) & (found["wrong"] >= truth)
    cheap = share <= 0.2
    width = (found["wrong"] - found["accurate"]) / (found["wrong"] + found["accurate"])
    spread = (f"{part.median():.1%} ({part.max():.1%})" for part in (width, share))
    row = [
        f"{truth.iloc[0]:.4f} ± {se:.4f}",
        f"{held.sum()} of {of}",
        *spread,
        f"{cheap.sum()} of {of}",
    ]
    heads = [
        "true value of σ",
        "searches that hold it",
        "half width: median (most)",
        "share of the study's path-steps",
    ]
    return [*heads, "at most a fifth"], [row]


@table
def accuracy_cells(reports: Path) -> Table:
    """What an accuracy takes on random gear sets, and its true error, kept beside the page."""
    found = pd.read_csv(Path(__file__).parent / "results" / "accuracy_cells.csv")
    random = found["cell"].str.match(r"\d")
    ratio = found["cell"].str.split(", ").str[1]
    groups = [(f"random, σ/√α = {name}", of) for name, of in found[random].groupby(ratio)]
    groups += [
        ("random, all", found[random]),
        *((r["cell"], found.loc[[i]]) for i, r in found[~random].iterrows()),
    ]
    rows = []
    for name, of in groups:
        reached = of[of["reached"]]
        rows.append(
            [
                name,
                f"{of['accuracy'].iloc[0]:g}",
                str(len(of)),
                f"{short(of['counted'].median(), 2)} ({short(of['counted'].max(), 2)})",
                f"{(of['counted'] <= 20.0).sum()} and {(of['counted'] <= 300.0).sum()}",
                str(len(reached)),
                f"{reached['kept'].sum()} of {len(reached)}" if len(reached) else "–",
                short(reached["error"].max(), 2) if len(reached) else "–",
            ]
        )
    head = [
        "cells",
        "accuracy",
        "number",
        "core-seconds: median (most)",
        "within 20 s and 5 min",
        "reached in 20 s",
    ]
    return [*head, "true error within it", "largest difference from the reference"], rows


@table
def unseen(reports: Path) -> Table:
    """How often an exactly right closure is called inaccurate, with and without the bound of unseen
    branches."""
    found = pd.read_csv(Path(__file__).parent / "results" / "unseen.csv")
    rows = [
        [
            r["scene"],
            short(r["kurtosis"]),
            f"{r['paths']:,}",
            f"{r['inaccurate']} of {r['seeds']}",
            f"{r['inaccurate_without']} of {r['seeds']}",
            _share(r["wrong_again"], r["seeds"]),
            f"{r['decided']:.1%}",
            f"{r['decided_without']:.1%}",
            f"{r['decided_again']:.1%}" if r["decided_again"] > 0.0 else "",
            f"{r['held']:.0f} of {r['reached']:.0f}" if r["reached"] > 0.0 else "",
        ]
        for r in found.to_dict("records")
    ]
    head = [
        "scene",
        "largest kurtosis",
        "paths",
        "called inaccurate",
        "without",
        "any row, judged again",
    ]
    return [
        *head,
        "rows decided",
        "decided without",
        "decided, judged again",
        "0.03 sd reached, and true",
    ], rows


def _share(hits: float, of: int) -> str:
    """A count with the 95 % interval of its share (Clopper and Pearson 1934); nothing where none
    was measured."""
    if not hits >= 0.0:
        return ""
    low, high = binomtest(int(hits), of).proportion_ci()
    return f"{hits:.0f} of {of} ({low:.2%} to {high:.2%})"


BEFORE = ("before: beyond the bound", "before: wrong", "before: wrong, unmarked")


@table
def branching(reports: Path) -> Table:
    """Errors of `branching` on random gear sets, its own bounds of them, and the time beside exact
    flights."""
    found = pd.read_csv(Path(__file__).parent / "results" / "branching.csv")
    rows = []
    every = found.assign(noise="all")
    for (seen, noise), of in [*found.groupby(["seen", "noise"]), *every.groupby(["seen", "noise"])]:
        total = of["rows"].sum()
        before = of["rows_before"].sum()
        used = of[of["advice"] == "branching"]
        faster = (
            f"{short(used['ratio'].min(), 2)} / {short(used['ratio'].median(), 2)}"
            if len(used)
            else "–"
        )
        rows.append(
            [
                "for tuning" if seen else "unseen",
                noise if noise == "all" else short(noise),
                *(
                    f"{short(of[c].median(), 2)} / {short(of[c].max(), 2)}"
                    for c in ("error_mean", "error_sd")
                ),
                *(
                    f"{of[c].sum() / total:.1%}"
                    for c in ("exceeded", "factor", "wrong", "unmarked")
                ),
                *(
                    f"{of[f'{c}_before'].sum() / before:.1%}"
                    for c in ("exceeded", "wrong", "unmarked")
                ),
                f"{len(used)} of {len(of)}",
                faster,
            ]
        )
    head = [
        "gear sets",
        "σ/√α",
        "worst mean: median / largest",
        "worst sd",
        "beyond the bound",
        "within a factor of 2",
    ]
    return [*head, "wrong", "wrong, unmarked", *BEFORE, "advised", "speed-up: least / median"], rows


@table
def fixed_times(reports: Path) -> Table:
    """Errors of `branching` and `saltation` at fixed times."""
    found = pd.read_csv(Path(__file__).parent / "results" / "fixed_times.csv")
    rows = []
    for (seen, noise), of in found.groupby(["seen", "noise"]):
        row = ["looked at" if seen else "unseen", short(noise)]
        for closure in ("branching", "saltation"):
            for moment in ("mean", "sd"):
                median = of[f"{closure}_{moment}_median"]
                largest = of[f"{closure}_{moment}_largest"]
                row.append(f"{short(median.median(), 2)} / {short(largest.max(), 2)}")
        rows.append(row)
    heads = [
        f"`{closure}`: {of}" for closure in ("branching", "saltation") for of in ("mean", "sd")
    ]
    return ["gear sets", "σ/√α", *heads], rows


@table
def speed(reports: Path) -> Table:
    """What a closure saves where it holds."""
    found = pd.read_csv(reports / "dat21" / "speed.csv")
    rows = [
        [
            r["closure"],
            short(r["sigma"]),
            short(r["impacts"]),
            ("" if r["resolved"] else "≤ ") + short(r["worst"], 2),
            seconds(r["closure_seconds"]),
            seconds(r["simulation_seconds"]),
            ("" if r["resolved"] else "≥ ") + f"{float(format(r['speed_up'], '.2g')):g}",
        ]
        for _, r in found.iterrows()
    ]
    return ["closure", "σ", "impacts", "worst error [sd]", "closure", "simulation", "ratio"], rows


@table
def shares(reports: Path) -> Table:
    """Share of the predicted means and sds that are accurate, over the noise intensities of the
    default study."""
    errors = pd.read_parquet(reports / "studies" / "noise" / "errors.parquet")
    errors = errors[
        (errors["kind"] == "section")
        & errors["verdict"].isin(["accurate", "inaccurate", "undecided"])
    ]
    errors = errors[errors["judged"]]
    agreement = (
        errors[errors["impact"] == errors["impact"].max()].groupby("sigma")["agreement"].max()
    )
    rows = []
    for sigma in sorted(errors["sigma"].unique())[::2]:
        row = [short(sigma), f"{agreement[sigma]:.2f}"]
        for closure in CLOSURES:
            verdicts = errors.loc[
                (errors["sigma"] == sigma) & (errors["closure"] == closure), "verdict"
            ]
            row.append(
                f"{(verdicts == 'accurate').mean():.2f} ({(verdicts != 'inaccurate').mean():.2f})"
            )
        rows.append(row)
    return ["σ", "paths on one itinerary", *CLOSURES], rows


@table
def memory(reports: Path) -> Table:
    """Between which correlation times white noise begins to mislead about each quantity of
    DAT21."""
    sections = pd.read_parquet(reports / "studies" / "memory" / "sections.parquet")
    long = pd.read_parquet(reports / "studies" / "long-memory" / "quantities.parquet")
    sections = sections[
        sections["quantity"].isin(MOMENTS) & sections["moment"].isin(("mean", "sd"))
    ]
    found = pd.concat(
        [sections, long[long["quantity"].isin(AVERAGES)].assign(moment="", impact=0)],
        ignore_index=True,
    )
    at = ["sigma", "quantity", "impact"]
    white = found[found["correlation_time"] == 0.0]
    sds = white[white["moment"] == "sd"].set_index(at)["value"].rename("sd")
    found = (
        found[found["correlation_time"] > 0.0]
        .merge(white, on=[*at, "moment"], suffixes=("", "_white"))
        .join(sds, on=at)
    )
    off = (found["value"] - found["value_white"]).abs()
    half = widest(len(found)) * np.hypot(found["se"], found["se_white"])
    allowed = found["sd"].fillna(found["value_white"]) * np.where(
        found["moment"] == "sd", 0.1, 0.05
    )
    found = found.assign(right=off + half <= allowed, wrong=off - half > allowed)
    rows = []
    for (moment, quantity), of in found.groupby(["moment", "quantity"], sort=False):
        row = [f"{moment} of {MOMENTS[quantity]}" if moment else AVERAGES[quantity]]
        for _, own in of.groupby("sigma"):
            by = own.groupby("correlation_time")
            right = by["right"].all().cummin()
            wrong = by["wrong"].any()
            first = (
                f"{wrong.index[wrong][0]:g}" if wrong.any() else f"(none up to {wrong.index[-1]:g})"
            )
            row.append(f"{right.index[right][-1] if right.any() else 0.0:g} – {first}")
        rows.append(row)
    return ["", *(f"σ = {s:g}" for s in sorted(found["sigma"].unique()))], rows


@table
def claims(reports: Path) -> Table:
    """The claims of the paper, each with its verdict."""
    found = pd.read_csv(reports / "claims" / "claims.csv")
    return ["", "claim", "test", "evidence", "verdict"], [
        [str(r["claim"]), f"{r['name']}: “{r['says']}”", r["test"], r["evidence"], r["verdict"]]
        for _, r in found.iterrows()
    ]


@table
def exponents(reports: Path) -> Table:
    """Lyapunov exponents of the orbit, and of the linearisation along a noisy path."""
    found = pd.read_csv(reports / "chaos" / "exponents.csv")
    rows = [
        [str(name), *(interval(r, "value") for _, r in of.iterrows())]
        for name, of in found.groupby("of", sort=False)
    ]
    return ["exponents per unit of τ", "largest", "second", "third", "fourth"], rows


@table
def finite_size(reports: Path) -> Table:
    """The finite-size exponent of two paths on one noise."""
    found = pd.read_csv(reports / "chaos" / "fsle.csv")
    return ["distance δ", "finite-size exponent", "events"], [
        [f"{r['delta']:.1e}", interval(r, "exponent", 2), short(r["events"])]
        for _, r in found.iterrows()
    ]


@table
def mean_maps(reports: Path) -> Table:
    """The closures as iterated maps."""
    found = pd.read_csv(reports / "chaos" / "mean_maps.csv")
    heads = [
        "closure",
        "map",
        "exponents of its means",
        "growth of its moments",
        "first impact that is not realizable",
    ]
    return heads, [
        [r["closure"], r["map"], r["exponents"], r["moments"], short(r["not_realizable"])]
        for _, r in found.iterrows()
    ]


@table
def crossings(reports: Path) -> Table:
    """Where the largest exponent changes its sign over the excitation."""
    found = pd.read_csv(reports / "chaos" / "crossings.csv")
    return ["of", "α between", "becomes"], [
        [r["of"], f"{r['low']:.3f} and {r['high']:.3f}", "positive" if r["to"] > 0 else "negative"]
        for _, r in found.iterrows()
    ]


@table
def tradeoff(reports: Path) -> Table:
    """What an accuracy costs with each scheme and each closure."""
    found = pd.read_csv(reports / "tradeoff" / "tradeoff.csv")
    return ["method", "error [sd]", "step", "paths", "core time", "measured"], [
        [
            r["method"] + (" (means alone)" if r["kind"] == "multilevel" else ""),
            short(r["error"]),
            short(r["dt"]),
            short(r["paths"] or math.nan),
            seconds(r["core_seconds"]),
            "yes" if r["measured"] else "extrapolated",
        ]
        for _, r in found.iterrows()
    ]


@table
def orders(reports: Path) -> Table:
    """Measured slopes of the step bias of the Euler-Maruyama schemes, and the orders on which they
    have settled."""
    found = pd.read_csv(reports / "tradeoff" / "orders.csv", keep_default_na=False, na_values=[""])
    rows = [
        [
            r["scheme"],
            short(r["sigma"]),
            " ".join(str(r[n]) for n in ("moment", "quantity") if not pd.isna(r[n])),
            f"{r['coarsest']:g} to {r['finest']:g}",
            interval(r, "slope", 2),
            (
                "not settled"
                if pd.isna(r["order"])
                else f"{r['order']:.2f} ± {0.5 * (r['order_high'] - r['order_low']):.2f}"
            ),
            short(r["limit_z"], 2),
            short(r["limit_allowed"], 2),
        ]
        for _, r in found[found["slope"].notna()].iterrows()
    ]
    return [
        "scheme",
        "σ",
        "moment",
        "steps",
        "slope",
        "order",
        "limit off by [se]",
        "allowed",
    ], rows


@table
def control(reports: Path) -> Table:
    """By what factor the control variate and antithetic pairs divide the variance."""
    found = pd.read_csv(reports / "tradeoff" / "control.csv")
    heads = [
        "σ",
        "control: means",
        "control: sds",
        "antithetic: means",
        "antithetic: sds",
        "time of the control",
    ]
    names = [
        "sigma",
        "means_median",
        "sds_median",
        "antithetic_means",
        "antithetic_sds",
        "time_ratio",
    ]
    return heads, [[short(r[name]) for name in names] for _, r in found.iterrows()]


@table
def levels(reports: Path) -> Table:
    """Multilevel Monte Carlo over the step."""
    found = pd.read_csv(reports / "tradeoff" / "levels.csv")
    heads = ["scheme", "level", "step", "variance of the difference (median)", "kurtosis (largest)"]
    names = ["scheme", "level", "dt", "variance_median", "kurtosis"]
    return heads, [[short(r[name]) for name in names] for _, r in found.iterrows()]


@table
def stability(reports: Path) -> Table:
    """Verdicts on the cells of the stability map whose step is admissible."""
    found = pd.read_csv(reports / "stability" / "stability.csv")
    found = found[found["share"] <= 1.0]
    verdicts = ("unbiased", "undecided", "biased", "unstable", "no limit")
    rows = []
    for scheme, of in found.groupby("scheme", sort=False):
        wrong = of[of["verdict"].isin(("biased", "unstable"))]
        counts = [short(int((of["verdict"] == v).sum())) for v in verdicts]
        rows.append([str(scheme), *counts, f"{int(wrong['diagnosed'].sum())} of {len(wrong)}"])
    return ["scheme", *verdicts, "biased or unstable, with a diagnostic"], rows


@table
def extremes(reports: Path) -> Table:
    """Extreme values: what was tried, against which truth, with what worst error."""
    found = pd.read_csv(reports / "stability" / "extremes.csv")
    return ["what", "tried", "truth", "worst error", "allowed", "in units of", "holds"], [
        [
            r["name"],
            r["tried"],
            r["truth"],
            short(r["worst"]),
            short(r["allowed"]),
            r["unit"],
            short(r["holds"]),
        ]
        for _, r in found.iterrows()
    ]


def _outcomes(folder: Path) -> Table:
    """How the scenes of a campaign ended, by entry point."""
    found = json.loads((folder / "summary.json").read_text())
    kinds = ("complete", "stopped", "refused", "defect")
    rows = [[n, *(short(ends.get(k, 0)) for k in kinds)] for n, ends in found["entries"].items()]
    return ["entry", *kinds], [*rows, ["all", *(short(found["ended"].get(k, 0)) for k in kinds)]]


@table
def fuzz(reports: Path) -> Table:
    """Random scenes near the paper's example and beyond it."""
    return _outcomes(reports / "fuzz")


@table
def fuzz_wide(reports: Path) -> Table:
    """Random scenes of any magnitude."""
    return _outcomes(reports / "fuzz-wide")


@table
def benchmarks(reports: Path) -> Table:
    """Times on one machine, kept beside this file: they are measured by hand and hold for the
    version beside them."""
    found = pd.read_csv(Path(__file__).parent / "benchmarks.csv")
    return list(found.columns), found.fillna("").astype(str).to_numpy().tolist()


@table
def first_answer(reports: Path) -> Table:
    """What the first answer takes in an older version and in this one, with nothing kept and with
    machine code kept."""
    found = pd.read_csv(Path(__file__).parent / "results" / "first_answer.csv")
    wide = found.pivot_table(
        index=["what", "state"],
        columns="version",
        values=["cpu_seconds", "wall_seconds"],
        sort=False,
    )
    heads = [f"{version}: {of} s" for of in ("processor", "wall") for version in ("before", "now")]
    order = [
        (of, version) for of in ("cpu_seconds", "wall_seconds") for version in ("before", "now")
    ]
    rows = [
        [*names, *(short(values[column], 3) for column in order)]
        for names, values in wide.iterrows()
    ]
    return ["", "machine code", *heads], rows


@table
def path_steps(reports: Path) -> Table:
    """What ``rattle check speed --json`` has printed on the machine that the page names, kept
    beside this file."""
    found = json.loads((Path(__file__).parent / "path_steps.json").read_text(encoding="utf-8"))
    columns = {
        "what": "",
        "ns": "ns",
        "times_floor": "times the floor",
        "gain": "times as fast",
        "us": "µs per path",
    }
    rows = [
        [short(math.nan if row[name] is None else row[name]) for name in columns] for row in found
    ]
    return list(columns.values()), rows


def cell(text: str) -> nodes.entry:
    """A cell; between two backticks stands code."""
    paragraph = nodes.paragraph()
    for i, part in enumerate(text.split("`")):
        if part:
            paragraph += nodes.literal("", part) if i % 2 else nodes.Text(part)
    return nodes.entry("", paragraph)


class FromReports(SphinxDirective):
    """What all of these directives share."""

    @property
    def reports(self) -> Path:
        """The folder of the reports."""
        return Path(self.config.rattle_reports)

    def noted(self, path: Path) -> Path:
        """A file, noted so that the page is read again when it changes."""
        if not path.exists():
            raise self.error(f"{path} is missing: make the reports first")
        self.env.note_dependency(str(path))
        return path


class Reported(FromReports):
    """A table of `TABLES`."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Make it."""
        name = self.arguments[0]
        try:
            heads, rows = TABLES[name](self.reports)
        except (OSError, KeyError) as error:
            raise self.error(
                f"the table {name} cannot be made of {self.reports}: {error!r}"
            ) from None
        whole = nodes.table(classes=["reported", f"reported-{name}"])
        group = nodes.tgroup(cols=len(heads))
        group += [nodes.colspec(colwidth=1) for _ in heads]
        group += nodes.thead("", nodes.row("", *map(cell, heads)))
        group += nodes.tbody("", *(nodes.row("", *map(cell, row)) for row in rows))
        whole += group
        return [nodes.container("", whole, classes=["wide-table"])]


class Answer(FromReports):
    """The sentences that open a report."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Make them."""
        file = self.noted(self.reports / self.arguments[0] / "page.json")
        items = nodes.bullet_list(classes=["answer"])
        for sentence in json.loads(file.read_text())["page"]["answer"]:
            items += nodes.list_item("", *cell(sentence).children)
        return [items]


class ReportedFigure(FromReports):
    """A figure of a report."""

    required_arguments = 1
    has_content = True
    option_spec = {"alt": directives.unchanged_required}  # noqa: RUF012  (as Sphinx wants it)

    def run(self) -> list[nodes.Node]:
        """Make it."""
        file = self.noted(self.reports / self.arguments[0])
        place = os.path.relpath(file, Path(self.env.doc2path(self.env.docname)).parent)
        image = nodes.image(uri=place, alt=self.options["alt"])
        caption = nodes.caption("", "", *self.parse_inline(" ".join(self.content))[0])
        return [nodes.figure("", image, caption)]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives, and the folder that they read."""
    app.add_config_value("rattle_reports", "", "env", [str])
    app.add_directive("reported", Reported)
    app.add_directive("answer", Answer)
    app.add_directive("reported-figure", ReportedFigure)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
