"""What a study could not compute, and why: one line for each reason, however many points share it."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rattle.compare.study.design import Point

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
NAMES = {"scene": "the scene", "sample": "the simulation"}
"""Names for readers of those keys of `Point.reasons` that are not closures."""


class FailedPoints(NamedTuple):
    """Something that cannot be computed at some points; their error messages differ at most in numbers."""

    what: str  # the scene, the simulation, or a closure
    why: str  # error message at the first of the points: field, value and remedy
    points: int  # points, of: number of points concerned, and number of all points
    of: int
    first: dict[str, Any]  # coordinates of the first point concerned

    @property
    def where(self) -> str:
        """Coordinates of the first point concerned, as text."""
        return ", ".join(f"{name} = {value}" for name, value in self.first.items()) or "the only point"

    def __str__(self) -> str:
        """Describe the failure in one sentence."""
        return f"{self.what} cannot be computed at {self.points} of {self.of} points, first at {self.where}: {self.why}"


def group_failures(points: Sequence[Point], failed: Mapping[str, str]) -> list[FailedPoints]:
    """Group the error messages of a study's points by their reason.

    Examples
    --------
    >>> said = "gap1 = {}: must be greater than 0"
    >>> print(*group_failures([Point({"gap1": g}, None, (), {"scene": said.format(g)}) for g in (-0.1, -0.2)], {}))
    the scene cannot be computed at 2 of 2 points, first at gap1 = -0.1: gap1 = -0.1: must be greater than 0
    """
    found: dict[tuple[str, str], list[tuple[Point, str]]] = {}
    for point in points:
        lost = {getattr(cell, "closure", "sample"): failed[cell.key] for cell in point.cells if cell.key in failed}
        for what, why in (point.reasons | lost).items():
            found.setdefault((what, NUMBER.sub("", why)), []).append((point, why))
    return [
        FailedPoints(NAMES.get(what, what), where[0][1], len(where), len(points), where[0][0].coordinates)
        for (what, _), where in found.items()
    ]
