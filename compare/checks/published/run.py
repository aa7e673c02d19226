"""All results, one after the other, judged together."""

import time
from collections.abc import Callable, Sequence

from rattle.compare.checks.published.bouncing_ball import bouncing_ball
from rattle.compare.checks.published.elastic_box import elastic_box
from rattle.compare.checks.published.exit_time import exit_time
from rattle.compare.checks.published.exponent_sum import exponent_sum
from rattle.compare.checks.published.free_flight import free_flight
from rattle.compare.checks.published.result import Measured, PublishedResult, limit
from rattle.compare.checks.published.return_speed import critical_restitution, return_speed
from rattle.scene.validate import choice, count

__all__ = ["RESULTS", "selftest"]

RESULTS: dict[str, Callable[[int, int], Measured]] = {
    result.__name__.replace("_", "-"): result
    for result in (exit_time, return_speed, critical_restitution, bouncing_ball, elastic_box, exponent_sum, free_flight)
}
"""Every result by its name on the command line."""


def selftest(names: Sequence[str] = (), *, seed: int = 0, workers: int = 2) -> list[PublishedResult]:
    """Put the program to the test of published results.

    All checks together of a correct program fail with a chance of at most
    `rattle.compare.checks.published.result.FALSE_ALARM`: what each is allowed in standard errors depends on
    how many there are.

    Parameters
    ----------
    names : sequence of str
        Which of `LAWS`; all by default.
    seed : int
        Of all random numbers.
    workers : int
        Threads.

    Raises
    ------
    InputError
        For a result that is not known, or a seed or a number of threads that cannot be.

    Examples
    --------
    >>> [(result.measured.name, result.holds) for result in selftest(["bouncing-ball"])]
    [('bouncing-ball sum', True)]
    """
    count("seed", seed, least=0)
    count("workers", workers)
    wanted = [choice("result", name, RESULTS) for name in dict.fromkeys(names)] or list(RESULTS)
    measured, seconds = [], []
    for name in wanted:
        started = time.perf_counter()
        measured.append(RESULTS[name](seed, workers))
        seconds.append(time.perf_counter() - started)
    allowed = limit(sum(check.se > 0.0 for m in measured for check in m.checks))
    return [PublishedResult(m, allowed, t) for m, t in zip(measured, seconds, strict=True)]
