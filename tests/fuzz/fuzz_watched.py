"""Runs jobs in a process of its own, which the kernel ends when one takes too long: compiled loops
heed no signal."""

import multiprocessing
import os
import signal
import time
import traceback
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

# seconds of processor time for a job: 64 sticking paths of ten million steps each take 72
BOUND = 300.0
WAITING = 10.0  # times as long may it take on the clock, for other work may be on the machine


class Outcome(NamedTuple):
    """How a job ended: ``complete``, ``stopped`` or ``refused``, or a defect: ``broken``, ``hung``
    or ``died``."""

    ended: str
    detail: str
    seconds: float

    @property
    def defect(self) -> bool:
        """Whether this must never happen."""
        return self.ended in ("broken", "hung", "died")


def _serve(jobs: Any, function: Callable[..., tuple[str, str]], bound: float) -> None:
    warnings.simplefilter("error")
    while True:
        job = jobs.recv()
        signal.setitimer(signal.ITIMER_PROF, bound)
        signal.setitimer(signal.ITIMER_REAL, WAITING * bound)
        started = time.process_time()
        try:
            ended, detail = function(*job)
        except Exception:
            ended = "broken"
            detail = traceback.format_exc()
        jobs.send(Outcome(ended, detail, time.process_time() - started))


class Watched:
    """Runs a function of a module, which gives how it ended and a detail, in a process; one that
    ends begins anew."""

    def __init__(self, function: Callable[..., tuple[str, str]], bound: float = BOUND) -> None:
        self.function = function
        self.bound = bound
        self._process: Any = None

    def run(self, *job: Any) -> Outcome:
        """One job."""
        if self._process is None:
            context = multiprocessing.get_context("spawn")
            self._jobs, theirs = context.Pipe()
            self._process = context.Process(
                target=_serve, args=(theirs, self.function, self.bound), daemon=True
            )
            self._process.start()
            theirs.close()
        try:
            self._jobs.send(job)
            return self._jobs.recv()
        except EOFError:
            self._process.join()
            code = self._process.exitcode
            self._process = None
            hung = code in (-signal.SIGPROF, -signal.SIGALRM)
            return Outcome(
                "hung" if hung else "died",
                f"no answer within {self.bound:g} s, or exit code {code}",
                self.bound,
            )

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()


def ends_as_named(kind: str) -> tuple[str, str]:
    """A job with a known end, for the negative control."""
    if kind == "waits":
        time.sleep(60.0)
    while kind == "loops":
        pass
    if kind == "dies":
        os._exit(3)
    if kind == "warns":
        warnings.warn("unwanted", RuntimeWarning, stacklevel=1)
    return "complete", kind
