"""All published results, and the run of them."""

from collections.abc import Callable, Sequence

from rattle.compare.checks.check import Result, run_checks
from rattle.compare.checks.published.bouncing_ball import bouncing_ball
from rattle.compare.checks.published.elastic_box import elastic_box
from rattle.compare.checks.published.energy_law import energy_law
from rattle.compare.checks.published.exit_time import exit_time
from rattle.compare.checks.published.exponents import exponent_sum, orbit_exponents
from rattle.compare.checks.published.free_flight import free_flight
from rattle.compare.checks.published.gaps import exit_side, random_gap
from rattle.compare.checks.published.impact_laws import impact_laws
from rattle.compare.checks.published.impact_pair import impact_pair
from rattle.compare.checks.published.return_speed import critical_restitution, return_moments, return_speed

RESULTS: dict[str, Callable[[int, int], Result]] = {
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


def check_results(names: Sequence[str] = (), *, seed: int = 0, workers: int = 2) -> list[Result]:
    """Test the installed program against published results, all of them or those of these names."""
    return run_checks(RESULTS, names, seed=seed, workers=workers)
