"""All laws, one after the other, judged together."""

import time
from collections.abc import Callable, Sequence

from rattle.compare.checks.laws.bouncing_ball import bouncing_ball
from rattle.compare.checks.laws.elastic_box import elastic_box
from rattle.compare.checks.laws.exit_time import exit_time
from rattle.compare.checks.laws.exponent_sum import exponent_sum
from rattle.compare.checks.laws.free_flight import free_flight
from rattle.compare.checks.laws.law import Law, Measured, limit
from rattle.compare.checks.laws.return_speed import critical_restitution, return_speed
from rattle.scene.validate import choice, count

__all__ = ["LAWS", "selftest"]

LAWS: dict[str, Callable[[int, int], Measured]] = {
    law.__name__.replace("_", "-"): law
    for law in (exit_time, return_speed, critical_restitution, bouncing_ball, elastic_box, exponent_sum, free_flight)
}
"""Every law by its name on the command line."""


def selftest(names: Sequence[str] = (), *, seed: int = 0, workers: int = 2) -> list[Law]:
    """Put the program to the test of published laws.

    All checks together of a correct program fail with a chance of at most `rattle.compare.checks.laws.law.FALSE_ALARM`:
    what each is allowed in standard errors depends on how many there are.

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
        For a law that is not known, or a seed or a number of threads that cannot be.

    Examples
    --------
    >>> [(law.measured.name, law.holds) for law in selftest(["bouncing-ball"])]
    [('bouncing-ball sum', True)]
    """
    count("seed", seed, least=0)
    count("workers", workers)
    wanted = [choice("law", name, LAWS) for name in dict.fromkeys(names)] or list(LAWS)
    measured, seconds = [], []
    for name in wanted:
        started = time.perf_counter()
        measured.append(LAWS[name](seed, workers))
        seconds.append(time.perf_counter() - started)
    allowed = limit(sum(check.se > 0.0 for m in measured for check in m.checks))
    return [Law(m, allowed, t) for m, t in zip(measured, seconds, strict=True)]
