"""Output folders that are written whole or not at all, and that never replace files of others."""

import errno
import os
import platform
import re
import secrets
import shutil
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from rattle.compare.report.json_text import Facts
from rattle.scene import OutputError, harmless, line
from rattle.scene.files import parse_json, read_regular
from rattle.scene.progress import do

MANIFEST = "manifest.json"
FIGURES_FOLDER = "figures"  # folder of the figures of some reports
LINKS = ("href", "src")  # of a link, and of a figure
EARLIER = "page.json"  # a file that earlier versions wrote
# bytes that must be free before a long run begins; a report takes a few million
BYTES_FREE = 20_000_000
# suffixes of scratch names: a folder or file being written, a folder being replaced
PART_SUFFIX = ".part"
OLD = ".old"
ANY_TEXT = "rattle"  # name in the scratch names of single files
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def page_files(name: str) -> tuple[str, str]:
    """Names of the files of a page, as Markdown and as HTML."""
    return f"{name}.md", f"{name}.html"


def default_place(name: str, suffix: str = "") -> Path:
    """The default output folder ``reports/NAME``, without the separators and control characters of
    a name."""
    safe = (
        re.sub(r"[/\\]+|\.\.+", "-", harmless(name.lower(), keep=""))
        .encode()[:120]
        .decode(errors="ignore")
    )
    return Path("reports") / f"{safe.strip('.- ') or 'scene'}{suffix}"


def refusal(out: Path, why: str) -> OutputError:
    """The error of an output that cannot be written."""
    return OutputError(f"out = {str(out)!r}: {why}")


def describe_refusal(out: Path, error: OSError) -> OutputError:
    """The error message for a failed write."""
    why = f"cannot be written ({error.strerror or error}); choose another place"
    if error.errno in FULL:
        why = (
            "the disk is full; nothing is half written, what was there is untouched: make room and"
            " try again"
        )
    return refusal(out, why)


@contextmanager
def refusals(out: Path) -> Iterator[None]:
    """Context in which a failed write raises `OutputError` with what to do."""
    try:
        yield
    except OutputError:
        raise
    # such as a full disk, a name that is too long, a folder that may not be read
    except OSError as error:
        raise describe_refusal(out, error) from None


def check_place(out: Path) -> Path:
    """Check that a folder or file can be made where it is to be; the closest folder above it that
    exists."""
    parent = next((p for p in out.absolute().parents if p.exists()), Path("/"))
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise refusal(out, f"{str(parent)!r} cannot be written; choose another place")
    return parent


def check_free(out: Path, ours: frozenset[str], overwrite: bool) -> None:
    """Check before a run that its output folder can be written, and holds nothing but files of such
    a report.

    `ours`: Names of such files; the files to which one of them links are ours too.
    """
    with refusals(out):
        if out.is_symlink() or (out.exists() and not out.is_dir()):
            raise refusal(out, "exists and is not a folder; choose another name")
        if (free := shutil.disk_usage(check_place(out)).free) < BYTES_FREE:
            room = f"{free / 1e6:.1f} MB are free there; make room for {BYTES_FREE / 1e6:.0f} MB"
            raise refusal(out, room)
        inside = list_files(out) if out.exists() else set()
        refuse_foreign(out, inside - ours - linked_files(out, ours))
        if inside and MANIFEST in ours and read_own_manifest(out) is None:
            refuse_foreign(out, inside)
    if inside and not overwrite:
        why = "holds an earlier report; choose another folder, or overwrite it (--overwrite)"
        raise refusal(out, why)


def refuse_foreign(out: Path, foreign: Collection[str]) -> None:
    """Refuse a folder in which there is anything that this project did not write."""
    if foreign:
        names = ", ".join(map(line, sorted(foreign)[:3]))
        raise refusal(out, f"holds other things ({names}); choose another folder")


def read_own_manifest(folder: Path) -> Facts | None:
    """Read the manifest of a report or study; None where there is none that this project wrote."""
    try:
        record = parse_json(read_regular(folder / MANIFEST))
        return record if "rattle" in record["versions"] else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def report_files(name: str) -> frozenset[str]:
    """Names of the files of a report besides those to which its page links."""
    return frozenset({MANIFEST, *page_files(name), EARLIER})


def list_files(out: Path) -> set[str]:
    """What lies in a folder, and in that of its figures."""
    inside = {path.name for path in out.iterdir()}
    if (out / FIGURES_FOLDER).is_dir():
        inside.remove(FIGURES_FOLDER)
        inside.update(f"{FIGURES_FOLDER}/{path.name}" for path in (out / FIGURES_FOLDER).iterdir())
    return inside


