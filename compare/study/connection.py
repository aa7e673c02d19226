"""The connection to a Dask scheduler, and how to secure it.

A Dask scheduler has no authentication and runs what it is sent: whoever reaches its port can run programs as its
workers, and whoever runs the scheduler can run programs here, for results come back as pickles.  Use one in a network
where every machine is trusted, or over TLS, where only holders of a certificate of one authority can talk: give
``tls://HOST:PORT`` and name the certificates in Dask's configuration, for example by
``DASK_DISTRIBUTED__COMM__TLS__CA_FILE``, ``..__TLS__CLIENT__CERT`` and ``..__TLS__CLIENT__KEY``; the scheduler and the
workers have their own, and ``DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION=true`` makes them refuse all else.
"""

import asyncio
import logging
import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rattle.scene.errors import InputError

if TYPE_CHECKING:
    from distributed import Client


def check_address(address: str) -> None:
    """Check the form of a scheduler's address.

    Examples
    --------
    >>> check_address("tcp://127.0.0.1:8786")
    >>> check_address("ucx://127.0.0.1:8786")
    Traceback (most recent call last):
    ...
    rattle.scene.errors.InputError: scheduler = 'ucx://127.0.0.1:8786': give tcp://HOST:PORT, or tls://HOST:PORT where \
it has certificates
    """
    found = re.fullmatch(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[\w.-]+):(\d{1,5})", address)
    if not found or not 0 < int(found[3]) < 2**16:
        raise InputError("scheduler", address, "give tcp://HOST:PORT, or tls://HOST:PORT where it has certificates")


def silence() -> None:
    """Keep Dask's own log messages off the terminal; errors that matter are raised as one line."""
    with suppress(ModuleNotFoundError):
        import_module("distributed")  # importing it sets the levels, so they are changed afterwards
    for name in ("distributed", "distributed.client", "tornado.application", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def connect(address: str, patience: float) -> "Client":
    """Connect to the scheduler at an address."""
    try:
        from distributed import Client  # an optional dependency, imported only when a scheduler is asked for
        from distributed.security import Security
    except ModuleNotFoundError:
        raise InputError("scheduler", address, "needs Dask: pip install rattle[cluster]") from None
    try:
        security = Security()  # as Dask's configuration has it
        certificates = security.get_connection_args("client")
    except (OSError, ValueError) as error:
        raise InputError("scheduler", address, f"the certificates in Dask's configuration: {error}") from None
    if address.startswith("tls:") and not certificates.get("ssl_context"):
        why = "needs certificates; name them in Dask's configuration (distributed.comm.tls: ca-file, client.cert, .key)"
        raise InputError("scheduler", address, why)
    try:
        with ThreadPoolExecutor(1) as pool:  # the main thread of a notebook already runs an event loop
            pool.submit(asyncio.run, _greeted(address, patience, certificates)).result()
        return Client(address, timeout=patience, set_as_default=False, security=security)
    except Exception as error:  # the kind depends on what listens at the port
        raise InputError(
            "scheduler",
            address,
            f"does not answer ({str(error) or type(error).__name__}); start one with dask scheduler, or leave it out",
        ) from None


async def _greeted(address: str, patience: float, certificates: dict[str, Any]) -> None:
    """Complete the handshake with a scheduler within `patience`: Dask itself would wait for ever for a silent peer."""
    from distributed.comm import connect

    async with asyncio.timeout(patience):
        (await connect(address, timeout=patience, **certificates)).abort()
