"""Operations on vectors and blocks of small matrices as explicit loops, which compile faster than array expressions.

Assigning an array to a slice in compiled code brings in numpy's broadcasting and its error messages, and an array
expression brings in iterators.  LLVM optimises these again in every caller.
"""

import math

import numpy as np

from rattle.closure.orbit import Floats
from rattle.scene.compiled import jit
from rattle.scene.constants import Constants
from rattle.scene.impact import contact_matrix

__all__ = ["beyond", "block", "congruence", "hit_matrix", "inner", "norm", "put", "put_row", "put_scaled"]


@jit
def put_row(to: Floats, values: Floats) -> None:
    """Copy a vector into another one.

    Parameters
    ----------
    to : ndarray, shape (n,)
        Overwritten.
    values : ndarray, shape (n,)
        The vector.

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

    Parameters
    ----------
    to : ndarray, shape (n,)
        Overwritten.
    values : ndarray, shape (n,)
        The vector.
    divisor : float
        The number.

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
    """Copy a matrix into another one, or into a block of one.

    Parameters
    ----------
    to : ndarray, shape (m, n)
        Overwritten.
    values : ndarray, shape (m, n)
        The matrix.

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
    """``x + h v``: a point a number of steps away from another one.

    Parameters
    ----------
    centre : ndarray, shape (n,)
        The point x.
    step : float
        The number of steps h.
    direction : ndarray, shape (n,)
        The step v.

    Returns
    -------
    ndarray, shape (n,)
        A new vector.

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
    """Euclidean norm, summed in order of the components.

    Parameters
    ----------
    v : ndarray, shape (n,)
        The vector.

    Returns
    -------
    float
        Its length.

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
    """Copy of a block of a matrix.

    Parameters
    ----------
    matrix : ndarray
        The matrix.
    rows : int
        Number of rows, from the first on.
    first, last : int
        Columns from `first` up to, but not including, `last`.

    Returns
    -------
    ndarray, shape (rows, last - first)
        A new matrix.

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
def congruence(linear: Floats, form: Floats) -> Floats:
    """``T A T'``, the covariance A after a linear map T.

    Parameters
    ----------
    linear : ndarray, shape (m, n)
        The linear map T.
    form : ndarray, shape (n, n)
        The covariance A.

    Returns
    -------
    ndarray, shape (m, m)
        A new matrix.

    Examples
    --------
    >>> congruence(np.array([[1.0, 2.0]]), np.eye(2)).tolist()
    [[5.0]]
    """
    return linear @ form @ linear.T


@jit
def inner(matrix: Floats, other: Floats, first: int) -> float:
    """Sum of the products of corresponding entries of a matrix and of a block of another one.

    Parameters
    ----------
    matrix : ndarray
        Its block begins at row and column `first`.
    other : ndarray, shape (m, n)
        Of the size of the block.
    first : int
        First row and column of the block.

    Returns
    -------
    float
        The Frobenius inner product.

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
    """The restitution map on the section state ``(tau, x1, y1, x2, y2, ...)``.

    Parameters
    ----------
    c : Constants
        The scene.
    mesh : {1, 2}
        Mesh that is struck.
    d : int
        Size of the section state, 5 or 9.

    Returns
    -------
    ndarray, shape (d, d)
        It leaves tau and the flanks unchanged.

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
