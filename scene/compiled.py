"""How physics is compiled: six decorators, where machine code is kept, instructions that numba
has no name for, memory for vectors.

Numba keeps machine code in a folder of the user's own, named by the sources that it was made from.
Cached files are unpickled and executed, so whoever can write to the folder can run code as you: it
is used only where you own it and nobody else has access (mode 0700).  What is missing, damaged or
cannot be read is compiled again. Where a source has been edited since this process began, nothing
is taken from the folder or put into it.

A compiler that may contract ``a * b + c`` does so on one processor and not on another.  Here the
source says where it happens (`fma`), and every processor gives the same bits: by an instruction
where there is one, by its emulation elsewhere.
"""

import gc
import hashlib
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, ClassVar, TypeVar, cast

import llvmlite
import llvmlite.binding
import numba
import numba.experimental.function_type  # with it numba knows the type of a function as argument
import numpy as np
from filelock import FileLock, Timeout
from numba import extending
from numba.core import event, types
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys
from numpy.typing import NDArray

from rattle.scene import compile_ahead
from rattle.scene.progress import compiler, print_on_stderr
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
CONFIG: Any = numba.config  # these four typed as Any: numba has no type hints
EVENTS: Any = event
NUMBAS_CACHE: Any = FunctionCache
NUMBAS_EXTENDING: Any = extending

LONGEST_WAIT = 10.0  # seconds for another process that writes what it has compiled: milliseconds
LONGEST_COMPILING = 120.0  # for one that compiles a function: half a minute on a slow machine
GARBAGE = 20_000  # objects between two collections of garbage while a function is compiled

Function = TypeVar("Function", bound=Callable[..., Any])

_folder: Path | None = None  # the cache folder; None where there is none
_warnings: list[str] = []  # printed when the first function is compiled
_refused: set[str] = set()  # why machine code is not kept, which is printed once
_choosing = Lock()  # held while numba is told the folder of one function
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

    All other sources may change freely.  A comment has the functions of its own file compiled
    again, by numba's own check of that file.  The processor is not part of it: numba distinguishes
    processors within a file.
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
        if _is_private(place / (mine + DIGEST)):
            _folder = (place / (mine + DIGEST)).absolute()
            break
        refused.append(place)
    else:
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
    if told := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(told)
    yield ROOT / "scene" / "__pycache__"
    home = os.environ.get("HOME")
    if cache := os.environ.get("XDG_CACHE_HOME") or (home and f"{home}/.cache"):
        yield Path(cache)
    with suppress(FileNotFoundError):  # no folder for temporary files can be written
        yield Path(tempfile.gettempdir())


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
        status = folder.lstat()
        closed = status.st_uid == os.geteuid() and not status.st_mode & 0o077
        return closed and folder.is_dir() and os.access(folder, os.W_OK)
    return False


def _refuse(difference: str) -> bool:
    """Whether machine code is not kept because some source differs, which is said once."""
    if difference and not _refused:
        _refused.add(difference)
        print_on_stderr(f"{difference}: from now on machine code is not kept")
    return bool(difference)


def _cpu_features() -> str:
    """What the processor that is compiled for can do, in LLVM's words."""
    features: str = CONFIG.CPU_FEATURES or llvmlite.binding.get_host_cpu_features().flatten()
    return features


