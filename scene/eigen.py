"""Eigenvalues and eigenvectors of small symmetric matrices, the same to the last bit on every processor."""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import internal, jit

Floats = NDArray[np.float64]

SWEEPS = 30  # at most; Jacobi's rotations converge quadratically, usually in six


@internal
def _rotate(a: Floats, vectors: Floats, p: int, q: int) -> None:
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

    Shapes: `symmetric` (n, n); `values` (n,); `vectors` (n, n).

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
                    _rotate(a, turned, p, q)
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
