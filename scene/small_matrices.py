"""Small matrices as explicit loops: quick to compile, and the same to the last bit on every processor.

Assigning an array to a slice in compiled code brings in numpy's broadcasting and its error messages, and an array
expression brings in iterators.  LLVM optimises these again in every caller.  BLAS and LAPACK choose their kernels by
the processor, and with them the order of sums.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import jit

__all__ = [
    "applied", "beyond", "block", "congruence", "dot", "eigen", "inner", "largest", "norm", "put", "put_row",
    "put_scaled", "quadratic", "times", "times_transposed",
]  # fmt: skip

Floats = NDArray[np.float64]

SWEEPS = 30  # at most; Jacobi's rotations converge quadratically, usually in six


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
def dot(v: Floats, w: Floats) -> float:
    """``v' w``, summed in order of the components.

    Parameters
    ----------
    v, w : ndarray, shape (n,)
        The vectors.

    Returns
    -------
    float
        Their inner product.

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
def largest(values: Floats, count: int) -> int:
    """Index of the largest of the first values; of the first of them where several are equal.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The values.
    count : int
        How many are looked at, at least one.

    Returns
    -------
    int
        The index.

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


@jit
def applied(matrix: Floats, v: Floats) -> Floats:
    """``A v``, a vector after a linear map.

    Parameters
    ----------
    matrix : ndarray, shape (m, n)
        The map A.
    v : ndarray, shape (n,)
        The vector.

    Returns
    -------
    ndarray, shape (m,)
        A new vector.

    Examples
    --------
    >>> applied(np.array([[1.0, 2.0], [0.0, 1.0]]), np.array([3.0, 4.0])).tolist()
    [11.0, 4.0]
    """
    out = np.empty(matrix.shape[0])
    for i in range(matrix.shape[0]):
        out[i] = dot(matrix[i], v)
    return out


@jit
def times(a: Floats, b: Floats) -> Floats:
    """``A B``.

    Parameters
    ----------
    a, b : ndarray, shapes (m, k) and (k, n)
        The factors.

    Returns
    -------
    ndarray, shape (m, n)
        A new matrix.

    Examples
    --------
    >>> times(np.array([[1.0, 2.0]]), np.array([[3.0], [4.0]])).tolist()
    [[11.0]]
    """
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@jit
def times_transposed(a: Floats, b: Floats) -> Floats:
    """``A B'``.

    Parameters
    ----------
    a, b : ndarray, shapes (m, k) and (n, k)
        The factors.

    Returns
    -------
    ndarray, shape (m, n)
        A new matrix.

    Examples
    --------
    >>> times_transposed(np.array([[1.0, 2.0]]), np.array([[3.0, 4.0]])).tolist()
    [[11.0]]
    """
    out = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            out[i, j] = dot(a[i], b[j])
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
    return times_transposed(times(linear, form), linear)


@jit
def quadratic(form: Floats, axes: Floats) -> Floats:
    """``T' A T``, the quadratic form A in the coordinates along the columns of T.

    Parameters
    ----------
    form : ndarray, shape (n, n)
        The form A.
    axes : ndarray, shape (n, m)
        The columns T.

    Returns
    -------
    ndarray, shape (m, m)
        A new matrix.

    Examples
    --------
    >>> quadratic(np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([[1.0], [2.0]])).tolist()
    [[4.0]]
    """
    mapped, out = times(form, axes), np.zeros((axes.shape[1], axes.shape[1]))
    for k in range(axes.shape[0]):
        for i in range(axes.shape[1]):
            for j in range(axes.shape[1]):
                out[i, j] += axes[k, i] * mapped[k, j]
    return out


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
def _rotated(a: Floats, vectors: Floats, p: int, q: int) -> None:
    """Jacobi's rotation that makes ``a[p, q]`` zero, applied to a symmetric matrix and to the vectors, in place."""
    theta = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(1.0 + theta * theta)) if abs(theta) < 1e150 else 0.5 / theta
    cosine = 1.0 / math.sqrt(1.0 + t * t)
    sine = t * cosine
    change = t * a[p, q]
    a[p, p] -= change
    a[q, q] += change
    a[p, q] = a[q, p] = 0.0
    for i in range(a.shape[0]):
        if i not in (p, q):
            at_p, at_q = a[i, p], a[i, q]
            a[i, p] = a[p, i] = cosine * at_p - sine * at_q
            a[i, q] = a[q, i] = sine * at_p + cosine * at_q
        at_p, at_q = vectors[i, p], vectors[i, q]
        vectors[i, p], vectors[i, q] = cosine * at_p - sine * at_q, sine * at_p + cosine * at_q


@jit
def eigen(symmetric: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues and eigenvectors of a symmetric matrix by Jacobi's cyclic rotations.

    Parameters
    ----------
    symmetric : ndarray, shape (n, n)
        The matrix, finite.

    Returns
    -------
    values : ndarray, shape (n,)
        Eigenvalues, smallest first.
    vectors : ndarray, shape (n, n)
        Their unit vectors in the columns.

    Notes
    -----
    Golub and Van Loan, Matrix Computations, section 8.5.  Entries that are below rounding of both of their diagonal
    entries are left, so small eigenvalues keep their relative accuracy where the matrix determines them.

    Examples
    --------
    >>> values, vectors = eigen(np.array([[2.0, 1.0], [1.0, 2.0]]))
    >>> values.round(12).tolist(), abs(vectors).round(6).tolist()
    ([1.0, 3.0], [[0.707107, 0.707107], [0.707107, 0.707107]])
    """
    n = symmetric.shape[0]
    a, turned = symmetric.copy(), np.zeros((n, n))
    for i in range(n):
        turned[i, i] = 1.0
    for _ in range(SWEEPS):
        settled = True
        for p in range(n - 1):
            for q in range(p + 1, n):
                if abs(a[p, q]) > 1e-17 * math.sqrt(abs(a[p, p])) * math.sqrt(abs(a[q, q])):
                    _rotated(a, turned, p, q)
                    settled = False
        if settled:
            break
    values, vectors, taken = np.empty(n), np.empty((n, n)), np.zeros(n)
    for k in range(n):
        at = -1
        for i in range(n):
            if taken[i] == 0.0 and (at < 0 or a[i, i] < a[at, at]):
                at = i
        taken[at], values[k] = 1.0, a[at, at]
        for i in range(n):
            vectors[i, k] = turned[i, at]
    return values, vectors
