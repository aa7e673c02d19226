"""A claim is looked at with more and more paths until it is decided or its budget is spent.

The sizes of all looks are fixed beforehand, and every interval is as wide as all rows at all looks demand (Bonferroni).
So all of them hold at once: it may depend on what has been seen which looks are taken, and the first decision stands.
"""

from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd

from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.judging import errors_of, judged
from rattle.compare.thresholds.prediction import Prediction
from rattle.compare.thresholds.sessions import Drawn, Thresholds

__all__ = ["Looked", "decide", "following", "standing"]


class Looked(NamedTuple):
    """What became of a claim: its rows as they were decided, and the ensemble of each look that was taken."""

    table: pd.DataFrame
    drawn: tuple[Drawn, ...]


def following(later: Sequence[int], table: pd.DataFrame) -> int | None:
    """The next look's number of paths: the first of those left that should decide every row, or the last.

    None where no look is left, where the claim has failed, and where no number of paths would decide any row.

    Examples
    --------
    >>> table = pd.DataFrame({"outcome": ["pass", "undecided"], "paths_needed": [float("nan"), 3000.0]})
    >>> following([2048, 4096, 8192], table), following([2048], table), following([], table)
    (4096, 2048, None)
    """
    needed = table.loc[table["outcome"] == "undecided", "paths_needed"].max()  # NaN where there is none
    if not later or (table["outcome"] == "fail").any() or pd.isna(needed):
        return None
    return next((paths for paths in later if paths >= needed), later[-1])


def standing(before: pd.DataFrame, now: pd.DataFrame) -> pd.DataFrame:
    """Rows of two looks: what has been decided stands, what has not is as the later look says."""
    return before.where(before["outcome"] != "undecided", now)


def decide(prediction: Prediction, claim: Claim, session: Thresholds) -> Looked:
    """Hold a prediction against the simulation, and go on simulating while that is undecided.

    Raises
    ------
    RattleError
        If the scene cannot be simulated, or an ensemble not be kept.
    """
    drawn: list[Drawn] = []

    def seen(paths: int | None) -> pd.DataFrame:
        drawn.append(session.ensemble(claim, paths))
        return judged(errors_of(prediction, drawn[-1].run, claim), session.z)

    first, *rest = session.settings.sizes(claim)
    table, later = seen(first), [paths for paths in rest if paths is not None]
    while (paths := following(later, table)) is not None:
        table = standing(table, seen(paths))
        later = [more for more in later if more > paths]
    return Looked(table, tuple(drawn))
