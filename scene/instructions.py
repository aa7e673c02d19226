"""Processor instructions that numba has no name for: the fused multiply-add, and the width of vectors.

A compiler that may contract ``a * b + c`` does so on one processor and not on another.  Here the source says where it
happens, and every processor gives the same bits: by an instruction where there is one, by its emulation elsewhere.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any, cast

import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic

from rattle.scene.compiled import inline

HALVES = 2.0**27 + 1.0  # Veltkamp's factor: splits the 53 bits of a float into two parts of at most 26
PLAIN = 1e-250, 1e250  # sizes of a product, and of its factors, between which the splitting is exact


def emulate_fma(a: float, b: float, c: float) -> float:
    """``a * b + c`` rounded once, in ordinary floating-point arithmetic.

    The product is split into two floats whose sum it is (Dekker 1971), and the three are added with one rounding;
    where a part could underflow or overflow, in fractions.

    Examples
    --------
    >>> emulate_fma(1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0) == -(2.0**-60)
    True
    """
    a, b, c = float(a), float(b), float(c)
    product = a * b
    if not all(map(math.isfinite, (a, b, c))):
        return product + c
    if not all(PLAIN[0] < abs(size) < PLAIN[1] for size in (a, b, product)):
        exact = Fraction(a) * Fraction(b) + Fraction(c)
        try:
            return float(exact)
        except OverflowError:
            return math.inf if exact > 0 else -math.inf
    high_a, high_b = HALVES * a - (HALVES * a - a), HALVES * b - (HALVES * b - b)
    low_a, low_b = a - high_a, b - high_b
    error = low_a * low_b - (((product - high_a * high_b) - low_a * high_b) - high_a * low_b)
    return math.fsum((product, error, c))


@intrinsic
def _fma(_context: Any, a: Any, b: Any, c: Any) -> Any:
    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), emit


@intrinsic
def _widest_vectors(_context: Any) -> Any:
    def emit(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # llvmlite's own `add` knows fewer names
        return context.get_dummy_value()

    return types.void(), emit


def _nothing() -> None:
    """Stands for `widest_vectors` where the compiler is off."""


INTERPRETED = bool(getattr(numba.config, "DISABLE_JIT", False))

fma = cast(Callable[[float, float, float], float], emulate_fma if INTERPRETED else _fma)
"""``fma(a, b, c)``: ``a * b + c`` rounded once, by an instruction in compiled code; emulated where numba is off."""

widest_vectors = cast(Callable[[], None], _nothing if INTERPRETED else _widest_vectors)
"""Ask the compiler for vectors of 512 bits in the calling function, where the processor has them.

It prefers 256 otherwise, since some processors lower their clock under wide vectors; the loops over paths win in spite
of that.  Numbers do not depend on it.
"""


@inline
def float_of(word: np.uint64) -> np.float64:
    """The float that has these bits.

    Examples
    --------
    >>> float(float_of(np.uint64(0x3FF0000000000000)))
    1.0
    """
    return np.uint64(word).view(np.float64)


@inline
def word_of(x: float) -> np.uint64:
    """The bits of a float.

    Examples
    --------
    >>> hex(word_of(1.0))
    '0x3ff0000000000000'
    """
    return np.float64(x).view(np.uint64)
