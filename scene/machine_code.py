"""Where compiled machine code is cached on disk; damaged or missing files are compiled again.

Cached files are unpickled and executed, so whoever can write to the folder can run code as you.  The folder is
therefore trusted only where you own it and nobody else has access (mode 0700).  The checksum at the end of each file,
index and machine code alike, guards against damage, not against an attacker: who can write the file can also write the
checksum.
"""

import atexit
import hashlib
import io
import multiprocessing
import os
import platform
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, UserProvidedCacheLocator
from numba.core.runtime.nrt import rtsys

PACKAGES = ("scene", "closure", "montecarlo")
COMPILER = ("scene/compiled.py", "scene/deferred.py", "scene/dispatcher.py", "scene/machine_code.py")
TAKEN = (*COMPILER, "scene/constants.py", "montecarlo/schemes/step_state.py")  # beside it, what compiled code takes
NUMBAS_FILES: Any = IndexDataCacheFile  # typed as Any: numba has no type hints
NUMBAS_CACHE: Any = FunctionCache
NUMBAS_STORE: Any = CompileResultCacheImpl
NUMBAS_PLACE: Any = UserProvidedCacheLocator
CHECKSUM = hashlib.sha256().digest_size  # bytes

D = TypeVar("D")

_folder: Path | None = None  # the cache folder; None where there is none
_warnings: list[str] = []  # about the cache folder and the processor; printed when the first function is compiled
_compiled = 0  # functions that this process has compiled


def source_digest(root: Path) -> str:
    """Digest of the sources of all compiled code and of the versions of the libraries that compile it.

    Sources of compiled code import `rattle.scene.compiled`, or are named in `TAKEN`; all others may change freely.
    The processor is not part of it: numba's index records the processor and its features for each entry.
    """
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__} {np.__version__}".encode())
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            name, source = path.relative_to(root).as_posix(), path.read_bytes()
            if b"from rattle.scene.compiled import" in source or name in TAKEN:
                digest.update(name.encode() + source)
    return digest.hexdigest()[:16]


def keep_by_source() -> None:
    """Point numba's cache to a folder named by user, installation and sources.

    Numba by itself checks only the file of the function that is called: after a change in a file that it calls
    into, it would go on with the old machine code, and the results would be those of other sources.

    The folder is the first of these that can be created and is private: in NUMBA_CACHE_DIR, in this installation, in
    the user's cache, among the system's temporary files; failing all, one that is removed when the process ends.
    Folders of earlier sources are removed; a process that still uses one compiles what it has not loaded.
    """
    global _folder
    root = Path(__file__).resolve().parent.parent
    mine = f"rattle-{os.geteuid()}-{hashlib.sha256(os.fsencode(root)).hexdigest()[:8]}-"
    name, places = mine + source_digest(root), [*_places(root)]
    _folder = next((place / name for place in places if _is_private(place / name)), None) or _temporary(mine)
    if _folder is None:
        _warnings.append(f"{places[0]} cannot be written: machine code is not kept")
        _warn()
        return
    if _folder.parent != places[0]:
        _warnings.append(f"{places[0]} cannot be written: machine code is kept in {_folder}")
    for other in _folder.parent.glob(mine + "*") if _folder.name == name else ():
        if other != _folder:
            shutil.rmtree(other, ignore_errors=True)


