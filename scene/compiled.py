"""How physics is compiled: the numba options, where machine code is kept, instructions that numba
has no name for.

Machine code is kept in a folder of the user's own, named by the sources that it was made from.
Cached files are unpickled and executed, so whoever can write to the folder can run code as you: it
is used only where you own it and nobody else has access (mode 0700).  What is missing, damaged, of
another function or cannot be read is compiled again. Where a source has been edited since this
process began, nothing is taken from the folder or put into it.

A compiler that may contract ``a * b + c`` does so on one processor and not on another.  Here the
source says where it happens (`fma`), and every processor gives the same bits: by an instruction
where there is one, by its emulation elsewhere.
"""

import gc
import hashlib
import math
import os
import pickle
import platform
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from filelock import FileLock, Timeout
from numba.core import event, types
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.extending import intrinsic

from rattle.scene import compile_ahead
from rattle.scene.progress import compiling, print_on_stderr, watch_compiler
from rattle.scene.sources import (
    PACKAGES,
    ROOT,
    SourceFile,
    describe_difference,
    describe_edit,
    digest_of,
    note_imports,
    read_sources,
    sources_in,
)

TAKEN = ("scene/compiled.py", "scene/types.py", "montecarlo/schemes/step_state.py")
"""Beside the sources that import the compiler, what compiled code takes."""
COMPILED = b"from rattle.scene." + b"compiled import"  # in two, since this source is not compiled
NUMBAS_RESULT: Any = CompileResult  # both typed as Any: numba has no type hints
EVENTS: Any = event

CHECKSUM = hashlib.sha256().digest_size
LONGEST_WAIT = 60.0  # seconds for what another process compiles: no function takes half as long
GARBAGE = 20_000, 10, 10  # thresholds of Python's garbage collector while a function is compiled

D = TypeVar("D")
P = ParamSpec("P")
R = TypeVar("R")

_folder: Path | None = None  # the cache folder; None where there is none
_warnings: list[str] = []  # printed when the first function is compiled
_compiled = 0  # functions that this process has compiled
_refused: set[str] = set()  # why machine code is not kept, which is printed once
_used: set[str] = set()  # names of the files that this process has read or written
_anew = False  # whether functions are compiled although their machine code is kept


def compiled_sources(sources: dict[str, SourceFile]) -> dict[str, SourceFile]:
    """Those of all compiled code: they import `rattle.scene.compiled`, or are named in `TAKEN`."""
    return {
        name: source
        for name, source in sources.items()
        if COMPILED in source.content or name in TAKEN
    }


def source_digest(root: Path) -> str:
    """Digest of the sources of all compiled code in an installation, as they stand now: see
    `compiled_digest`."""
    return compiled_digest(compiled_sources(read_sources(root, *PACKAGES)))


def compiled_digest(sources: dict[str, SourceFile]) -> str:
    """Digest of the sources of all compiled code and of the versions of the libraries that compile
    it.

    All other sources may change freely, and so may comments and docstrings.  The processor is not
    part of it: it is part of the name of each file.
    """
    return digest_of(sources, numba.__version__, llvmlite.__version__, np.__version__)


SOURCES = compiled_sources(sources_in(*PACKAGES))
DIGEST = compiled_digest(SOURCES)


def keep_by_source() -> None:
    """Choose the folder for machine code, named by user, installation and sources.

    Numba by itself checks only the file of the function that is called: after a change in a file
    that it calls into, it would go on with the old machine code, and the results would be those of
    other sources.

    The folder is the first that can be created and is private.  Folders of earlier sources are
    removed; a process that still uses one compiles what it has not loaded.
    """
    global _folder
    mine = f"rattle-{os.geteuid()}-{hashlib.sha256(os.fsencode(ROOT)).hexdigest()[:8]}-"
    refused = []
    for place in _places():
        _folder = place / (mine + DIGEST)
        if _is_private(_folder):
            break
        refused.append(place)
    else:
        _folder = None
        print_on_stderr(f"{refused[0]} cannot be written: machine code is not kept")
        return
    if refused:
        _warnings.append(f"{refused[0]} cannot be written: machine code is kept in {_folder}")
    for other in _folder.parent.glob(mine + "*"):
        if other != _folder:
            shutil.rmtree(other, ignore_errors=True)


