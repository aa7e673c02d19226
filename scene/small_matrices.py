"""Small matrices as explicit loops: quick to compile, and the same to the last bit on every processor.

Assigning an array to a slice in compiled code brings in numpy's broadcasting and its error messages, and an array
expression brings in iterators.  LLVM optimises these again in every caller.  BLAS and LAPACK choose their kernels by
the processor, and with them the order of sums.
"""

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import internal
from rattle.scene.small_vectors import dot

Floats = NDArray[np.float64]


@internal
def put(to: Floats, values: Floats) -> None:
    """Copy a matrix into another one, or into a block of one.

    Shapes: `to` (m, n); `values` (m, n).
    """
    for i in range(to.shape[0]):
        for j in range(to.shape[1]):
            to[i, j] = values[i, j]


@internal
def apply(matrix: Floats, v: Floats) -> Floats:
    """``A v``, a vector after a linear map.

    Shapes: `matrix` (m, n); `v` (n,); result (m,).
    """
    out = np.empty(matrix.shape[0])
    for i in range(matrix.shape[0]):
        out[i] = dot(matrix[i], v)
    return out


@internal
def times(a: Floats, b: Floats) -> Floats:
    """``A B``.

    Shapes: `a`, `b` (m, k) and (k, n); result (m, n).
    """
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@internal
def times_transposed(a: Floats, b: Floats) -> Floats:
    """``A B'``.

    Shapes: `a`, `b` (m, k) and (n, k); result (m, n).
    """
    out = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            out[i, j] = dot(a[i], b[j])
    return out


@internal
def block(matrix: Floats, rows: int, first: int, last: int) -> Floats:
    """Copy of a block of a matrix.

    Shapes: result (rows, last - first).
    """
    out = np.empty((rows, last - first))
    for i in range(rows):
        for j in range(first, last):
            out[i, j - first] = matrix[i, j]
    return out


@internal
def congruence(linear: Floats, form: Floats) -> Floats:
    """``T A T'``, the covariance A after a linear map T.

    Shapes: `linear` (m, n); `form` (n, n); result (m, m).
    """
    return times_transposed(times(linear, form), linear)


@internal
def quadratic(form: Floats, axes: Floats) -> Floats:
    """``T' A T``, the quadratic form A in the coordinates along the columns of T.

    Shapes: `form` (n, n); `axes` (n, m); result (m, m).
    """
    mapped, out = times(form, axes), np.zeros((axes.shape[1], axes.shape[1]))
    for k in range(axes.shape[0]):
        for i in range(axes.shape[1]):
            for j in range(axes.shape[1]):
                out[i, j] += axes[k, i] * mapped[k, j]
    return out


@internal
def inner(matrix: Floats, other: Floats, first: int) -> float:
    """Sum of the products of corresponding entries of a matrix and of a block of another one.

    Shapes: `other` (m, n).
    """
    total = 0.0
    for i in range(other.shape[0]):
        for j in range(other.shape[1]):
            total += matrix[first + i, first + j] * other[i, j]
    return total
