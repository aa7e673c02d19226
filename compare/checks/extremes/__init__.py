"""Checks at extreme parameter values against independent references.

The references are the formulas in 400 digits, limits, published results, and exact scaling relations.
"""

from rattle.compare.checks.check import EXTREMES, collect
from rattle.compare.checks.extremes import formulas, impacts, invariance, sampling

ROWS = collect(EXTREMES, formulas, impacts, invariance, sampling)
"""Every check by the name of its function."""
