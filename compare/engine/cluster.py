"""Runs the work of cells on a running Dask cluster, over a connection that can be secured
(docs/guide/studies.md).

A Dask scheduler runs what it is sent, and its results come back as pickles: use one in a trusted
network, or over TLS (``tls://HOST:PORT``), with the certificates that Dask's configuration names.
"""

import asyncio
import logging
import re
import time
from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any, Self

from rattle.compare.engine.run import Runner
from rattle.compare.engine.store import Say, numerical_version
from rattle.scene import InputError, RattleError
from rattle.scene.sources import PACKAGES, describe_difference, sources_in

if TYPE_CHECKING:
    from distributed import Client, Scheduler


def check_address(address: str) -> None:
    """Check the form of a scheduler's address."""
    parts = re.fullmatch(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[\w.-]+):(\d{1,5})", address)
    if not parts or not 0 < int(parts[3]) < 2**16:
        raise InputError(
            "scheduler",
            address,
            "give tcp://HOST:PORT, or tls://HOST:PORT where it has certificates",
        )


def silence() -> None:
    """Keep Dask's own log messages off the terminal; errors that matter are raised as one line."""
    with suppress(ModuleNotFoundError):
        import_module("distributed")  # importing it sets the levels, so they are changed afterwards
    for name in ("distributed", "distributed.client", "tornado.application", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def connect(address: str, patience: float) -> "Client":
    """Connect to the scheduler at an address."""
    try:
        # an optional dependency, imported only when a scheduler is asked for
        from distributed import Client
        from distributed.security import Security
    except ModuleNotFoundError:
        raise InputError("scheduler", address, "needs Dask: pip install rattle[cluster]") from None
    try:
        security = Security()  # as Dask's configuration has it
        certificates = security.get_connection_args("client")
    except (OSError, ValueError) as error:
        raise InputError(
            "scheduler", address, f"the certificates in Dask's configuration: {error}"
        ) from None
    if address.startswith("tls:") and not certificates.get("ssl_context"):
        why = (
            "needs certificates; name them in Dask's configuration (distributed.comm.tls: ca-file,"
            " client.cert, .key)"
        )
        raise InputError("scheduler", address, why)
    try:
        # the main thread of a notebook already runs an event loop
        with ThreadPoolExecutor(1) as pool:
            pool.submit(asyncio.run, _greeted(address, patience, certificates)).result()
        return Client(address, timeout=patience, set_as_default=False, security=security)
    except Exception as error:  # the kind depends on what listens at the port
        why = (
            f"does not answer ({str(error) or type(error).__name__}); start one with dask"
            " scheduler, or leave it out"
        )
        raise InputError("scheduler", address, why) from None


async def _greeted(address: str, patience: float, certificates: dict[str, Any]) -> None:
    """Complete the handshake with a scheduler within `patience`: Dask itself would wait for ever
    for a silent peer."""
    from distributed.comm import connect

    async with asyncio.timeout(patience):
        (await connect(address, timeout=patience, **certificates)).abort()


BLOCKS_OF_A_TASK = 64
"""Blocks of one task: about a second of exact flights, against 3.5 ms of scheduling."""
SCHEDULER_PATIENCE = 15.0
"""Seconds that a scheduler may take to answer, and that a cluster may have no worker.

Dask's nanny process restarts a worker that has died in less time.
"""
WATCH = 1.0  # seconds between two questions to the scheduler which workers it has
SILENCE = 20.0
"""Seconds without a sign of life from a worker, after which its work is given to others.

Its heart beats every few seconds in the largest clusters; Dask itself waits for 5 minutes (its
``worker-ttl``).
"""
HURRY = 0.5  # seconds to take leave of a scheduler after an error or an interrupt


class Lost(RattleError):
    """The cluster can no longer be used; the message says why, and what to do."""


class Cluster(Runner):
    """The workers of a running Dask cluster.

    Every task carries the numerical version that it was planned with; a worker with another version
    refuses it, because workers may join at any time.

    `address`: Address of the scheduler, as in ``tcp://host:8786``, or ``tls://host:8786`` with the
    certificates named in Dask's configuration. `patience`: Seconds to wait for an answer of the
    scheduler, and for a worker while there is none.
    """

    share = BLOCKS_OF_A_TASK

    def __init__(self, address: str, patience: float = SCHEDULER_PATIENCE) -> None:
        check_address(address)
        super().__init__(0)
        self.address = address
        self.patience = patience

    def __enter__(self) -> Self:
        self._client = connect(self.address, self.patience)
        try:
            self._client.wait_for_workers(1, timeout=self.patience)
            self.workers = sum(self._client.nthreads(callback_timeout=self.patience).values())
        except BaseException as error:
            self.__exit__()
            if isinstance(error, TimeoutError):
                raise self._refuse("has no workers; start some: dask worker ADDRESS") from None
            if isinstance(error, OSError):
                raise self._refuse(f"no longer answers ({error}); start it again") from None
            raise
        self._executor = self._client.get_executor(pure=False)
        self._seen = self._looked = time.monotonic()
        # of each worker the last by its clock, and by ours
        self._heartbeats: dict[str, tuple[float, float]] = {}
        self._all_silent = False
        return self

    def __exit__(self, kind: type[BaseException] | None = None, *what: object) -> None:
        with suppress(Exception):  # the scheduler may be gone already
            self._client.close(timeout=self.patience if kind is None else HURRY)

    def submit(self, work: Callable[..., Any], *given: Any) -> Future[Any]:
        """Run some work on a worker."""
        try:
            return self._executor.submit(compute_checked, numerical_version(), work, *given)
        except Exception:  # the kind depends on how the scheduler was lost
            raise CancelledError from None

    def stop(self) -> None:
        """Abandon the tasks that are running."""
        with suppress(Exception):  # the scheduler may be gone already
            self._executor.shutdown(wait=False)

    def check(self, say: Say) -> None:
        """Notice a scheduler or workers that are gone or do not answer: Dask itself would wait for
        ever."""
        if time.monotonic() - self._looked < WATCH:
            return
        try:
            identity = self._client.sync(
                self._client.scheduler.identity, callback_timeout=self.patience
            )
        except Exception:  # the kind depends on how the scheduler was lost
            raise self._loss("no longer answers: start it again") from None
        now = self._looked = time.monotonic()
        if identity["workers"]:
            self._seen = now
        if now - self._seen > self.patience:
            raise self._loss(
                f"has had no workers for {self.patience:.0f} s: start some (dask worker ADDRESS)"
            )
        beats = {address: worker["last_seen"] for address, worker in identity["workers"].items()}
        for address, beat in beats.items():
            if self._heartbeats.get(address, (None, now))[0] != beat:
                self._heartbeats[address] = (beat, now)
        silent = [address for address in beats if now - self._heartbeats[address][1] > SILENCE]
        if len(silent) < len(beats):
            self._replace(silent, say)
        elif silent and not self._all_silent:
            say(
                f"no worker has answered for {SILENCE:.0f} s ({', '.join(silent)}); waiting for"
                " one; Ctrl-C ends this"
            )
        self._all_silent = len(silent) == len(beats)

    def _replace(self, silent: Iterable[str], say: Say) -> None:
        """Give the work of some workers to the others."""
        for address in silent:
            say(
                f"worker {address} has not answered for {SILENCE:.0f} s; its cells go to the others"
            )
            # a scheduler may refuse to run functions; then it does so itself, later
            with suppress(Exception):
                self._client.run_on_scheduler(remove_worker, address)

    def reason(self, error: BaseException) -> str:
        """Why one cell cannot be computed; raises an error that concerns all cells."""
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            return (
                f"the workers that computed it died ({error.allowed_failures + 1} of them, the last"
                f" at {error.last_worker.address}): check their logs and their memory"
            )
        if isinstance(error, CancelledError):
            raise self._loss("no longer answers: start it again")
        if isinstance(error, Lost | ImportError):
            raise self._loss(str(error))
        return super().reason(error)

    def _loss(self, why: str) -> Lost:
        """The error for a cluster that was lost during the work."""
        return Lost(
            f"scheduler = {self.address!r}: {why}; finished results are kept; run the same command"
            " again to continue"
        )

    def _refuse(self, why: str) -> InputError:
        """The error for a cluster that cannot be used from the beginning."""
        return InputError("scheduler", self.address, why)


async def remove_worker(address: str, dask_scheduler: "Scheduler") -> None:
    """On the scheduler: remove a worker, as it does itself with one that has been silent for
    minutes."""
    await dask_scheduler.remove_worker(address, stimulus_id="rattle: silent")


def compute_checked(version: str, work: Callable[..., Any], *given: Any) -> Any:
    """On a worker: the result of some work, or Lost if the worker's numerical version is not
    `version`."""
    from distributed import get_worker

    if change := describe_difference(sources_in(*PACKAGES)):
        raise Lost(f"worker {get_worker().address}: {change}: start it again")
    if (version_here := numerical_version()) != version:
        worker = get_worker().address
        raise Lost(
            f"worker {worker} has numerical version {version_here}, here it is {version}: install"
            " the same there"
        )
    return work(*given)