def _places(root: Path) -> Iterator[Path]:
    """Parents of the cache folder, in order of preference."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(os.environ["NUMBA_CACHE_DIR"]).absolute()
    yield root / "scene" / "__pycache__"
    with suppress(RuntimeError):  # a user without a home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").absolute()
    with suppress(FileNotFoundError):  # a system without one
        yield Path(tempfile.gettempdir())


def _is_private(folder: Path) -> bool:
    """Whether a folder is owned by this user, closed to others and writable; it is created if missing.

    Links are refused.  A folder of ours that was open to others is emptied: they may have put something into it.
    """
    try:
        for _ in range(2):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            found = folder.lstat()
            if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
                return False
            if not found.st_mode & 0o077:
                tempfile.TemporaryFile(dir=folder).close()
                return True
            shutil.rmtree(folder)
    except OSError:
        pass
    return False


def _temporary(mine: str) -> Path | None:
    """A cache folder that is removed when this process ends."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=mine))
    except OSError:
        return None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def has_fma() -> bool:
    """Whether compiled code may use AVX2 and a fused multiply-add; every processor but an old x86-64 has its like.

    Without them the results are right and slower, since each multiply-add calls a function.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return True
    features = getattr(numba.config, "CPU_FEATURES", None) or llvmlite.binding.get_host_cpu_features().flatten()
    return {"+avx2", "+fma"} <= set(features.split(","))


@cache
def _check_processor() -> None:
    """Warn of a slow processor, once."""
    if not has_fma():
        _warnings.append("this processor has no AVX2 or no FMA: simulations take several times as long as they might")


def _warn() -> None:
    """Print the warnings about the cache folder and the processor to standard error, once."""
    _check_processor()
    while _warnings:
        print(f"rattle: {_warnings.pop()}", file=sys.stderr)


def folder() -> Path | None:
    """Folder that machine code is kept in."""
    return _folder


def count_compiled() -> int:
    """How many functions this process has compiled, because they were not in the cache."""
    return _compiled


def _count() -> None:
    """Count a function that has to be compiled; with the first one, say on a terminal that this takes a while."""
    global _compiled
    _compiled += 1
    if _compiled == 1 and sys.stderr.isatty() and multiprocessing.parent_process() is None:
        print("rattle: compiling for this processor, about a minute, once (rattle warm-up: for all)", file=sys.stderr)


class Sealed(NUMBAS_FILES):  # type: ignore[misc]
    """Numba's index and machine-code files of a function, with a checksum at their ends, which unpickling ignores."""

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())

    def _load_index(self) -> Any:
        return super()._load_index() if _is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        if not _is_whole(self._data_path(name)):
            raise OSError(f"{name} is damaged")  # numba treats it as absent
        return super()._load_data(name)


def _is_whole(path: str) -> bool:
    """Whether a file exists and its checksum is right."""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-CHECKSUM]).digest() == content[-CHECKSUM:]


class InFolder(NUMBAS_PLACE):  # type: ignore[misc]
    """Our folder, and for our functions only: numba reads NUMBA_CACHE_DIR again when any of its variables changes."""

    def __init__(self, function: Any, file: Any) -> None:
        super().__init__(function, file)
        self._cache_path = os.path.join(str(_folder), self.get_suitable_cache_subpath(file))

    @classmethod
    def from_function(cls, function: Any, file: Any) -> Any:
        """Where the machine code of a function is kept; None if it is not."""
        return None if _folder is None else super(NUMBAS_PLACE, cls).from_function(function, file)


class Stored(NUMBAS_STORE):  # type: ignore[misc]
    """How machine code is stored: in our folder or nowhere; numba's runtime is loaded for functions that call it."""

    _locator_classes = (InFolder,)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Load machine code."""
        _, _, (machine_code, _) = payload[0]
        if b"NRT_" in machine_code:
            rtsys.initialize(target_context)
        return super().rebuild(target_context, payload)


class Kept(NUMBAS_CACHE):  # type: ignore[misc]
    """Numba's cache of a function, for a folder that may be full, or removed by another version, at any time.

    Few functions of a package are called in a process, and most of those from the cache.  So what numba prepares where
    a function is declared waits for its first call, and the description of all that numba can compile for the first
    function that has to be compiled.
    """

    _impl_class = Stored

    def __init__(self, function: Any) -> None:
        self._function, self._py_func = function, function.py_func

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or "_enabled" in vars(self):
            raise AttributeError(name)
        try:
            super().__init__(self._py_func)
            self._cache_file.__class__ = Sealed
        except RuntimeError:  # the folder is gone and cannot be made again
            self._cache_path = None
            self.disable()
        return getattr(self, name)

    def _is_inner(self) -> bool:
        """Whether the function is compiled for compiled code, to be kept with that; never in numba's plain way."""
        return bool(getattr(self._function, "inner", False))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Read machine code from the cache; None where it has to be compiled, which is announced once."""
        found = None if self._is_inner() else self._load_overload(sig, target_context)
        if found is None:
            _count()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write machine code to the cache, or skip it where that is not possible: it is compiled again next time."""
        _warn()
        if not self._is_inner() and _folder is not None and _is_private(_folder):
            with suppress(OSError):
                super().save_overload(sig, data)


def seal(function: D) -> D:
    """Have the machine code of a function kept on disk, in files with a checksum."""
    made: Any = function
    if _folder is not None and hasattr(made, "py_func"):
        made._cache = Kept(made)
    return function
