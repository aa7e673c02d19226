"""How physics is compiled: the numba options, where machine code is kept, instructions that numba has no name for.

Machine code is kept in a folder of the user's own, named by the sources that it was made from.  Cached files are
unpickled and executed, so whoever can write to the folder can run code as you: it is used only where you own it and
nobody else has access (mode 0700).  What is missing, damaged or cannot be read is compiled again.

A compiler that may contract ``a * b + c`` does so on one processor and not on another.  Here the source says where it
happens (`fma`), and every processor gives the same bits: by an instruction where there is one, by its emulation
elsewhere.
"""

import hashlib
import math
import multiprocessing
import os
import pickle
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, UserProvidedCacheLocator
from numba.core.runtime.nrt import rtsys
from numba.extending import intrinsic, register_jitable

PACKAGES = ("scene", "closure", "montecarlo")
TAKEN = ("scene/compiled.py", "scene/types.py", "montecarlo/schemes/step_state.py")
"""Beside the sources that import the compiler, what compiled code takes."""
COMPILED = b"from rattle.scene." + b"compiled import"  # in two, since this source is not compiled
UNCOMPILED = re.compile(rb'"{3}(?:.|\n)*?"{3}|[ \t]*\x23[^\n]*')  # docstrings and comments
NUMBAS_PLACE: Any = UserProvidedCacheLocator  # typed as Any: numba has no type hints
NUMBAS_STORE: Any = CompileResultCacheImpl
NUMBAS_CACHE: Any = FunctionCache

D = TypeVar("D")
P = ParamSpec("P")
R = TypeVar("R")

_folder: Path | None = None  # the cache folder; None where there is none
_warnings: list[str] = []  # printed when the first function is compiled
_compiled = 0  # functions that this process has compiled


def strip(source: bytes) -> bytes:
    """A source without its comments and empty lines, and with empty docstrings."""
    stripped = UNCOMPILED.sub(lambda found: b'""' if found[0].startswith(b'"') else b"", source)
    return b"\n".join(line for line in stripped.splitlines() if line.strip())


def source_digest(root: Path) -> str:
    """Digest of the sources of all compiled code and of the versions of the libraries that compile it.

    Sources of compiled code import `rattle.scene.compiled`, or are named in `TAKEN`; all others may change freely, and
    so may comments and docstrings.  The processor is not part of it: numba's index records its features by entry.
    """
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__} {np.__version__}".encode())
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            name, source = path.relative_to(root).as_posix(), path.read_bytes()
            if COMPILED in source or name in TAKEN:
                digest.update(name.encode() + strip(source))
    return digest.hexdigest()[:16]


def keep_by_source() -> None:
    """Choose the folder for machine code, named by user, installation and sources.

    Numba by itself checks only the file of the function that is called: after a change in a file that it calls
    into, it would go on with the old machine code, and the results would be those of other sources.

    The folder is the first of these that can be created and is private: in NUMBA_CACHE_DIR, in this installation, in
    the user's cache, among the system's temporary files.  Folders of earlier sources are removed; a process that still
    uses one compiles what it has not loaded.
    """
    global _folder
    root = Path(__file__).resolve().parent.parent
    mine = f"rattle-{os.geteuid()}-{hashlib.sha256(os.fsencode(root)).hexdigest()[:8]}-"
    shared, own = Path(tempfile.gettempdir()), Path(os.environ.get("HOME") or tempfile.gettempdir()) / ".cache"
    places = [root / "scene" / "__pycache__", Path(os.environ.get("XDG_CACHE_HOME") or own), shared]
    if os.environ.get("NUMBA_CACHE_DIR"):
        places.insert(0, Path(os.environ["NUMBA_CACHE_DIR"]))
    folders = [place.absolute() / (mine + source_digest(root)) for place in places]
    _folder = next(filter(_is_private, folders), None)
    if _folder is None:
        print(f"rattle: {folders[0].parent} cannot be written: machine code is not kept", file=sys.stderr)
        return
    if _folder != folders[0]:
        _warnings.append(f"{folders[0].parent} cannot be written: machine code is kept in {_folder}")
    for other in _folder.parent.glob(mine + "*"):
        if other != _folder:
            shutil.rmtree(other, ignore_errors=True)


def _is_private(folder: Path) -> bool:
    """Whether a folder is owned by this user, closed to others and writable; it is created if missing.

    Links are refused.  A folder of ours that was open to others is emptied: they may have put something into it.
    """
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if folder.lstat().st_uid == os.geteuid() and folder.lstat().st_mode & 0o077:
            shutil.rmtree(folder)  # refuses a link
            folder.mkdir(mode=0o700)
        found = folder.lstat()
        closed = found.st_uid == os.geteuid() and not found.st_mode & 0o077
        return closed and folder.is_dir() and os.access(folder, os.W_OK)
    return False


