"""The numbers of a scene for compiled code."""

import math
from collections.abc import Sequence

import numpy as np

from rattle.scene.parts import SINE_ALONE, Order, Wheel
from rattle.scene.types import SINE, WHEEL, Orders, Wheels
from rattle.scene.wheel import complete_wheels, restitution_pieces

FAR_ORDERS = 8
"""Gap between orders above which the sine of the next one is not computed from that of the last."""


def compile_wheels(
    tree: Sequence[Wheel],
    fixed: bool,
    noise_sources: Sequence[tuple[int, float]],
    drive: tuple[Order, ...],
) -> Wheels:
    """The wheels of a scene; a tolerance that is `fixed` is part of the walls."""
    wheels: Wheels = np.zeros(len(tree), WHEEL)
    for wheel, record in zip(tree, wheels, strict=True):
        for name in ("ratio", "beta", "gamma", "stiffness", "mass"):
            record[name] = getattr(wheel, name)
        law = wheel.law
        record.epsilon, record.variance = law.moments
        record.slowing = law.slowing
        record.rows = len(law.table)
        if law.table:
            pieces = restitution_pieces(law.table)
            record.pieces[: len(pieces)] = pieces
        record.wall = wheel.gap + fixed * wheel.tolerance
        record.low = wheel.low_gap + fixed * wheel.tolerance
        record.size = record.wall or 1.0  # a wall in the middle has the unit of length
        parent = int(wheel.parent) - 1
        record.parent = parent
        record.sign = 1.0 if parent < 0 else -1.0
        record.turn = wheel.ratio * (wheels[parent].turn if parent >= 0 else 1.0)
    for source, (number, intensity) in enumerate(noise_sources):
        if number:
            wheels["alone" if source else "own"][number - 1] = intensity
    complete_wheels(wheels, compile_orders(drive))
    return wheels


def compile_orders(drive: tuple[Order, ...]) -> Orders | tuple[()]:
    """The drive of a scene, its orders ascending."""
    moving = tuple(one for one in drive if one.amplitude)
    if moving == SINE_ALONE:
        return SINE
    j = np.array([one.order for one in moving])
    a, phase = (np.array([getattr(one, name) for one in moving]) for name in ("amplitude", "phase"))
    gap = np.diff(j, prepend=0)
    order = j.astype(float)
    most1, most2, most3 = (float((abs(a) * order**n).sum()) for n in (1, 2, 3))
    odd, even = (a * np.array([turn(p) for p in phase.tolist()]) for turn in (math.cos, math.sin))
    gap = np.where(gap > FAR_ORDERS, 0, gap)
    waves = np.empty((2, len(j)))
    return Orders(order, gap, odd, even, order[-1], most1, most2, most3, waves)
