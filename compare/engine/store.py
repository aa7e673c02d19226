"""A store of results: a Parquet file for each cell, named by the digest of its inputs and of the
numerical code."""

import errno
import hashlib
import json
import os
import platform
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeAlias

import llvmlite.binding
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, SoftFileLock, Timeout

from rattle.compare.report.folder import ANY_TEXT, PART_SUFFIX, describe_refusal, scratch_path
from rattle.compare.report.json_text import Facts as Facts
from rattle.compare.report.json_text import json_digest, json_text
from rattle.montecarlo.kernel.blocks import Blocks
from rattle.scene import OutputError, Scene, line
from rattle.scene.compiled import has_fma
from rattle.scene.files import read_regular
from rattle.scene.progress import print_on_stderr
from rattle.scene.sources import PACKAGES, describe_difference, digest_of, sources_in

LIBRARIES = ("numpy", "numba", "llvmlite", "scipy")


@cache
def numerical_version(*packages: str) -> str:
    """Compute a digest of the numerical code that this process runs, of its libraries, and of the
    kind of processor.

    All x86-64 processors with AVX2 and FMA are of one kind, for their bits agree.  Each other is a
    kind of its own.

    Comments, docstrings and empty lines do not change the digest.
    """
    libraries = (f"{library} {import_module(library).__version__};" for library in LIBRARIES)
    return digest_of(
        sources_in(*packages or PACKAGES), _processor(), *platform.libc_ver(), *libraries
    )


def _processor() -> str:
    """The kind of processor, by the bits it gives."""
    machine = platform.machine()
    if machine.lower() in ("x86_64", "amd64") and has_fma():
        return "x86-64 with AVX2 and FMA"
    return f"{machine} {llvmlite.binding.get_host_cpu_name()}"


LOCKS = "locks"  # folder in every store
PAUSE = 0.2  # seconds between two tries of a cell that another process is computing
MOST_TRIES = 5  # tries before that process is named
SEAL = hashlib.sha256().digest_size
PARQUET_ENTRY = b"rattle"  # metadata entry of a Parquet file that holds its key and its facts


Say: TypeAlias = Callable[[str], object]
"""Says a line to whoever waits."""


class Content(NamedTuple):
    """What the file of a cell holds."""

    table: pd.DataFrame
    # plain data with an entry ``seconds``; may hold what is not reproducible, such as times
    facts: Facts


class Cell(ABC):
    """One result to compute, or to find in a store under its key."""

    # those whose code determines the result besides that of scenes
    packages: ClassVar[tuple[str, ...]]
    # whether the work is handed to `blocks`; otherwise it is one task
    splits: ClassVar[bool] = False
    scene: Scene

    @property
    @abstractmethod
    def group(self) -> str:
        """Name of the cells that take about as long: a closure, or ``ensembles``."""

    @property
    @abstractmethod
    def settings(self) -> Facts:
        """Everything that determines the result besides the scene, with an entry ``kind``."""

    def list_fields(self, *left_out: str) -> Facts:
        """The fields of a dataclass by name, but the scene and some others."""
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]
        return {name: getattr(self, name) for name in names if name not in ("scene", *left_out)}

    @property
    def core_seconds(self) -> float:
        """Expected seconds of one core; of an ensemble a short run tells it."""
        return 0.0

    @abstractmethod
    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, Facts]:
        """Compute table and facts; `blocks` runs blocks of paths, in this thread one after the
        other by default."""

    def restore(self, content: Content) -> Any:
        """Turn what was stored into a result of this kind of cell, which has the facts as
        ``facts``; or leave it so."""
        return content

    def describe(self, result: Any) -> str:
        """What the progress line and the log say of a result; nothing by default."""
        return ""

    @cached_property
    def key(self) -> str:
        """Digest of the scene's dimensionless numbers, the settings, and the version of the code
        that is used."""
        numbers = replace(self.scene, gears=None).to_dict()  # without the gears that it came from
        settings = dict(self.settings)
        content = {"kind": settings.pop("kind"), "scene": numbers, "settings": settings}
        return json_digest(content | {"version": numerical_version("scene", *self.packages)})[:32]

    @property
    def label(self) -> str:
        """Short description for the progress line."""
        return f"{self.group} at sigma {self.scene.sigma:.3g}"

    def compute(self, blocks: Blocks | None = None) -> Content:
        """Compute what is stored, with the time that it takes."""
        started = time.perf_counter()
        table, facts = self.evaluate(blocks)
        return Content(table, facts | {"seconds": time.perf_counter() - started})