def has_fma() -> bool:
    """Whether compiled code may use AVX2 and a fused multiply-add; every processor but an old x86-64 has its like.

    Without them the results are right and slower, since each multiply-add calls a function.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return True
    features = getattr(numba.config, "CPU_FEATURES", None) or llvmlite.binding.get_host_cpu_features().flatten()
    return {"+avx2", "+fma"} <= set(features.split(","))


def folder() -> Path | None:
    """Folder that machine code is kept in."""
    return _folder


def count_compiled() -> int:
    """How many functions this process has compiled, because they were not in the cache."""
    return _compiled


def _count() -> None:
    """Count a function that has to be compiled; with the first one, print the warnings."""
    global _compiled
    _compiled += 1
    if _compiled > 1:
        return
    if not has_fma():
        _warnings.append("this processor has no AVX2 or no FMA: simulations take several times as long as they might")
    if sys.stderr.isatty() and multiprocessing.parent_process() is None:
        _warnings.append("compiling for this processor, about a minute, once (rattle warm-up: for all)")
    for warning in _warnings:
        print(f"rattle: {warning}", file=sys.stderr)


class BySource(NUMBAS_PLACE):  # type: ignore[misc]
    """Numba's place of a function's files: in our folder, whose name stands for the sources."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file, self._cache_path = file, os.path.join(str(_folder), self.get_suitable_cache_subpath(file))

    get_source_stamp = get_disambiguator = lambda self: ""  # numba's index has a digest of the bytecode

    @classmethod
    def from_function(cls, function: Any, file: str) -> Any:
        """Where the machine code of a function is kept."""
        return cls(function, file)


class Checked(NUMBAS_STORE):  # type: ignore[misc]
    """Numba's form of a compiled function, with a checksum."""

    _locator_classes = (BySource,)

    def reduce(self, compiled: Any) -> tuple[bytes, bytes]:
        """What is written."""
        content = pickle.dumps(super().reduce(compiled))
        return hashlib.sha256(content).digest(), content

    def rebuild(self, target_context: Any, stored: tuple[bytes, bytes]) -> Any:
        """The function from what was read; with numba's runtime, for functions that call it."""
        checksum, content = stored
        if hashlib.sha256(content).digest() != checksum:
            raise ValueError("machine code is damaged")
        rtsys.initialize(target_context)
        return super().rebuild(target_context, pickle.loads(content))


class OnDisk(NUMBAS_CACHE):  # type: ignore[misc]
    """Numba's cache of a function, for a folder that may be full, damaged, or removed by another version."""

    _impl_class = Checked

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Machine code from the cache; None where it has to be compiled, which is announced once.

        Numba would first describe all that it can compile (0.3 s), which only a function that is not here needs.
        """
        found = None
        try:
            found = self._load_overload(signature, target_context)
        except Exception:  # whatever a damaged file raises: all of the function is compiled again
            with suppress(OSError):
                self.flush()
        if found is None:
            _count()
        return found

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Write machine code to the cache, where that is possible: otherwise it is compiled again next time."""
        if _is_private(cast(Path, _folder)):
            with suppress(OSError):
                super().save_overload(signature, compiled)


def keep(function: D) -> D:
    """Have the machine code of a function kept on disk."""
    made: Any = function
    if _folder is not None and hasattr(made, "py_func"):
        made._cache = OnDisk(made.py_func)
    return function


keep_by_source()
OPTIONS: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
LEAN: dict[str, Any] = OPTIONS | {"_nrt": False}
INTERNAL: dict[str, Any] = OPTIONS | {"no_cpython_wrapper": True}
SIMULATED_GPU = bool(getattr(numba.config, "ENABLE_CUDASIM", False))  # runs as Python, and calls these
LEAN_INTERNAL: dict[str, Any] = LEAN | {"no_cpython_wrapper": not SIMULATED_GPU}
INLINE: dict[str, Any] = LEAN_INTERNAL | {"forceinline": True}


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


def lean_internal(function: Callable[P, R]) -> Callable[P, R]:
    """As `lean`, for compiled callers alone, as `internal` is."""
    return cast(Callable[P, R], numba.njit(**LEAN_INTERNAL)(function))


def shared(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function for its compiled callers alone; in Python it runs as it stands: for what is called rarely."""
    return register_jitable(**OPTIONS)(function)


def shared_inline(function: Callable[P, R]) -> Callable[P, R]:
    """As `shared`, and always inlined as `inline` does: for a formula that both Python and loops over paths need."""
    return register_jitable(**INLINE)(function)


def inline(function: Callable[P, R]) -> Callable[P, R]:
    """As `lean_internal`, and always inlined by LLVM: a loop over paths vectorises only when its body calls nothing."""
    return cast(Callable[P, R], numba.njit(**INLINE)(function))


def splice(function: Callable[P, R]) -> Callable[P, R]:
    """Inline a function into its caller before type inference: branches on the caller's constants are removed.

    A function with one caller compiles faster so: by itself it would be optimised, and then again within its caller.
    Other functions do not: the copy is typed and optimised again in each caller.
    """
    return cast(Callable[P, R], numba.njit(inline="always")(function))


def emulate_fma(a: float, b: float, c: float) -> float:
    """``a * b + c`` rounded once, in fractions."""
    a, b, c = float(a), float(b), float(c)
    exact = Fraction(a) * Fraction(b) + Fraction(c) if all(map(math.isfinite, (a, b, c))) else 0
    try:
        return float(exact) if exact else a * b + c  # which has the sign of a zero
    except OverflowError:
        return math.inf if exact > 0 else -math.inf


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
    """The float that has these bits."""
    return np.uint64(word).view(np.float64)


@inline
def word_of(x: float) -> np.uint64:
    """The bits of a float."""
    return np.float64(x).view(np.uint64)
