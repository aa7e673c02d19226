"""Paired differences of runs on common noise, and the standard errors that they state."""

import numpy as np
import pandas as pd
from scenes import dat21

from rattle.compare.study.cells import Sample
from rattle.compare.study.impacts import compare_paired

PAIRS = 20


def test_paired_differences_have_the_errors_that_they_state():
    """Of twenty pairs of short runs the spread of their differences is the paired standard error,
    which is smaller than that of independent runs; 3.5 relative errors of an sd of twenty."""
    tables = []
    for seed in range(PAIRS):
        cells = [Sample(dat21(s), impacts=2, seed=seed, paths=4096) for s in (0.3, 0.33)]
        tables.append(compare_paired(*(cell.restore(cell.compute()) for cell in cells)))
    rows = pd.concat(tables).query("impact == 2 and quantity == 'tau'").groupby("moment")
    spread = rows["difference"].std()
    se = rows[["se", "se_independent"]].agg(lambda one: np.sqrt(np.mean(one**2)))
    allowed = 3.5 / np.sqrt(2.0 * (PAIRS - 1)) + 0.1
    assert ((spread / se["se"] - 1.0).abs() < allowed).all()
    assert (se["se"] < 0.8 * se["se_independent"]).all()
    assert ((spread / (0.3 * se["se"]) - 1.0).abs() > allowed).all()  # negative control
