"""Drag torque over the driver's mean speed: a table in a file of gears, straight between its
points."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

from rattle.scene.errors import InputError, non_negative

DragTable = tuple[tuple[float, float], ...]
DRAG_TABLES = {"torque1_over_rpm": "torque1", "torque2_over_rpm": "torque2"}
"""Tables of drag over speed, and the torque that each takes the place of."""


def read_drag(name: str, points: object) -> DragTable:
    """The points of a drag table, 1/min and N mm, checked: two or more, at rising speeds."""
    form = "write it as [[rpm, N mm], [rpm, N mm], ...] with two points or more"
    if not isinstance(points, Sequence) or isinstance(points, str) or len(points) < 2:
        raise InputError(name, points, form)
    table = []
    for number, point in enumerate(points, 1):
        if not isinstance(point, Sequence) or isinstance(point, str) or len(point) != 2:
            raise InputError(name, point, f"point {number} leaves a gap in the table; {form}")
        rpm = non_negative(f"{name}: speed of point {number}", point[0])
        torque = non_negative(f"{name}: torque of point {number}", point[1])
        table.append((rpm, torque))
    for (slower, _), (faster, _) in pairwise(table):
        if faster <= slower:
            raise InputError(name, faster, f"must be above {slower:g}: speeds in rising order")
    return tuple(table)


def drag_at(name: str, table: DragTable, rpm: float) -> float:
    """The drag torque at a speed, interpolated linearly; no speed beyond the table has one."""
    first = table[0]
    last = table[-1]
    if not first[0] <= rpm <= last[0]:
        why = f"the table ends at {first[0]:g} and {last[0]:g} 1/min; add a point beyond {rpm:g}"
        raise InputError(name, f"{rpm:g} 1/min", why)
    right = min(bisect_right(table, (rpm, float("inf"))), len(table) - 1)
    rpm0, torque0 = table[right - 1]
    rpm1, torque1 = table[right]
    return torque0 + (torque1 - torque0) * (rpm - rpm0) / (rpm1 - rpm0)
