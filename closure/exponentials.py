"""Exponentials of arrays, as fast as numpy's, whose last bits do not depend on the processor."""

import math

import numpy as np
from numpy.typing import ArrayLike

from rattle.scene.compiled import jit
from rattle.scene.types import Floats


def exponentials(values: ArrayLike) -> Floats:
    """``e^x`` of each number of an array, as `rattle.scene.elementary.each` gives it and a hundred
    times faster."""
    given = np.asarray(values, dtype=float)
    out = np.empty(given.shape)
    _exponentials(given.ravel(), out.ravel())
    return out


@jit
def _exponentials(values: Floats, out: Floats) -> None:
    """Write ``e^x`` of each value into `out`; both of shape (n,)."""
    for i, x in enumerate(values):
        out[i] = math.exp(x)
