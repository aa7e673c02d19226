"""A store of results: a Parquet file for each cell, named by the digest of the cell's inputs."""

import errno
import hashlib
import json
import os
import platform
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, SoftFileLock, Timeout

from rattle.compare.report.folder import ANY_TEXT, PART, describe_refusal, scratch_path, within, write_whole
from rattle.compare.report.json_text import json_text
from rattle.montecarlo.kernel.blocks import Blocks
from rattle.scene.errors import OutputError
from rattle.scene.text import harmless, line

PAUSE = 0.2  # seconds between two tries of a cell that another process is computing
PATIENCE = 5  # tries before that process is named
SEAL = hashlib.sha256().digest_size
NAME = b"rattle"  # metadata entry of a Parquet file that holds its key and its facts


class Content(NamedTuple):
    """What the file of a cell holds."""

    table: pd.DataFrame
    facts: dict[str, Any]  # plain data with an entry ``seconds``; may hold what is not reproducible, such as times


class Cell(Protocol):
    """One result to compute, or to find in a store under its key."""

    @property
    def key(self) -> str:
        """Digest of everything that determines the result."""
        ...

    @property
    def label(self) -> str:
        """Short description for the progress line."""
        ...

    @property
    def group(self) -> str:
        """Name of the cells that take about as long: a closure, or ``ensembles``."""
        ...

    @property
    def splits(self) -> bool:
        """Whether `compute` hands its work to `blocks`; otherwise it is one task."""
        ...

    @property
    def core_seconds(self) -> float | None:
        """Expected seconds of one core; None for an ensemble, of which a short run tells it."""
        ...

    def compute(self, blocks: Blocks | None = None) -> Content:
        """Compute the result."""
        ...

    def restore(self, content: Content) -> Any:
        """Turn what was stored into a result of this kind of cell, which has the facts as ``facts``."""
        ...


def print_on_stderr(text: str) -> None:
    """Print a line on standard error."""
    print(harmless(f"rattle: {text}"), file=sys.stderr, flush=True)


