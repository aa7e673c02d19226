"""Where the cells of a study are computed: on threads of this process, or on a Dask cluster."""

import threading
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol, Self

from compare.study.cell import Cell, Prediction
from compare.study.store import Stored
from compare.study.version import numerical_version
from montecarlo.block import BlockResult, Plan, run
from montecarlo.ensemble import Blocks, Floats, in_pool
from scene.errors import InputError, RattleError

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["Cluster", "Here", "Place", "Stopped"]

SHARE = 64
"""Blocks of one task on a cluster: about a second of exact flights, long beside what the scheduler takes for a task."""


class Stopped(RattleError):
    """The study was interrupted; what was in flight is given up."""


class Place(Protocol):
    """Where cells are computed."""

    threads: int

    def compute(self, cell: Cell) -> Stored:
        """The result of a cell."""
        ...

    def stop(self) -> None:
        """Give up what is in flight."""
        ...

    def __enter__(self) -> Self:
        """Get ready."""
        ...

    def __exit__(self, *what: object) -> None:
        """Let go."""
        ...


class Here:
    """Threads of this process; cells in flight share them, so that the last cell uses all."""

    def __init__(self, workers: int) -> None:
        self.threads = workers
        self._stopped = threading.Event()

    def __enter__(self) -> Self:
        self._pool = ThreadPoolExecutor(self.threads)
        return self

    def __exit__(self, *what: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def compute(self, cell: Cell) -> Stored:
        """The result of a cell."""
        return cell.compute(_stoppable(in_pool(self._pool, self.threads), self._stopped))

    def stop(self) -> None:
        """Give up what is in flight, after the blocks that run."""
        self._stopped.set()


def _stoppable(blocks: Blocks, stopped: threading.Event) -> Blocks:
    def until_stopped(plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        for result in blocks(plan, first):
            if stopped.is_set():
                raise Stopped("interrupted")
            yield result

    return until_stopped


class Cluster:
    """Workers of a running Dask cluster; an ensemble is split into parts of `SHARE` blocks, merged here in order.

    Parameters
    ----------
    address : str
        Of the scheduler, as in ``tcp://host:8786``.
    patience : float
        Seconds to wait for the scheduler and its first worker.

    Raises
    ------
    InputError
        Where Dask is not installed, the scheduler does not answer or has no workers, or a worker has another
        numerical version: its results would not be the same.
    """

    def __init__(self, address: str, patience: float = 10.0) -> None:
        self.address, self.patience = address, patience
        self._stopped = threading.Event()
        self.threads = 0

    def __enter__(self) -> Self:
        self._client = _connected(self.address, self.patience)
        try:
            self._check_workers()
        except BaseException:
            self._client.close()
            raise
        return self

    def __exit__(self, *what: object) -> None:
        self._client.close()

    def _check_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=self.patience)
        except TimeoutError:
            raise InputError("scheduler", self.address, "has no workers; start some: dask worker ADDRESS") from None
        try:
            versions = self._client.run(numerical_version)
        except Exception as error:  # whatever a worker without this package, or with another Python, makes of it
            raise InputError(
                "scheduler", self.address, f"a worker cannot run rattle ({error}); install the same version there"
            ) from None
        own = numerical_version()
        for worker, version in versions.items():
            if version != own:
                raise InputError(
                    "scheduler", self.address,
                    f"worker {worker} has numerical version {version}, here it is {own}: install the same there",
                )  # fmt: skip
        self.threads = sum(self._client.nthreads().values())

    def compute(self, cell: Cell) -> Stored:
        """The result of a cell."""
        if isinstance(cell, Prediction):
            future = self._client.submit(cell.compute, key=f"{cell.key}-{uuid.uuid4().hex[:8]}", retries=3)
            found: Stored = future.result()
            return found
        return cell.compute(_stoppable(self._blocks, self._stopped))

    def _blocks(self, plan: Plan, first: int) -> Iterator[tuple[BlockResult, Floats | None]]:
        name = uuid.uuid4().hex[:12]
        starts = iter(range(first, plan.blocks, SHARE))

        def submitted(start: int) -> Any:
            end = min(start + SHARE, plan.blocks)
            return self._client.submit(run_part, plan, start, end, key=f"blocks-{name}-{start}", retries=3)

        waiting = [submitted(s) for s in islice(starts, 2 * self.threads)]
        try:
            while waiting:
                yield from ((result, None) for result in waiting.pop(0).result())
                waiting.extend(submitted(s) for s in islice(starts, 1))
        finally:
            if waiting:
                self._client.cancel(waiting)

    def stop(self) -> None:
        """Give up what is in flight."""
        self._stopped.set()


def run_part(plan: Plan, first: int, end: int) -> list[BlockResult]:
    """The results of some blocks of a plan, each by itself: they are merged in block order wherever they were run."""
    return [run(plan, block)[0] for block in range(first, end)]


def _connected(address: str, patience: float) -> "Client":
    try:
        from distributed import Client  # nothing of it is loaded before a scheduler is asked for
    except ModuleNotFoundError:
        raise InputError("scheduler", address, "needs Dask: pip install rattle[cluster]") from None
    try:
        return Client(address, timeout=patience, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            "scheduler", address, f"does not answer ({error}); start one with dask scheduler, or leave it out"
        ) from None
