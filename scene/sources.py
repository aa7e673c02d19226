"""The sources of this process: as they stood when it began, and whether they are what it has
imported.

Modules are imported when they are first needed.  Somebody may have edited a source before that, so
what is in memory is that of the beginning only where the file was not written in between; an edit
that was taken back leaves its time.
"""

import hashlib
import os
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from importlib.machinery import SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
IMPORTED = Path(__file__).parent.parent  # an editable installation imports links to the sources
PACKAGES = ("scene", "closure", "montecarlo")
UNCOMPILED = re.compile(rb'"{3}(?:.|\n)*?"{3}|[ \t]*\x23[^\n]*')  # docstrings and comments


class SourceFile(NamedTuple):
    """A source file."""

    written: int  # when its content, name or owner last changed, in ns
    content: bytes

    @property
    def stripped(self) -> bytes:
        """Its content without comments and empty lines, and with empty docstrings."""
        stripped = UNCOMPILED.sub(
            lambda found: b'""' if found[0].startswith(b'"') else b"", self.content
        )
        return b"\n".join(line for line in stripped.splitlines() if line.strip())


def read_source(path: Path) -> SourceFile:
    """Read a source; an edit while it is read counts as later."""
    written = path.stat().st_ctime_ns
    return SourceFile(written, path.read_bytes())


def read_sources(root: Path, *folders: str) -> dict[str, SourceFile]:
    """The sources in some folders, by their paths in an installation."""
    return {
        path.relative_to(root).as_posix(): read_source(path)
        for folder in folders
        for path in sorted((root / folder).rglob("*.py"))
    }


def digest_of(sources: dict[str, SourceFile], *what: str) -> str:
    """Digest of some sources, which comments and docstrings do not change, and of what else is
    given."""
    digest = hashlib.sha256(" ".join(what).encode())
    for name, source in sources.items():
        digest.update(name.encode() + source.stripped)
    return digest.hexdigest()[:16]


BEGUN = read_sources(ROOT, *PACKAGES, "compare")
"""All sources, as they stood when this process began."""

_waiting = {
    f"rattle.{name[:-3].removesuffix('/__init__').replace('/', '.')}": name for name in BEGUN
}
"""Modules with their sources that have not been seen in memory."""
_imported: set[str] = set()  # sources that were imported as they stood when this process began
_otherwise: set[str] = set()  # sources that may have been imported otherwise
_read: set[str] = set()  # sources from which Python's bytecode in memory is known to be


def sources_in(*folders: str) -> dict[str, SourceFile]:
    """The sources in some folders, as they stood when this process began."""
    return {
        name: source
        for name, source in BEGUN.items()
        if name.startswith(tuple(f"{f}/" for f in folders))
    }


def note_imports() -> None:
    """Note which sources have been imported since the last call, and whether they were written
    before that."""
    for module in _waiting.keys() & sys.modules.keys():
        name = _waiting.pop(module, "")  # another thread may have noted it
        if name:
            (_imported if _is_untouched(name) else _otherwise).add(name)


def describe_edit(names: Iterable[str]) -> str:
    """Say which of some sources has changed since this process began, or may have been imported
    otherwise, if any."""
    note_imports()
    edited = next(filter(_is_edited, names), "")
    return edited and f"{edited} was edited while this process ran"


def describe_difference(names: Iterable[str]) -> str:
    """Say for which of some sources what is in memory may be of another source, if for any."""
    if edit := describe_edit(names):
        return edit
    stale = next((name for name in names if name in _imported and _is_stale(name)), "")
    return stale and f"Python has bytecode of another source for {stale} (touch that file)"


def _is_untouched(name: str) -> bool:
    """Whether a source has not been written since this process began."""
    with suppress(OSError):
        return (ROOT / name).stat().st_ctime_ns == BEGUN[name].written
    return False


def _is_edited(name: str) -> bool:
    if name in _otherwise:
        return True
    with suppress(OSError):
        return not _is_untouched(name) and read_source(ROOT / name).stripped != BEGUN[name].stripped
    return True


def _is_stale(name: str) -> bool:
    """Whether the bytecode that Python keeps of a source is that of another: it compares sizes and
    seconds only."""
    path = IMPORTED / name
    kept = Path(cache_from_source(os.fspath(path)))
    if name in _read or not kept.exists():
        return False
    if kept.stat().st_mtime_ns <= path.stat().st_ctime_ns:
        loader = SourceFileLoader(path.stem, os.fspath(path))
        if loader.get_code(path.stem) != loader.source_to_code(
            loader.get_data(loader.path), loader.path
        ):
            return True
    _read.add(name)
    return False