def has_fma() -> bool:
    """Whether compiled code may use AVX2 and a fused multiply-add; every processor but an old
    x86-64 has its like.

    Without them the results are right and slower, since each multiply-add calls a function.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return True
    return {"+avx2", "+fma"} <= set(_cpu_features().split(","))


def processor() -> str:
    """Name and features of the processor that is compiled for."""
    name = CONFIG.CPU_NAME or llvmlite.binding.get_host_cpu_name()
    return f"{llvmlite.binding.get_process_triple()} {name} {_cpu_features()}"


def source_stamp() -> str:
    """Digest of the same sources with their comments: numba compiles again what stands in a file
    with an edited one."""
    return hashlib.sha256(b"".join(source.content for source in SOURCES.values())).hexdigest()


def folder() -> Path | None:
    """Folder that machine code is kept in."""
    return _folder


@contextmanager
def compiling_anew() -> Iterator[None]:
    """Context in which every function is compiled, although its machine code is kept."""
    global _anew
    _anew = True
    try:
        yield
    finally:
        _anew = False


class Kept(NUMBAS_CACHE):  # type: ignore[misc]
    """Numba's cache of a function, for what numba's own does not survive or does slowly.

    - A damaged file and a full disk raise there; here the function is compiled.
    - Two processes that compile one function for different types write one index, and each may
      store its machine code under the other's name; here one writes after the other.
    - Before it reads, it describes all that it can compile (0.3 s of every start), which only a
      function that is not kept needs.
    - It sees no edit of a file that a function calls into, while a process runs.
    - A compiled function that a function closes over has another key in each process there; here
      it is part of the function's name (`_name_closure`), since the folder is that of its source.
    - Two processes that need one function at the same time both compile it there; here one waits.
      Who compiles holds a lock, which the operating system releases when the process ends.
    """

    held: ClassVar[dict[str, FileLock]] = {}  # of what this process compiles

    def _index_key(self, signature: Any, codegen: Any) -> Any:
        """What tells the machine code of a function of one name apart: types, processor, code."""
        return signature, codegen.magic_tuple(), self._py_func.__code__.co_code

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Machine code from the disk; None where it has to be compiled.

        What another process compiles now is waited for.
        """
        if compiler.depth == 0:  # what is still held could not be compiled
            for key in tuple(self.held):
                self._release(key)
        if _anew or _refuse(describe_edit(SOURCES)):
            return None
        rtsys.initialize(target_context)  # numba's runtime, for functions that call it
        compiled = self._read(signature, target_context)
        if compiled is None and self._take(signature):
            compiled = self._read(signature, target_context)  # another process may have compiled it
            if compiled is not None:
                self._release(self._key(signature))
        return compiled

    def _read(self, signature: Any, target_context: Any) -> Any:
        """Machine code from the disk; None where there is none, or none that can be read."""
        try:
            return self._load_overload(signature, target_context)
        except Exception:  # whatever a damaged file raises
            with suppress(OSError):
                self.flush()
            return None

    def _take(self, signature: Any) -> bool:
        """Take the lock of a function that has to be compiled, once no other process compiles it;
        whether that was possible."""
        if _folder is None or not _is_private(_folder):
            return False
        key = self._key(signature)
        digest = hashlib.sha256(key.encode()).hexdigest()[:16]
        lock = FileLock(_folder / f"{digest}.lock", thread_local=False)
        try:
            with suppress(Timeout):
                lock.acquire(timeout=0.0)
            if not lock.is_locked:
                with compiler.waiting():
                    lock.acquire(timeout=LONGEST_COMPILING)
        except (OSError, NotImplementedError, Timeout):
            return False
        self.held[key] = lock
        return True

    def _key(self, signature: Any) -> str:
        """What another process calls a function for some types too."""
        return f"{self._py_func.__module__}.{self._py_func.__qualname__} {signature}"

    def _release(self, key: str) -> None:
        """Let other processes have a function that is compiled, or cannot be."""
        if lock := self.held.pop(key, None):
            lock.release()

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Write machine code to the disk, where that is possible: otherwise it is compiled again
        next time."""
        try:
            self._write(signature, compiled)
        finally:
            self._release(self._key(signature))

    def _write(self, signature: Any, compiled: Any) -> None:
        if _folder is None or _refuse(describe_difference(SOURCES)) or not _is_private(_folder):
            return
        lock = FileLock(_folder / "index.lock", timeout=LONGEST_WAIT)
        with suppress(OSError, NotImplementedError), lock:  # a full disk, or one without locks
            super().save_overload(signature, compiled)


class _Compiling(event.Listener):
    """What is done around the compiling of each function of this package."""

    def on_start(self, event: Any) -> None:
        """Begin a function: with the first one print the warnings and have other processes compile
        beside this one.

        Garbage is collected rarely: numba makes so many objects that it would take a tenth of the
        time.
        """
        if not _is_ours(event):
            return
        compiler.begin()
        if compiler.depth == 1:
            self._thresholds = gc.get_threshold()
            gc.set_threshold(GARBAGE)
            _print_warnings()
            if _folder is not None and not _anew:
                compile_ahead.start(_folder)

    def on_end(self, event: Any) -> None:
        """End a function, which may be one that cannot be compiled."""
        if not _is_ours(event):
            return
        if compiler.depth == 1:
            gc.set_threshold(*self._thresholds)
        compiler.end()


def _is_ours(event: Any) -> bool:
    """Whether it is a function of this package: a user's own are the user's to announce."""
    module: str = event.data["dispatcher"].py_func.__module__
    return module.startswith("rattle.")


@cache
def _print_warnings() -> None:
    """Print what is wrong with this processor and its folders, once."""
    if not has_fma():
        _warnings.append(
            "this processor has no AVX2 or no FMA: simulations take several times as long as they"
            " might"
        )
    for warning in _warnings:
        print_on_stderr(warning)


keep_by_source()
EVENTS.register("numba:compile", _Compiling())
INTERPRETED = bool(CONFIG.DISABLE_JIT)


def _name_closure(function: Any) -> None:
    """Give a function that closes over values a name of its own for these.

    The linker knows machine code by name, types and a number that counts anew in each process: of
    two kernels of one name, each compiled first in its process, both would run the one loaded
    first.
    """
    if not function.__closure__:
        return
    cells = [cell.cell_contents for cell in function.__closure__]
    values = [f"{x.__module__}.{x.__qualname__}" if callable(x) else x for x in cells]
    function.__qualname__ += f"_{hashlib.sha256(repr(values).encode()).hexdigest()[:8]}"


def _keep(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Compile a function, and have its machine code kept on disk."""
    note_imports()
    _name_closure(function)
    compiled: Any = numba.njit(**options)(function)
    if _folder is not None and not INTERPRETED:
        # a kernel is made when it is first needed, perhaps in several threads: with the folder of
        # another thread, numba would write into the folder in which the process runs
        with _choosing:
            users = CONFIG.CACHE_DIR  # where a user's own functions are kept
            CONFIG.CACHE_DIR = str(_folder)
            with suppress(RuntimeError):  # a full disk
                compiled._cache = Kept(function)
            CONFIG.CACHE_DIR = users
    return compiled


