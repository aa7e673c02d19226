"""Small vectors as explicit loops, for the reasons of `rattle.scene.small_matrices`."""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import internal

Floats = NDArray[np.float64]


@internal
def put_row(to: Floats, values: Floats) -> None:
    """Copy a vector into another one.

    Shapes: `to` (n,); `values` (n,).
    """
    for i in range(to.size):
        to[i] = values[i]


@internal
def put_scaled(to: Floats, values: Floats, divisor: float) -> None:
    """Copy a vector, divided by a number, into another one or into itself.

    Shapes: `to` (n,); `values` (n,).
    """
    for i in range(to.size):
        to[i] = values[i] / divisor


@internal
def beyond(centre: Floats, step: float, direction: Floats) -> Floats:
    """``x + h v``: a point a number of steps away from another one.

    Shapes: `centre` (n,); `direction` (n,); result (n,).
    """
    out = np.empty(centre.size)
    for i in range(centre.size):
        out[i] = centre[i] + step * direction[i]
    return out


@internal
def dot(v: Floats, w: Floats) -> float:
    """``v' w``, summed in order of the components.

    Shapes: `v`, `w` (n,).
    """
    total = 0.0
    for i in range(v.size):
        total += v[i] * w[i]
    return total


@internal
def norm(v: Floats) -> float:
    """Euclidean norm, summed in order of the components.

    Shapes: `v` (n,).
    """
    total = 0.0
    for i in range(v.size):
        total += v[i] * v[i]
    return math.sqrt(total)


@internal
def largest(values: Floats, count: int) -> int:
    """Index of the largest of the first values; of the first of them where several are equal.

    Shapes: `values` (n,).
    """
    at = 0
    for i in range(1, count):
        if values[i] > values[at]:
            at = i
    return at
