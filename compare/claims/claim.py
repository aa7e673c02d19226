"""What a judged claim is."""

from typing import NamedTuple

import pandas as pd

__all__ = ["HOLDS_ONLY", "NOT_REPRODUCED", "REPRODUCED", "UNDECIDED", "Claim", "table"]

REPRODUCED, NOT_REPRODUCED, UNDECIDED = "reproduced", "not reproduced", "undecided"
HOLDS_ONLY = "holds only for {}"


class Claim(NamedTuple):
    """A claim of the paper and what became of it.

    Attributes
    ----------
    name : str
        A few words for it.
    where : str
        Place in the paper.
    says : str
        What it says.
    test : str
        What was measured, and when the claim counts as reproduced.
    evidence : str
        The numbers, with their intervals.
    verdict : str
        ``reproduced``, ``not reproduced``, ``holds only for ...`` or ``undecided``.
    """

    name: str
    where: str
    says: str
    test: str
    evidence: str
    verdict: str


def table(claims: list[Claim]) -> pd.DataFrame:
    """The claims, numbered from 1."""
    return pd.DataFrame(claims, index=pd.RangeIndex(1, len(claims) + 1, name="claim"))
