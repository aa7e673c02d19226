"""Small vectors as explicit loops, for the reasons of `rattle.scene.small_matrices`."""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import jit

Floats = NDArray[np.float64]


@jit
def put_row(to: Floats, values: Floats) -> None:
    """Copy a vector into another one.

    Shapes: `to` (n,); `values` (n,).

    Examples
    --------
    >>> to = np.zeros(3)
    >>> put_row(to[1:], np.array([1.0, 2.0]))
    >>> to.tolist()
    [0.0, 1.0, 2.0]
    """
    for i in range(to.size):
        to[i] = values[i]


@jit
def put_scaled(to: Floats, values: Floats, divisor: float) -> None:
    """Copy a vector, divided by a number, into another one or into itself.

    Shapes: `to` (n,); `values` (n,).

    Examples
    --------
    >>> v = np.array([1.0, 2.0])
    >>> put_scaled(v, v, 2.0)
    >>> v.tolist()
    [0.5, 1.0]
    """
    for i in range(to.size):
        to[i] = values[i] / divisor


@jit
def beyond(centre: Floats, step: float, direction: Floats) -> Floats:
    """``x + h v``: a point a number of steps away from another one.

    Shapes: `centre` (n,); `direction` (n,); result (n,).

    Examples
    --------
    >>> beyond(np.array([1.0, 2.0]), 2.0, np.array([0.0, 1.0])).tolist()
    [1.0, 4.0]
    """
    out = np.empty(centre.size)
    for i in range(centre.size):
        out[i] = centre[i] + step * direction[i]
    return out


@jit
def dot(v: Floats, w: Floats) -> float:
    """``v' w``, summed in order of the components.

    Shapes: `v`, `w` (n,).

    Examples
    --------
    >>> dot(np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    11.0
    """
    total = 0.0
    for i in range(v.size):
        total += v[i] * w[i]
    return total


@jit
def norm(v: Floats) -> float:
    """Euclidean norm, summed in order of the components.

    Shapes: `v` (n,).

    Examples
    --------
    >>> norm(np.array([3.0, 4.0]))
    5.0
    """
    total = 0.0
    for i in range(v.size):
        total += v[i] * v[i]
    return math.sqrt(total)


@jit
def largest(values: Floats, count: int) -> int:
    """Index of the largest of the first values; of the first of them where several are equal.

    Shapes: `values` (n,).

    Examples
    --------
    >>> largest(np.array([1.0, 3.0, 3.0, 9.0]), 3)
    1
    """
    at = 0
    for i in range(1, count):
        if values[i] > values[at]:
            at = i
    return at
