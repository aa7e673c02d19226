"""A claim of the paper with its verdict."""

from typing import NamedTuple

import pandas as pd

REPRODUCED, NOT_REPRODUCED, UNDECIDED = "reproduced", "not reproduced", "undecided"
HOLDS_ONLY = "holds only for {}"
PART = "holds in part"
KINDS = (NOT_REPRODUCED, UNDECIDED, PART, REPRODUCED)
"""Kinds of verdicts, from the worst to the best for the claim."""


class PaperClaim(NamedTuple):
    """A claim of the paper with its test, evidence and verdict."""

    name: str  # short title
    where: str  # place in the paper
    says: str  # the claim itself, in the paper's own words; ``…`` stands for words left out
    test: str  # what is measured, and the result for which the claim counts as reproduced
    evidence: str  # the measured numbers, with their intervals
    verdict: str  # ``reproduced``, ``not reproduced``, ``holds only for ...`` or ``undecided``

    @property
    def kind(self) -> str:
        """The kind of its verdict, one of `KINDS`."""
        return PART if self.verdict.startswith(HOLDS_ONLY.format("")) else self.verdict


def table(claims: list[PaperClaim]) -> pd.DataFrame:
    """Convert claims to a table."""
    return pd.DataFrame(claims, index=pd.RangeIndex(1, len(claims) + 1, name="claim"))
