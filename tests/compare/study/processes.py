"""A Dask scheduler and workers as processes of their own, which can be killed and stopped."""

import subprocess
from contextlib import contextmanager

from programs import start

SCHEDULER = """
import asyncio, sys
from distributed import Scheduler

async def main():
    place = {"protocol": sys.argv[1], "host": "127.0.0.1", "port": 0}
    async with Scheduler(**place, dashboard=False) as scheduler:
        print(scheduler.address, flush=True)
        await scheduler.finished()

if __name__ == "__main__":
    asyncio.run(main())
"""
WORKER = """
import asyncio, sys
from distributed import Worker

async def main():
    async with Worker(sys.argv[1], nthreads=1, dashboard=False) as worker:
        print(worker.address, flush=True)
        await worker.finished()

if __name__ == "__main__":
    asyncio.run(main())
"""


@contextmanager
def _running(code, *words, **environment):
    """A process, and the address that it prints once it answers there; killed in the end."""
    running = start("-c", code, *words, stderr=subprocess.DEVNULL, **environment)
    try:
        address = running.stdout.readline().strip()
        assert address, "it has ended before it answered"
        yield running, address
    finally:
        running.kill()
        running.communicate()


def scheduler(protocol="tcp://", **environment):
    """A scheduler without workers."""
    return _running(SCHEDULER, protocol, **environment)


def worker(address, **environment):
    """A worker of one thread."""
    return _running(WORKER, address, **environment)
