"""All claims in the order of the paper; the page and the folder of ``rattle check claims``."""

from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Drawing

from rattle.compare.chaos.figures import draw
from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.page import CHAOS_CAPTIONS
from rattle.compare.checks.claims.judges import (
    CLAIM_TEXTS,
    NOT_REPRODUCED,
    PaperClaim,
)
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.report.report import Report
from rattle.compare.report.style import new_figure
from rattle.compare.report.texts import REPORT_TEXTS, glossary

EVIDENCE_FIGURES = [text.get("figure", "") for text in CLAIM_TEXTS.values()]
"""Figure of the study of chaos that shows the evidence of each claim, if there is one."""
VERDICT_KINDS: Any = REPORT_TEXTS["marks"]["claims"]
"""Kinds of verdicts, from the worst to the best for the claim."""


def answer(claims: list[PaperClaim]) -> list[str]:
    """Summarise how many claims have which verdict, and which are not reproduced."""
    return render_sentences(
        "checks/claims/answer.j2", claims=claims, kinds=VERDICT_KINDS, failed=NOT_REPRODUCED
    )


def verdict_figure(claims: list[PaperClaim]) -> Drawing:
    """Draw the verdict on each claim: a row for each claim, a column for each kind of verdict that
    occurs."""
    kinds = [kind for kind in VERDICT_KINDS if any(c.kind == kind for c in claims)]
    figure, (ax,) = new_figure(8.6, 0.27 * len(claims) + 0.7)
    for row, claim in enumerate(claims):
        style = VERDICT_KINDS[claim.kind]["style"]
        ax.plot(kinds.index(claim.kind), row, ms=10, ls="none", **style)
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


def make_report(claims: list[PaperClaim], chaos: ChaosStudy, record: Facts) -> Report:
    """The report on the claims."""
    drawn = {name: figure for name, figure in draw(chaos).items() if name in EVIDENCE_FIGURES}
    numbered = pd.DataFrame({"claim": range(1, len(claims) + 1)}).join(pd.DataFrame(claims))
    marks = [VERDICT_KINDS[claim.kind]["cell"] for claim in claims]
    return Report(
        "claims",
        "The paper's claims, judged",
        answer(claims),
        record,
        {
            "rows": numbered.assign(mark=marks),
            "claims": list(zip(claims, EVIDENCE_FIGURES, strict=True)),
            "captions": CHAOS_CAPTIONS,
        },
        glossary("claims", gears=chaos.scene.gears),
        figures=drawn | {"verdicts": verdict_figure(claims)},
        tables={"claims": numbered},
        template="checks/claims/page.j2",
    )
