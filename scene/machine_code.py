"""Where machine code is kept, and what becomes of it when it is damaged or cannot be kept: it is compiled again."""

import hashlib
import os
import shutil
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import IndexDataCacheFile

__all__ = ["keep_by_source", "sealed"]

PACKAGES = ("scene", "closure", "montecarlo")
NUMBAS_FILES: Any = IndexDataCacheFile  # numba has no types
SEAL = hashlib.sha256().digest_size

D = TypeVar("D")


def keep_by_source() -> None:
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


class Sealed(NUMBAS_FILES):  # type: ignore[misc]
    """Numba's files of a function's machine code, each with a digest at its end, which its own reading passes over."""

    def _dump(self, content: Any) -> bytes:
        data: bytes = super()._dump(content)
        return data + hashlib.sha256(data).digest()

    def _load_data(self, name: str) -> Any:
        with open(self._data_path(name), "rb") as file:
            data = file.read()
        if hashlib.sha256(data[:-SEAL]).digest() != data[-SEAL:]:
            raise OSError(f"{name} is damaged")  # numba takes it for absent
        return super()._load_data(name)

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except Exception:  # whatever a damaged index leads to: then nothing is kept yet
            return {}

    def save(self, key: Any, data: Any) -> None:
        """Keep machine code; on a disk that is full it is compiled anew the next time."""
        try:
            super().save(key, data)
        except OSError:
            return


def sealed(function: D) -> D:
    """A compiled function whose machine code is kept under seal."""
    file = getattr(getattr(function, "_cache", None), "_cache_file", None)
    if file is not None:  # none where the compiler is off, or has no place to keep anything
        file.__class__ = Sealed
    return function