def _places() -> Iterator[Path]:
    """Where the folder may be: as told, in this installation, in the user's cache, among the
    temporary files."""
    with suppress(FileNotFoundError):  # of a relative path, where the current folder was removed
        if os.environ.get("NUMBA_CACHE_DIR"):
            yield Path(os.environ["NUMBA_CACHE_DIR"]).absolute()
    yield ROOT / "scene" / "__pycache__"
    with suppress(FileNotFoundError):
        if os.environ.get("XDG_CACHE_HOME"):
            yield Path(os.environ["XDG_CACHE_HOME"]).absolute()
        elif os.environ.get("HOME"):
            yield (Path(os.environ["HOME"]) / ".cache").absolute()
    with suppress(FileNotFoundError):  # no folder for temporary files can be written
        yield Path(tempfile.gettempdir()).absolute()


def _is_private(folder: Path) -> bool:
    """Whether a folder is owned by this user, closed to others and writable; it is created if
    missing.

    Links are refused.  A folder of ours that was open to others is emptied: they may have put
    something into it.
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


def _refuse(difference: str) -> bool:
    """Whether machine code is not kept because some source differs, which is said once."""
    if difference and not _refused:
        _refused.add(difference)
        print_on_stderr(f"{difference}: from now on machine code is not kept")
    return bool(difference)


def has_fma() -> bool:
    """Whether compiled code may use AVX2 and a fused multiply-add; every processor but an old
    x86-64 has its like.

    Without them the results are right and slower, since each multiply-add calls a function.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return True
    features = (
        getattr(numba.config, "CPU_FEATURES", None)
        or llvmlite.binding.get_host_cpu_features().flatten()
    )
    return {"+avx2", "+fma"} <= set(features.split(","))


def folder() -> Path | None:
    """Folder that machine code is kept in."""
    return _folder


def count_compiled() -> int:
    """How many functions this process has compiled, because they were not in the cache."""
    return _compiled


def files_used() -> set[str]:
    """Names of the files of machine code that this process has read or written."""
    return set(_used)


def processor() -> str:
    """Name and features of the processor that is compiled for."""
    name = getattr(numba.config, "CPU_NAME", None) or llvmlite.binding.get_host_cpu_name()
    features = (
        getattr(numba.config, "CPU_FEATURES", None)
        or llvmlite.binding.get_host_cpu_features().flatten()
    )
    return f"{llvmlite.binding.get_process_triple()} {name} {features}"


@contextmanager
def compiling_anew() -> Iterator[None]:
    """Context in which every function is compiled, although its machine code is kept."""
    global _anew
    _anew = True
    try:
        yield
    finally:
        _anew = False


def _count() -> None:
    """Count a function that has to be compiled; with the first one, print the warnings."""
    global _compiled
    _compiled += 1
    if _compiled > 1:
        return
    if not has_fma():
        _warnings.append(
            "this processor has no AVX2 or no FMA: simulations take several times as long as they"
            " might"
        )
    for warning in _warnings:
        print_on_stderr(warning)


