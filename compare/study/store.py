"""A content-addressed store of results: one Parquet file each, named by the digest of its inputs."""

import errno
import hashlib
import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout

from rattle.compare.report.folder import describe_refusal, within, write_whole
from rattle.compare.report.json_text import json_text
from rattle.compare.study.waiting import sign
from rattle.scene.errors import OutputError

MOST_VALUES, MOST_BYTES = 50_000_000, 400_000_000
"""Largest size of an unpacked file; a hundred thousand impacts fit."""
SEAL = hashlib.sha256().digest_size
SYSTEM = (OSError, MemoryError, ImportError)
"""Errors of the system, not of a file: no permission, no descriptor or memory left, a failing disk, a missing module.

Pyarrow also raises an OSError, but without an errno, for content that it cannot parse.
"""
REMEDIES = {
    errno.EACCES: "ask its owner for permission to read it (chmod g+r)",
    errno.EPERM: "ask its owner for permission to read it (chmod g+r)",
    errno.EMFILE: "close what holds files open, or allow more of them (ulimit -n)",
    errno.ENFILE: "close what holds files open",
    errno.ENOMEM: "free memory",
    errno.EIO: "check the disk",
}
NAME = b"rattle"  # metadata entry of a Parquet file that holds its key and its facts


def _check_size(metadata: Any) -> None:
    """Raise ValueError for a file that would unpack to more than any result has."""
    groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
    values = sum(g.column(i).num_values for g in groups for i in range(g.num_columns))
    size = sum(g.total_byte_size for g in groups)
    if max(values, metadata.num_rows * metadata.num_columns) > MOST_VALUES or size > MOST_BYTES:
        raise ValueError(f"would unpack to {values:,} values in {size:,} bytes, more than any result has")


def with_seal(parquet: bytes) -> bytes:
    """A Parquet file with a digest of all its bytes inserted before its footer, where readers ignore it."""
    at = _footer(parquet)
    return parquet[:at] + hashlib.sha256(parquet).digest() + parquet[at:]


def _without_seal(content: bytes) -> bytes:
    """The original Parquet file; raises ValueError if any bit has changed, since pyarrow can crash on such a file."""
    at = _footer(content)
    parquet = content[: max(at - SEAL, 0)] + content[max(at, 0) :]
    if at < SEAL or content[at - SEAL : at] != hashlib.sha256(parquet).digest():
        raise ValueError("its content is not what was written")
    return parquet


def _footer(parquet: bytes) -> int:
    """Offset of the footer of a Parquet file, from the length in its last eight bytes."""
    return len(parquet) - 8 - int.from_bytes(parquet[-8:-4], "little")


class _Wrong(Exception):
    """A file could be read but is not the result of its key."""


def _parse(key: str, content: bytes) -> "Stored":
    """The result in a file's content; raises _Wrong if there is none, and passes on errors of the system."""
    try:
        with pq.ParquetFile(pa.BufferReader(_without_seal(content))) as file:
            _check_size(file.metadata)
            found = file.read(use_threads=False)
        record = json.loads(found.schema.metadata[NAME])
        if record["key"] != key:
            raise ValueError("belongs to another key")
        if not isinstance(record["facts"], dict):
            raise ValueError("its facts are no table")
        return Stored(found.to_pandas(use_threads=False), record["facts"])
    except Exception as error:  # pyarrow and pandas raise many kinds for a file that is not theirs
        if isinstance(error, SYSTEM) and not (isinstance(error, OSError) and error.errno is None):
            raise
        raise _Wrong((str(error) or type(error).__name__).splitlines()[0]) from None


class Stored(NamedTuple):
    """Content of a file."""

    table: pd.DataFrame
    facts: dict[str, Any]  # plain data; may hold entries that are not reproducible, such as times


