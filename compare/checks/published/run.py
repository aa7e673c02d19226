"""Runs the checks of published results and judges them together."""

import time
from collections.abc import Callable, Sequence

from rattle.compare.checks.published.bouncing_ball import bouncing_ball
from rattle.compare.checks.published.elastic_box import elastic_box
from rattle.compare.checks.published.energy_law import energy_law
from rattle.compare.checks.published.exit_time import exit_time
from rattle.compare.checks.published.exponent_sum import exponent_sum
from rattle.compare.checks.published.free_flight import free_flight
from rattle.compare.checks.published.gaps import exit_side, random_gap
from rattle.compare.checks.published.impact_laws import impact_laws
from rattle.compare.checks.published.impact_pair import impact_pair
from rattle.compare.checks.published.orbit_exponents import orbit_exponents
from rattle.compare.checks.published.result import Measured, PublishedResult, limit
from rattle.compare.checks.published.return_speed import critical_restitution, return_moments, return_speed
from rattle.scene.validate import choice, count

RESULTS: dict[str, Callable[[int, int], Measured]] = {
    result.__name__.replace("_", "-"): result
    for result in (
        exit_time,
        return_speed,
        return_moments,
        critical_restitution,
        bouncing_ball,
        elastic_box,
        exponent_sum,
        orbit_exponents,
        free_flight,
        impact_laws,
        energy_law,
        impact_pair,
        random_gap,
        exit_side,
    )
}
"""Every result by its name on the command line."""


def check_results(names: Sequence[str] = (), *, seed: int = 0, workers: int = 2) -> list[PublishedResult]:
    """Test the installed program against published results.

    The admissible error of each check depends on their number (Bonferroni), so that at least one check of a correct
    program fails with a probability of at most `rattle.compare.checks.published.result.FALSE_ALARM`.

    Examples
    --------
    >>> [(result.measured.name, result.holds) for result in check_results(["bouncing-ball"])]
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
