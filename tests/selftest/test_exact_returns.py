"""The return-speed result holds for the noise's tree and for the refinement of ``exact-flight``."""

import math

from exact_returns import log_ratios

from rattle.compare.checks.published.result import limit
from rattle.compare.checks.published.return_speed import MEAN
from rattle.compare.checks.published.returning import log_speeds

PATHS = 40_000


def z_of(ln):
    return (ln.mean() - MEAN) / (ln.std() / math.sqrt(ln.size))


def test_steps_of_the_tree_obey_the_law():
    assert abs(z_of(log_speeds(1.0, PATHS, 1, seed=3)[:, 0])) < limit(1)


def test_steps_of_exact_flight_obey_the_law():
    """A trial is cut because of what its end would be; to forget that end and draw it anew made E ln rho 1.93."""
    assert abs(z_of(log_ratios(PATHS, seed=3))) < limit(1)
