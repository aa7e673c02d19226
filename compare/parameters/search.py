"""Sequential search for the values of a parameter between which a closure stops holding.

At each value paths are added until the verdict on the closure is decided; all looks at all values
share one family of 95 %.  A closure is shown wrong by any one row, so all rows are counted then.
It is accurate if every row is, which no single row says falsely more often than at its own level,
so they are not (an intersection-union test, Berger 1982).
"""

import math
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.compare.judge.rows import Claimed, judge_errors, waits_for_branch
from rattle.compare.judge.verdict import JUDGED, Tolerances, Verdict, is_accurate
from rattle.compare.parameters.finding import by_error
from rattle.compare.study.parameters import Parameter
from rattle.compare.validation.errors import list_errors
from rattle.montecarlo.diagnostics.reference import Simulated
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.looks import BUDGET_ENDED, Looks, order_ends_first
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import Scene, duration_text, section_names
from rattle.scene.progress import ESTIMATES

PATHS_OF_LOOKS = (4096, 16384, 65536, 262_144, 1_048_576)
"""Paths after which a value is judged."""
# fewer paths say only roughly how many would decide, and too little of a branch near which they are
ROUGH = PATHS_OF_LOOKS[2]
MOST_VALUES = 40  # values of a search
SEARCH_BUDGET = 60.0  # core-seconds, by default
# of what is left of the budget, which one more look at a value may be expected to take: what is too
# near an edge must not take what narrows the others
LOOK_SHARE = 0.25
# share of a tolerance below which it does not matter what a branch that was not seen could change
SLIGHT = 0.01


class SearchRange(NamedTuple):
    """Where a search goes and how finely, what is left of its processor time, and its seed."""

    parameter: Parameter
    scan: tuple[float, float, int, float]  # both ends, number of values, width of an edge
    time_left: Budget
    seed: int


class JudgedValue(NamedTuple):
    """A value of the parameter, and the verdict on the closure there."""

    value: float
    verdict: str  # `Verdict.ACCURATE`, `INACCURATE` or `UNDECIDED`
    paths: int = 0
    # the worst row's error over its tolerance, with the bounds of its interval
    error: float = math.nan
    low: float = math.nan
    high: float = math.nan
    row: str = ""  # that row
    remark: str = ""  # why it is undecided


class Edge(NamedTuple):
    """Two values between which the closure stops holding: at one it is accurate, at the other it is
    wrong."""

    accurate: float
    wrong: float
    why: str  # the row that is wrong


class Widths(NamedTuple):
    """Half widths of the intervals, in standard errors, by what is to be shown: each takes half of
    the 5 %."""

    accurate: float
    wrong: float


def critical(impacts: int, wheels: int, searches: int = 1) -> Widths:
    """The half widths at every look of some searches (Bonferroni), one look of each value taken
    again."""
    rows = 2 * len(section_names(wheels)) * impacts
    looks = (len(PATHS_OF_LOOKS) + 1) * MOST_VALUES * searches
    return Widths(widest(looks), widest(rows * looks))


def state_effort(label: str, over: str, points: int, least: float, most: float) -> None:
    """State what a search is expected to take: core-seconds of a value that is judged at the first
    or the last look."""
    times = f"{duration_text(least, 2)} to {duration_text(most, 2)} of processor time"
    values = f"{points} values of {over}, then more between those that differ"
    ESTIMATES.info("%s", f"{label}: {values}; each takes about {times}")


def judge_value(
    value: float,
    scene: Scene,
    predicted: Claimed,
    simulate: Callable[[Scene, int, bool], Simulated],
    z: Widths,
    tolerances: Tolerances,
    budget: Budget | None = None,
) -> JudgedValue:
    """Add paths until a closure is decided at one value, or until what is undecided would take more
    than the last look.

    Where that waits for a rare branch, it is judged by `ROUGH` paths or more from then on, a part
    of them near it.
    """
    near_branches = False
    looks = Looks(PATHS_OF_LOOKS, rough=ROUGH, budget=budget, share=LOOK_SHARE)
    rows = pd.DataFrame()
    for paths in looks:
        run = simulate(scene, paths, near_branches)
        errors = list_errors([predicted], run, tolerances)
        tables = [judge_errors(errors, width) for width in z]
        narrow, rows = (table[table["verdict"].isin(JUDGED)] for table in tables)
        if rows.empty:
            return JudgedValue(value, Verdict.INACCURATE, paths, row="nothing is predicted")
        off = rows["verdict"] == Verdict.INACCURATE
        if off.any():
            return _point(value, Verdict.INACCURATE, paths, rows[off])
        if is_accurate(set(narrow["verdict"])):
            return _point(value, Verdict.ACCURATE, paths, narrow)
        outside = rows["error"].abs() > rows["tolerance"]
        rest = pd.concat([narrow[~outside], rows[outside]])
        rest = rest[rest["verdict"] == Verdict.UNDECIDED]
        needed = count_needed(rest, paths)
        may_aim = not (near_branches or scene.correlation_time)
        if may_aim and not needed <= PATHS_OF_LOOKS[-1] and waits_for_branch(rest).any():
            near_branches = True
            looks.repeat(ROUGH)
        else:
            looks.expect(needed)
    if rows.empty:
        return JudgedValue(value, Verdict.UNDECIDED, remark=looks.why)
    if looks.why != BUDGET_ENDED:
        looks.why = next((text for text in rest["remark"] if text), looks.why)
    return _point(value, Verdict.UNDECIDED, paths, rows)._replace(remark=looks.why)