def linked_files(out: Path, ours: Iterable[str]) -> set[str]:
    """The files in a folder to which its pages in Markdown link."""
    from markdown_it import MarkdownIt  # --help need not wait for it

    linked = set[str]()
    for page in ours:
        with suppress(OSError):
            text = read_regular(out / page) if page.endswith(".md") else b""
            for block in MarkdownIt("commonmark").parse(text.decode(errors="replace")):
                for token in block.children or ():
                    linked.update(str(token.attrs[name]) for name in LINKS if name in token.attrs)
    return linked


def check_own(path: Path, mark: bytes, what: str) -> None:
    """Check that a file may be written: there is none, an empty one, or one of this project.

    `mark`: A regular expression that is found in the first bytes of such a file. `what`: Its kind,
    in words.
    """
    with refusals(path):
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise refusal(path, "exists and is not a file; choose another name")
        if not path.exists():
            return
        with path.open("rb") as file:
            head = file.read(1000)
    if head and not re.search(mark, head):
        raise refusal(path, f"exists and is not {what}; choose another name")


@contextmanager
def whole_folder(out: Path, ours: frozenset[str], overwrite: bool) -> Iterator[Path]:
    """Context that writes a folder whole or not at all: into one beside it, which replaces it at
    the end."""
    check_free(out, ours, overwrite)
    with refusals(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        do(f"writing {out}")
        with scratch_folder(out.parent, out.name) as scratch:
            yield scratch
            _put(scratch, out, ours, overwrite)


@contextmanager
def scratch_folder(parent: Path, name: str) -> Iterator[Path]:
    """Context with a temporary folder; leftovers of killed processes under the same name are
    removed first."""
    sweep(parent, name)
    scratch = scratch_path(parent, name, PART_SUFFIX)
    scratch.mkdir()
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def write_whole(path: Path, text: str) -> None:
    """Write a text file whole or not at all; a symbolic link of that name is replaced, not
    followed."""
    with refusals(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent, ANY_TEXT)
        scratch = scratch_path(path.parent, ANY_TEXT, PART_SUFFIX)
        try:
            scratch.write_text(text, encoding="utf-8")
            os.replace(scratch, path)
        finally:
            scratch.unlink(missing_ok=True)


def scratch_path(parent: Path, name: str, suffix: str) -> Path:
    """A new scratch name, with machine and process; what is made under it has the permissions of
    the umask."""
    return parent / f".{name}-{platform.node()}-{os.getpid()}-{secrets.token_hex(4)}{suffix}"


def _put(scratch: Path, out: Path, ours: frozenset[str], overwrite: bool) -> None:
    """Move a scratch folder to its place; if another run has taken that meanwhile, to a numbered
    name beside it."""
    try:
        check_free(out, ours, overwrite)
        _replace(scratch, out)
    except OSError as error:
        if not (isinstance(error, OutputError) or error.errno in (errno.ENOTEMPTY, errno.EEXIST)):
            raise
        beside = next(p for n in count(2) if not (p := out.with_name(f"{out.name}-{n}")).exists())
        os.rename(scratch, beside)
        why = f"has been taken by another run meanwhile; this report is kept as {str(beside)!r}"
        raise refusal(out, why) from None


def _replace(scratch: Path, out: Path) -> None:
    """Move an old folder away, the new one to its place; of a process killed in between, `sweep`
    restores the old."""
    if not out.exists():
        os.rename(scratch, out)
        return
    old = scratch_path(out.parent, out.name, OLD)
    os.rename(out, old)
    try:
        os.rename(scratch, out)
    except BaseException:
        os.rename(old, out)
        raise
    shutil.rmtree(old, ignore_errors=True)


def sweep(parent: Path, name: str) -> None:
    """Remove scratch files and folders of killed processes; restore a folder that one was
    replacing."""
    pattern = re.compile(
        rf"\.{re.escape(name)}-{re.escape(platform.node())}-(\d{{1,9}})-[0-9a-f]{{8}}(\{PART_SUFFIX}|\{OLD})"
    )
    with suppress(OSError):  # a folder that may be written but not read
        for left in map(pattern.fullmatch, os.listdir(parent)):
            if left and not _is_running(int(left[1])):
                _clear(parent / left[0], parent / name)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except OSError as error:
        return error.errno == errno.EPERM
    return True


def _clear(left: Path, out: Path) -> None:
    """Remove what a killed process has left, or restore the folder that it was replacing."""
    if not left.is_dir() or left.is_symlink():
        left.unlink()
    elif left.suffix == OLD and not out.exists():
        os.rename(left, out)
    else:
        shutil.rmtree(left, ignore_errors=True)


def name_of(path: Path) -> str:
    """The name of a scene or study: that of its file without suffix."""
    return path.stem.encode(errors="replace").decode()
