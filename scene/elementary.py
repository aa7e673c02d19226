"""Elementary functions of arrays and quadrature whose last bits do not depend on the processor.

numpy takes other exponentials, powers and trigonometric functions where it finds AVX-512, and its
quadrature nodes are eigenvalues from LAPACK, which chooses its kernels by the processor.  The
functions of the C library are the same on all processors with a fused multiply-add.
"""

import math
from collections.abc import Callable
from functools import cache
from itertools import accumulate, repeat
from operator import mul

import numpy as np
from numpy.typing import ArrayLike

from rattle.scene.types import Floats


def each(function: Callable[[float], float], values: ArrayLike) -> Floats:
    """A function of the standard library, of each number of an array."""
    given = np.asarray(values, dtype=float)
    return np.array([function(x) for x in given.ravel().tolist()]).reshape(given.shape)


def powers(x: Floats, most: int) -> list[Floats]:
    """Powers of an array, by multiplication."""
    return list(accumulate(repeat(x, most), mul, initial=np.ones_like(x)))


def unknown(*shape: int) -> Floats:
    """An array of numbers of which none is known yet: NaN."""
    return np.full(shape, np.nan)


@cache
def gauss_legendre(n: int) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss and Legendre's quadrature on [-1, 1].

    Shapes: result (n,).
    """
    nodes = np.zeros(n)
    weights = np.zeros(n)
    for i in range((n + 1) // 2):
        x = math.cos(math.pi * (i + 0.75) / (n + 0.5)) if 2 * i + 1 < n else 0.0
        slope = 0.0
        for _ in range(10):  # Newton's method doubles the digits, from two on
            p = 1.0
            q = 0.0
            for k in range(1, n + 1):
                p, q = ((2 * k - 1) * x * p - (k - 1) * q) / k, p
            slope = n * (x * p - q) / (x * x - 1.0)
            x -= p / slope
        nodes[i] = -x
        nodes[n - 1 - i] = x
        weights[i] = weights[n - 1 - i] = 2.0 / ((1.0 - x * x) * slope * slope)
    return nodes, weights
