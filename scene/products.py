"""Products of small matrices in numpy, summed in order: the bits of `rattle.scene.small_matrices`, nothing compiled."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def product(a: Floats, b: Floats) -> Floats:
    """``A B``; of stacks of matrices, one by one.

    Shapes: `a`, `b` (..., m, k) and (..., k, n); result (..., m, n).

    Examples
    --------
    >>> product(np.array([[1.0, 2.0]]), np.array([[3.0], [4.0]])).tolist()
    [[11.0]]
    """
    terms = a[..., :, :, None] * b[..., None, :, :]
    return np.asarray(np.add.accumulate(terms, axis=-2)[..., -1, :] + 0.0)  # a sum of -0.0 is 0.0


def transform(linear: Floats, form: Floats) -> Floats:
    """``T A T'``, the covariance A after a linear map T; of a stack of covariances, one by one.

    Shapes: `linear` (m, n); `form` (..., n, n); result (..., m, m).

    Examples
    --------
    >>> transform(np.array([[1.0, 2.0]]), np.eye(2)).tolist()
    [[5.0]]
    """
    return product(product(linear, form), linear.T)


def image(matrix: Floats, v: Floats) -> Floats:
    """``A v``; of a stack of matrices, one by one.

    Shapes: `matrix` (..., m, n); `v` (n,); result (..., m).

    Examples
    --------
    >>> image(np.array([[1.0, 2.0], [0.0, 1.0]]), np.array([3.0, 4.0])).tolist()
    [11.0, 4.0]
    """
    return product(matrix, v[:, None])[..., 0]


def totals(terms: Floats) -> Floats:
    """Sum of all numbers of each matrix, in order.

    Shapes: `terms` (..., m, n); result (...).

    Examples
    --------
    >>> totals(np.array([[[1.0, 2.0], [3.0, 4.0]]])).tolist()
    [10.0]
    """
    return np.asarray(np.add.accumulate(terms.reshape(*terms.shape[:-2], -1), axis=-1)[..., -1] + 0.0)


def total(terms: Floats) -> float:
    """Sum of all numbers, in order.

    Examples
    --------
    >>> total(np.array([[1.0, 2.0], [3.0, 4.0]]))
    10.0
    """
    return float(np.add.accumulate(terms.ravel())[-1] + 0.0)
