"""What a study of the long run says: its answer in a few sentences, its figure and the blocks of its page."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.report import Block, Column, PageSection, Table, Text, numbers
from rattle.compare.report.glossary import CLOSURE_TERMS, VERDICT_TERMS, glossary
from rattle.compare.stationary.study import LongTables
from rattle.compare.stationary.study_figure import shares
from rattle.compare.stationary.verdicts import TOLERANCES
from rattle.compare.study.figures import panels
from rattle.compare.study.folder import Drawing
from rattle.compare.validation.verdict import span

CAPTION = (
    "The long run over the field that varies, with 95 % intervals: impacts, energy lost, speeds, slow impacts, and the "
    "share of its quantities that each closure has right (no curve where it predicts none). Units: the drive's angular "
    "frequency ω, the backlash ν₁ of mesh 1, inertia I₁ and radius R₁ of wheel 1."
)


def answer(r: LongTables) -> list[str]:
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


def draw(r: LongTables) -> list[Drawing]:
    """Draw the figure, where a field varies, once for all values of the others."""
    drawn = []
    for number, (fixed, _) in enumerate(panels(r.study, r.quantities) if r.study.along and not r.empty else ()):
        at = "".join(f" {field} = {v}." for field, v in fixed.items())
        drawn.append(
            Drawing(f"figures/long-run-{number + 1}" if fixed else "figures/long-run", r.plot(**fixed), CAPTION + at)
        )
    return drawn


def blocks(
    r: LongTables, record: Mapping[str, Any], seconds: Mapping[str, float]
) -> tuple[tuple[Block, ...], tuple[PageSection, ...]]:
    """The main quantities at every point and the words above the sections of the page."""
    words = glossary(*CLOSURE_TERMS, *VERDICT_TERMS, "exact flight", "σ", "ε", "orbit", gears=r.study.gears)
    return (_main(r), Text(TOLERANCES, note=True), words), ()


def _main(r: LongTables) -> Table:
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
