"""Drag torque over the driver's mean speed, in a file of gears: a table, straight between its
points, or a polynomial."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeAlias, TypedDict

import numpy as np
from numpy.polynomial.polynomial import Polynomial, polyval

from rattle.scene.errors import InputError, finite, non_negative

DRAG_TABLES = {"torque1_over_rpm": "torque1", "torque2_over_rpm": "torque2"}
"""Drag over speed, and the torque that each takes the place of."""
BELOW_ZERO = -1e-9  # of the largest term of a polynomial: rounding, where the drag falls to 0


class DragPolynomial(TypedDict):
    """The drag torque as a polynomial of the speed, and from which speed to which it holds."""

    polynomial: tuple[float, ...]  # N mm times powers of min, from 1/min to the power 0 on
    rpm: tuple[float, float]


DragTable: TypeAlias = tuple[tuple[float, float], ...]
DragLaw: TypeAlias = DragTable | DragPolynomial


def read_drag(name: str, given: Any) -> DragLaw:
    """The drag over speed, checked: a polynomial, or points in 1/min and N mm at rising speeds."""
    if isinstance(given, Mapping):
        return _read_polynomial(name, given)
    form = "write it as [[rpm, N mm], [rpm, N mm], ...] with two points or more"
    if not _is_list(given) or len(given) < 2:
        why = f"{form}, or as {{ polynomial = [a0, a1, a2], rpm = [lowest, highest] }}"
        raise InputError(name, given, why)
    table = []
    for number, point in enumerate(given, 1):
        if not _is_list(point) or len(point) != 2:
            raise InputError(name, point, f"point {number} leaves a gap in the table; {form}")
        rpm = non_negative(f"{name}: speed of point {number}", point[0])
        torque = non_negative(f"{name}: torque of point {number}", point[1])
        table.append((rpm, torque))
    for (slower, _), (faster, _) in pairwise(table):
        if faster <= slower:
            raise InputError(name, faster, f"must be above {slower:g}: speeds in rising order")
    return tuple(table)


def _is_list(given: Any) -> bool:
    """Whether something is a list of things, rather than a text."""
    return isinstance(given, Sequence) and not isinstance(given, str)


def _read_polynomial(name: str, given: Mapping[str, Any]) -> DragPolynomial:
    """A polynomial that is nowhere negative at the speeds that it holds for."""
    form = (
        "write { polynomial = [a0, a1, a2], rpm = [lowest, highest] }: the torque a0 + a1 rpm + a2"
        " rpm^2 in N mm, and from which speed to which it holds"
    )
    polynomial: Any = given.get("polynomial")
    rpm: Any = given.get("rpm")
    complete = set(given) == {"polynomial", "rpm"} and _is_list(polynomial) and _is_list(rpm)
    if not complete or not polynomial or len(rpm) != 2:
        raise InputError(name, dict(given), form)
    powers = tuple(finite(f"{name}: a{power}", a) for power, a in enumerate(polynomial))
    lowest = non_negative(f"{name}: lowest speed", rpm[0])
    highest = non_negative(f"{name}: highest speed", rpm[1])
    if highest <= lowest:
        raise InputError(name, [lowest, highest], "give a lowest speed and a higher one")
    turns = Polynomial(powers).deriv().roots().real  # and some more: they do no harm
    extremes = [lowest, highest, *turns[(turns > lowest) & (turns < highest)].tolist()]
    torques = polyval(extremes, powers)
    largest = polyval(highest, np.abs(powers))
    if torques.min() < BELOW_ZERO * largest:
        at = extremes[int(torques.argmin())]
        why = f"is {torques.min():.3g} N mm at {at:.4g} 1/min; drag cannot push a wheel"
        raise InputError(name, list(powers), why)
    return {"polynomial": powers, "rpm": (lowest, highest)}


def drag_at(name: str, drag: DragLaw, rpm: float) -> float:
    """The drag torque at a speed, N mm; no speed beyond those that it holds for has one."""
    if isinstance(drag, tuple):
        what = "table"
        lowest = drag[0][0]
        highest = drag[-1][0]
        more = f"add a point beyond {rpm:g}"
    else:
        what = "polynomial"
        lowest, highest = drag["rpm"]
        more = f"give it for {rpm:g} too, if it holds there"
    if not lowest <= rpm <= highest:
        why = f"the {what} ends at {lowest:g} and {highest:g} 1/min; {more}"
        raise InputError(name, f"{rpm:g} 1/min", why)
    if not isinstance(drag, tuple):
        return max(float(polyval(rpm, drag["polynomial"])), 0.0)
    right = min(bisect_right(drag, (rpm, float("inf"))), len(drag) - 1)
    rpm0, torque0 = drag[right - 1]
    rpm1, torque1 = drag[right]
    return torque0 + (torque1 - torque0) * (rpm - rpm0) / (rpm1 - rpm0)