def as_argument(function: Any, *arguments: Any) -> Any:
    """A `lean` function as another compiled one takes it, to call it by its address, for arguments
    like these.

    What calls a function by its name is linked with a copy of it, which LLVM optimises once more:
    of a kernel that takes as long as the kernel itself.
    """
    if INTERPRETED:
        return function
    return _by_address(function, tuple(map(numba.typeof, arguments)))


@cache
def _by_address(function: Any, kinds: tuple[Any, ...]) -> Any:
    """A compiled function, as numba calls it by its address."""
    function.compile(kinds)
    return types.CompileResultWAP(function.overloads[kinds])


OPTIONS: dict[str, Any] = {
    "nogil": True,
    "no_cfunc_wrapper": True,
    "error_model": "numpy",
    "_nrt": True,
    "forceinline": False,
}
"""Compiled code releases the interpreter lock.

Division follows IEEE rules instead of raising: a branch on every division keeps LLVM from
vectorising the loops over paths.  No fast-math: results do not depend on how a loop over paths is
cut.  What is not set a function that compiled code calls takes from its first caller.
"""
LEAN = OPTIONS | {"_nrt": False}
INTERNAL = OPTIONS | {"no_cpython_wrapper": True}
LEAN_INTERNAL = LEAN | {"no_cpython_wrapper": True}
INLINE = LEAN_INTERNAL | {"forceinline": True}

ZERO = cast(int, np.int64(0))
"""Of a non-literal type: numba compiles a function again for every literal argument."""


def jit(function: Function) -> Function:
    """Compile a function that Python calls, and keep its machine code on disk."""
    return cast(Function, _keep(function, OPTIONS))


def lean(function: Function, by_address: bool = False) -> Function:
    """As `jit`, without reference counting: for functions that allocate no arrays and take views
    only.

    With it the kernels of the paths would take a quarter more time to compile. `by_address`:
    Whether compiled code can call it by its address too, see `as_argument`.
    """
    return cast(Function, _keep(function, LEAN | {"no_cfunc_wrapper": not by_address}))


def internal(function: Function) -> Function:
    """Compile a function for its compiled callers, which keep its code; Python runs it as it
    stands."""
    return _compile_for_callers(function, INTERNAL)


def lean_internal(function: Function) -> Function:
    """As `internal`, without reference counting: see `lean`.

    With reference counting Euler's step without noise takes an eighth longer.
    """
    return _compile_for_callers(function, LEAN_INTERNAL)


