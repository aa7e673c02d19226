"""Range of validity of each closure: the impact up to which it is accurate, and what limits it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from rattle.closure import MeanMap
from rattle.compare.validation.comparison import Comparison
from rattle.compare.validation.correlation import first_failure
from rattle.compare.validation.validity_range import UNDECIDED, is_accurate, is_wrong, unbroken, want
from rattle.compare.validation.verdict import NOT_JUDGED

CAUSES = {
    "holds": "accurate at every impact computed",
    "undecided": UNDECIDED,
    "fixed time": "it ignores that impact times vary",
    "off itinerary": "paths have left its itinerary",
    "grazing": "an impact grazes",
    "second order": "second order is not enough",
    "mixture": "it has too few mixture components",
    "not realizable": "no distribution has its moments",
    "ended": "it ends",
}
"""What limits the range of validity: key in the tables, and phrase."""

DIVERGED = 0.99  # agreement below which no closure along a single orbit can be accurate
OFF_ITINERARY = 0.9999  # the same for saltation, else exact to first order: a few distant paths already change an sd
SLOW = 3.0  # mean impact speed, in its sds, below which a Gaussian has a part of the paths miss the wall (grazing)


class Validity(NamedTuple):
    """Range of validity of a closure at one noise intensity; which rows are judged is stated in `verdict.RULE`."""

    closure: str
    sigma: float  # noise intensity
    accurate: int  # last impact up to which every section mean and sd that it predicts is accurate
    not_inaccurate: int  # last impact up to which none is inaccurate; beyond ``accurate`` some are undecided
    cause: str  # what limits the range, a key of `CAUSES`
    why: str  # the evidence for the cause
    on_itinerary: int  # last impact up to which 99 % of the paths have followed the closure's itinerary
    paths: int
    dt: float  # of the simulation


def find_validity(v: Comparison, closure: str) -> Validity:
    """Range of validity of one closure of a validation.

    Examples
    --------
    >>> from rattle.compare import validate
    >>> from rattle.scene import DAT21, Scene
    >>> v = validate(Scene.from_gears(DAT21, sigma=0.01), impacts=3, paths=20_000, rng=1)
    >>> find_validity(v, "saltation").accurate, find_validity(v, "published").not_inaccurate
    (3, 0)
    """
    rows = rows_to_judge(v, closure)
    impacts = range(1, len(v.run.section) + 1)
    verdicts = {k: set(group["verdict"]) for k, group in rows.groupby("impact")}
    accurate = unbroken(impacts, [is_accurate(verdicts[k]) for k in impacts]) or 0
    not_inaccurate = unbroken(impacts, [not is_wrong(verdicts[k]) for k in impacts]) or 0
    on_itinerary = unbroken(impacts, v.run.agreement[closure] >= DIVERGED) or 0
    if accurate == len(impacts):
        cause, why = "holds", CAUSES["holds"]
    elif not_inaccurate == len(impacts):
        cause, why = "undecided", f"{want(rows)} from impact {accurate + 1} on"
    else:
        cause, why = _why(v, closure, not_inaccurate + 1)
    return Validity(closure, v.scene.sigma, accurate, not_inaccurate, cause, why, on_itinerary, v.run.paths, v.run.dt)


def find_validities(validations: Sequence[Comparison]) -> pd.DataFrame:
    """Ranges of validity of all closures at all noise intensities."""
    return pd.DataFrame([find_validity(v, closure) for v in validations for closure in v.predictions])


def rows_to_judge(v: Comparison, closure: str) -> pd.DataFrame:
    """The section rows of a closure that are judged, see `rattle.compare.validation.verdict.RULE`."""
    rows = v.section_rows(closure)
    return rows[rows["verdict"] != NOT_JUDGED]


def _why(v: Comparison, closure: str, impact: int) -> tuple[str, str]:
    """Why a closure is not accurate at an impact: cause and evidence; of several causes the first in this order."""
    prediction = v.predictions[closure]
    failed = first_failure(v.correlation, closure)
    if failed and failed[0] <= impact:
        return "not realizable", f"not realizable at impact {failed[0]}: {failed[2]}"
    if prediction.trace.found < impact:
        return "ended", prediction.stopped
    worst = _worst(v, closure, impact)
    if prediction.trace.parts is not None:
        lost = float(prediction.section["discarded"].loc[impact])
        and_lost = f", and {lost:.1%} of the probability was discarded so far" if lost >= 5e-4 else ""
        return "mixture", f"{worst}: {CAUSES['mixture']}{and_lost}"
    agreement = float(v.run.agreement[closure].loc[impact])
    if agreement < (OFF_ITINERARY if closure == "saltation" else DIVERGED):
        return "off itinerary", f"{worst}: {1.0 - agreement:.2%} of the {CAUSES['off itinerary']}"
    slow = _slowest(prediction, impact)
    if slow is not None:
        return "grazing", f"{worst}: impact {slow[0]} grazes (its mean speed is {slow[1]:.1f} of its sds)"
    if closure == "saltation":
        return "second order", f"{worst}: {CAUSES['second order']}"
    return "fixed time", f"{worst}, at any noise: {CAUSES['fixed time']}"


def _worst(v: Comparison, closure: str, impact: int) -> str:
    rows = rows_to_judge(v, closure)
    rows = rows[(rows["impact"] == impact) & (rows["verdict"] == "inaccurate")]
    if rows.empty:
        return f"nothing to compare at impact {impact}"
    row = rows.iloc[int((rows["error"] / rows["tolerance"]).abs().argmax())]
    return f"{row['moment']} of {row['quantity']} wrong at impact {impact}"


def _slowest(prediction: MeanMap, impact: int) -> tuple[int, float] | None:
    """The first impact up to a given one whose mean speed is below `SLOW` of its own sds, and that ratio."""
    for k in range(1, impact + 1):
        column = 1 if prediction.trace.mesh[k] == 1 else 3
        speed, sd = abs(prediction.trace.mean[k, column]), prediction.trace.sd[k, column + 2]
        if speed < SLOW * sd < np.inf:
            return k, float(speed / sd)
    return None
