"""Small vectors and matrices whose sums are in order: the same to the last bit on every processor,
as BLAS's are not.

First as explicit loops for compiled code, then in numpy for what is called a few times per answer;
both give the same bits.  Array expressions in compiled code would bring in numpy's iterators and
error messages, for LLVM to optimise.
"""

import math
from typing import Any

import numpy as np

from rattle.scene.compiled import internal, jit, lean, lean_internal
from rattle.scene.types import Floats


@internal
def put_row(to: Any, values: Any) -> None:
    """Copy a vector into another one, or into the beginning of one.

    Shapes: `to` (n,) or longer; `values` (n,).
    """
    for i in range(values.size):
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
def add_outer(to: Floats, factor: float, v: Floats, w: Floats) -> None:
    """Add ``f v w'`` to a matrix.

    Shapes: `to` (m, n); `v` (m,); `w` (n,).
    """
    for i in range(v.size):
        for j in range(w.size):
            to[i, j] += factor * (v[i] * w[j])


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
    return math.sqrt(dot(v, v))


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


@internal
def put(to: Floats, values: Floats) -> None:
    """Copy a matrix into another one, or into the first rows and columns of one.

    Shapes: `to` (m, n) or larger; `values` (m, n).
    """
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            to[i, j] = values[i, j]


@internal
def add(to: Floats, values: Floats) -> None:
    """Add a matrix to another one.

    Shapes: `to`, `values` (m, n).
    """
    for i in range(to.shape[0]):
        for j in range(to.shape[1]):
            to[i, j] += values[i, j]


@internal
def apply(matrix: Floats, v: Floats) -> Floats:
    """``A v``, a vector after a linear map.

    Shapes: `matrix` (m, n); `v` (n,); result (m,).
    """
    out = np.empty(matrix.shape[0])
    for i in range(matrix.shape[0]):
        out[i] = dot(matrix[i], v)
    return out


@lean_internal
def add_product(a: Floats, b: Floats, out: Floats) -> None:
    """Add ``A B`` to a matrix.

    Shapes: `a`, `b` (m, k) and (k, n); `out` (m, n).
    """
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]


@lean
def add_products(a: Floats, b: Floats, out: Floats) -> None:
    """Add ``A B`` to each matrix of a stack.

    Shapes: `a`, `b` (stack, m, k) and (stack, k, n); `out` (stack, m, n).
    """
    for s in range(a.shape[0]):
        add_product(a[s], b[s], out[s])


@internal
def times(a: Floats, b: Floats) -> Floats:
    """``A B``.

    Shapes: `a`, `b` (m, k) and (k, n); result (m, n).
    """
    out = np.zeros((a.shape[0], b.shape[1]))
    add_product(a, b, out)
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
    mapped = times(form, axes)
    out = np.zeros((axes.shape[1], axes.shape[1]))
    for k in range(axes.shape[0]):
        for i in range(axes.shape[1]):
            for j in range(axes.shape[1]):
                out[i, j] += axes[k, i] * mapped[k, j]
    return out


@internal
def inner(matrix: Floats, other: Floats) -> float:
    """Sum of the products of corresponding entries of two matrices.

    Shapes: `matrix`, `other` (m, n).
    """
    total = 0.0
    for i in range(other.shape[0]):
        for j in range(other.shape[1]):
            total += matrix[i, j] * other[i, j]
    return total


SWEEPS = 30  # at most; Jacobi's rotations converge quadratically, usually in six


@internal
def _rotate(a: Floats, vectors: Floats, p: int, q: int) -> None:
    """Jacobi's rotation that makes ``a[p, q]`` zero, applied to a symmetric matrix and to the
    vectors, in place."""
    theta = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
    t = (
        math.copysign(1.0, theta) / (abs(theta) + math.sqrt(1.0 + theta * theta))
        if abs(theta) < 1e150
        else 0.5 / theta
    )
    cosine = 1.0 / math.sqrt(1.0 + t * t)
    sine = t * cosine
    change = t * a[p, q]
    a[p, p] -= change
    a[q, q] += change
    a[p, q] = a[q, p] = 0.0
    for i in range(a.shape[0]):
        if i not in (p, q):
            at_p = a[i, p]
            at_q = a[i, q]
            a[i, p] = a[p, i] = cosine * at_p - sine * at_q
            a[i, q] = a[q, i] = sine * at_p + cosine * at_q
        at_p = vectors[i, p]
        at_q = vectors[i, q]
        vectors[i, p] = cosine * at_p - sine * at_q
        vectors[i, q] = sine * at_p + cosine * at_q


@jit
def eigen(symmetric: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues and eigenvectors of a symmetric matrix by Jacobi's cyclic rotations.

    Shapes: `symmetric` (n, n); `values` (n,); `vectors` (n, n).

    Notes
    -----
    Golub and Van Loan, Matrix Computations, section 8.5.  Entries that are below rounding of both
    of their diagonal entries are left, so small eigenvalues keep their relative accuracy where the
    matrix determines them.
    """
    n = symmetric.shape[0]
    a = symmetric.copy()
    turned = np.eye(n)
    for _ in range(SWEEPS):
        settled = True
        for p in range(n - 1):
            for q in range(p + 1, n):
                if abs(a[p, q]) > 1e-17 * math.sqrt(abs(a[p, p])) * math.sqrt(abs(a[q, q])):
                    _rotate(a, turned, p, q)
                    settled = False
        if settled:
            break
    values = np.empty(n)
    vectors = np.empty((n, n))
    taken = np.zeros(n)
    for k in range(n):
        at = -1
        for i in range(n):
            if taken[i] == 0.0 and (at < 0 or a[i, i] < a[at, at]):
                at = i
        taken[at], values[k] = 1.0, a[at, at]
        for i in range(n):
            vectors[i, k] = turned[i, at]
    return values, vectors


def product(a: Floats, b: Floats) -> Floats:
    """``A B``; of stacks of matrices, one by one.

    Shapes: `a`, `b` (..., m, k) and (..., k, n); result (..., m, n).
    """
    stack = a.shape[:-2]
    if stack != b.shape[:-2]:
        stack = np.broadcast_shapes(stack, b.shape[:-2])
        a, b = (np.broadcast_to(part, stack + part.shape[-2:]) for part in (a, b))
    count = math.prod(stack)
    rows, columns = a.shape[-2], b.shape[-1]
    left, right = (np.ascontiguousarray(part).reshape(count, *part.shape[-2:]) for part in (a, b))
    out = np.zeros((count, rows, columns))
    add_products(left, right, out)
    return out.reshape(*stack, rows, columns)


def transform(linear: Floats, form: Floats) -> Floats:
    """``T A T'``, the covariance A after a linear map T; of stacks, one by one.

    Shapes: `linear` (..., m, n); `form` (..., n, n); result (..., m, m).
    """
    return product(product(linear, form), linear.mT)


def image(matrix: Floats, v: Floats) -> Floats:
    """``A v``; of stacks, one by one.

    Shapes: `matrix` (..., m, n); `v` (..., n); result (..., m).
    """
    return product(matrix, v[..., None])[..., 0]


def total(terms: Floats) -> Floats:
    """Sum along the last axis, in order.

    Shapes: `terms` (..., n); result (...).
    """
    return np.asarray(np.add.accumulate(terms, axis=-1)[..., -1])


def totals(terms: Floats) -> Floats:
    """Sum of all numbers of each matrix, in order.

    Shapes: `terms` (..., m, n); result (...).
    """
    return total(terms.reshape(*terms.shape[:-2], -1)) + 0.0
