"""The three-way verdict on an error and its interval, the tolerances that decide it, and ranges of
validity in words.

*Accurate up to*: every judged moment is accurate, there and before.  *Not shown wrong up to*: none
is inaccurate, but beyond the first limit some are *undecided*: too few paths, or too long a step,
to decide.
"""

import math
from collections.abc import Iterable, Sequence
from enum import StrEnum
from itertools import takewhile
from operator import itemgetter
from typing import NamedTuple, TypeVar

import numpy as np
import pandas as pd

from rattle.compare.report.texts import join_words
from rattle.montecarlo.statistics.intervals import TOO_FEW


class Verdict(StrEnum):
    """A verdict on what a closure says, wherever one is given; why it is undecided says a remark
    beside it."""

    ACCURATE = "accurate"
    INACCURATE = "inaccurate"
    UNDECIDED = "undecided"
    NOT_PREDICTED = "not predicted"
    EXCLUDED = "excluded"


DECIDED = (Verdict.ACCURATE, Verdict.INACCURATE)
"""Verdicts that more paths do not change."""

JUDGED = (*DECIDED, Verdict.UNDECIDED)
"""Verdicts on rows that are judged and predicted; counts and sentences refer to these rows only."""

MARKS: dict[str, str] = {
    Verdict.ACCURATE: "good",
    Verdict.INACCURATE: "bad",
    Verdict.UNDECIDED: "open",
    Verdict.NOT_PREDICTED: "",
}
"""Mark of a table cell, see `rattle.compare.report.MARKS`; what is excluded has none."""

UNSEEN = ("unseen_low", "unseen_high", "unseen_paths")


class Tolerances(NamedTuple):
    """The largest errors that count as accurate.

    Attributes
    ----------
    mean, sd : float
        Of means and of sds, in units of the quantity's sd.
    rho : float
        Of correlation coefficients, absolute.
    skew, kurt : float
        Of skewness and excess kurtosis, absolute; ``rattle.judge`` alone judges them.

    Examples
    --------
    >>> Tolerances(mean=0.02).sd
    0.1
    """

    mean: float = 0.05
    sd: float = 0.10
    rho: float = 0.05
    skew: float = 0.2
    kurt: float = 0.5


