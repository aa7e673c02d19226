"""Sequential testing of a claim: interim looks with more and more paths until it is decided or its budget is spent.

The sizes of all looks are fixed beforehand, and the intervals have simultaneous coverage over all rows of the claim at
all looks (Bonferroni).  Therefore looks may be skipped depending on earlier ones, and the first decision on a row is
final.  Other claims do not widen them: a verdict does not depend on which tests run beside it.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import pandas as pd

from rattle.compare.study.cells import Sample
from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.judging import errors_of, judge_errors
from rattle.compare.thresholds.prediction import Prediction
from rattle.compare.thresholds.sessions import Drawn, Thresholds
from rattle.compare.validation.verdict import widest


class Looked(NamedTuple):
    """The decision on a claim."""

    table: pd.DataFrame  # its rows, each as of the look that decided it
    drawn: tuple[Drawn, ...]  # the simulation of each look that was taken
    z: float  # half width of the intervals in standard errors


def following(later: Sequence[int], table: pd.DataFrame) -> int | None:
    """Choose the number of paths of the next look: the first that should decide every row, or the last.

    Returns: None if no look is left, the claim has failed, or no number of paths would decide any row.

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
    """Combine the rows of two looks: decided rows are kept, undecided ones are taken from the later look."""
    return before.where(before["outcome"] != "undecided", now)


def decide(prediction: Prediction, claim: Claim, session: Thresholds) -> Looked:
    """Compare a prediction with the simulation, with more paths while the claim is undecided."""
    sizes, settings = session.settings.sizes(claim), session.settings
    z = widest(len(claim.rows) * len(sizes), settings.false_alarm)

    def look(paths: int | None) -> tuple[pd.DataFrame, Drawn]:
        sample = Sample(claim.scene, claim.impacts[-1], settings.seed, claim.scheme, paths, claim.accuracy)
        drawn = session.draw(sample)
        return judge_errors(errors_of(prediction, drawn.run, claim), z), drawn

    return Looked(*look_until_decided(sizes, look), z)


def look_until_decided(
    sizes: Sequence[int | None], look: Callable[[int | None], tuple[pd.DataFrame, Drawn]]
) -> tuple[pd.DataFrame, tuple[Drawn, ...]]:
    """The rows, each as of the look that decided it, and the simulation of each look that was taken."""
    table, first = look(sizes[0])
    drawn, later = [first], [paths for paths in sizes[1:] if paths is not None]
    while (paths := following(later, table)) is not None:
        now, more = look(paths)
        table, drawn = standing(table, now), [*drawn, more]
        later = [size for size in later if size > paths]
    return table, tuple(drawn)
