"""Output folders that are written whole or not at all, and that never replace files of others."""

import ctypes
import errno
import fcntl
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rattle.compare.interrupt import unfinished
from rattle.scene.errors import OutputError
from rattle.scene.text import harmless, line

ROOM = 20_000_000  # bytes that must be free before a long run begins; a report takes a few million
PART, OLD = ".part", ".old"  # suffixes of scratch names: a folder or file being written, a folder being replaced
ANY_TEXT = "rattle"  # name in the scratch names of single files
AT_FDCWD, RENAME_EXCHANGE = -100, 2  # constants of Linux, see renameat2(2)
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def default_place(name: str, suffix: str = "") -> Path:
    """The default output folder ``reports/NAME``.

    `name`: From a file, so it may hold anything; separators and control characters are replaced.

    Examples
    --------
    >>> default_place("DAT21").as_posix(), default_place("../../etc/x", "-repeated").as_posix()
    ('reports/dat21', 'reports/etc-x-repeated')
    """
    safe = re.sub(r"[/\\]+|\.\.+", "-", harmless(name.lower(), keep="")).encode()[:120].decode(errors="ignore")
    return Path("reports") / f"{safe.strip('.- ') or 'scene'}{suffix}"


def describe_refusal(out: Path, error: OSError) -> OutputError:
    """The error message for a failed write.

    Examples
    --------
    >>> print(describe_refusal(Path("a"), OSError(errno.ENOSPC, "No space left on device")))
    out = 'a': the disk is full; nothing is half written, what was there is untouched: make room and try again
    """
    if error.errno in FULL:
        why = "the disk is full; nothing is half written, what was there is untouched: make room and try again"
    else:
        why = f"cannot be written ({error.strerror or error}); choose another place"
    return OutputError(f"out = {str(out)!r}: {why}")


def check_free(out: Path, ours: frozenset[str], overwrite: bool) -> None:
    """Check before a run that its output folder can be written without losing other files.

    `ours`: Names of the files of such a report; a folder with any other file is not replaced.
    """
    try:
        _check_free(out, ours, overwrite)
    except OutputError:
        raise
    except OSError as error:  # such as a name that is too long, or a folder that may not be read
        raise describe_refusal(out, error) from None


def _check_free(out: Path, ours: frozenset[str], overwrite: bool) -> None:
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise OutputError(f"out = {str(out)!r}: exists and is not a folder; choose another name")
    parent = next((p for p in out.absolute().parents if p.exists()), Path("/"))
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise OutputError(f"out = {str(out)!r}: {str(parent)!r} cannot be written; choose another place")
    if (free := shutil.disk_usage(parent).free) < ROOM:
        raise OutputError(f"out = {str(out)!r}: {free / 1e6:.1f} MB are free there; make room for {ROOM / 1e6:.0f} MB")
    if not out.exists():
        return
    inside = {p.name for p in out.iterdir()}
    foreign = sorted(inside - ours)
    if foreign:
        raise OutputError(
            f"out = {str(out)!r}: holds other things ({', '.join(map(line, foreign[:3]))}); choose another folder"
        )
    if inside and not overwrite:
        raise OutputError(f"out = {str(out)!r}: holds an earlier report; choose another folder, or give --overwrite")


@contextmanager
def whole_folder(out: Path, ours: frozenset[str], overwrite: bool) -> Iterator[Path]:
    """Context that writes a folder atomically: into a scratch folder beside it, which replaces it at the end."""
    check_free(out, ours, overwrite)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with scratch_folder(out.parent, out.name) as scratch:
            yield scratch
            _put(scratch, out, ours, overwrite)
    except OutputError:
        raise
    except OSError as error:
        raise describe_refusal(out, error) from None


@contextmanager
def scratch_folder(parent: Path, name: str) -> Iterator[Path]:
    """Context with a temporary folder; leftovers of killed processes under the same name are removed first.

    Yields: The folder.  It is locked (flock) while its process lives, so that no other process removes it as a
    leftover.
    """
    sweep(parent, name)
    scratch, number = _lock(parent, name, Path.mkdir)
    unfinished.add(scratch)
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        unfinished.discard(scratch)
        os.close(number)