def judge(table: pd.DataFrame) -> pd.DataFrame:
    """Give a verdict on each row: is the error of a predicted moment within its tolerance?

    `table`: Columns ``predicted, error, low, high, noise, tolerance, paths``; optionally ``judged``
    (bool), and ``unseen_low, unseen_high, unseen_paths`` (see `section_errors`).  ``low`` and
    ``high`` bound the error; ``noise`` is the part of the interval's half width that more paths
    would reduce.  An interval that so few paths cannot have is NaN. Returns: A copy with two more
    columns.  ``verdict``: ``accurate`` if the whole interval lies within the tolerance,
    ``inaccurate`` if all of it lies outside, else ``undecided``; ``not predicted`` where a value is
    missing, ``excluded`` where ``judged`` is False.  ``paths_needed``: the number of paths that
    would decide an undecided row, NaN where only a smaller step can: those that decide it whatever
    the branches do which this sample cannot have seen, or those that show these, whichever are
    fewer.
    """
    out = table.copy()
    for name in UNSEEN:
        out[name] = out[name].fillna(0.0) if name in out else 0.0
    numbers = ["predicted", "error", "low", "high", "noise", "tolerance"]
    out[numbers] = out[numbers].astype(float)  # an empty table has columns of type object
    error = out["error"]
    tolerance = out["tolerance"]
    inside, outside = _compare_interval(out["low"], out["high"], tolerance)
    excluded = ~out["judged"].astype(bool) if "judged" in out else np.zeros(len(out), bool)
    out["verdict"] = np.select(
        [excluded, out["predicted"].isna() | error.isna(), inside, outside],
        [Verdict.EXCLUDED, Verdict.NOT_PREDICTED, *DECIDED],
        Verdict.UNDECIDED,
    )
    # of what the sample has seen
    low = out["low"] + out["unseen_low"]
    high = out["high"] - out["unseen_high"]
    # what more paths do not reduce
    fixed = out.get("rest", 0.5 * (high - low) - out["noise"]).astype(float)
    margin = (error.abs() - tolerance).abs() - fixed
    # room that unseen branches leave at most
    beside = margin - out[["unseen_low", "unseen_high"]].max(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        needed, whatever = (
            out["paths"] * (out["noise"] / room.where(room > 0.0)) ** 2 for room in (margin, beside)
        )
    seen = np.logical_or(*_compare_interval(low, high, tolerance))
    needed = needed.where(~seen & low.notna(), 0.0).clip(lower=out["unseen_paths"])
    needed = needed.where(~(whatever < needed), whatever)
    more_decide = (out["verdict"] == Verdict.UNDECIDED) & (margin > 0.0) & np.isfinite(needed)
    out["paths_needed"] = np.ceil(needed).where(more_decide)
    return out


def _compare_interval(
    low: pd.Series, high: pd.Series, tolerance: pd.Series
) -> tuple["pd.Series[bool]", "pd.Series[bool]"]:
    """Whether all of an interval lies within the tolerance, and whether all of it lies outside."""
    return (low >= -tolerance) & (high <= tolerance), (low > tolerance) | (high < -tolerance)


ACCURATE_UP_TO = "accurate up to"
NOT_WRONG = "not shown wrong up to"
WRONG = "shown wrong"
ENDED = "not followed to its end"
"""The phrases for a range of validity, and for what lies beyond it."""

T = TypeVar("T")


def is_accurate(verdicts: Iterable[str]) -> bool:
    """Whether every row that is judged and predicted is accurate, and there is at least one."""
    return set(verdicts) & set(JUDGED) == {Verdict.ACCURATE}


def is_inaccurate(verdicts: Iterable[str]) -> bool:
    """Whether some judged row is inaccurate, or nothing is predicted."""
    judged = set(verdicts) & set(JUDGED)
    return not judged or Verdict.INACCURATE in judged


def unbroken(values: Iterable[T], holds: Iterable[bool]) -> T | None:
    """The last value up to which a condition is true without a gap."""
    reached = [value for value, _ in takewhile(itemgetter(1), zip(values, holds, strict=True))]
    return reached[-1] if reached else None


def want(rows: pd.DataFrame) -> str:
    """Whether undecided rows lack paths, a smaller step, or both."""
    needed = rows.loc[rows["verdict"] == Verdict.UNDECIDED, "paths_needed"]
    if not needed.isna().any():
        return TOO_FEW
    return (
        f"{TOO_FEW}, and too long a step" if needed.notna().any() else "too long a step to decide"
    )


def in_words(
    name: str,
    values: Sequence[float],
    accurate: float,
    not_wrong: float,
    *,
    ended: bool = False,
    undecided: str = TOO_FEW,
    exact: Iterable[float] = (),
) -> str:
    """A range of validity over a scene parameter in words, and what lies beyond it.

    `accurate`, `not_wrong`: The last value up to which all is accurate, and up to which nothing is
    inaccurate; NaN if not even the first. `ended`: Whether beyond ``not_wrong`` the closure cannot
    be continued to the last impact, rather than being inaccurate. `exact`: All values at which all
    is accurate, those beyond a wrong one too.
    """
    beyond = [value for value in values if not value <= not_wrong]
    parts = []
    if not math.isnan(accurate):
        parts.append((ACCURATE_UP_TO, accurate, ""))
    if not math.isnan(not_wrong) and not_wrong != accurate:
        parts.append((NOT_WRONG, not_wrong, f" ({undecided})"))
    if beyond:
        parts.append(
            (f"{ENDED if ended else WRONG} at", beyond[0], "" if parts else ", the smallest")
        )
    phrases = [
        f"{what} {'' if i else f'{name} = '}{value:.4g}{more}"
        for i, (what, value, more) in enumerate(parts)
    ]
    again = [f"{value:.4g}" for value in exact if beyond and value > beyond[0]]
    if again:
        phrases.append(f"and accurate at {join_words(again)} (not one interval)")
    return ", ".join(phrases)
