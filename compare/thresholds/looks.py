"""Sequential testing of a claim: interim looks with more and more paths until it is decided or its budget is spent.

The sizes of all looks are fixed beforehand, and the intervals have simultaneous coverage over all rows at all looks
(Bonferroni).  Therefore looks may be skipped depending on earlier ones, and the first decision on a row is final.
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
    """The decision on a claim.

    Attributes
    ----------
    table : DataFrame
        Its rows, each as of the look that decided it.
    drawn : tuple of Drawn
        The ensemble of each look that was taken.
    """

    table: pd.DataFrame
    drawn: tuple[Drawn, ...]


def following(later: Sequence[int], table: pd.DataFrame) -> int | None:
    """Choose the number of paths of the next look: the first that should decide every row, or the last.

    Parameters
    ----------
    later : sequence of int
        Sizes of the remaining looks, ascending.
    table : DataFrame
        Rows so far, with ``outcome`` and ``paths_needed``.

    Returns
    -------
    int or None
        None if no look is left, the claim has failed, or no number of paths would decide any row.

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
    """Combine the rows of two looks: decided rows are kept, undecided ones are taken from the later look.

    Parameters
    ----------
    before, now : DataFrame
        Rows of the earlier and of the later look.

    Returns
    -------
    DataFrame
    """
    return before.where(before["outcome"] != "undecided", now)


def decide(prediction: Prediction, claim: Claim, session: Thresholds) -> Looked:
    """Compare a prediction with the simulation, with more paths while the claim is undecided.

    Parameters
    ----------
    prediction : Prediction
        What the closure predicts.
    claim : Claim
        What the test says of a model.
    session : Thresholds
        What the tests of the session share.

    Returns
    -------
    Looked

    Raises
    ------
    RattleError
        If the scene cannot be simulated, or an ensemble cannot be stored.
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
