"""The three-way verdict on an error and its interval, and the tolerances that decide it."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

__all__ = ["Tolerances"]

JUDGED = ("accurate", "inaccurate", "undecided")
"""Verdicts on rows that are judged and predicted; counts and sentences refer to these rows only."""

NOT_JUDGED = "not judged"
VERDICTS = (*JUDGED, "not predicted", NOT_JUDGED)

RULE = (
    "At each impact the displacement at the mesh that most simulated paths strike is excluded (at the wall) from "
    "verdicts, counts and sentences: it is the known position of the wall, and its spread tells only how many paths "
    "have left the itinerary (and, with a random tolerance, how the gaps were drawn)."
)
"""Which rows `at_wall` excludes, and why, as pages state it."""

UNSEEN = ("unseen_low", "unseen_high", "unseen_paths")


class Tolerances(NamedTuple):
    """The largest errors that count as accurate.

    Attributes
    ----------
    mean, sd : float
        Of means and of sds, in units of the quantity's sd.
    rho : float
        Of correlation coefficients, absolute.

    Examples
    --------
    >>> Tolerances(mean=0.02).sd
    0.1
    """

    mean: float = 0.05
    sd: float = 0.10
    rho: float = 0.05


def widest(checks: int, family_error: float = 0.05) -> float:
    """Half width, in standard errors, of simultaneous two-sided normal confidence intervals (Bonferroni).

    Examples
    --------
    >>> round(widest(1), 2), round(widest(100), 2)
    (1.96, 3.48)
    """
    return float(-ndtri(0.5 * family_error / max(checks, 1)))


def at_wall(quantity: Any, mesh: Any) -> Any:
    """Whether a quantity is the displacement at the struck mesh, which is not judged, see `RULE`.

    Examples
    --------
    >>> at_wall(np.array(["x1", "x2", "y1"]), np.array([1, 1, 1])).tolist()
    [True, False, False]
    """
    return ((quantity == "x1") & (mesh == 1)) | ((quantity == "x2") & (mesh == 2))


def judge(table: pd.DataFrame) -> pd.DataFrame:
    """Give a verdict on each row: is the error of a predicted moment within its tolerance?

    `table`: Columns ``predicted, error, low, high, noise, tolerance, paths``; optionally ``judged`` (bool), and
    ``unseen_low, unseen_high, unseen_paths`` (see `section_errors`).  ``low`` and ``high`` bound the error;
    ``noise`` is the part of the interval's half width that more paths would reduce.  An interval that so few
    paths cannot have is NaN. Returns: A copy with two more columns.  ``verdict``: ``accurate`` if the whole
    interval lies within the tolerance, ``inaccurate`` if all of it lies outside, else ``undecided``; ``not
    predicted`` where a value is missing, ``not judged`` where ``judged`` is False.  ``paths_needed``: the number
    of paths that would decide an undecided row, NaN where only a smaller step can.  It counts the paths that show
    the branches which this sample cannot have seen, where these alone leave the row open.
    """
    out = table.copy()
    for name in UNSEEN:
        out[name] = out[name].fillna(0.0) if name in out else 0.0
    numbers = ["predicted", "error", "low", "high", "noise", "tolerance"]
    out[numbers] = out[numbers].astype(float)  # an empty table has columns of type object
    tolerance = out["tolerance"]
    inside = (out["low"] >= -tolerance) & (out["high"] <= tolerance)
    outside = (out["low"] > tolerance) | (out["high"] < -tolerance)
    absent = out["predicted"].isna() | out["error"].isna()
    excluded = ~out["judged"].astype(bool) if "judged" in out else np.zeros(len(out), bool)
    out["verdict"] = np.select(
        [excluded, absent, inside, outside], [NOT_JUDGED, "not predicted", "accurate", "inaccurate"], "undecided"
    )
    low, high = out["low"] + out["unseen_low"], out["high"] - out["unseen_high"]  # of what the sample has seen
    fixed = out.get("rest", 0.5 * (high - low) - out["noise"]).astype(float)  # what more paths do not reduce
    margin = (out["error"].abs() - tolerance).abs() - fixed
    with np.errstate(invalid="ignore", divide="ignore"):
        needed = out["paths"] * (out["noise"] / margin) ** 2
    undecided = out["verdict"] == "undecided"
    seen = ((low >= -tolerance) & (high <= tolerance)) | (low > tolerance) | (high < -tolerance)
    needed = needed.where(~seen & low.notna(), 0.0).clip(lower=out["unseen_paths"])
    out["paths_needed"] = np.where(undecided & (margin > 0.0) & np.isfinite(needed), np.ceil(needed), np.nan)
    return out
