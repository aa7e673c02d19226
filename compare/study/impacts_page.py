"""What a study of impacts says: its answer in a few sentences, its figures and the content of its
page."""

from collections.abc import Mapping

import pandas as pd

from rattle.compare.judge.verdict import Verdict, in_words, is_accurate, want
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.report.texts import span
from rattle.compare.study.estimate import scaling
from rattle.compare.study.figures import STUDY_FIGURES, panels
from rattle.compare.study.folder import Drawing
from rattle.compare.study.impacts import Tables, find_validity
from rattle.compare.validation.errors import ON_ITINERARY, RULE

TEMPLATE = "study/impacts.j2"
# up to so many different ranges of validity of a closure are listed one by one in the answer
MOST_RANGES_LISTED = 4


def answer(r: Tables) -> list[str]:
    """Summarise a study in a few sentences.

    Returns: Advice, the range of validity of each closure over all impacts, and the itinerary
    agreement after the last.
    """
    impacts = r.study.impacts
    shares = r.sections.query("quantity == 'tau' and moment == 'mean' and impact == @impacts")
    agreement = span(shares["agreement"], ".1%") if len(shares) else ""
    if r.validity.empty:
        return render_sentences("study/answer.j2", impacts=impacts, agreement=agreement, ranges=[])
    last = r.validity[r.validity["impact"] == impacts]
    name = r.study.along
    values = r.errors[name]
    apart = r.errors[r.errors["kind"] == ON_ITINERARY]
    of_followers = find_validity(r.study, apart)
    return render_sentences(
        "study/answer.j2",
        impacts=impacts,
        agreement=agreement,
        name=name,
        values=span(values, ".4g"),
        largest=values.max(),
        accurate=_everywhere(last, "accurate").to_dict(),
        not_wrong=_everywhere(last, "not_inaccurate").to_dict(),
        partly=last["closure"][last["accurate"].notna()].unique().tolist(),
        ranges=_ranges(r, r.of_all_paths, last),
        on_itinerary=_ranges(r, apart, of_followers[of_followers["impact"] == impacts])
        if len(apart)
        else [],
    )


def _everywhere(last: pd.DataFrame, column: str) -> pd.Series:
    """The least range of each closure over the other fields; without those that have none
    somewhere."""
    return last.groupby("closure", sort=False)[column].min(skipna=False).dropna()


def _ranges(r: Tables, errors: pd.DataFrame, last: pd.DataFrame) -> list[str]:
    """A sentence for each closure."""
    every = last.groupby("closure", sort=False)
    return [f"`{closure}`: {_range_in_words(r, errors, rows)}." for closure, rows in every]


def _range_in_words(r: Tables, errors: pd.DataFrame, rows: pd.DataFrame) -> str:
    """A closure's range of validity at each value of the other fields; of many, only the smallest
    and the largest."""
    places: dict[
        str, list[str]
    ] = {}  # values of the other fields, by the sentence that holds there
    ranges = rows.sort_values(["accurate", "not_inaccurate"], na_position="first")
    judged = errors[errors["judged"]]
    for row in ranges.to_dict("records"):
        fixed = ["closure", *r.study.others]
        here = judged[(judged[fixed] == [row[name] for name in fixed]).all(axis="columns")]
        along = here[r.study.along]
        values = sorted(along.unique())
        sentence = in_words(
            r.study.along,
            values,
            row["accurate"],
            row["not_inaccurate"],
            ended=row["ended"],
            undecided=want(here[along <= row["not_inaccurate"]]),
            exact=[v for v in values if is_accurate(here.loc[along == v, "verdict"])],
        )
        place = ", ".join(f"{name} = {row[name]}" for name in r.study.others)
        places.setdefault(sentence, []).append(place)
    if len(places) == 1:
        return next(iter(places))
    if len(places) <= MOST_RANGES_LISTED:
        listed = (f"{sentence} (at {' and '.join(at)})" for sentence, at in places.items())
        return "; ".join(listed)
    (least, low), *_, (most, high) = places.items()
    return f"from {least} (at {low[0]}) to {most} (at {high[-1]})"


def draw(r: Tables) -> list[Drawing]:
    """Draw the figures, each once for all values of the fields that vary besides the first."""
    drawn = []
    for name, plot in STUDY_FIGURES.items():
        for number, (fixed, part) in enumerate(panels(r.study, getattr(r, plot.table)), 1):
            file = f"figures/{name}-{number}" if fixed else f"figures/{name}"
            at = ", ".join(f"{field} = {v}" for field, v in fixed.items())
            caption = f"{plot.title} ({at})." if at else f"{plot.title}."
            drawn.append(Drawing(file, plot.figure(r, part), caption))
    return drawn


def content(r: Tables, seconds: Mapping[str, float]) -> Facts:
    """What the template of the page shows: counts of verdicts, and the cost."""
    rows = r.of_all_paths
    kinds = [rows["closure"], rows["moment"] + "s"]
    verdicts = pd.DataFrame({verdict: rows["verdict"] == verdict for verdict in Verdict})
    counts = verdicts.groupby(kinds, sort=False).sum().rename_axis(["closure", "moments"])
    cost = r.cost.groupby("what", sort=False)["seconds"].agg(["count", "median", "sum"])
    return {
        "counts": counts.reset_index(),
        "cost": cost.reset_index(),
        "scaling": scaling(r.study.cells, seconds),
        "rule": RULE,
    }
