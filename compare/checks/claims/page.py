"""All claims in the order of the paper; the page and the folder of ``rattle claims``."""

from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Drawing

from rattle.compare.chaos.figures import draw
from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.page import FIGURES
from rattle.compare.chaos.page import WORDS as CHAOS_WORDS
from rattle.compare.checks.claims.judges import (
    NOT_REPRODUCED,
    PART,
    REPRODUCED,
    TEXTS,
    UNDECIDED,
    PaperClaim,
)
from rattle.compare.report import Figure, Page, PageSection, Row, Table, TableCell, Text
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save
from rattle.compare.report.style import new_figure
from rattle.compare.report.texts import glossary
from rattle.compare.validation.verdict import join_words

SHOWN = [text.get("figure", "") for text in TEXTS.values()]
"""Figure of the study of chaos that shows the evidence of each claim, if there is one."""
KINDS = {
    NOT_REPRODUCED: ("is not reproduced", "are not reproduced", "bad", "X", "#D55E00"),
    UNDECIDED: ("is undecided", "are undecided", "open", "^", "#999999"),
    PART: ("holds only in part", "hold only in part", "part", "D", "#E69F00"),
    REPRODUCED: ("is reproduced", "are reproduced", "good", "o", "#009E73"),
}
"""Kinds of verdicts, from the worst to the best for the claim: in words, of one claim and of
several; mark of the cell; marker and colour in the figure, from Okabe and Ito's palette (place and
marker tell them without colour as well)."""
PARTS = (
    "The paper, {0.where}: “{0.says}”",
    "Verdict: {0.verdict}.",
    "Test: {0.test}",
    "Evidence: {0.evidence}",
)
"""Paragraphs of the section on a claim."""
KEY = "verdicts"
CAPTION = "The verdict on each claim, in the order of the paper."
CONTENTS = contents("claims", figures=(KEY, *filter(None, SHOWN)), tables=["claims"])
"""Files of such a folder; a folder with any other file is not overwritten."""
WORDS = (
    *CHAOS_WORDS,
    "ρ1, ρ2",
    "stage",
    "accurate",
    "reproduced",
    "not reproduced",
    "holds only for",
)


def answer(claims: list[PaperClaim]) -> list[str]:
    """Summarise how many claims have which verdict, and which are not reproduced."""
    counts = Counter(c.kind for c in claims)
    said = join_words(
        [f"{n} {KINDS[kind][n > 1]}" for kind in reversed(KINDS) if (n := counts[kind])]
    )
    failed = [f"“{c.name}”" for c in claims if c.kind == NOT_REPRODUCED]
    return [
        f"Of {len(claims)} testable claims of the paper"
        f" {said}{f': {join_words(failed)}' if failed else ''}."
    ]


def verdict_figure(claims: list[PaperClaim]) -> Drawing:
    """Draw the verdict on each claim: a row for each claim, a column for each kind of verdict that
    occurs."""
    kinds = [kind for kind in KINDS if any(c.kind == kind for c in claims)]
    figure, (ax,) = new_figure(8.6, 0.27 * len(claims) + 0.7, 1, 1)
    for row, claim in enumerate(claims):
        marker, colour = KINDS[claim.kind][3:]
        ax.plot(kinds.index(claim.kind), row, ms=10, ls="none", marker=marker, color=colour)
    ax.set_xticks(
        range(len(kinds)), [f"{kind}: {sum(c.kind == kind for c in claims)}" for kind in kinds]
    )
    ax.set_yticks(
        range(len(claims)),
        [f"{number}. {claim.name}" for number, claim in enumerate(claims, start=1)],
    )
    ax.tick_params(length=0, labeltop=True, labelbottom=False)
    ax.set(xlim=(-0.5, len(kinds) - 0.5), ylim=(len(claims) - 0.5, -0.5))
    return figure


def write_claims(
    out: Path, claims: list[PaperClaim], chaos: ChaosStudy, record: dict[str, Any], overwrite: bool
) -> list[str]:
    """Write the folder of the claims atomically."""
    said = answer(claims)
    drawn = {name: figure for name, figure in draw(chaos).items() if name in SHOWN}
    opening = Figure(f"{KEY}.svg", CAPTION, f"{CAPTION} {said[0]}")
    rows: list[Row] = [
        [str(i), c.says, TableCell(c.verdict, KINDS[c.kind][2]), c.where]
        for i, c in enumerate(claims, start=1)
    ]
    overview = Table.of(["claim", "the paper says", "verdict", "where"], rows)
    sections = []
    for i, (shown, claim) in enumerate(zip(SHOWN, claims, strict=True), start=1):
        pictures = (
            [Figure(f"{shown}.svg", FIGURES[shown], FIGURES[shown])] if shown in drawn else []
        )
        paragraphs = [Text(part.format(claim)) for part in PARTS]
        sections.append(PageSection(f"{i}. {claim.name}", (*paragraphs, *pictures)))
    blocks = opening, overview, glossary(*WORDS, gears=chaos.scene.gears)
    page = Page(
        "The paper's claims, judged", tuple(said), source_of(record), blocks, tuple(sections)
    )
    tables = {
        "claims": pd.DataFrame({"claim": range(1, len(claims) + 1)}).join(pd.DataFrame(claims))
    }
    drawn[KEY] = verdict_figure(claims)
    save(
        out,
        "claims",
        page,
        record,
        allowed=CONTENTS,
        figures=drawn,
        tables=tables,
        overwrite=overwrite,
    )
    return said
