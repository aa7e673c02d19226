"""The return-speed result holds for the noise's tree and for the refinement of ``exact-flight``."""

import math

from exact_returns import log_ratios

from rattle.compare.checks.check import limit
from rattle.compare.checks.published.return_speed import MEAN
from rattle.compare.checks.published.returning import log_speeds

PATHS = 40_000


def z_of(ln):
    return (ln.mean() - MEAN) / (ln.std() / math.sqrt(ln.size))


def test_steps_of_the_brownian_tree_obey_the_published_result():
    assert abs(z_of(log_speeds(1.0, PATHS, 1, seed=3)[:, 0])) < limit(1)


def test_steps_of_exact_flight_obey_the_published_result():
    """A trial step is cut depending on its end; drawing the end anew instead of keeping it made E ln rho 1.93."""
    assert abs(z_of(log_ratios(PATHS, seed=3))) < limit(1)