class Kept:
    """The machine code of a function on disk, a file for each signature and processor, in place of
    numba's cache.

    A file begins with a digest of its key and its content.  So whatever lies under its name, by
    damage or by exchange, is used only if it was made from this function under these options, for
    these types, for this processor and from these sources.

    Who compiles holds a lock, which the operating system releases when the process ends; others
    wait for the file.
    """

    def __init__(self, function: Any, options: dict[str, Any]) -> None:
        self._function, self.cache_path = function, str(_folder)
        self._options = sorted(options.items())
        self._locks: dict[Any, FileLock] = {}  # of what this process is compiling
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        # of a function that it closes over its name, not its address
        self._cells = [f"{x.__module__}.{x.__qualname__}" if callable(x) else x for x in cells]

    def _locate(self, signature: Any, codegen: Any) -> tuple[Path, bytes]:
        """File and key of the function for some types."""
        code = self._function.__code__
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        function = name, self._options, self._cells, code.co_code
        key = repr((DIGEST, function, signature, codegen.magic_tuple())).encode()
        short = name.removeprefix("rattle.").replace("<locals>.", "")
        return Path(self.cache_path, f"{short}-{hashlib.sha256(key).hexdigest()[:16]}.nbc"), key

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Machine code from the disk; None where it has to be compiled, which is announced once.

        Numba's own cache would first describe all that it can compile (0.3 s), which only a
        function that is not here needs.
        """
        with suppress(Exception):  # whatever a damaged file raises: the function is compiled again
            if not (_anew or _refuse(describe_edit(SOURCES))):
                path, key = self._locate(signature, target_context.codegen())
                found = self._read(path, key, target_context)
                if found is None:
                    _start_others()
                    self._take(signature, path)
                    # another process may have compiled it
                    found = self._read(path, key, target_context)
                if found is not None:
                    self.release(signature)
                    return found
        _count()
        return None

    def _read(self, path: Path, key: bytes, target_context: Any) -> Any:
        """Machine code of a file; None where there is none."""
        if not path.exists():
            return None
        stored = path.read_bytes()
        if stored[:CHECKSUM] != hashlib.sha256(key + stored[CHECKSUM:]).digest():
            return None
        rtsys.initialize(target_context)  # numba's runtime, for functions that call it
        found = NUMBAS_RESULT._rebuild(target_context, *pickle.loads(stored[CHECKSUM:]))
        _used.add(path.name)
        return found

    def _take(self, signature: Any, path: Path) -> None:
        """Take the lock of a function that has to be compiled; without it where that is not
        possible, or takes long."""
        if not _is_private(path.parent):
            return
        lock = FileLock(path.with_suffix(".lock"))
        with suppress(OSError, Timeout, NotImplementedError):
            try:
                lock.acquire(timeout=0.0)
            except Timeout:
                with compiling():
                    lock.acquire(timeout=LONGEST_WAIT)
            self._locks[signature] = lock

    def release(self, signature: Any) -> None:
        """Release the lock of a function: it has been compiled or cannot be."""
        lock = self._locks.pop(signature, None)
        if lock is not None:
            with suppress(OSError):
                Path(lock.lock_file).unlink(missing_ok=True)  # whoever waits finds the machine code
            lock.release()

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Write machine code to the disk, where that is possible: otherwise it is compiled again
        next time."""
        try:
            self._write(signature, compiled)
        finally:
            self.release(signature)

    def _write(self, signature: Any, compiled: Any) -> None:
        if compiled.library.has_dynamic_globals or not _is_private(Path(self.cache_path)):
            return
        if _refuse(describe_difference(SOURCES)):
            return
        path, key = self._locate(signature, compiled.codegen)
        content = pickle.dumps(compiled._reduce())
        scratch = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
        with suppress(OSError):
            scratch.write_bytes(hashlib.sha256(key + content).digest() + content)
            scratch.replace(path)
            _used.add(path.name)
        with suppress(OSError):
            scratch.unlink(missing_ok=True)

    def flush(self) -> None:
        """Remove nothing: what is compiled again replaces its file."""


def _start_others() -> None:
    """Have other processes compile beside this one, which has to compile something."""
    if _folder is not None:
        compile_ahead.start(_folder)


class _Compiling(event.Listener):
    """What is done around the compiling of each function, and of those within it."""

    def __init__(self) -> None:
        self._thresholds: list[tuple[int, int, int]] = []

    def on_start(self, event: Any) -> None:
        """Have garbage collected rarely: numba makes so many objects that it would take a tenth of
        the time."""
        self._thresholds.append(gc.get_threshold())
        gc.set_threshold(*map(max, GARBAGE, gc.get_threshold()))

    def on_end(self, event: Any) -> None:
        """Release the lock of a function that cannot be compiled; what has been compiled is written
        next."""
        gc.set_threshold(*self._thresholds.pop())
        function = event.data["dispatcher"]
        signature = event.data["args"]
        if isinstance(function._cache, Kept) and signature not in function.signatures:
            function._cache.release(signature)


