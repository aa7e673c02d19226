"""The key figure of the claims: each claim, and the kind of its verdict."""

from typing import Any

from matplotlib.figure import Figure

from rattle.compare.claims.claim import KINDS, NOT_REPRODUCED, PART, REPRODUCED, UNDECIDED, Claim
from rattle.compare.report.style import new_figure

MARKS: Any = {
    NOT_REPRODUCED: {"color": "#D55E00", "marker": "X"},
    UNDECIDED: {"color": "#999999", "marker": "^"},
    PART: {"color": "#E69F00", "marker": "D"},
    REPRODUCED: {"color": "#009E73", "marker": "o"},
}
"""Colours of Okabe and Ito's palette; place and marker tell the verdicts without colour as well."""


def verdict_figure(claims: list[Claim]) -> Figure:
    """Draw the verdict on each claim: a row for each claim, a column for each kind of verdict that occurs."""
    kinds = [kind for kind in KINDS if any(c.kind == kind for c in claims)]
    figure, (ax,) = new_figure(8.6, 0.27 * len(claims) + 0.7, 1, 1)
    for row, claim in enumerate(claims):
        ax.plot(kinds.index(claim.kind), row, ms=10, ls="none", **MARKS[claim.kind])
    ax.set_xticks(range(len(kinds)), [f"{kind}: {sum(c.kind == kind for c in claims)}" for kind in kinds])
    ax.set_yticks(range(len(claims)), [f"{number}. {claim.name}" for number, claim in enumerate(claims, start=1)])
    ax.tick_params(length=0, labeltop=True, labelbottom=False)
    ax.set_xlim(-0.5, len(kinds) - 0.5)
    ax.set_ylim(len(claims) - 0.5, -0.5)
    return figure
