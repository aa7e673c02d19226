"""Vectors and blocks of small matrices, in loops: what array expressions would say, compiled in a fraction of the time.

A slice that compiled code assigns an array to brings numpy's broadcasting along, messages included, and an expression
in arrays brings its iterators.  LLVM optimises them again in every caller of the function they stand in.
"""

import math

import numpy as np

from rattle.closure.orbit import Floats
from rattle.scene.compiled import jit
from rattle.scene.impact import contact_matrix
from rattle.scene.scene import Constants

__all__ = ["beyond", "block", "congruence", "hit_matrix", "inner", "norm", "put", "put_row", "put_scaled"]


@jit
def put_row(to: Floats, values: Floats) -> None:
    """Write a vector into another one.

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
    """Write a vector, divided by a number, into another one or into itself.

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
def put(to: Floats, values: Floats) -> None:
    """Write a matrix into another one, or into a block of one.

    Examples
    --------
    >>> to = np.zeros((2, 3))
    >>> put(to[:, 1:], np.eye(2))
    >>> to.tolist()
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    for i in range(to.shape[0]):
        for j in range(to.shape[1]):
            to[i, j] = values[i, j]


@jit
def beyond(centre: Floats, step: float, direction: Floats) -> Floats:
    """A point so many steps from another one, ``x + h v``.

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
def norm(v: Floats) -> float:
    """Euclidean norm, summed in order.

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
def block(matrix: Floats, rows: int, first: int, last: int) -> Floats:
    """Copy of the first so many rows, columns `first` up to `last`.

    Examples
    --------
    >>> block(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), 1, 1, 3)
    array([[2., 3.]])
    """
    out = np.empty((rows, last - first))
    for i in range(rows):
        for j in range(first, last):
            out[i, j - first] = matrix[i, j]
    return out


@jit
def congruence(turn: Floats, form: Floats) -> Floats:
    """``T A T'``: a covariance A under a linear map T.

    Examples
    --------
    >>> congruence(np.array([[1.0, 2.0]]), np.eye(2)).tolist()
    [[5.0]]
    """
    return turn @ form @ turn.T


@jit
def inner(matrix: Floats, other: Floats, first: int) -> float:
    """Sum of the products of entries: of all of `other` with those of `matrix` from row and column `first` on.

    Examples
    --------
    >>> inner(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[10.0]]), 1)
    40.0
    """
    total = 0.0
    for i in range(other.shape[0]):
        for j in range(other.shape[1]):
            total += matrix[first + i, first + j] * other[i, j]
    return total


@jit
def hit_matrix(c: Constants, mesh: int, d: int) -> Floats:
    """The contact law on the d section quantities ``(tau, x1, y1, x2, y2, ...)``, shape (d, d).

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> (hit_matrix(Scene.from_gears(DAT21).constants, 1, 5) @ np.array([0.3, 0.5, 2.0, 0.1, 2.0])).round(12).tolist()
    [0.3, 0.5, -1.8, 0.1, -1.8]
    """
    contact, out = contact_matrix(c, mesh), np.zeros((d, d))
    for i in range(d):
        out[i, i] = 1.0
    for i in range(4):
        for j in range(4):
            out[1 + i, 1 + j] = contact[i, j]
    return out
