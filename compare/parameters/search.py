"""Sequential search for the values of a parameter between which a closure stops holding.

At each value paths are added until the verdict on the closure is decided.  All looks at all values share one family of
95 %, so what is said of the whole search is right with 95 % probability.
"""

import math
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from rattle.compare.validation.errors import Claimed, Simulated, section_errors
from rattle.compare.validation.verdict import JUDGED, Tolerances, is_accurate, is_wrong, widest
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene

LOOKS = (4096, 16384, 65536, 262_144, 1_048_576)
"""Paths after which a value is judged."""
MOST = 40  # values of a search
SLIGHT = 0.01  # share of a tolerance below which it does not matter what a branch that was not seen could change
ACCURATE, WRONG, UNDECIDED = "accurate", "wrong", "undecided"


class Point(NamedTuple):
    """A value of the parameter, and the verdict on the closure there."""

    value: float
    verdict: str  # `ACCURATE`, `WRONG` or `UNDECIDED`
    paths: int
    error: float  # the worst row's error over its tolerance, with the bounds of its interval
    low: float
    high: float
    row: str  # that row
    remark: str  # why it is undecided


class Edge(NamedTuple):
    """Two values between which the closure stops holding: at one it is accurate, at the other it is wrong."""

    accurate: float
    wrong: float
    why: str  # the row that is wrong

    @property
    def width(self) -> float:
        """Larger over smaller value, less 1."""
        return math.exp(abs(math.log(self.wrong / self.accurate))) - 1.0


def critical(impacts: int, stages: int, searches: int = 1) -> float:
    """Standard errors of the intervals of every row at every look of some searches (Bonferroni)."""
    rows = 2 * (len(SECTION) - (0 if stages == 2 else 2)) * impacts
    return widest(rows * len(LOOKS) * MOST * searches)


def judge_value(
    value: float,
    scene: Scene,
    predicted: Claimed,
    simulate: Callable[[Scene, int], Simulated],
    z: float,
    tolerances: Tolerances,
) -> Point:
    """Add paths until a closure is decided at one value, or until what is undecided would take more than the last look.

    `simulate`: Makes an ensemble of so many paths of a scene.
    """
    for paths in LOOKS:
        rows = section_errors(predicted, simulate(scene, paths), z, tolerances)
        rows = rows[rows["verdict"].isin(JUDGED)]
        if rows.empty:
            return Point(value, WRONG, paths, math.nan, math.nan, math.nan, "nothing is predicted", "")
        verdicts = set(rows["verdict"])
        wrong = rows[rows["verdict"] == "inaccurate"]
        worst = (wrong if len(wrong) else rows).assign(share=lambda r: r["error"].abs() / r["tolerance"])
        row = worst.to_dict("records")[int(worst["share"].argmax())]
        sign = 1.0 if row["error"] >= 0.0 else -1.0
        low, high = sorted(sign * row[name] / row["tolerance"] for name in ("low", "high"))
        name = f"{row['moment']} of {row['quantity']} at impact {row['impact']}"
        found = Point(value, UNDECIDED, paths, float(row["share"]), float(low), float(high), name, "")
        if is_wrong(verdicts):
            return found._replace(verdict=WRONG)
        if is_accurate(verdicts):
            return found._replace(verdict=ACCURATE)
        open_rows = rows[rows["verdict"] == "undecided"]
        beyond = open_rows["error"].abs() > open_rows["tolerance"]
        hidden = open_rows[["unseen_low", "unseen_high"]].max(axis=1) > SLIGHT * open_rows["tolerance"]
        margin = (open_rows["error"].abs() - open_rows["tolerance"]).abs()
        needed = open_rows["paths_needed"].fillna(np.inf).where(hidden, paths * (open_rows["noise"] / margin) ** 2)
        if needed.max() > LOOKS[-1] and not (needed[beyond] <= LOOKS[-1]).any():
            break  # neither verdict is in reach
    remarks = [text for text in open_rows["remark"] if text]
    return found._replace(remark=remarks[0] if remarks else "too few paths to decide")


def search(
    judge: Callable[[float], Point],
    low: float,
    high: float,
    points: int,
    width: float,
    known: dict[float, Point],
    near: Iterable[float] = (),
) -> list[Edge]:
    """Find every edge in a range, each to ± a relative width.

    `known`: Filled with every value that was judged. `near`: Where edges are expected; tried before halving.
    """
    changes = find_changes(judge, low, high, points, width, known, first=ACCURATE, near=near)
    return [Edge(good.value, bad.value, bad.row) for good, bad in changes]


def find_changes(
    judge: Callable[[float], Any],
    low: float,
    high: float,
    points: int,
    width: float,
    known: dict[float, Any],
    *,
    first: str,
    near: Iterable[float] = (),
    each: Callable[..., Iterable[Any]] = map,
) -> list[tuple[Any, Any]]:
    """Scan a range, then halve the logarithm of every change of verdict until it is known to ± a relative width.

    Returns pairs of what was judged, that with the verdict `first` before the other.

    `judge`: Gives an object with ``value`` and ``verdict``.
    `known`: Filled with every value that was judged.
    `near`: Where changes are expected; tried before halving.
    `each`: Applies a function to all values of the scan.
    """

    def at(value: float) -> Any:
        value = float(f"{value:.6g}")
        if value not in known:
            known[value] = judge(value)
        return known[value]

    scan = list(each(at, np.geomspace(low, high, points)))
    decided = [point for point in scan if point.verdict != UNDECIDED]
    return [
        _narrow(at, *((a, b) if a.verdict == first else (b, a)), width, known, [float(f"{v:.6g}") for v in near])
        for a, b in pairwise(decided)
        if a.verdict != b.verdict
    ]


def _narrow(
    at: Callable[[float], Any], good: Any, bad: Any, width: float, known: dict[float, Any], guesses: list[float]
) -> tuple[Any, Any]:
    """Narrow the two values of a change; what stays undecided between them is approached from both sides."""
    doubt = [point.value for point in known.values() if _between(point.value, good.value, bad.value)]
    enough = math.log((1.0 + width) / (1.0 - width))
    while len(known) < MOST and abs(math.log(bad.value / good.value)) > 1.001 * enough:  # values are rounded
        # the wider of the two gaps beside what is undecided, or the whole
        near, far = (min, max) if good.value < bad.value else (max, min)
        gaps = [(good.value, near(doubt)), (far(doubt), bad.value)] if doubt else [(good.value, bad.value)]
        one, other = max(gaps, key=lambda gap: abs(math.log(gap[1] / gap[0])))
        span = math.log(other / one)
        if doubt and abs(span) < 0.5 * enough:
            break
        guess = None if doubt else next((value for value in guesses if _between(value, good.value, bad.value)), None)
        # where one more verdict suffices, at the value that is easiest to show wrong
        last = not doubt and abs(span) < 2.0 * enough
        middle = at(one * math.exp(math.copysign(enough, span) if last else 0.5 * span) if guess is None else guess)
        if middle.verdict == good.verdict:
            good = middle
        elif middle.verdict == bad.verdict:
            bad = middle
        else:
            doubt.append(middle.value)
        doubt = [value for value in doubt if _between(value, good.value, bad.value)]
    return good, bad


def _between(value: float, one: float, other: float) -> bool:
    return min(one, other) < value < max(one, other)
