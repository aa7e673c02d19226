"""Runs jobs in a process of its own, which is killed when a job exceeds its time limit.

Compiled loops do not react to signals, so that a hang can be ended only from outside.
"""

import multiprocessing
import time
import traceback
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import psutil

__all__ = ["Outcome", "Watched"]

BOUND = 60.0  # seconds of processor time for a job
START = 300.0  # for the first job, which compiles
WAITING = 10.0  # times its processor time that a job may take on the clock: other work may be on the machine
LOOK = 1.0  # seconds between two looks at the clocks


class Outcome(NamedTuple):
    """How a job ended: ``complete``, ``stopped`` or ``refused``, or a defect: ``broken``, ``hung`` or ``died``."""

    ended: str
    detail: str
    seconds: float

    @property
    def defect(self) -> bool:
        """Whether this must never happen."""
        return self.ended in ("broken", "hung", "died")


def _serve(jobs: Any, function: Callable[..., tuple[str, str]]) -> None:
    warnings.simplefilter("error")
    while True:
        try:
            job = jobs.recv()
        except EOFError:
            return
        started = time.process_time()
        try:
            ended, detail = function(*job)
        except Exception:
            ended, detail = "broken", traceback.format_exc()
        jobs.send(Outcome(ended, detail, time.process_time() - started))


class Watched:
    """Runs a function, which gives how it ended and a detail, in a process that is started anew after a hang.

    Parameters
    ----------
    function : callable
        Of a module that a new process can import.
    bounds : dict of str to float
        Seconds of processor time that a job may take, by the first of its arguments; `BOUND` for others.
    warm : tuple
        Arguments of a first job, which may take as long as compiling does.
    """

    def __init__(
        self, function: Callable[..., tuple[str, str]], bounds: dict[str, float], warm: list[tuple[Any, ...]]
    ) -> None:
        self.function, self.bounds, self.warm = function, bounds, warm
        self._process: Any = None

    def run(self, *job: Any) -> Outcome:
        """One job."""
        if self._process is None:
            self._begin()
        return self._ask(job, self.bounds.get(str(job[0]), BOUND))

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._jobs, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self.function), daemon=True)
        self._process.start()
        theirs.close()
        for job in self.warm:
            first = self._ask(job, START)
            assert not first.defect, first.detail

    def _ask(self, job: tuple[Any, ...], bound: float) -> Outcome:
        started = time.perf_counter()
        self._jobs.send(job)
        before = self._processor_time()
        try:
            while time.perf_counter() - started < WAITING * bound and self._processor_time() - before < bound:
                if self._jobs.poll(min(LOOK, bound)):
                    answer: Outcome = self._jobs.recv()
                    return answer
            ended, detail = "hung", f"no answer within {bound:g} s"
        except EOFError:
            self._process.join()
            ended, detail = "died", f"exit code {self._process.exitcode}"
        self.close()
        return Outcome(ended, detail, time.perf_counter() - started)

    def _processor_time(self) -> float:
        used = psutil.Process(self._process.pid).cpu_times()
        return float(used.user + used.system + used.children_user + used.children_system)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._jobs.close()
            self._process = None
