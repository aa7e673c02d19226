"""What a study of impacts says: its answer in a few sentences, its figures and the content of its
page."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from rattle.compare.report.texts import CLOSURE_TERMS, SECTION_TERMS, VERDICT_TERMS
from rattle.compare.study.estimate import scaling
from rattle.compare.study.figures import STUDY_FIGURES, panels
from rattle.compare.study.folder import Drawing
from rattle.compare.study.impacts import Tables, find_validity
from rattle.compare.validation.errors import ON_ITINERARY
from rattle.compare.validation.verdict import (
    RULE,
    Verdict,
    in_words,
    is_accurate,
    join_words,
    span,
    want,
)

TEMPLATE = "study/impacts.j2"
SYMBOLS = ("exact flight", "σ", "α", "ε", "ρ1, ρ2", "orbit", "agreement")
WORDS = (*CLOSURE_TERMS, *SECTION_TERMS, *VERDICT_TERMS, *SYMBOLS)
# up to so many different ranges of validity of a closure are listed one by one in the answer
MOST_RANGES_LISTED = 4


def answer(r: Tables) -> list[str]:
    """Summarise a study in a few sentences.

    Returns: Advice, the range of validity of each closure over all impacts, and the itinerary
    agreement after the last.
    """
    sentences = []
    table = r.validity
    impacts = r.study.impacts
    if not table.empty:
        last = table[table["impact"] == impacts]
        name = r.study.along
        values = r.errors[name]
        sentences = [
            _advice(last, impacts, name, values.max()),
            f"Every section mean and sd of {impacts} impacts, {name} = {span(values, '.4g')}:",
            *_ranges(r, r.of_all_paths, last),
        ]
        if not (apart := r.errors[r.errors["kind"] == ON_ITINERARY]).empty:
            last = find_validity(r.study, apart).query("impact == @impacts")
            sentences += [
                "Of the paths on the noise-free itinerary alone:",
                *_ranges(r, apart, last),
            ]
    reached = r.sections[(r.sections["quantity"] == "tau") & (r.sections["moment"] == "mean")]
    shares = reached[reached["impact"] == impacts]["agreement"]
    if len(shares):
        sentences.append(
            f"After {impacts} impacts {span(shares, '.1%')} of the paths are on the noise-free"
            " itinerary."
        )
    return sentences or ["No point could be computed; the command says why."]


def _advice(last: pd.DataFrame, impacts: int, name: str, largest: float) -> str:
    """Which closure is accurate furthest, wherever the other fields of the study lie."""
    accurate, open_to = (_everywhere(last, column) for column in ("accurate", "not_inaccurate"))
    shown = name if name != "sigma" else "σ"
    over = f"over {impacts} impacts"
    if accurate.empty and not open_to.empty:
        each = join_words([f"`{c}` up to {shown} = {x:.4g}" for c, x in open_to.items()])
        return (
            f"Undecided: no closure is shown to be accurate {over} in every row of this study. Not"
            f" shown to be wrong: {each}. More paths would settle it; until then simulate."
        )
    if accurate.empty:
        some = [f"`{c}`" for c in last[last["accurate"].notna()]["closure"].unique()]
        where = f"; {join_words(some)} {'is' if len(some) == 1 else 'are'} at some" if some else ""
        return f"Simulate: no closure is accurate {over} in every row of this study{where}."
    best = [f"`{closure}`" for closure in accurate.index[accurate == accurate.max()]]
    take = f"Take {' or '.join(best)} up to {shown} = {accurate.max():.4g}"
    if accurate.max() >= largest:
        return f"{take}, the largest of this study: all means and sds {over} are accurate there."
    return (
        f"{take}; beyond it simulate: no closure is shown to be accurate {over} everywhere there."
    )


def _everywhere(last: pd.DataFrame, column: str) -> pd.Series:
    """The least range of each closure over the other fields; without those that have none
    somewhere."""
    return (
        last.groupby("closure", sort=False)[column]
        .agg(lambda limits: limits.min(skipna=False))
        .dropna()
    )


def _ranges(r: Tables, errors: pd.DataFrame, last: pd.DataFrame) -> list[str]:
    """A sentence for each closure."""
    every = last.groupby("closure", sort=False)
    return [f"`{closure}`: {_range_in_words(r, errors, rows)}." for closure, rows in every]


def _range_in_words(r: Tables, errors: pd.DataFrame, rows: pd.DataFrame) -> str:
    """A closure's range of validity at each value of the other fields; of many, only the smallest
    and the largest."""
    found: dict[str, list[str]] = {}  # values of the other fields, by the sentence that holds there
    for row in rows.sort_values(["accurate", "not_inaccurate"], na_position="first").to_dict(
        "records"
    ):
        own = errors[(errors["closure"] == row["closure"]) & errors["judged"]]
        for name in r.study.others:
            own = own[own[name] == row[name]]
        values = sorted(own[r.study.along].unique())
        lacking = want(own[own[r.study.along] <= row["not_inaccurate"]])
        ends = (row["accurate"], row["not_inaccurate"])
        exact = [value for value, at in own.groupby(r.study.along) if is_accurate(at["verdict"])]
        said = in_words(
            r.study.along, values, *ends, ended=row["ended"], undecided=lacking, exact=exact
        )
        found.setdefault(said, []).append(
            ", ".join(f"{name} = {row[name]}" for name in r.study.others)
        )
    if len(found) == 1:
        return next(iter(found))
    if len(found) <= MOST_RANGES_LISTED:
        return "; ".join(f"{said} (at {' and '.join(where)})" for said, where in found.items())
    (least, low), *_, (most, high) = found.items()
    return f"from {least} (at {low[0]}) to {most} (at {high[-1]})"


def draw(r: Tables) -> list[Drawing]:
    """Draw the figures, each once for all values of the fields that vary besides the first."""
    drawn = []
    for name, plot in STUDY_FIGURES.items():
        for number, (fixed, part) in enumerate(panels(r.study, getattr(r, plot.table)), 1):
            own = f"figures/{name}-{number}" if fixed else f"figures/{name}"
            at = ", ".join(f"{field} = {v}" for field, v in fixed.items())
            drawn.append(
                Drawing(
                    own, plot.figure(r, part), f"{plot.title} ({at})." if at else f"{plot.title}."
                )
            )
    return drawn


def content(r: Tables, seconds: Mapping[str, float]) -> dict[str, Any]:
    """What the template of the page shows: counts of verdicts, and the cost."""
    groups = r.of_all_paths.groupby(["closure", "moment"], sort=False)["verdict"]
    counts = [
        {"closure": c, "moments": f"{m}s"} | {v: int((said == v).sum()) for v in Verdict}
        for (c, m), said in groups
    ]
    cost = r.cost.groupby("what", sort=False)["seconds"].agg(["count", "median", "sum"])
    return {
        "counts": pd.DataFrame(counts),
        "cost": cost.reset_index(),
        "scaling": scaling(r.study.cells, seconds),
        "rule": RULE,
    }