def inline(function: Function) -> Function:
    """As `internal`, and LLVM always inlines it: a loop over paths vectorises only when its body
    calls nothing."""
    return _compile_for_callers(function, INLINE)


def splice(function: Function) -> Function:
    """Inline a function into its caller before type inference: branches on the caller's constants
    are removed.

    A function with one caller compiles faster so (`branching` as a whole by a seventh): by itself
    it would be optimised and become machine code, and then again within its caller. Other functions
    do not: the copy is typed and optimised again in each caller. Nor does the kernel within the
    long run, for one large function compiles slower than two; and the steps of all lanes at once
    take a tenth longer within the kernel.
    """
    return cast(Function, numba.njit(inline="always")(function))


def _compile_for_callers(function: Function, options: dict[str, Any]) -> Function:
    """Have numba take a function for a compiled one.

    Numba's `register_jitable` would do so too, and compile it once more for each set of options of
    its callers.
    """
    if not INTERPRETED:
        known: Any = function
        known.compiled = numba.njit(**options)(function)  # numba's type refers to it weakly
        known._numba_type_ = known.compiled._numba_type_
    return function


def fma(a: float, b: float, c: float) -> float:
    """``a * b + c`` rounded once: by an instruction in compiled code, in fractions in Python."""
    a = float(a)
    b = float(b)
    c = float(c)
    exact = Fraction(a) * Fraction(b) + Fraction(c) if all(map(math.isfinite, (a, b, c))) else 0
    try:
        return float(exact) if exact else a * b + c  # which has the sign of a zero
    except OverflowError:
        return math.inf if exact > 0 else -math.inf


def _type_fma(_context: Any) -> Any:
    return lambda _a, _b, _c: numba.float64(numba.float64, numba.float64, numba.float64)


def _emit_fma(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
    return builder.fma(*arguments)


NUMBAS_EXTENDING.type_callable(fma)(_type_fma)
NUMBAS_EXTENDING.lower_builtin(fma, types.float64, types.float64, types.float64)(_emit_fma)


def widest_vectors() -> None:
    """Ask the compiler for vectors of 512 bits in the calling function, where the processor has
    them.

    It prefers 256 otherwise, since some processors lower their clock under wide vectors; the loops
    over paths win in spite of that.  Numbers do not depend on it.
    """


LINE = 64  # bytes of a line of the cache, and of the widest vector


def vector_memory(shape: tuple[int, ...], fill: float = 0.0) -> NDArray[np.float64]:
    """A new array that begins at a line of the cache.

    A wide vector that lies across two lines is read and written in two parts: Euler's step takes a
    seventh longer so.  Numpy begins its arrays anywhere.
    """
    memory = np.empty(8 * math.prod(shape) + LINE, np.uint8)
    start = -memory.ctypes.data % LINE
    array: NDArray[np.float64] = np.ndarray(shape, np.float64, memory, start)
    array.fill(fill)
    return array


def not_inlined() -> None:
    """Keep the calling function out of its callers: one that runs rarely would be optimised once
    more within each of them."""


def little_code() -> None:
    """Ask the compiler for little code in the calling function: LLVM takes half as long for it.

    Loops over paths would run slower with it; functions that have none run as fast.
    """


def _lower_to_attribute(mark: Callable[[], None], attribute: str) -> None:
    """Have compiled code give the function that calls `mark` an attribute; in Python it does
    nothing."""

    def type_mark(_context: Any) -> Any:
        return lambda: types.void

    NUMBAS_EXTENDING.type_callable(mark)(type_mark)

    def emit(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        # llvmlite's own `add` knows fewer names
        set.add(builder.function.attributes, attribute)
        return context.get_dummy_value()

    NUMBAS_EXTENDING.lower_builtin(mark)(emit)


_lower_to_attribute(widest_vectors, '"prefer-vector-width"="512"')
_lower_to_attribute(not_inlined, "noinline")
_lower_to_attribute(little_code, "optsize")


@inline
def float_of(word: np.uint64) -> np.float64:
    """The float that has these bits."""
    return np.uint64(word).view(np.float64)


@inline
def word_of(x: float) -> np.uint64:
    """The bits of a float."""
    return np.float64(x).view(np.uint64)
