"""A folder of results, one Parquet file each, named by the content of what determines them."""

import errno
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout

from scene.errors import OutputError

__all__ = ["Store", "Stored"]

NAME = b"rattle"  # of the entry in a file's metadata that holds its key and its facts


def _digest(table: pd.DataFrame, facts: dict[str, Any]) -> str:
    """Digest of the values of a table, of their types and their index, and of the facts beside it."""
    names = [*map(str, table.columns), str(table.index.name), facts]
    digest = hashlib.sha256(json.dumps(names, sort_keys=True).encode())
    for values in (table.index.to_numpy(), *(table[name].to_numpy() for name in table)):
        if values.dtype == object and len(values):
            values = np.concatenate(values) if isinstance(values[0], np.ndarray) else values.astype(str)
        if values.dtype.kind == "f":
            values = np.where(np.isnan(values), np.nan, values)  # one NaN is as good as another
        digest.update(f"{values.dtype.str} {values.shape}".encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


class Stored(NamedTuple):
    """What a file holds: a table, and facts beside it that need not repeat (times, say)."""

    table: pd.DataFrame
    facts: dict[str, Any]


class Store:
    """Results by key; whole or absent, whatever happens to the process that writes them.

    Parameters
    ----------
    folder : Path
        Where the files are; made when it is missing.

    Raises
    ------
    OutputError
        If the folder cannot be made or written.

    Examples
    --------
    >>> import tempfile
    >>> store = Store(Path(tempfile.mkdtemp()))
    >>> store.write("abc", pd.DataFrame({"tau": [0.5]}), {"seconds": 1.0})
    >>> store.read("abc").facts, store.read("other")
    ({'seconds': 1.0}, None)
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            for part in (folder, self._locks):
                part.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._refused(f"cannot be made ({error.strerror}); choose another place") from None
        if not os.access(folder, os.W_OK):
            raise self._refused("cannot be written; choose another place")

    @property
    def _locks(self) -> Path:
        return self.folder / "locks"

    @property
    def aside(self) -> Path:
        """Where files are moved that are not what their name says."""
        return self.folder / "set-aside"

    def path(self, key: str) -> Path:
        """The file of a key."""
        return self.folder / f"{key}.parquet"

    def read(self, key: str) -> Stored | None:
        """What is stored under a key; None where nothing is.  What is damaged or foreign is set aside."""
        path = self.path(key)
        if not path.exists():
            return None
        try:
            found = pq.read_table(path, page_checksum_verification=True, use_threads=False, memory_map=False)
            record = json.loads(found.schema.metadata[NAME])
            if record["key"] != key:
                raise ValueError("belongs to another key")
            stored = Stored(found.to_pandas(), record["facts"])
            if record["sha256"] != _digest(*stored):
                raise ValueError("its content is not what was written")
            return stored
        except FileNotFoundError:  # set aside by another process in this moment
            return None
        except Exception as error:  # a damaged file makes pyarrow and pandas raise whatever they meet in it
            self._set_aside(path, (str(error) or type(error).__name__).splitlines()[0])
            return None

    def write(self, key: str, table: pd.DataFrame, facts: dict[str, Any]) -> None:
        """Store a table under a key: the file appears whole or not at all.

        Raises
        ------
        OutputError
            If the disk is full or the folder cannot be written; what was stored before is untouched.
        """
        content = pa.Table.from_pandas(table)
        record = json.dumps({"key": key, "facts": facts, "sha256": _digest(table, facts)}).encode()
        content = content.replace_schema_metadata({**content.schema.metadata, NAME: record})
        scratch = None
        try:
            number, scratch = tempfile.mkstemp(prefix=f".{key}-", suffix=".part", dir=self.folder)
            with os.fdopen(number, "wb") as file:
                pq.write_table(content, file, compression="zstd", write_page_checksum=True)
                file.flush()
                os.fsync(file.fileno())
            os.replace(scratch, self.path(key))
        except OSError as error:
            if scratch is not None:
                Path(scratch).unlink(missing_ok=True)
            why = "the disk is full" if error.errno == errno.ENOSPC else f"cannot be written ({error.strerror})"
            raise self._refused(f"{why}; what is finished is there: make room and repeat the command") from None

    @contextmanager
    def alone(self, key: str) -> Iterator[bool]:
        """Whether this thread is the only one, of all processes, at work on a key; a lock ends with its process."""
        lock = FileLock(self._locks / key, thread_local=False)
        try:
            lock.acquire(blocking=False)
        except Timeout:
            yield False
            return
        try:
            yield True
        finally:
            lock.release()

    def sweep(self) -> None:
        """Remove what killed processes have left half written; what another process is writing now is its own."""
        for part in self.folder.glob(".*.part"):
            with self.alone(part.name[1:].split("-")[0]) as alone:
                if alone:
                    part.unlink(missing_ok=True)

    def _refused(self, why: str) -> OutputError:
        return OutputError(f"out = {str(self.folder)!r}: {why}")

    def _set_aside(self, path: Path, why: str) -> None:
        self.aside.mkdir(exist_ok=True)
        target = self.aside / path.name
        number = 1
        while target.exists():
            target = self.aside / f"{path.stem}-{number}.parquet"
            number += 1
        try:
            os.replace(path, target)
        except FileNotFoundError:
            return
        target.with_suffix(".txt").write_text(f"{path.name}: {why}\n", encoding="utf-8")
