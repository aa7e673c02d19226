"""Limits on z-scores, corrected for how many are looked at."""

import numpy as np
from scipy import stats

FALSE_ALARM = 1e-3
"""Chance that a whole family of z-scores of a correct program fails, before its seed was fixed."""
LEEWAY = 4.5
"""Standard errors: the largest of 500 rows is that far off once in 300 tables."""


def limit(checks):
    """Largest |z| allowed among so many z-scores (Bonferroni)."""
    return float(stats.norm.isf(0.5 * FALSE_ALARM / checks))


def agrees(value, truth, se, slack=0.0):
    """Whether all values lie within the corrected limit of the truth, after a stated systematic
    `slack`."""
    value, truth, se, slack = np.broadcast_arrays(value, truth, se, slack)
    return bool((np.abs(value - truth) <= limit(value.size) * se + slack).all())