def within(folder: Path, *names: str) -> None:
    """Check that subfolders are no symbolic links, through which files would be written elsewhere."""
    for name in names:
        if (folder / name).is_symlink() and name != ".":
            raise OutputError(
                f"out = {str(folder)!r}: {name!r} is a link to elsewhere; remove it, or choose another place"
            )


def _lock(parent: Path, name: str, make: Callable[[Path], object]) -> tuple[Path, int]:
    """Make a scratch file or folder and lock it; repeated if another process removed it before it was locked.

    Returns its path and the locked file descriptor.
    """
    while True:
        scratch = _scratch(parent, name, PART)
        make(scratch)
        with suppress(FileNotFoundError):
            number = os.open(scratch, os.O_RDONLY | os.O_NOFOLLOW)
            with suppress(OSError):  # a file system without locks
                fcntl.flock(number, fcntl.LOCK_EX)
            if scratch.exists():
                return scratch, number
            os.close(number)


def _scratch(parent: Path, name: str, suffix: str) -> Path:
    """A new scratch name; unlike those of `tempfile`, files made under it have the permissions of the umask."""
    return parent / f".{name}-{secrets.token_hex(4)}{suffix}"


def _empty(path: Path) -> None:
    path.touch(exist_ok=False)


def write_whole(path: Path, text: str) -> None:
    """Write a text file whole or not at all; a symbolic link of that name is replaced, not followed."""
    try:
        sweep(path.parent, ANY_TEXT)
        scratch, number = _lock(path.parent, ANY_TEXT, _empty)
        try:
            scratch.write_text(text, encoding="utf-8")
            os.replace(scratch, path)
        finally:
            scratch.unlink(missing_ok=True)
            os.close(number)
    except OSError as error:
        raise describe_refusal(path, error) from None


def _put(scratch: Path, out: Path, ours: frozenset[str], overwrite: bool) -> None:
    """Move a scratch folder to its place; if another run has taken that meanwhile, to a numbered name beside it."""
    try:
        check_free(out, ours, overwrite)
        if not out.exists():
            os.rename(scratch, out)
        elif not _exchange(scratch, out):
            _replace(scratch, out)
    except OSError as error:
        if not (isinstance(error, OutputError) or error.errno in (errno.ENOTEMPTY, errno.EEXIST)):
            raise
        number = 2
        while (kept := out.with_name(f"{out.name}-{number}")).exists():
            number += 1
        os.rename(scratch, kept)
        raise OutputError(
            f"out = {str(out)!r}: has been taken by another run meanwhile; this report is kept as {str(kept)!r}"
        ) from None


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two folders atomically; False where the system cannot."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    return bool(rename(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0)


def _replace(scratch: Path, out: Path) -> None:
    """Replace a folder in two steps; if the process is killed between them, `sweep` restores the old folder."""
    old = _scratch(out.parent, out.name, OLD)
    old.mkdir()
    os.rename(out, old)
    try:
        os.rename(scratch, out)
    except OSError:
        os.rename(old, out)
        raise
    shutil.rmtree(old, ignore_errors=True)


def sweep(parent: Path, name: str) -> None:
    """Remove scratch files and folders of killed processes; restore a folder that one was replacing."""
    pattern = re.compile(rf"\.{re.escape(name)}-[a-z0-9_]{{8}}(\{PART}|\{OLD})")
    try:
        found = [parent / name for name in os.listdir(parent) if pattern.fullmatch(name)]
    except OSError:  # a folder that may be written but not read
        return
    for left in found:
        with suppress(OSError), _open(left) as number:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)  # raises where its process lives
            if not left.is_dir():
                left.unlink()
            elif left.suffix == OLD and any(left.iterdir()) and not (parent / name).exists():
                os.rename(left, parent / name)
            else:
                shutil.rmtree(left, ignore_errors=True)


@contextmanager
def _open(path: Path) -> Iterator[int]:
    number = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        yield number
    finally:
        os.close(number)


def name_of(path: Path) -> str:
    """The name of a scene or study: that of its file without suffix.

    Examples
    --------
    >>> name_of(Path("gears/mine.toml"))
    'mine'
    """
    return path.stem.encode(errors="replace").decode()
