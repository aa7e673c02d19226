"""Computes the cells of a study on a running Dask cluster; workers may join and leave at any time."""

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from rattle.compare.study.cells import Cell, Prediction
from rattle.compare.study.connection import check_address, connect
from rattle.compare.study.executors import SHARE, Failed, Stopped, stoppable
from rattle.compare.study.store import Stored
from rattle.compare.study.version import numerical_version
from rattle.montecarlo.blocks import Floats
from rattle.montecarlo.kernel.block import BlockResult, Plan, run
from rattle.scene.errors import InputError, RattleError

if TYPE_CHECKING:
    from distributed import Future

PATIENCE = 15.0
"""Seconds that a scheduler may take to answer, and that a cluster may have no worker.

Dask's nanny process restarts a worker that has died in less time.
"""
LOOK = 0.2  # seconds between two checks for Ctrl-C and for a lost cluster while a result is awaited
WATCH = 1.0  # seconds between two questions to the scheduler which workers it has
FETCH = 120.0  # seconds that the results of a task may take through the network
RETRIES = 3  # how often a task that has raised an exception is run again, on any worker


class Lost(RattleError):
    """The cluster can no longer be used; the message says why, and what to do."""


class Foreign(NamedTuple):
    """Returned instead of a result by a worker that has another numerical version."""

    worker: str
    version: str


