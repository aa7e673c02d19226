"""The numba options under which scalar physics is compiled, in one place."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.np import linalg

from rattle.scene.machine_code import keep, keep_by_source

P = ParamSpec("P")
R = TypeVar("R")


def _without_blas() -> None:
    """Have numba's array functions imported without their search for a BLAS, which loads `scipy.linalg` (0.3 s).

    Nothing here calls it, and scipy, a requirement, has one for who does.
    """
    search, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        from numba.np import arraymath
    finally:
        linalg.ensure_blas = search
    setattr(arraymath, "ensure_blas", search)  # noqa: B010  (numba has no types)


_without_blas()

keep_by_source()
OPTIONS: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
LEAN: dict[str, Any] = OPTIONS | {"_nrt": False}
INTERNAL: dict[str, Any] = OPTIONS | {"no_cpython_wrapper": True}
INLINE: dict[str, Any] = LEAN | {"forceinline": True}


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function with numba, keep the machine code on disk, and release the interpreter lock while it runs.

    Division follows IEEE rules instead of raising: a branch on every division keeps LLVM from
    vectorising the loops over paths.  No fast-math: results do not depend on how a loop over paths is cut.
    """
    return cast(Callable[P, R], keep(numba.njit(**OPTIONS)(function)))


def lean(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit`, without reference counting: for functions that allocate no arrays and take views only."""
    return cast(Callable[P, R], keep(numba.njit(**LEAN)(function)))


def internal(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit`, for a function that compiled code alone calls: Python cannot call it, and its callers keep its code."""
    return cast(Callable[P, R], numba.njit(**INTERNAL)(function))


def inline(function: Callable[P, R]) -> Callable[P, R]:
    """As `lean`, and always inlined by LLVM: a loop over paths vectorises only when its body calls nothing."""
    return cast(Callable[P, R], numba.njit(**INLINE)(function))


def splice(function: Callable[P, R]) -> Callable[P, R]:
    """Inline a function into its caller before type inference, so that branches on the caller's constants are removed.

    For no other reason: the copy is typed again in each caller.
    """
    return cast(Callable[P, R], numba.njit(inline="always")(function))
