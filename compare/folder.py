"""An output folder that is either written whole or not at all, and never replaces what is not ours."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scene.errors import OutputError

__all__ = ["check_free", "whole_folder"]


def check_free(out: Path, ours: frozenset[str], overwrite: bool) -> None:
    """Refuse a folder that could not be written without losing something.

    Raises
    ------
    OutputError
        Names the folder, what is in the way, and what to do.
    """
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise OutputError(f"out = {str(out)!r}: exists and is not a folder; choose another name")
    parent = next((p for p in out.absolute().parents if p.exists()), Path("/"))
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise OutputError(f"out = {str(out)!r}: {str(parent)!r} cannot be written; choose another place")
    if not out.exists():
        return
    inside = {p.name for p in out.iterdir()}
    foreign = sorted(inside - ours)
    if foreign:
        raise OutputError(f"out = {str(out)!r}: holds other things ({', '.join(foreign[:3])}); choose another folder")
    if inside and not overwrite:
        raise OutputError(f"out = {str(out)!r}: holds an earlier report; choose another folder, or give --overwrite")


@contextmanager
def whole_folder(out: Path, ours: frozenset[str], overwrite: bool) -> Iterator[Path]:
    """A scratch folder beside `out` that takes its place when the block ends well, and vanishes when it does not."""
    check_free(out, ours, overwrite)
    out.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        yield scratch
        scratch.chmod(0o755)
        check_free(out, ours, overwrite)
        if out.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{out.name}-old-", dir=out.parent))
            os.replace(out, old)
            os.replace(scratch, out)
            shutil.rmtree(old)
        else:
            os.replace(scratch, out)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