class Cluster:
    """The workers of a running Dask cluster, used as a context manager.

    An ensemble is split into tasks of `SHARE` blocks, whose results are merged here in block order.  Every task
    carries the numerical version that it was planned with; a worker with another version refuses it, because workers
    may join at any time.

    `address`: Address of the scheduler, as in ``tcp://host:8786``, or ``tls://host:8786`` with the certificates
    named in Dask's configuration. `patience`: Seconds to wait for an answer of the scheduler, and for a worker
    while there is none.
    """

    def __init__(self, address: str, patience: float = PATIENCE) -> None:
        check_address(address)
        self.address, self.patience = address, patience
        self._stopped = threading.Event()
        self._lost = ""
        self.threads = 0

    def __enter__(self) -> Self:
        self._client = connect(self.address, self.patience)
        try:
            self._client.wait_for_workers(1, timeout=self.patience)
            self._check_workers()
            self.threads = sum(self._client.nthreads(callback_timeout=self.patience).values())
        except TimeoutError:
            self._close()
            raise self._refuse("has no workers; start some: dask worker ADDRESS") from None
        except OSError as error:
            self._close()
            raise self._refuse(f"no longer answers ({error}); start it again") from None
        except BaseException:
            self._close()
            raise
        threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(self, *what: object) -> None:
        self._stopped.set()
        self._close()

    def _close(self) -> None:
        with suppress(Exception):  # the scheduler may be gone already
            self._client.close(timeout=self.patience)

    def stop(self) -> None:
        """Abandon the tasks that are running."""
        self._stopped.set()

    def compute(self, cell: Cell) -> Stored:
        """Compute a cell on the cluster."""
        from distributed import KilledWorker

        try:
            if isinstance(cell, Prediction):
                found: Stored = self._result(self._submit(f"{cell.key}-{_own()}", cell.compute))
                return found
            return cell.compute(stoppable(self._blocks, self._stopped))
        except KilledWorker as error:
            raise Failed(
                f"{cell.label}: the workers that computed it died ({error.allowed_failures + 1} of them, the last at "
                f"{error.last_worker.address}): check their logs and their memory"
            ) from None

    def _blocks(self, plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        name = _own()
        starts = iter(range(first, plan.blocks, SHARE))

        def submitted(start: int) -> "Future":
            end = min(start + SHARE, plan.blocks)
            return self._submit(f"blocks-{name}-{start}", run_part, plan, start, end)

        waiting = [submitted(s) for s in islice(starts, 2 * self.threads)]
        try:
            while waiting:
                yield from ((result, None) for result in self._result(waiting.pop(0)))
                waiting.extend(submitted(s) for s in islice(starts, 1))
        finally:
            for future in waiting:
                future.release()  # Dask does not start a task that no client waits for

    def _submit(self, key: str, work: Callable[..., Any], *given: Any) -> "Future":
        try:
            return self._client.submit(compute_checked, numerical_version(), work, *given, key=key, retries=RETRIES)
        except Exception as error:  # the client has lost its connection
            raise self._lose(error) from None

    def _result(self, future: "Future") -> Any:
        """Wait for the result of a task; raises Stopped after an interrupt and Lost without a usable cluster."""
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        while not done.wait(LOOK):
            if self._stopped.is_set():
                raise Stopped("interrupted")
            if self._lost:
                raise Lost(self._lost)
        if future.status == "error":
            return self._raise(future.exception())
        try:
            found = future.result(timeout=FETCH)
        except (CancelledError, OSError) as error:
            raise self._lose(error) from None
        if isinstance(found, Foreign):
            raise self._lasting(_differs(found))
        return found

    def _raise(self, error: BaseException) -> None:
        """Raise the exception of a task again, or Lost if a worker cannot run rattle at all."""
        from distributed import KilledWorker

        if not isinstance(error, RattleError | KilledWorker):
            try:
                self._check_workers()
            except InputError as refused:
                raise self._lasting(refused.remedy) from None
        raise error

    def _lose(self, error: BaseException) -> RattleError:
        """The error to raise for a lost connection."""
        if self._stopped.is_set():
            return Stopped("interrupted")
        return Lost(self._lost) if self._lost else self._lasting("no longer answers: start it again")

    def _lasting(self, why: str) -> Lost:
        return Lost(
            f"scheduler = {self.address!r}: {why}; finished results are kept; run the same command again to continue"
        )

    def _refuse(self, why: str) -> InputError:
        return InputError("scheduler", self.address, why)

    def _watch(self) -> None:
        """Notice a scheduler or workers that are gone, in a thread of its own: Dask itself would wait for ever."""
        seen = time.monotonic()
        while not self._stopped.wait(WATCH):
            try:
                if self._client.nthreads(callback_timeout=self.patience):
                    seen = time.monotonic()
            except Exception:  # the kind depends on how the scheduler was lost
                self._lost = self._lost or str(self._lasting("no longer answers: start it again"))
            if time.monotonic() - seen > self.patience:
                why = f"has had no workers for {self.patience:.0f} s: start some (dask worker ADDRESS)"
                self._lost = self._lost or str(self._lasting(why))
            if self._lost:
                return

    def _check_workers(self) -> None:
        """Refuse workers of another numerical version: their results would differ."""
        try:
            versions = self._client.run(numerical_version, on_error="return", callback_timeout=self.patience)
        except (CancelledError, OSError) as error:
            raise self._refuse(f"or a worker of it does not answer ({error or type(error).__name__})") from None
        own = numerical_version()
        for worker, version in versions.items():
            if isinstance(version, BaseException):  # the worker lacks this package, or has another Python
                why = f"worker {worker} cannot run rattle ({version}); install the same version there"
                raise self._refuse(why)
            if version != own:
                raise self._refuse(_differs(Foreign(worker, version)))


def compute_checked(version: str, work: Callable[..., Any], *given: Any) -> Any:
    """On a worker: the result of some work, or Foreign if the worker's numerical version is not `version`."""
    from distributed import get_worker

    own = numerical_version()
    return work(*given) if own == version else Foreign(get_worker().address, own)


def run_part(plan: Plan, first: int, end: int) -> list[BlockResult]:
    """On a worker: the results of blocks `first` to `end`, one each, so that the client can merge them in order."""
    return [run(plan, block)[0] for block in range(first, end)]


def _differs(found: Foreign) -> str:
    return (
        f"worker {found.worker} has numerical version {found.version}, here it is {numerical_version()}: "
        "install the same there, or stop it"
    )


def _own() -> str:
    return uuid.uuid4().hex[:12]
