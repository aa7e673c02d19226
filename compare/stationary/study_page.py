"""What a study of the long run, ``r``, which is `rattle.compare.stationary.study.LongTables`, says and shows."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.report import Block, Column, PageSection, Table, Text, numbers
from rattle.compare.report.glossary import CLOSURE_TERMS, VERDICT_TERMS, glossary
from rattle.compare.report.style import STYLE, new_figure
from rattle.compare.stationary.verdicts import TOLERANCES
from rattle.compare.study.figures import label_field, panels
from rattle.compare.study.folder import Drawing
from rattle.compare.validation.verdict import JUDGED, span

CAPTION = (
    "The long run over the field that varies, with 95 % intervals: impacts, energy lost, speeds, slow impacts, and the "
    "share of its quantities that each closure has right (no curve where it predicts none). Units: the drive's angular "
    "frequency ω, the backlash ν₁ of mesh 1, inertia I₁ and radius R₁ of wheel 1."
)


PANELS = (
    ("impacts", r"per $1/\omega$", ("rate", "rate_mesh1", "rate_mesh2")),
    (
        "energy lost",
        r"$I_1/R_1^2\,(\nu_1\omega)^2$ per period",
        ("energy_per_period", "energy_per_period_mesh1", "energy_per_period_mesh2"),
    ),
    ("speed: 5, 50 and 95 %", r"$\nu_1\omega$", ("q05_speed", "q50_speed", "q95_speed")),
    ("slow impacts", "share", ("slow_share", "slow_share_mesh1", "slow_share_mesh2")),
)
AVERAGES = ("speed", "slow_share", "energy_per_period")
"""Quantities whose autocorrelation is drawn."""
STYLES: Any = [
    {"color": color, "marker": marker, "ms": 3, "lw": 1.0}
    for color, marker in (("#000000", "D"), ("#0072B2", "o"), ("#D55E00", "s"))
]


def study_figure(along: str, quantities: pd.DataFrame, verdicts: pd.DataFrame) -> Figure:
    """Draw rates, losses, speeds, slow shares and the closures' verdicts over the first field that varies."""
    figure, axes = new_figure(10.0, 6.0, 2, 3)
    of = dict(iter(quantities.groupby("quantity")))
    for ax, (title, unit, names) in zip(axes, PANELS, strict=False):
        for name, style in zip(names, STYLES, strict=True):
            if name in of:
                rows = of[name].sort_values(along)
                ax.fill_between(rows[along], rows["low"], rows["high"], color=style["color"], alpha=0.25, lw=0)
                ax.plot(rows[along], rows["value"], label=name, **style)
        ax.set_title(title, loc="left")
        ax.set_ylabel(unit)
    memory, shown = axes[4:]
    averages = [name for name in quantities["quantity"].unique() if name in AVERAGES]
    for name, style in zip(averages, STYLES, strict=False):
        memory.plot(of[name][along], of[name]["autocorrelation"], label=name, **style)
    memory.set(yscale="log", ylabel="impacts")
    memory.set_title("autocorrelation time", loc="left")
    good = shares(verdicts, along).dropna(axis="columns", how="all")
    for closure in good:
        shown.plot(good.index, good[closure], lw=1.2, ms=4, label=str(closure), **STYLE[str(closure)])
    shown.set(ylabel="share", ylim=(-0.05, 1.05), visible=not good.empty)
    shown.set_title("accurate quantities", loc="left")
    for ax in axes:
        label_field(ax, along, quantities[along])
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize=6)
    return figure


def shares(verdicts: pd.DataFrame, along: str) -> pd.DataFrame:
    """How many quantities of each closure are accurate at each value of a field.

    Returns: Index the field; for each closure the share of its judged quantities that are accurate, NaN without
    any.
    """
    if verdicts.empty:
        return pd.DataFrame()
    judged = verdicts[verdicts["verdict"].isin(JUDGED)]
    good = judged.assign(good=judged["verdict"] == "accurate").groupby([along, "closure"])["good"].mean().unstack()
    return good.reindex(sorted(verdicts[along].unique()))


def answer(r: Any) -> list[str]:
    """Summarise a study of the long run in a few sentences."""
    if r.empty:
        return ["No point could be computed; the command says why."]
    name, said = r.study.along or "the points", []
    for quantity, words in (("rate", "impacts per unit of time"), ("energy_per_period", "energy lost per period")):
        rows = r.quantities[r.quantities["quantity"] == quantity].sort_values("value")
        ends = [f"{row['value']:.4g}" for row in (rows.iloc[0], rows.iloc[-1])]
        if ends[0] == ends[1]:
            said.append(f"{words}: {ends[0]}")
            continue
        if r.study.along:
            ends = [f"{e} (at {name} = {rows[r.study.along].iloc[i]:.4g})" for e, i in zip(ends, (0, -1), strict=True)]
        said.append(f"{words}: from {' to '.join(ends)}")
    sentences = [f"In the long run, {said[0]}.", f"{said[1][0].upper()}{said[1][1:]}."]
    if r.study.along and not r.verdicts.empty:
        good = shares(r.verdicts, r.study.along)
        for closure in r.study.closures:
            own = good[closure].dropna() if closure in good else pd.Series(dtype=float)
            if own.empty:
                why = r.verdicts[r.verdicts["closure"] == closure]["reason"].iloc[0]
                sentences.append(f"`{closure}` predicts nothing of the long run at any value: {why}.")
                continue
            sentences.append(
                f"`{closure}` predicts the long run at {len(own)} of {len(good)} values of {name}, and is fully "
                f"accurate at {(own == 1.0).sum() or 'none'} of them; {span(own, '.0%')} of its quantities are "
                "accurate."
            )
    other = r.cost[r.cost["kind"] != "simulated"]
    if len(other):
        sentences.append(f"At {len(other)} of {len(r.cost)} points nothing is random and the values are exact.")
    return sentences


def draw(r: Any) -> list[Drawing]:
    """Draw the figure, where a field varies, once for all values of the others."""
    drawn = []
    for number, (fixed, _) in enumerate(panels(r.study, r.quantities), 1):
        own = f"figures/long-run-{number}" if fixed else "figures/long-run"
        at = "".join(f" {field} = {v}." for field, v in fixed.items())
        drawn.append(Drawing(own, r.plot(**fixed), CAPTION + at))
    return drawn


def blocks(
    r: Any, record: Mapping[str, Any], seconds: Mapping[str, float]
) -> tuple[tuple[Block, ...], tuple[PageSection, ...]]:
    """The main quantities at every point and the words above the sections of the page."""
    words = glossary(*CLOSURE_TERMS, *VERDICT_TERMS, "exact flight", "σ", "ε", "orbit", gears=r.study.gears)
    return (_main(r), Text(TOLERANCES, note=True), words), ()


def _main(r: Any) -> Table:
    """The main quantities at every point, with half widths of their intervals."""
    names = r.study.names
    shown = ("rate", "speed", "energy_per_period", "slow_share")
    heads = [Column(n) for n in names] + list(numbers(*(x for n in shown for x in (n, "±")), "burn-in", "periods"))
    rows = []
    for _, point in r.cost.iterrows():
        own = r.quantities[(r.quantities[names] == point[names]).all(axis="columns")].set_index("quantity")
        half = 0.5 * (own["high"] - own["low"])
        main = (column.get(name, np.nan) for name in shown for column in (own["value"], half))
        rows.append([*(f"{point[n]}" for n in names), *main, float(point["burn_in"]), float(point["periods"])])
    return Table.of(heads or ["the only point"], rows, "Every point" if len(rows) > 12 else "")