EVENTS.register("numba:compile", _Compiling())


def keep(function: D) -> D:
    """Have the machine code of a function kept on disk."""
    note_imports()
    made: Any = function
    if _folder is not None and hasattr(made, "py_func"):
        made._cache = Kept(made.py_func, made.targetoptions)
    return function


keep_by_source()
watch_compiler()
INTERPRETED = bool(getattr(numba.config, "DISABLE_JIT", False))
OPTIONS: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
"""Compiled code releases the interpreter lock.

Division follows IEEE rules instead of raising: a branch on every division keeps LLVM from
vectorising the loops over paths.  No fast-math: results do not depend on how a loop over paths is
cut.  What is not set a function that compiled code calls takes from its first caller.
"""
LEAN = OPTIONS | {"_nrt": False}
INTERNAL = OPTIONS | {"no_cpython_wrapper": True}
INLINE = LEAN | {"no_cpython_wrapper": True, "forceinline": True}


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that Python calls, and keep its machine code on disk."""
    return cast(Callable[P, R], keep(numba.njit(**OPTIONS)(function)))


def lean(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit`, without reference counting: for functions that allocate no arrays and take views
    only.

    With it the kernels of the paths would take a quarter more time to compile.
    """
    return cast(Callable[P, R], keep(numba.njit(**LEAN)(function)))


def internal(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function for its compiled callers, which keep its code; Python runs it as it
    stands."""
    return _compile_for_callers(function, INTERNAL)


def inline(function: Callable[P, R]) -> Callable[P, R]:
    """As `internal`, and LLVM always inlines it: a loop over paths vectorises only when its body
    calls nothing."""
    return _compile_for_callers(function, INLINE)


def splice(function: Callable[P, R]) -> Callable[P, R]:
    """Inline a function into its caller before type inference: branches on the caller's constants
    are removed.

    A function with one caller compiles faster so (`branching` as a whole by a tenth): by itself it
    would be optimised, and then again within its caller. Other functions do not: the copy is typed
    and optimised again in each caller.
    """
    return cast(Callable[P, R], numba.njit(inline="always")(function))


def _compile_for_callers(function: Callable[P, R], options: dict[str, Any]) -> Callable[P, R]:
    """Have numba take a function for a compiled one.

    Numba's `register_jitable` would do so too, and compile it once more for each set of options of
    its callers.
    """
    if not INTERPRETED:
        known: Any = function
        known.compiled = numba.njit(**options)(function)  # numba's type refers to it weakly
        known._numba_type_ = known.compiled._numba_type_
    return function


def emulate_fma(a: float, b: float, c: float) -> float:
    """``a * b + c`` rounded once, in fractions."""
    a = float(a)
    b = float(b)
    c = float(c)
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
        # llvmlite's own `add` knows fewer names
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), emit


def _nothing() -> None:
    """Stands for `widest_vectors` where the compiler is off."""


fma = cast(Callable[[float, float, float], float], emulate_fma if INTERPRETED else _fma)
"""``fma(a, b, c)``: ``a * b + c`` rounded once, by an instruction in compiled code; emulated where
numba is off."""

widest_vectors = cast(Callable[[], None], _nothing if INTERPRETED else _widest_vectors)
"""Ask the compiler for vectors of 512 bits in the calling function, where the processor has them.

It prefers 256 otherwise, since some processors lower their clock under wide vectors; the loops over
paths win in spite of that.  Numbers do not depend on it.
"""


@inline
def float_of(word: np.uint64) -> np.float64:
    """The float that has these bits."""
    return np.uint64(word).view(np.float64)


@inline
def word_of(x: float) -> np.uint64:
    """The bits of a float."""
    return np.float64(x).view(np.uint64)
