"""Paired differences of runs on common noise, and the standard errors that they state."""

import numpy as np
from scenes import dat21

from rattle.compare.study.cells import Sample
from rattle.compare.study.impacts import compare_paired

PAIRS = 20


def test_paired_differences_have_the_errors_that_they_state():
    """Of twenty pairs of short runs the spread of their differences is the paired standard error,
    which is smaller than that of independent runs; 3.5 relative errors of an sd of twenty."""
    rows = []
    for seed in range(PAIRS):
        scenes = [dat21(sigma) for sigma in (0.3, 0.33)]
        cells = [Sample(scene, impacts=2, seed=seed, paths=4096) for scene in scenes]
        table = compare_paired(*(cell.restore(cell.compute()) for cell in cells))
        rows.append(table.query("impact == 2 and quantity == 'tau'").set_index("moment"))
    allowed = 3.5 / np.sqrt(2.0 * (PAIRS - 1)) + 0.1
    for moment in ("mean", "sd"):
        spread = np.std([row["difference"][moment] for row in rows], ddof=1)
        paired = np.sqrt(np.mean([row["se"][moment] ** 2 for row in rows]))
        assert abs(spread / paired - 1.0) < allowed
        independent = np.sqrt(np.mean([row["se_independent"][moment] ** 2 for row in rows]))
        assert paired < 0.8 * independent
        assert abs(spread / (0.3 * paired) - 1.0) > allowed  # negative control
