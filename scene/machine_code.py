"""Where machine code is kept, and what becomes of it when it is damaged or cannot be kept: it is compiled again.

What is kept is unpickled and run, so whoever can write to the folder can run code as you.  The folder is therefore
trusted only where it is yours alone (mode 0700).  The digest at the end of each file, index and machine code alike,
guards against damage, not against an attacker: who can write the file can write the digest.
"""

import atexit
import hashlib
import io
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import llvmlite
import numba
import numpy as np
from numba.core.caching import FunctionCache, IndexDataCacheFile

__all__ = ["keep_by_source", "sealed", "source_digest"]

PACKAGES = ("scene", "closure", "montecarlo")
NUMBAS_FILES: Any = IndexDataCacheFile  # numba has no types
NUMBAS_CACHE: Any = FunctionCache
SEAL = hashlib.sha256().digest_size

D = TypeVar("D")

_folder: Path | None = None  # where machine code is kept
_to_say: list[str] = []  # of the place, by the process that compiles


def source_digest(root: Path) -> str:
    """Digest of the sources of all compiled code below `root`, however deep, and of the libraries that compile it.

    The processor is not in it: numba's index names the kind and the features of the one that each entry is for.
    """
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__} {np.__version__}".encode())
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def keep_by_source() -> bool:
    """Point numba's cache to a folder named by user, installation and sources; False where none can be written.

    Numba by itself looks only at the file of the function that is called: after a change in a file that it calls
    into, it would go on with the old machine code, and the numbers would be those of another program.

    The folder is the first that can be made and is ours alone: where NUMBA_CACHE_DIR says, in this installation, in the
    user's cache, among the system's temporary files; failing all, one that goes with the process.  Folders of earlier
    sources are removed; a process that still uses one compiles what it has not loaded.
    """
    global _folder
    root = Path(__file__).resolve().parent.parent
    mine = f"rattle-{os.geteuid()}-{hashlib.sha256(os.fsencode(root)).hexdigest()[:8]}-"
    name, places = mine + source_digest(root), [*_places(root)]
    _folder = next((place / name for place in places if _is_private(place / name)), None) or _passing(mine)
    if _folder is None:
        _to_say.append(f"{places[0]} cannot be written: machine code is not kept")
        _say()
        return False
    if _folder.parent != places[0]:
        _to_say.append(f"{places[0]} cannot be written: machine code is kept in {_folder}")
    for other in _folder.parent.glob(mine + "*") if _folder.name == name else ():
        if other != _folder:
            shutil.rmtree(other, ignore_errors=True)
    setattr(numba.config, "CACHE_DIR", str(_folder))  # noqa: B010  (numba.config has no types)
    return True


def _places(root: Path) -> Iterator[Path]:
    """Where machine code may lie, best first."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(os.environ["NUMBA_CACHE_DIR"]).absolute()
    yield root / "scene" / "__pycache__"
    with suppress(RuntimeError):  # a user without a home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").absolute()
    with suppress(FileNotFoundError):  # a system without one
        yield Path(tempfile.gettempdir())


def _is_private(folder: Path) -> bool:
    """Whether a folder for machine code is ours alone and can be written, made where it is missing; a link is not.

    One of ours that was open to others is emptied: they may have put something into it.
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


def _passing(mine: str) -> Path | None:
    """A folder that goes with this process."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=mine))
    except OSError:
        return None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _say() -> None:
    """Say on standard error what is to be said, once."""
    while _to_say:
        print(f"rattle: {_to_say.pop()}", file=sys.stderr)


class Sealed(NUMBAS_FILES):  # type: ignore[misc]
    """Numba's index and machine code of a function, with a digest at their ends, which its own closure passes over."""

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
            raise OSError(f"{name} is damaged")  # numba takes it for absent
        return super()._load_data(name)


def _is_whole(path: str) -> bool:
    """Whether a file is there and as it was written."""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-SEAL]).digest() == content[-SEAL:]


class Kept(NUMBAS_CACHE):  # type: ignore[misc]
    """Numba's cache of a function, for a folder that may be full, or be swept away by another version, at any time."""

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep machine code; where that is not possible any more it is compiled anew the next time."""
        _say()
        if _folder is not None and _is_private(_folder):
            with suppress(OSError):
                super().save_overload(sig, data)


def sealed(function: D) -> D:
    """A compiled function whose machine code is kept under seal."""
    cache = getattr(function, "_cache", None)
    if isinstance(cache, NUMBAS_CACHE):  # not where the compiler is off, or has no place to keep anything
        cache.__class__ = Kept
        cache._cache_file.__class__ = Sealed
        if Path(cache.cache_path).parent != _folder:  # numba has found it unfit meanwhile, and taken another
            cache.disable()
    return function