class Store:
    """Results by key; files are written atomically, so that a killed process leaves no partial result.

    Examples
    --------
    >>> import tempfile
    >>> store = Store(Path(tempfile.mkdtemp()))
    >>> store.write("abc", pd.DataFrame({"tau": [0.5]}), {"seconds": 1.0})
    >>> store.read("abc").facts, store.read("other")
    ({'seconds': 1.0}, None)
    """

    def __init__(self, folder: Path, read_only: bool = False) -> None:
        self.folder = folder
        within(folder, self._locks.name, self.aside.name)
        if read_only:
            return
        try:
            for part in (folder, self._locks):
                part.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._refuse(f"cannot be made ({error.strerror}); choose another place") from None
        if not os.access(folder, os.W_OK):
            raise self._refuse("cannot be written; choose another place")

    @property
    def _locks(self) -> Path:
        return self.folder / "locks"

    @property
    def aside(self) -> Path:
        """Folder to which damaged and foreign files are moved."""
        return self.folder / "set-aside"

    def path(self, key: str) -> Path:
        """Path of the file of a key."""
        return self.folder / f"{key}.parquet"

    def lock(self, key: str) -> Path:
        """Path of the lock file of a key, which names the process that holds it."""
        return self._locks / key

    def read(self, key: str) -> Stored | None:
        """Read the result of a key; a damaged or foreign file is moved aside."""
        try:
            content = self._content(key)
            return None if content is None else _parse(key, content)
        except _Wrong as wrong:
            self.set_aside(key, str(wrong))
            return None
        except SYSTEM as error:
            raise self.unreadable(key, error) from None

    def _content(self, key: str) -> bytes | None:
        try:
            with open(self.path(key), "rb") as file:
                if os.fstat(file.fileno()).st_size > MOST_BYTES:
                    raise _Wrong("no result is as large")
                return file.read()
        except FileNotFoundError:
            return None

    def unreadable(self, key: str, error: BaseException) -> OutputError:
        """Build the error for a result that the operating system does not let be read."""
        number = errno.ENOMEM if isinstance(error, MemoryError) else getattr(error, "errno", None)
        what = os.strerror(number) if number else str(error)
        remedy = REMEDIES.get(number or 0, "remove the cause")
        name = self.path(key).name
        return self._refuse(f"{name} cannot be read ({what}); it stays as it is: {remedy}, and repeat the command")

    def write(self, key: str, table: pd.DataFrame, facts: dict[str, Any]) -> None:
        """Store a table under a key, atomically."""
        content = pa.Table.from_pandas(table)
        record = json_text({"key": key, "facts": facts}, indent=None).encode()
        content = content.replace_schema_metadata({**content.schema.metadata, NAME: record})
        sink, scratch = pa.BufferOutputStream(), self.folder / f".{key}-{secrets.token_hex(4)}.part"
        pq.write_table(content, sink, compression="zstd")
        try:
            with open(scratch, "xb") as file:  # permissions by the umask, so that others may read it
                file.write(with_seal(sink.getvalue().to_pybytes()))
                file.flush()
                os.fsync(file.fileno())
            os.replace(scratch, self.path(key))
        except OSError as error:
            scratch.unlink(missing_ok=True)
            why = "the disk is full" if error.errno == errno.ENOSPC else f"cannot be written ({error.strerror})"
            raise self._refuse(f"{why}; finished results are kept: make room and repeat the command") from None

    @contextmanager
    def alone(self, key: str) -> Iterator[bool]:
        """Try to lock a key, without waiting; the lock ends with the context, or with its process."""
        lock = FileLock(self.lock(key), thread_local=False)
        try:
            lock.acquire(blocking=False)
        except Timeout:
            yield False
            return
        except OSError as error:
            raise describe_refusal(self.folder, error) from None
        try:
            sign(lock)
            yield True
        finally:
            lock.release()

    def sweep(self) -> None:
        """Remove partial files of killed processes; those of running processes are locked and stay."""
        for part in self.folder.glob(".*.part"):
            with suppress(OSError), self.alone(part.name[1:].split("-")[0]) as alone:
                if alone:
                    part.unlink(missing_ok=True)

    def _refuse(self, why: str) -> OutputError:
        return OutputError(f"out = {str(self.folder)!r}: {why}")

    def set_aside(self, key: str, why: str) -> None:
        """Move the file of a key to `aside`, with a note of the reason."""
        path, number = self.path(key), 1
        try:
            self.aside.mkdir(exist_ok=True)
            target = self.aside / path.name
            while target.exists():
                target = self.aside / f"{path.stem}-{number}.parquet"
                number += 1
            os.replace(path, target)
        except FileNotFoundError:
            return
        except OSError as error:
            raise self._refuse(f"{path.name} is damaged and cannot be moved away ({error.strerror})") from None
        with suppress(OutputError):  # the note is not essential
            write_whole(target.with_suffix(".txt"), f"{path.name}: {why.splitlines()[0][:200] if why else '?'}\n")
