"""A loose wheel of a gearbox, and what compiled code knows of it (docs/model.md section 2).

A gearbox is a tree of loose wheels behind one driver: every wheel meshes with a parent.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rattle.scene.compiled import inline, internal, splice
from rattle.scene.drive import most_modulation, most_modulation_rate
from rattle.scene.types import Constants, Floats, Wheels


@internal
def complete_wheels(wheels: Wheels, drive: Any) -> None:
    """Fill in what follows from parent, sign, ratio, turn, damping, drag, noise and mass.

    Shapes: `wheels` (wheels,), of `rattle.scene.types.WHEEL`.
    """
    for wheel in wheels:
        wheel.drives = 0
        wheel.fastest = wheel.beta + math.sqrt(wheel.stiffness)
        beta = wheel.beta if wheel.parent < 0 else wheels[wheel.parent].beta
        wheel.modulation = most_modulation(drive, beta)
        wheel.modulation_rate = most_modulation_rate(drive, beta)
        if wheel.parent < 0:
            wheel.share = 0.0
            wheel.coupling = 0.0
            wheel.drag = wheel.sign * wheel.gamma
            wheel.second = wheel.sign * wheel.turn
            wheel.first = wheel.sign * wheel.turn * wheel.beta
            wheel.force = wheel.sign * wheel.own
            wheel.shaking = wheel.alone
        else:
            parent = wheels[wheel.parent]
            parent.drives = 1
            carried = wheel.ratio * wheel.ratio * wheel.mass
            wheel.share = carried / (carried + parent.mass)
            wheel.coupling = wheel.ratio * (wheel.beta - parent.beta)
            wheel.drag = wheel.ratio * parent.gamma - wheel.gamma
            wheel.second = 0.0
            wheel.first = wheel.turn * (parent.beta - wheel.beta)
            wheel.force = wheel.ratio * parent.own - wheel.own
            wheel.shaking = math.hypot(wheel.alone, wheel.ratio * parent.alone)


def restitution_pieces(table: Sequence[tuple[float, float]]) -> Floats:
    """What is left of the restitution of slow impacts over the speed: each row the speed at which a
    cubic piece begins, and its coefficients of rising power.

    Monotone and once differentiable (Fritsch and Butland 1984); constant beyond both ends, where
    the slope is 0.

    Shapes: `table` (rows, 2); result (rows + 1, 5).
    """
    from scipy.interpolate import PchipInterpolator  # takes a moment to load

    speeds, values = np.array(table).T
    left = values / values[0]
    ends = np.pad(speeds, 1, constant_values=(0.0, 2.0 * speeds[-1]))
    pieces = PchipInterpolator(ends, np.pad(left, 1, mode="edge"))
    return np.column_stack([pieces.x[:-1], pieces.c[::-1].T])


@splice
def with_wheels(c: Constants, wheels: Wheels) -> Constants:
    """The constants of a scene with other wheels.  Spliced, for only the caller knows whether
    references are counted."""
    return Constants(c.alpha, c.sigma, wheels, c.drive, c.memory, c.modulates, c.pressing)


@splice
def with_known_noise(c: Constants, noise: float) -> Constants:
    """The constants while the common noise has a known value, for what keeps meshes closed."""
    alpha = c.alpha + c.modulates * noise
    return Constants(alpha, c.sigma, c.wheels, c.drive, c.memory, c.modulates, noise)


@inline
def nearest_wall(c: Constants, i: int, x: float) -> tuple[int, float]:
    """The side of the wall of gap i that is nearest to a displacement, and the distance to it."""
    wheel = c.wheels[i]
    above = wheel.wall - x
    below = wheel.low + x
    return (1, above) if above <= below else (-1, below)


def flanks_of(c: Constants) -> Floats:
    """Distances of the flanks +1, -1, +2, -2, ... from the middle, shape (2 wheels,)."""
    return np.column_stack([c.wheels["wall"], c.wheels["low"]]).ravel()
