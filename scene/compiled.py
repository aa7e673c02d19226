"""One place for the options under which scalar physics is compiled."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

from rattle.scene.machine_code import keep_by_source, sealed

__all__ = ["inlined", "jit", "lean", "reducing", "spliced"]

P = ParamSpec("P")
R = TypeVar("R")

OPTIONS: dict[str, Any] = {
    "cache": keep_by_source(), "nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy",
}  # fmt: skip
LEAN: dict[str, Any] = OPTIONS | {"_nrt": False}


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile to machine code once, keep it on disk, release the interpreter lock.

    Division follows IEEE rules instead of raising: a branch on every division keeps LLVM from
    vectorising the loops over paths.  No fast-math: results do not depend on how a loop is cut.
    """
    return cast(Callable[P, R], sealed(numba.njit(**OPTIONS)(function)))


def lean(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit`, for loops that allocate nothing: views of arrays are taken without counting references to them."""
    return cast(Callable[P, R], sealed(numba.njit(**LEAN)(function)))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `lean`, and always made part of its caller: a loop over paths vectorises only when it calls nothing."""
    return cast(Callable[P, R], sealed(numba.njit(**LEAN, forceinline=True)(function)))


def reducing(function: Callable[P, R]) -> Callable[P, R]:
    """As `lean`, and sums may be taken in any order that the compiler likes, always the same: they vectorise."""
    return cast(Callable[P, R], sealed(numba.njit(**LEAN, fastmath={"reassoc"})(function)))


def spliced(function: Callable[P, R]) -> Callable[P, R]:
    """Written into its caller before types are known: branches on the caller's constants go, with all they call.

    A large body that is called from one place is then optimised once, not again in every function above it.
    """
    return cast(Callable[P, R], numba.njit(inline="always")(function))
