"""One place for the options under which scalar physics is compiled."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

__all__ = ["jit"]

P = ParamSpec("P")
R = TypeVar("R")


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile to machine code once, keep it on disk, release the interpreter lock.

    Division follows IEEE rules instead of raising: a branch on every division keeps LLVM from
    vectorising the loops over paths.  No fast-math: results do not depend on how a loop is cut.
    """
    return cast(Callable[P, R], numba.njit(cache=True, nogil=True, error_model="numpy")(function))
