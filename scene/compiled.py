"""One place for the options under which scalar physics is compiled, and for where the machine code is kept."""

import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

__all__ = ["inlined", "jit", "lean", "reducing", "spliced"]

P = ParamSpec("P")
R = TypeVar("R")

PACKAGES = ("scene", "closure", "montecarlo")

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
LEAN: dict[str, Any] = OPTIONS | {"_nrt": False}


def _keep_machine_code_by_source() -> None:
    """Point numba's cache to a folder named by the sources of all compiled code.

    Numba by itself looks only at the file of the function that is called: after a change in a file that it calls
    into, it would go on with the old machine code, and the numbers would be those of another program.
    """
    root = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).glob("*.py")):
            digest.update(path.read_bytes())
    folder = root / "scene" / "__pycache__" / f"machine-code-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # an installation that cannot be written does not change either: numba finds a place of its own
    if not os.access(folder, os.W_OK):
        return
    for other in folder.parent.glob("machine-code-*"):
        if other != folder:
            shutil.rmtree(other, ignore_errors=True)
    setattr(numba.config, "CACHE_DIR", str(folder))  # noqa: B010  (numba.config has no types)


if "NUMBA_CACHE_DIR" not in os.environ:
    _keep_machine_code_by_source()


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile to machine code once, keep it on disk, release the interpreter lock.

    Division follows IEEE rules instead of raising: a branch on every division keeps LLVM from
    vectorising the loops over paths.  No fast-math: results do not depend on how a loop is cut.
    """
    return cast(Callable[P, R], numba.njit(**OPTIONS)(function))


def lean(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit`, for loops that allocate nothing: views of arrays are taken without counting references to them."""
    return cast(Callable[P, R], numba.njit(**LEAN)(function))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `lean`, and always made part of its caller: a loop over paths vectorises only when it calls nothing."""
    return cast(Callable[P, R], numba.njit(**LEAN, forceinline=True)(function))


def reducing(function: Callable[P, R]) -> Callable[P, R]:
    """As `lean`, and sums may be taken in any order that the compiler likes, always the same: they vectorise."""
    return cast(Callable[P, R], numba.njit(**LEAN, fastmath={"reassoc"})(function))


def spliced(function: Callable[P, R]) -> Callable[P, R]:
    """Written into its caller before types are known: branches on the caller's constants go, with all they call.

    A large body that is called from one place is then optimised once, not again in every function above it.
    """
    return cast(Callable[P, R], numba.njit(inline="always")(function))