class Store:
    """Results by key; files are written atomically, so that a killed process leaves no partial result.

    Examples
    --------
    >>> import tempfile
    >>> from rattle.compare.study.cells import Prediction
    >>> from rattle.scene import DAT21, Scene
    >>> store = Store(Path(tempfile.mkdtemp()))
    >>> cell = Prediction(Scene.from_gears(DAT21), impacts=1, closure="corrected")
    >>> store.read(cell) is None
    True
    >>> round(float(store.obtain(cell).section.loc[1, "tau"]), 3)
    0.56
    """

    def __init__(self, folder: Path, read_only: bool = False) -> None:
        self.folder, self.aside, self._locks = folder, folder / "set-aside", folder / "locks"
        within(folder, self._locks.name, self.aside.name)
        if read_only:
            return
        try:
            self._locks.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._refuse(f"cannot be made ({error.strerror}); choose another place") from None
        if not os.access(folder, os.W_OK):
            raise self._refuse("cannot be written; choose another place")

    def path(self, cell: Cell) -> Path:
        """Path of the file of a cell."""
        return self.folder / f"{cell.key}.parquet"

    def read(self, cell: Cell) -> Any:
        """Read the result of a cell, None if there is none; a damaged or foreign file is moved to `aside`."""
        path = self.path(cell)
        try:
            return cell.restore(_parse(cell.key, path.read_bytes()))
        except FileNotFoundError:
            return None
        except (OSError, MemoryError) as error:
            if isinstance(error, MemoryError) or error.errno is not None:  # pyarrow's own have no number
                why = os.strerror(getattr(error, "errno", None) or errno.ENOMEM)
                how = "it stays as it is: remove the cause, and repeat the command"
                raise self._refuse(f"{path.name} cannot be read ({why}); {how}") from None
            self._set_aside(path, str(error))
        except Exception as error:  # pyarrow and pandas raise many kinds for a file that is not theirs
            self._set_aside(path, str(error) or type(error).__name__)
        return None

    def write(self, cell: Cell, content: Content) -> None:
        """Store the result of a cell, atomically."""
        table, sink = pa.Table.from_pandas(content.table), pa.BufferOutputStream()
        record = json_text({"key": cell.key, "facts": content.facts}, indent=None).encode()
        table = table.replace_schema_metadata({**table.schema.metadata, NAME: record})
        pq.write_table(table, sink, compression="zstd")
        scratch = scratch_path(self.folder, ANY_TEXT, PART)
        try:
            with open(scratch, "xb") as file:  # permissions by the umask, so that others may read it
                file.write(with_seal(sink.getvalue().to_pybytes()))
                file.flush()
                os.fsync(file.fileno())
            os.replace(scratch, self.path(cell))
        except OSError as error:
            scratch.unlink(missing_ok=True)
            why = "the disk is full" if error.errno == errno.ENOSPC else f"cannot be written ({error.strerror})"
            raise self._refuse(f"{why}; finished results are kept: make room and repeat the command") from None

    def attempt(self, cell: Cell, compute: Callable[[Cell], Content]) -> Any:
        """Read or compute the result of a cell; None, after a pause, while another process or thread computes it."""
        if (found := self.read(cell)) is not None:
            return found
        with self.alone(cell.key) as alone:
            if alone:
                if (found := self.read(cell)) is None:  # it may have been stored just before the lock was taken
                    content = compute(cell)
                    self.write(cell, content)
                    found = cell.restore(content)
                return found
        time.sleep(PAUSE)
        return None

    def obtain(
        self,
        cell: Cell,
        compute: Callable[[Cell], Content] = lambda cell: cell.compute(),
        say: Callable[[str], object] = print_on_stderr,
    ) -> Any:
        """Read or compute the result of a cell, waiting for another process that computes it."""
        waits = Waits(self, say)
        while (found := self.attempt(cell, compute)) is None:
            waits.count(cell)
        return found

    @contextmanager
    def alone(self, key: str) -> Iterator[bool]:
        """Try to lock a key, without waiting; the lock ends with the context, or with its process."""
        lock = FileLock(self._locks / key, thread_local=False)
        try:
            lock.acquire(blocking=False)
        except Timeout:
            yield False
            return
        except OSError as error:
            raise describe_refusal(self.folder, error) from None
        try:
            with suppress(OSError):  # the name of its holder is not essential
                if not isinstance(lock, SoftFileLock):
                    since = time.strftime("%Y-%m-%d %H:%M:%S")
                    with open(os.open(lock.lock_file, os.O_WRONLY | os.O_TRUNC | os.O_NOFOLLOW), "w") as file:
                        file.write(f"process {os.getpid()} on {platform.node()} since {since}")
            yield True
        finally:
            lock.release()

    def holder(self, key: str) -> str:
        """Name the process that holds the lock of a key."""
        try:
            return line((self._locks / key).read_text(errors="replace"))[:100] or "another process"
        except OSError:
            return "another process"

    def _refuse(self, why: str) -> OutputError:
        return OutputError(f"out = {str(self.folder)!r}: {why}")

    def _set_aside(self, path: Path, why: str) -> None:
        """Move a file to `aside`, with a note of the reason."""
        target, number = self.aside / path.name, 1
        while target.exists():
            target, number = self.aside / f"{path.stem}-{number}.parquet", number + 1
        try:
            self.aside.mkdir(exist_ok=True)
            os.replace(path, target)
        except FileNotFoundError:
            return
        except OSError as error:
            raise self._refuse(f"{path.name} is damaged and cannot be moved away ({error.strerror})") from None
        with suppress(OutputError):  # the note is not essential
            write_whole(target.with_suffix(".txt"), f"{path.name}: {(why.splitlines() or ['?'])[0][:200]}\n")


class Waits:
    """Counts tries of cells that other processes are computing, and names each process once after about a second."""

    def __init__(self, store: Store, say: Callable[[str], object]) -> None:
        self._store, self._say = store, say
        self._tries: Counter[str] = Counter()
        self._named: set[str] = set()

    def count(self, cell: Cell) -> None:
        """Count a try."""
        self._tries[cell.key] += 1
        who = self._store.holder(cell.key)
        if self._tries[cell.key] >= PATIENCE and who not in self._named:
            self._named.add(who)
            self._say(f"waiting for {who}, at work on {cell.label}; continues when it finishes")


def _parse(key: str, content: bytes) -> Content:
    """The result in a file's content; raises an error of some kind if there is none."""
    with pq.ParquetFile(pa.BufferReader(_without_seal(content))) as file:
        found = file.read(use_threads=False)
    record = json.loads(found.schema.metadata[NAME])
    if record["key"] != key:
        raise ValueError("belongs to another key")
    float(record["facts"]["seconds"])
    return Content(found.to_pandas(use_threads=False), record["facts"])


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