def count_needed(rows: pd.DataFrame, paths: int) -> float:
    """Paths that decide a value, from its undecided rows after some paths: all rows, or one that is
    beyond its tolerance."""
    beyond = rows["error"].abs() > rows["tolerance"]
    hidden = rows[["unseen_low", "unseen_high"]].max(axis=1) > SLIGHT * rows["tolerance"]
    margin = (rows["error"].abs() - rows["tolerance"]).abs()
    by_noise = paths * (rows["noise"] / margin) ** 2
    needed = rows["paths_needed"].fillna(np.inf).where(hidden, by_noise)
    return float(np.fmin(needed.max(), needed[beyond].min()))


def _point(value: float, verdict: str, paths: int, rows: pd.DataFrame) -> JudgedValue:
    """A value with the worst of some rows."""
    row = by_error(rows).iloc[0]
    unit = math.copysign(row["tolerance"], row["error"])
    low, high = sorted(float(row[name] / unit) for name in ("low", "high"))
    name = f"{row['moment']} of {row['quantity']} at impact {row['impact']}"
    return JudgedValue(value, verdict, paths, float(row["error"] / unit), low, high, name)


def find_changes(
    judge: Callable[[float], Any],
    low: float,
    high: float,
    points: int,
    width: float,
    *,
    first: str,
    near: Iterable[float] = (),
    map_scan: Callable[..., Iterable[Any]] = map,
) -> tuple[list[tuple[Any, Any]], pd.DataFrame]:
    """Scan a range, its ends first, then halve the logarithm of every change of verdict until it is
    known to ± a relative width.

    Returns pairs of what was judged, that with the verdict `first` before the other, and all that
    was judged.  Values `near` which a change is expected are tried before halving;
    `map_scan` maps over those of the scan.
    """
    known: dict[float, Any] = {}
    guesses = [float(f"{value:.6g}") for value in near]
    enough = math.log((1.0 + width) / (1.0 - width))

    def at(value: float) -> Any:
        value = float(f"{value:.6g}")
        if value not in known:
            known[value] = judge(value)
        return known[value]

    def narrow(good: Any, bad: Any) -> tuple[Any, Any]:
        """Narrow the two values of a change; what stays undecided between them is approached from
        both sides."""
        while len(known) < MOST_VALUES:
            low, high = sorted((good.value, bad.value))
            if math.log(high / low) <= 1.001 * enough:  # values are rounded
                break
            doubt = sorted(value for value in known if low < value < high)
            guess = next((value for value in guesses if low < value < high), None)
            if doubt:
                # the wider of the two gaps beside what is undecided
                one, other = max(
                    (low, doubt[0]), (doubt[-1], high), key=lambda gap: gap[1] / gap[0]
                )
                if math.log(other / one) < 0.5 * enough:
                    break
                middle = math.sqrt(one * other)
            elif guess is not None:
                middle = guess
            else:
                # where one more verdict suffices, at the value that is easiest to show wrong
                span = math.log(bad.value / good.value)
                suffices = abs(span) < 2.0 * enough
                middle = good.value * math.exp(
                    math.copysign(enough, span) if suffices else 0.5 * span
                )
            judged = at(middle)
            if judged.verdict == good.verdict:
                good = judged
            elif judged.verdict == bad.verdict:
                bad = judged
        return good, bad

    scan = sorted(map_scan(at, order_ends_first(np.geomspace(low, high, points).tolist())))
    decided = [point for point in scan if point.verdict != Verdict.UNDECIDED]
    changes = [
        narrow(a, b) if a.verdict == first else narrow(b, a)
        for a, b in pairwise(decided)
        if a.verdict != b.verdict
    ]
    return changes, pd.DataFrame(sorted(known.values())).astype({"verdict": str})
