"""The range of validity of a closure, in the same three phrases wherever it is stated.

*Accurate up to*: every judged moment is accurate, there and before.  *Not shown wrong up to*: none is inaccurate, but
beyond the first limit some are *undecided*: too few paths, or too long a step, to decide.
"""

import math
from collections.abc import Iterable, Sequence
from typing import TypeVar

import pandas as pd

from rattle.compare.validation.verdict import JUDGED

ACCURATE, NOT_WRONG = "accurate up to", "not shown wrong up to"
WRONG, ENDED = "shown wrong", "not followed to its end"
UNDECIDED = "too few paths to decide"
"""The phrases for a range of validity, and for what lies beyond it."""

T = TypeVar("T")


def is_accurate(verdicts: Iterable[str]) -> bool:
    """Whether every row that is judged and predicted is accurate, and there is at least one."""
    return set(verdicts) & set(JUDGED) == {"accurate"}


def is_wrong(verdicts: Iterable[str]) -> bool:
    """Whether some judged row is inaccurate, or nothing is predicted."""
    judged = set(verdicts) & set(JUDGED)
    return not judged or "inaccurate" in judged


def unbroken(values: Iterable[T], holds: Iterable[bool]) -> T | None:
    """The last value up to which a condition is true without a gap.

    Examples
    --------
    >>> unbroken([0.1, 0.2, 0.4, 0.8], [True, True, False, True])
    0.2
    """
    reached = None
    for value, true_here in zip(values, holds, strict=True):
        if not true_here:
            break
        reached = value
    return reached


def want(rows: pd.DataFrame) -> str:
    """Whether undecided rows lack paths, a smaller step, or both.

    Examples
    --------
    >>> want(pd.DataFrame({"verdict": ["undecided", "accurate"], "paths_needed": [1e6, float("nan")]}))
    'too few paths to decide'
    """
    needed = rows.loc[rows["verdict"] == "undecided", "paths_needed"]
    if not needed.isna().any():
        return UNDECIDED
    return f"{UNDECIDED}, and too long a step" if needed.notna().any() else "too long a step to decide"


def in_words(
    name: str,
    values: Sequence[float],
    accurate: float,
    not_wrong: float,
    *,
    ended: bool = False,
    undecided: str = UNDECIDED,
) -> str:
    """A range of validity over a scene parameter in words, and what lies beyond it.

    `accurate`, `not_wrong`: The last value up to which all is accurate, and up to which nothing is inaccurate;
    NaN if not even the first. `ended`: Whether beyond ``not_wrong`` the closure cannot be continued to the last
    impact, rather than being inaccurate.

    Examples
    --------
    >>> in_words("σ", [0.1, 0.2, 0.4], 0.1, 0.2)
    'accurate up to σ = 0.1, not shown wrong up to 0.2 (too few paths to decide), shown wrong at 0.4'
    >>> in_words("σ", [0.1, 0.2], math.nan, 0.2)
    'not shown wrong up to σ = 0.2 (too few paths to decide)'
    >>> in_words("σ", [0.1, 0.2], math.nan, math.nan)
    'shown wrong at σ = 0.1, the smallest'
    """
    beyond = [value for value in values if not value <= not_wrong]
    parts = []
    if not math.isnan(accurate):
        parts.append((ACCURATE, accurate, ""))
    if not math.isnan(not_wrong) and not_wrong != accurate:
        parts.append((NOT_WRONG, not_wrong, f" ({undecided})"))
    if beyond:
        parts.append((f"{ENDED if ended else WRONG} at", beyond[0], "" if parts else ", the smallest"))
    phrases = [f"{what} {'' if i else f'{name} = '}{value:.4g}{more}" for i, (what, value, more) in enumerate(parts)]
    return ", ".join(phrases)


def join_words(items: Sequence[str]) -> str:
    """Join items as in a sentence: commas, and ``and`` before the last.

    Examples
    --------
    >>> join_words(["a", "b", "c"])
    'a, b and c'
    """
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def span(values: Iterable[float], form: str) -> str:
    """The range of some values in words; one value where they are the same as printed.

    >>> span([17.257, 17.262], ".4g"), span([0.05, 0.1], ".0%")
    ('17.26', '5% to 10%')
    """
    found = list(values)
    low, high = format(min(found), form), format(max(found), form)
    return low if low == high else f"{low} to {high}"