class Store:
    """Results by key; files are written atomically, so that a killed process leaves no partial
    result."""

    def __init__(self, folder: Path, read_only: bool = False) -> None:
        self.folder = folder
        self._locks = folder / LOCKS
        self._tries: Counter[str] = Counter()  # of cells that other processes compute, by process
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

    def missing(self, cells: Iterable[Cell]) -> list[Cell]:
        """List the cells that are not stored."""
        return [cell for cell in cells if not self.path(cell).is_file()]

    def read(self, cell: Cell) -> Any:
        """Read the result of a cell; None if there is none, or a damaged file, which will be
        replaced."""
        # pyarrow and pandas raise many kinds for a file that is not theirs
        with suppress(Exception):
            return cell.restore(_parse(cell.key, read_regular(self.path(cell))))
        if self.path(cell).is_dir():
            raise self._refuse(
                f"{self.path(cell).name} is a folder in place of a result; remove it"
            )
        return None

    def check_sources(self, cell: Cell) -> None:
        """Raise an error if the code that computes a cell is not that which its key stands for."""
        if change := describe_difference(sources_in("scene", *cell.packages)):
            raise self._refuse(f"{change}, so no result is stored; start it again")

    def write(self, cell: Cell, content: Content) -> None:
        """Store the result of a cell, atomically."""
        self.check_sources(cell)
        table = pa.Table.from_pandas(content.table)
        sink = pa.BufferOutputStream()
        record = json_text({"key": cell.key, "facts": content.facts}, indent=None).encode()
        table = table.replace_schema_metadata({**table.schema.metadata, PARQUET_ENTRY: record})
        pq.write_table(table, sink, compression="zstd")
        scratch = scratch_path(self.folder, ANY_TEXT, PART_SUFFIX)
        try:
            scratch.write_bytes(with_seal(sink.getvalue().to_pybytes()))
            os.replace(scratch, self.path(cell))
        except OSError as error:
            scratch.unlink(missing_ok=True)
            why = (
                "the disk is full"
                if error.errno == errno.ENOSPC
                else f"cannot be written ({error.strerror})"
            )
            raise self._refuse(
                f"{why}; finished results are kept: make room and repeat the command"
            ) from None

    def attempt(
        self,
        cell: Cell,
        compute: Callable[[Cell], Content] = lambda cell: cell.compute(),
        say: Say = print_on_stderr,
    ) -> Any:
        """Read or compute the result of a cell; None, after a pause, while another process or
        thread computes it.

        After about a second that process is named, once.
        """
        if (result := self.read(cell)) is not None:
            return result
        with self.alone(cell.key) as alone:
            if alone:
                # it may have been stored just before the lock was taken
                if (result := self.read(cell)) is None:
                    self.check_sources(cell)
                    content = compute(cell)
                    self.write(cell, content)
                    result = cell.restore(content)
                return result
        time.sleep(PAUSE)
        who = self._holder(cell.key)
        self._tries[who] += 1
        if self._tries[who] == MOST_TRIES:
            say(f"waiting for {who}, at work on {cell.label}; continues when it finishes")
        return None

    def obtain(self, cell: Cell, *how: Any) -> Any:
        """Read or compute the result of a cell as `attempt` does, waiting for another process that
        computes it."""
        while (result := self.attempt(cell, *how)) is None:
            pass
        return result

    @contextmanager
    def alone(self, key: str) -> Iterator[bool]:
        """Try to lock a key, without waiting; the lock ends with the context, or with its
        process."""
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
                    holder = f"process {os.getpid()} on {platform.node()} since {since}"
                    Path(lock.lock_file).write_text(holder, encoding="utf-8")
            yield True
        finally:
            lock.release()

    def _holder(self, key: str) -> str:
        """Name the process that holds the lock of a key."""
        with suppress(OSError):
            return (
                line(read_regular(self._locks / key).decode(errors="replace"))[:100]
                or "another process"
            )
        return "another process"

    def _refuse(self, why: str) -> OutputError:
        """The error for a folder that cannot be used."""
        return OutputError(f"out = {str(self.folder)!r}: {why}")


class TemporaryStore(Store):
    """Results of one call, in memory."""

    def __init__(self) -> None:
        self._contents: dict[str, Content] = {}

    def missing(self, cells: Iterable[Cell]) -> list[Cell]:
        """List the cells that are not stored."""
        return [cell for cell in cells if cell.key not in self._contents]

    def read(self, cell: Cell) -> Any:
        """Read the result of a cell; None if there is none."""
        content = self._contents.get(cell.key)
        return None if content is None else cell.restore(content)

    def check_sources(self, cell: Cell) -> None:
        """Accept any: what is in memory is used by the code in memory."""

    def write(self, cell: Cell, content: Content) -> None:
        """Store the result of a cell."""
        self._contents[cell.key] = content

    @contextmanager
    def alone(self, key: str) -> Iterator[bool]:
        """No other process can compute the cell."""
        yield True


def open_store(folder: Path | str | None) -> Store:
    """The store in a folder; without a folder, a temporary one."""
    return Store(Path(folder)) if folder else TemporaryStore()


def _parse(key: str, content: bytes) -> Content:
    """The result in a file's content; raises an error of some kind if there is none."""
    with pq.ParquetFile(pa.BufferReader(_without_seal(content))) as file:
        table = file.read(use_threads=False)
    record = json.loads(table.schema.metadata[PARQUET_ENTRY])
    if record["key"] != key:
        raise ValueError("belongs to another key")
    float(record["facts"]["seconds"])
    return Content(table.to_pandas(use_threads=False), record["facts"])


def with_seal(parquet: bytes) -> bytes:
    """A Parquet file with a digest of all its bytes inserted before its footer, where readers
    ignore it."""
    at = _footer(parquet)
    return parquet[:at] + hashlib.sha256(parquet).digest() + parquet[at:]


def _without_seal(content: bytes) -> bytes:
    """The original Parquet file; raises ValueError if any bit has changed, since pyarrow can crash
    on such a file."""
    at = _footer(content)
    parquet = content[: max(at - SEAL, 0)] + content[max(at, 0) :]
    if at < SEAL or content[at - SEAL : at] != hashlib.sha256(parquet).digest():
        raise ValueError("its content is not what was written")
    return parquet


def _footer(parquet: bytes) -> int:
    """Offset of the footer of a Parquet file, from the length in its last eight bytes."""
    return len(parquet) - 8 - int.from_bytes(parquet[-8:-4], "little")
